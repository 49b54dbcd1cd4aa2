"""Run an SSP archive in another master: ``foreign_ssp.py libcosim|ecos FILE STEPS STEP_S NAME...``.

Prints the last values of ``component.variable`` as JSON.
"""

import ctypes
import json
import sys
from pathlib import Path


def libcosim(file, steps, step_s, names):
    """Read by an observer that keeps the last values."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(file, round(step_s * 1e9))
    observer = CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    assert execution.step(steps), execution.status()
    values = []
    for name in names:
        component, _, variable = name.partition(".")
        slave = execution.slave_index_from_instance_name(component)
        known = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
        values.append(observer.last_real_values(slave, [known[variable]])[0])
    return values


def ecos(file, steps, step_s, names):
    """Read from the simulation."""
    tbb = next(Path(sys.prefix, "lib").glob("libtbb.so.12"), None)
    if tbb is not None:
        ctypes.CDLL(str(tbb), ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=file, step_size=step_s) as simulation:
        sets = [name.partition(".")[0] for name in names]
        simulation.init(parameter_set=sets[0])
        for _ in range(steps):
            simulation.step(1)
        return [simulation.get_real(name.replace(".", "::", 1)) for name in names]


if __name__ == "__main__":
    master, file, steps, step_s, *names = sys.argv[1:]
    values = globals()[master](file, int(steps), float(step_s), names)
    sys.stdout.write(f"\n{json.dumps(values)}\n")
