"""The parts of the FMU importer that need no FMU: arrays, clocks, steps, archives, descriptions."""

import zipfile

import pytest
from fmpy.model_description import (
    CoSimulation,
    DefaultExperiment,
    ModelDescription,
    ModelVariable,
    Unknown,
)
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.fmu import stepping
from orchestrator.fmu.archive import unpack
from orchestrator.fmu.clocks import Clock, following
from orchestrator.fmu.description import Annotation, annotation, preferred_rate, read
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.gather import gathered
from orchestrator.fmu.instance import LOOK, Outcome
from orchestrator.fmu.variables import blocks, variables


def scalar(name, reference, causality="input", **more):
    """Return a scalar of FMI 2."""
    return ModelVariable(
        name=name, valueReference=reference, type="Real", causality=causality,
        variability="continuous", initial="exact", start=more.pop("start", str(reference)), **more,
    )  # fmt: skip


def described(*variables, outputs=()):
    """Return a description of FMI 2."""
    return ModelDescription(
        fmiVersion="2.0", modelVariables=list(variables), outputs=list(outputs),
        coSimulation=CoSimulation(modelIdentifier="m"),
    )  # fmt: skip


@given(st.lists(st.integers(1, 3), min_size=1, max_size=3), st.randoms(use_true_random=False))
def test_elements_become_an_array_row_by_row_in_whatever_order_they_are(shape, random):
    """References and start values follow the indices."""
    import itertools

    indices = list(itertools.product(*(range(1, n + 1) for n in shape)))
    ordered = [scalar(f"g.u[{','.join(map(str, i))}]", k) for k, i in enumerate(indices)]
    shuffled = ordered[:]
    random.shuffle(shuffled)
    whole, elements = gathered(described(*shuffled, scalar("x", 99)))
    array, _ = sorted(whole.modelVariables, key=lambda v: v.name)
    assert (array.name, array.shape) == ("g.u", tuple(shape))
    assert list(elements["g.u"]) == list(range(len(indices)))
    assert array.start == [str(k) for k in range(len(indices))]
    (block,) = blocks(variables(whole, elements).values())
    assert block.references == (99, *range(len(indices)))
    assert block.starts == {"g.u": 1}


@pytest.mark.parametrize(
    "names", [["u[1]", "u[3]"], ["u[0]", "u[1]"], ["u[1]", "u[1,1]"], ["u[1]", "u"], ["u[2]"]]
)
def test_what_is_no_whole_array_stays_as_it_is(names):
    """A missing element, another base or rank, or a name that is taken."""
    whole, elements = gathered(described(*(scalar(n, k) for k, n in enumerate(names))))
    assert [v.name for v in whole.modelVariables] == names
    assert elements == {}


def test_elements_that_differ_are_not_one_array():
    """An array has one unit, one type, one causality."""
    whole, _ = gathered(described(scalar("u[1]", 0, unit="m"), scalar("u[2]", 1, unit="s")))
    assert len(whole.modelVariables) == 2


def test_an_arrays_dependencies_are_those_of_its_elements():
    """Unknown for one element is unknown for all."""
    u, y = (
        [scalar(f"u[{k}]", k) for k in (1, 2)],
        [scalar(f"y[{k}]", 2 + k, "output") for k in (1, 2)],
    )
    for second, expected in (([u[1]], ["u"]), ([], ["u"]), (None, None)):
        outputs = [Unknown(variable=y[0], dependencies=[u[0]]),
                   Unknown(variable=y[1], dependencies=second)]  # fmt: skip
        whole, _ = gathered(described(*u, *y, outputs=outputs))
        (entry,) = whole.outputs
        found = entry.dependencies
        assert (found if found is None else [v.name for v in found]) == expected


def clock(**keys):
    return Clock(**({"reference": 1, "priority": 1, "variability": "constant", "interval": 0.1,
                     "shift": 0.0} | keys))  # fmt: skip


def test_ticks_do_not_drift():
    """The tenth tick of 0.1 s is at 1.0 s exactly."""
    one = clock(shift=0.5)
    one.start(1.0)
    assert one.next == 1.5
    for _ in range(10):
        one.ticked()
    assert one.next == 2.5


def test_a_countdown_ticks_once_for_every_interval_that_is_named():
    """After its interval, not at the start."""
    one = clock(variability="countdown", interval=None)
    one.start(0.0)
    one.interval = 0.3
    assert one.next == 0.3
    one.ticked()
    assert following([one]) == float("inf")
    one.renew(0.3, 0.4)
    assert one.next == pytest.approx(0.7)


class Scripted:
    """An instance that answers steps from a list."""

    def __init__(self, *outcomes):
        self.outcomes, self.steps = list(outcomes), []

    def do_step(self, time, step_size):
        """Note the call; there is more to say as long as the list lasts."""
        self.steps.append((time, step_size))
        return LOOK if self.outcomes else 0

    def outcome(self, status, time, step_size):
        """Return the next of the list."""
        answer, fraction = self.outcomes.pop(0)
        return Outcome(answer, time + fraction * step_size)


def advance(instance, start=0.0, end=1.0, longest=1.0):
    return stepping.advance(instance, start, end, longest=longest)


def test_early_returns_are_finished():
    """From where the FMU stopped; a Warning on the way is not forgotten."""
    instance = Scripted((0, 0.5), (1, 0.5))
    assert advance(instance) == (1, 1.0)
    assert instance.steps == [(0.0, 1.0), (0.5, 0.5), (0.75, 0.25)]


def test_a_refusal_stops_where_the_fmu_is():
    """Also part of the way: what advanced (FMI 2) is continued, what did not is told."""
    assert advance(Scripted((2, 0.0))) == (2, 0.0)
    assert advance(Scripted((2, 0.5), (2, 0.0))) == (2, 0.5)
    assert advance(Scripted((0, 0.5), (3, 0.0))) == (3, 0.5)


def test_missed_steps_are_caught_up_in_usual_sizes():
    """No part is longer than the communication step."""
    instance = Scripted()
    assert advance(instance, 0.0, 3.0) == (0, 3.0)
    assert instance.steps == [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0)]


def test_no_step_goes_on_for_ever(monkeypatch):
    """Neither where time stands still nor where it creeps."""
    with pytest.raises(FmuError, match="time stands still"):
        advance(Scripted(*[(0, 0.0)] * 2000))
    monkeypatch.setattr(stepping, "MOST_PARTS", 50)
    with pytest.raises(FmuError, match="cut too small, got 50 parts"):
        advance(Scripted(*[(0, 0.001)] * 100))


def test_only_what_a_simulation_reads_is_unpacked(tmp_path):
    """Documentation and sources stay in the archive; the folder goes when its owner does."""
    file = tmp_path / "a.fmu"
    with zipfile.ZipFile(file, "w") as archive:
        for name in ("modelDescription.xml", "sources/a.c", "resources/b/c.txt", "binaries/x/a.so"):
            archive.writestr(name, "text")
    folder, owner = unpack(file)
    found = {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}
    assert found == {"modelDescription.xml", "resources/b/c.txt", "binaries/x/a.so"}
    owner.cleanup()
    assert not folder.exists()
    folder, owner = unpack(file, ["modelDescription.xml"])
    assert [p.name for p in folder.iterdir()] == ["modelDescription.xml"]
    owner.cleanup()


def test_the_rate_of_the_default_experiment_counts_if_it_is_whole_internal_steps():
    """0.05 s of 0.01 s each, not of 0.02 s; our own annotation is before everything."""
    for internal, rate in ((0.01, 20.0), (0.02, 50.0), (None, 20.0)):
        one = described()
        one.coSimulation.fixedInternalStepSize = internal
        one.defaultExperiment = DefaultExperiment(stepSize="0.05")
        assert preferred_rate(one, None, is_scheduled=False) == rate
        assert preferred_rate(one, Annotation(rate_hz=2.0), is_scheduled=False) == 2.0
    assert preferred_rate(described(), None, is_scheduled=False) is None


XML = """<fmiModelDescription fmiVersion="3.0" modelName="m" instantiationToken="t">
<CoSimulation modelIdentifier="m" hasEventMode="true" fixedInternalStepSize="0.01"
 providesDirectionalDerivatives="true" canSerializeFMUState="true" canGetAndSetFMUState="true"/>
{annotations}
<ModelVariables>
<Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
<Clock name="c" valueReference="1" causality="input" intervalVariability="constant"
 intervalDecimal="0.25" shiftDecimal="0.1" priority="3"/>
<UInt8 name="n" valueReference="2" causality="input" start="2" min="1" max="9"/>
<String name="s" valueReference="3" causality="input"><Dimension start="2"/>
<Start value="a"/><Start value="b"/></String>
<Float64 name="y" valueReference="4" causality="output"><Alias name="z"/></Float64>
</ModelVariables>
<ModelStructure><Output valueReference="4" dependencies=""/>
<InitialUnknown valueReference="4"/></ModelStructure>
</fmiModelDescription>"""


def test_what_fmpy_does_not_read_is_added(tmp_path):
    """Clocks, unsigned limits, arrays of text, derivatives, step size, our annotation."""
    execution = '<Execution kind="sampled" rate_hz="2" interface="1" arrays="true"/>'
    note = f'<Annotations><Annotation type="hedgehop">{execution}</Annotation></Annotations>'
    (tmp_path / "modelDescription.xml").write_text(XML.format(annotations=note))
    found, is_scheduled = read(tmp_path, "m.fmu", validate=False)
    assert not is_scheduled
    by_name = {v.name: v for v in found.modelVariables}
    tick = by_name["c"]
    assert (tick.intervalDecimal, tick.shiftDecimal, tick.priority) == (0.25, 0.1, 3)
    assert (by_name["n"].min, by_name["n"].max) == ("1", "9")
    assert by_name["s"].start == ["a", "b"]
    assert found.coSimulation.providesDirectionalDerivative
    assert found.coSimulation.fixedInternalStepSize == 0.01
    assert annotation(tmp_path) == Annotation("sampled", 2.0, arrays=True)


def test_an_alias_depends_on_what_its_variable_depends_on(tmp_path):
    """FMI 3 lists an output once, under one of its names."""
    from orchestrator.assembly.description import ports

    (tmp_path / "modelDescription.xml").write_text(XML.format(annotations=""))
    own = ports("a", read(tmp_path, "m.fmu", validate=False)[0])
    assert own["y"].depends_on == own["z"].depends_on == frozenset()
    assert own["s"].start.tolist() == ["a", "b"]
