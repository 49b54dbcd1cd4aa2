"""Exported FMUs do in other masters what their components do natively."""

import os
import subprocess
import sys
from pathlib import Path

import fmpy
import numpy as np
import pytest
from exported import EVERYTHING, VERSIONS, Master, exported, unpacked
from foreign_masters import run
from small_exports import Everything, EverythingParameters

from orchestrator.assembly.make import arguments, make
from orchestrator.export.export import choose
from orchestrator.flight import fly
from orchestrator.recording.diff import diff

FOREIGN = [("libcosim", 2), ("ecos", 2), ("ecos", 3)]
JACKSBORO = Path(__file__).parents[1] / "scenarios" / "jacksboro.yaml"
WATCHED = ("state.north", "state.u", "state.theta", "state.thrust", "clearance", "load_factor")


def test_fmpy_simulates_it():
    """FMPy's own loop gives the native answer, with inputs over time and parameters."""
    times = np.linspace(0.0, 1.0, 11)
    ramp = np.array([(t, 2.0 * t) for t in times], [("time", float), ("v", float)])
    for fmi in VERSIONS:
        result = fmpy.simulate_fmu(
            str(exported(EVERYTHING, fmi)), stop_time=1.0, output_interval=0.1,
            output=["total", "noise", "is_flag"], input=ramp, start_values={"bias": 0.25, "n": 4},
        )  # fmt: skip
        component = Everything(EverythingParameters())
        component.initialize(start_time=0.0, stop_time=None, seed=0)
        for k, row in enumerate(result):
            values = component.get(["total", "noise"])
            assert row["total"] == pytest.approx(values["total"], abs=1e-15)
            assert row["noise"] == values["noise"]
            component.set({"v": float(ramp["v"][k])})
            component.step(0.1 * k, 0.1)


@pytest.mark.skipif(sys.platform != "linux", reason="the masters have wheels for Linux only")
@pytest.mark.parametrize(("master", "fmi"), FOREIGN)
def test_two_coupled_instances_in_another_master(master, fmi):
    """One instance integrates what another does; equal to stepping the components by hand."""
    file = str(exported(EVERYTHING, fmi))
    rows = run(
        master=master, step_s=0.1, steps=20, fmus={"a": file, "b": file}, initial={"a.v": 1.5},
        links=[["a.total", "b.v"]], read=["a.total", "b.total", "b.noise"],
    )  # fmt: skip
    a, b = (Everything(EverythingParameters()) for _ in "ab")
    a.set({"v": 1.5})
    for component in (a, b):
        component.initialize(start_time=0.0, stop_time=None, seed=0)
    expected = []
    for k in range(20):
        b.set({"v": a.get(["total"])["total"]})
        a.step(0.1 * k, 0.1)
        b.step(0.1 * k, 0.1)
        values = {**a.get(["total"]), **{f"b.{n}": v for n, v in b.get(["total", "noise"]).items()}}
        expected.append(list(values.values()))
    assert np.abs(np.array(rows) - expected).max() < 1e-14


def vehicle():
    """Return the native vehicle of the shipped scenario."""
    chosen = choose("vehicle", JACKSBORO)
    return chosen.plan.factory(**arguments(chosen.plan, make(chosen.resources)))


def test_the_vehicle_flies_as_it_does_natively():
    """Under the same commands the exported vehicle is the native one, bit for bit, also restored."""
    for fmi in VERSIONS:
        component, made = vehicle(), Master(exported("vehicle", fmi, JACKSBORO))
        names = [v.name for v in component.describe().modelVariables if v.causality == "output"]
        component.initialize(start_time=0.0)
        made.initialize()
        state = None
        for k in range(40):
            values = {
                "command.thrust": 1.0 + 0.02 * np.sin(0.3 * k),
                "command.pitch": -0.02 + 0.01 * np.sin(0.2 * k),
                "command.roll": 0.03 * np.sin(0.25 * k),
                "command.heading": 0.0,
                "wind.north": 1.0,
            }
            if k == 10:
                state = made.fmu.getFMUState()
                for j in range(3):  # to be forgotten
                    made.step((k + j) * 0.05, 0.05)
                made.fmu.setFMUState(state)
            component.set(values)
            made.set(values)
            component.step(k * 0.05, 0.05)
            made.step(k * 0.05, 0.05)
            assert {name: made.get(name) for name in names} == component.get(names)
        made.free()


@pytest.mark.skipif(sys.platform != "linux", reason="the masters have wheels for Linux only")
@pytest.mark.parametrize(("master", "fmi"), FOREIGN)
def test_the_vehicle_flies_in_another_master(master, fmi):
    """Under constant commands the trajectory is the native one to rounding of the master's time."""
    commands = {"thrust": 1.01, "pitch": -0.03, "roll": 0.02, "heading": 0.1}
    rows = run(
        master=master, step_s=0.05, steps=20, links=[], read=[f"v.{name}" for name in WATCHED],
        fmus={"v": str(exported("vehicle", fmi, JACKSBORO))},
        initial={f"v.command.{name}": value for name, value in commands.items()},
    )  # fmt: skip
    component = vehicle()
    component.set({f"command.{name}": value for name, value in commands.items()})
    component.initialize(start_time=0.0)
    for k, row in enumerate(rows):
        component.step(0.05 * k, 0.05)
        expected = list(component.get(WATCHED).values())
        assert np.abs(np.subtract(row, expected)).max() == 0.0


def test_a_scenario_flies_the_same_with_fmus_in_it(tmp_path):
    """With vehicle and MPC as FMUs every signal of the flight is the native one, bit for bit."""
    parts = [("vehicle", 2), ("mpc", 3)]
    uses = [f"components.{name}.use={exported(name, fmi, JACKSBORO)}" for name, fmi in parts]
    common = ["duration_s=1.5", "recording.wall_clock=false"]
    native, swapped = tmp_path / "native.mcap", tmp_path / "swapped.mcap"
    fly(JACKSBORO, out=native, overrides=common)
    fly(JACKSBORO, out=swapped, overrides=[*common, *uses])
    different = [one for one in diff(native, swapped) if "got missing and there" not in str(one)]
    assert different == []  # what only the FMUs have are parameters that descriptions leave out


def test_two_fmus_of_one_module_name_do_not_meet(tmp_path):
    """Two FMUs whose Python modules have the same name each run their own code in one process."""
    here = Path(__file__).parent
    files = []
    for gain in (2.0, 5.0):
        folder = tmp_path / f"{gain:g}"
        folder.mkdir()
        (folder / "clash.py").write_text(
            "from small_exports import Everything, EverythingParameters\n"
            "from clash_gain import GAIN\n"
            "def thing(parameters: EverythingParameters) -> Everything:\n"
            "    assert GAIN == parameters.gain\n"
            "    return Everything(parameters)\n"
        )
        (folder / "clash_gain.py").write_text(f"GAIN = {gain}\n")
        (folder / "clash.yaml").write_text(
            f"title: clash\nduration_s: 1\ncomponents:\n"
            f"  thing: {{use: 'clash:thing', parameters: {{gain: {gain}}}}}\n"
        )
        environment = {**os.environ, "PYTHONPATH": str(here)}
        subprocess.run(
            [sys.executable, "-m", "orchestrator", "export", "thing", "--scenario", "clash.yaml",
             "-o", f"clash{gain:g}.fmu"],
            cwd=folder, env=environment, check=True, capture_output=True,
        )  # fmt: skip
        files.append(folder / f"clash{gain:g}.fmu")
    unpacked.cache_clear()
    masters = [Master(file) for file in files]
    for made, gain in zip(masters, (2.0, 5.0), strict=True):
        made.initialize(u=np.ones((2, 3)))
        assert made.get("y") == [gain + 0.5] * 6
    for made in masters:
        made.free()
