"""Run FMUs in other masters, in a process of their own: ``python foreign_masters.py < plan.json``.

The plan: ``master``, ``step_s``, ``steps``, ``fmus`` (instance to file), ``initial`` and ``links``
(``instance.variable`` to value, source to target) and ``read``. The answer is a row of what is read
after initialization and after every step.
"""

import ctypes
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def run(**plan: Any) -> list[list[float]]:
    """Return the rows of a plan, run in another process.

    Raises
    ------
    AssertionError
        If the master fails or dies; with what it said.
    """
    done = subprocess.run(
        [sys.executable, __file__], input=json.dumps(plan), capture_output=True, text=True,
        timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, f"{done.returncode} {done.stdout} {done.stderr}"
    return json.loads(done.stdout.splitlines()[-1])


def libcosim(plan: dict[str, Any]) -> list[list[float]]:
    """Run FMI 2 FMUs in libcosim."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    execution = CosimExecution.from_step_size(round(plan["step_s"] * 1e9))
    slaves = {
        name: execution.add_local_slave(CosimLocalSlave(file, name))
        for name, file in plan["fmus"].items()
    }
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    known = {
        f"{name}.{variable.name.decode()}": variable
        for name, slave in slaves.items()
        for variable in execution.slave_variables(slave)
    }

    def place(path: str) -> tuple[int, int]:
        return slaves[path.partition(".")[0]], known[path].reference

    for path, value in plan["initial"].items():
        assert execution.real_initial_value(*place(path), value)
    for source, target in plan["links"]:
        assert execution.connect_real_variables(*place(source), *place(target)) == 0

    def read() -> list[float]:
        return [observer.last_real_values(place(p)[0], [place(p)[1]])[0] for p in plan["read"]]

    rows = []
    for k in range(plan["steps"] + 1):
        if k:
            assert execution.step()
        if k or plan.get("first"):
            rows.append(read())
    return rows


def ecos(plan: dict[str, Any]) -> list[list[float]]:
    """Run FMI 2 or 3 FMUs in Ecos."""
    tbb = next(Path(sys.prefix, "lib").glob("libtbb.so.12"), None)
    if tbb is not None:
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation, EcosSimulationStructure

    structure = EcosSimulationStructure()
    for name, file in plan["fmus"].items():
        structure.add_model(name, file)
    for source, target in plan["links"]:
        structure.make_real_connection(*(path.replace(".", "::", 1) for path in (source, target)))
    initial = {path.replace(".", "::", 1): value for path, value in plan["initial"].items()}
    structure.add_parameter_set("initial", initial)
    simulation = EcosSimulation(structure=structure, step_size=plan["step_s"])
    simulation.init(parameter_set="initial")

    def read() -> list[float]:
        return [simulation.get_real(path.replace(".", "::", 1)) for path in plan["read"]]

    rows = []
    for k in range(plan["steps"] + 1):
        if k:
            simulation.step(1)
        if k or plan.get("first"):
            rows.append(read())
    simulation.free()
    return rows


MASTERS: dict[str, Callable[[dict[str, Any]], list[list[float]]]] = {
    "libcosim": libcosim,
    "ecos": ecos,
}

if __name__ == "__main__":
    given = json.load(sys.stdin)
    sys.stdout.write("\n" + json.dumps(MASTERS[given["master"]](given)) + "\n")
