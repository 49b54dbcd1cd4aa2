"""``python -IB WORKER NAME``: what c/process.c starts; WORKER is this folder, in an FMU's resources."""

import sys
from importlib import import_module
from pathlib import Path

here = Path(__file__).parent
sys.path[0] = str(here.parent)  # was this folder: its files are a package
protocol = import_module(f"{here.name}.protocol")
del sys.path[0]
sys.dont_write_bytecode = False  # -B is for the FMU's folder, which is the host's
protocol.main(here.parent, sys.argv[1])
