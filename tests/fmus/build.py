"""Small FMUs for the tests, compiled from the C files of this folder with one call of cc."""

import hashlib
import inspect
import subprocess
import sys
import zipfile
from pathlib import Path

from fmus.description import FRONT_END, header, xml
from fmus.models import MODELS, Model

HERE = Path(__file__).parent


def model_of(name: str, fmi: int, defines: dict[str, object]) -> Model:
    """Return the model of a name as its defines make it."""
    make = MODELS[name]
    more = {"FMI": fmi} if "FMI" in inspect.signature(make).parameters else {}
    return make(**more, **defines)


def build(name: str, folder: Path, fmi: int = 2, **defines: object) -> Path:
    """Return an FMU, made if it is not in ``folder`` yet.

    Parameters
    ----------
    name : str
        One of ``fmus.models.MODELS``.
    fmi : int
        2 or 3.
    defines
        Options of the model, or macros of its C file: ``FAULT="SEGFAULT", AT=3``;
        ``WITHOUT_STEP=1`` leaves out doStep, ``MINIMAL=1`` the functions of model exchange;
        ``ONCE=1`` refuses a second instance in a process, and says so.
    """
    if name == "clocked" and fmi == 2:
        raise ValueError("clocked: FMI 2 has no clocks")
    key = hashlib.sha256(repr((name, fmi, sorted(defines.items()))).encode()).hexdigest()[:8]
    fmu = folder / f"{name}{fmi}-{key}" / f"{name}.fmu"
    if fmu.exists():
        return fmu
    fmu.parent.mkdir(parents=True)
    model = model_of(name, fmi, defines)
    library = compiled(name, model, fmi, fmu.parent)
    with zipfile.ZipFile(fmu, "w") as archive:
        archive.writestr("modelDescription.xml", xml(name, model, fmi))
        archive.write(library, f"binaries/{platform(fmi)}/{library.name}")
    return fmu


def platform(fmi: int) -> str:
    """Return the name of the folder of this machine's binaries."""
    import fmpy

    return fmpy.platform if fmi == 2 else fmpy.platform_tuple


def compiled(name: str, model: Model, fmi: int, folder: Path) -> Path:
    """Return the shared library of a model, compiled against FMPy's FMI headers.

    What is in front of the model is compiled once for all models of the same variables.
    """
    import fmpy

    text = header(name, model, fmi)
    front = folder.parent / f"front{fmi}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    include = [f"-I{front}", f"-I{HERE}", f"-I{Path(fmpy.__file__).parent / 'c-code'}"]
    if not front.exists():
        front.mkdir()
        (front / "variables.h").write_text(text)
        sources = ["instance.c", f"fmi{fmi}.c", *(["refused.c"] if fmi == 3 else [])]
        _cc("-c", *include, *(str(HERE / source) for source in sources), at=front)
    library = folder / f"{name}{fmpy.sharedLibraryExtension}"
    macros = [f"-D{key}={value}" for key, value in model.defines.items() if key not in FRONT_END]
    objects = map(str, sorted(front.glob("*.o")))
    _cc(
        "-shared", *macros, *include, str(HERE / f"{name}.c"), *objects, "-lm", "-o", str(library),
        at=folder,
    )  # fmt: skip
    return library


def _cc(*arguments: str, at: Path) -> None:
    flags = ["-O1", "-fPIC", "-std=gnu11", "-ffp-contract=off", "-Wall", "-Wextra", "-Werror"]
    subprocess.run(["cc", *flags, *arguments], check=True, cwd=at)


if __name__ == "__main__":  # python -m fmus.build NAME FOLDER [2|3] [KEY=VALUE ...]
    name, folder, *rest = sys.argv[1:]
    fmi = int(rest.pop(0)) if rest and rest[0] in "23" else 2
    made = build(name, Path(folder), fmi, **dict(text.split("=", 1) for text in rest))
    sys.stdout.write(f"{made}\n")
