"""Tiny components whose behaviour is a function and whose calls can be logged."""

# ruff: noqa: D102  (the contract's members are documented in orchestrator/component.py)

import pickle
from dataclasses import dataclass, field
from difflib import get_close_matches

import numpy as np

from orchestrator.assembly.couple import couple
from orchestrator.scenario.records import ComponentSpec, ConnectionSpec, Scenario

UNITS = {  # name: kg, m, s, rad, factor, offset
    "1": (0, 0, 0, 0, 1.0, 0.0),
    "m": (0, 1, 0, 0, 1.0, 0.0),
    "km": (0, 1, 0, 0, 1000.0, 0.0),
    "s": (0, 0, 1, 0, 1.0, 0.0),
    "rad": (0, 0, 0, 1, 1.0, 0.0),
    "deg": (0, 0, 0, 1, 0.017453292519943295, 0.0),
}


@dataclass(frozen=True)
class Execution:
    """When a scripted component runs."""

    kind: str
    rate_hz: float
    interface: int = 1


@dataclass(frozen=True)
class Row:
    """One variable; ``through`` are the inputs that an output passes on, None says nothing."""

    name: str
    causality: str
    start: object = 0.0
    unit: str = "1"
    shape: tuple = ()
    through: tuple | None = ()
    items: tuple = ()
    variability: str | None = None


def describe(name, rows, *, variable_step=False, state=False, units=UNITS):
    """Return FMPy's description of a table of variables."""
    from fmpy import model_description as fmi

    made, types = {}, []
    for reference, row in enumerate(rows, start=1):
        kind = (
            "Enumeration"
            if row.items
            else {bool: "Boolean", int: "Int64", str: "String"}.get(type(row.start), "Float64")
        )
        declared = None
        if row.items:
            items = [fmi.Item(name=text, value=str(i)) for i, text in enumerate(row.items)]
            declared = fmi.SimpleType(name=f"{row.name}_t", type="Enumeration", items=items)
            types.append(declared)
        is_output = row.causality == "output"
        natural = (
            "fixed"
            if row.causality == "parameter"
            else ("continuous" if kind == "Float64" else "discrete")
        )
        start = str(row.start).lower() if isinstance(row.start, bool) else str(row.start)
        made[row.name] = fmi.ModelVariable(
            name=row.name,
            valueReference=reference,
            type=kind,
            shape=row.shape,
            causality=row.causality,
            variability=row.variability or natural,
            initial="calculated" if is_output else "exact",
            start=None if is_output else start,
            unit=row.unit if kind == "Float64" else None,
            declaredType=declared,
            dimensions=[fmi.Dimension(start=str(n), valueReference=None) for n in row.shape],
        )
    time = fmi.ModelVariable(
        name="time", valueReference=0, type="Float64", causality="independent",
        variability="continuous",
    )  # fmt: skip
    outputs = [row for row in rows if row.causality == "output"]
    return fmi.ModelDescription(
        fmiVersion="3.0",
        modelName=name,
        instantiationToken=name,
        variableNamingConvention="structured",
        coSimulation=fmi.CoSimulation(
            modelIdentifier=name,
            canHandleVariableCommunicationStepSize=variable_step,
            canGetAndSetFMUstate=state,
            canSerializeFMUstate=state,
        ),
        unitDefinitions=[
            fmi.Unit(
                name=n,
                baseUnit=fmi.BaseUnit(kg=u[0], m=u[1], s=u[2], rad=u[3], factor=u[4], offset=u[5]),
            )
            for n, u in units.items()
        ],
        typeDefinitions=types,
        modelVariables=[time, *made.values()],
        outputs=[
            fmi.Unknown(
                variable=made[row.name],
                dependencies=None if row.through is None else [made[n] for n in row.through],
            )
            for row in outputs
        ],
        initialUnknowns=[fmi.Unknown(variable=made[row.name]) for row in outputs],
    )


@dataclass
class Scripted:
    """A component made of a table and functions of its values.

    ``behave(values, time, step_size)`` is the step and may return a status or raise; ``pass_on``
    computes feed-through outputs whenever outputs are read. Calls are added to ``log`` under
    ``name``.
    """

    kind: str
    rate_hz: float
    rows: list
    behave: object = None
    pass_on: object = None
    name: str = ""
    log: list | None = None
    variable_step: bool = False
    is_restorable: bool = False
    values: dict = field(default_factory=dict)
    seed: int | None = None

    def __post_init__(self):
        for row in self.rows:
            full = np.full(row.shape, row.start) if row.shape else row.start
            self.values.setdefault(row.name, full)

    @property
    def execution(self):
        return Execution(self.kind, self.rate_hz)

    def describe(self):
        return describe(
            "scripted", self.rows, variable_step=self.variable_step, state=self.is_restorable
        )

    def _say(self, *what):
        if self.log is not None:
            self.log.append((self.name, *what))

    def _check(self, names):
        for name in names:
            if name not in self.values:
                near = get_close_matches(name, self.values, n=1)
                raise KeyError(f"unknown variable {name!r}, did you mean {near}")

    def initialize(self, *, start_time, stop_time, seed):
        self._say("initialize", start_time, stop_time)
        self.seed = seed

    def set(self, values):
        self._check(values)
        if values:
            self._say("set", dict(values))
        self.values.update({n: np.copy(v) if np.ndim(v) else v for n, v in values.items()})

    def get(self, names):
        self._check(names)
        self._say("get")
        if self.pass_on is not None:
            self.pass_on(self.values)
        return {n: np.copy(v) if np.ndim(v) else v for n in names for v in (self.values[n],)}

    def step(self, time, step_size):
        self._say("step", time, step_size)
        status = self.behave(self.values, time, step_size) if self.behave is not None else None
        return status or 0

    def terminate(self):
        self._say("terminate")

    def get_state(self):
        return pickle.dumps(self.values)

    def set_state(self, state):
        self.values = pickle.loads(state)


def integrator(rate_hz=20.0, y=0.0, **more):
    """Return a continuous component with dy/dt = u: exact for held inputs."""

    def behave(values, time, step_size):
        values["y"] += step_size * values["u"]

    rows = [Row("u", "input"), Row("y", "output")]
    return Scripted("continuous", rate_hz, rows, behave, values={"y": y}, **more)


def counter(rate_hz=2.0, kind="sampled", **more):
    """Return a staircase: y counts the steps; it passes nothing on."""

    def behave(values, time, step_size):
        values["y"] += 1.0
        values["seen"] = values["u"]

    rows = [Row("u", "input"), Row("y", "output"), Row("seen", "output")]
    return Scripted(kind, rate_hz, rows, behave, **more)


def gain(k=1.0, rate_hz=20.0, kind="sampled", **more):
    """Return z = k u at the same instant, of either kind."""

    def pass_on(values):
        values["z"] = k * values["u"]

    rows = [Row("u", "input"), Row("z", "output", through=("u",))]
    if kind == "sampled":
        return Scripted(kind, rate_hz, rows, lambda values, time, h: pass_on(values), **more)
    return Scripted(kind, rate_hz, rows, pass_on=pass_on, **more)


def clock(rate_hz=20.0, kind="continuous", **more):
    """Return y = the time up to which it has stepped."""

    def behave(values, time, step_size):
        values["y"] = time + step_size if kind == "continuous" else time

    return Scripted(kind, rate_hz, [Row("y", "output")], behave, **more)


def make_restorable(start=1.0):
    """Return a random walk that can be saved; for the conformance suite, by name."""
    return RandomWalk(start)


def make_forgetful():
    """Return a random walk whose state lacks the generator."""
    walk = RandomWalk()
    walk.get_state = lambda: pickle.dumps((walk.values, None))
    walk.set_state = lambda state: walk.values.update(pickle.loads(state)[0])
    return walk


class RandomWalk:
    """y += normal noise + u; the seed decides. Restores its generator with everything else."""

    execution = Execution("sampled", 10.0)

    def __init__(self, start=1.0):
        self.start = start
        self.values = {"u": 0.0, "y": start}

    def describe(self):
        rows = [Row("u", "input"), Row("y", "output")]
        return describe("walk", rows, state=True)

    def initialize(self, *, start_time, stop_time, seed):
        self.generator = np.random.default_rng(seed)

    def set(self, values):
        for name in values:
            if name not in self.values:
                raise KeyError(f"unknown variable {name!r}, did you mean 'u'")
        self.values.update(values)

    def get(self, names):
        for name in names:
            if name not in self.values:
                raise KeyError(f"unknown variable {name!r}, did you mean 'y'")
        return {name: self.values[name] for name in names}

    def step(self, time, step_size):
        self.values["y"] += float(self.generator.normal()) + self.values["u"]
        return 0

    def terminate(self):
        pass

    def get_state(self):
        return pickle.dumps((self.values, self.generator))

    def set_state(self, state):
        self.values, self.generator = pickle.loads(state)


def system(components, connections=(), duration_s=1.0, events=(), end_on=(), seed=0, **keys):
    """Return the system of components by name; ``keys`` are component keys by name.

    A connection is ``"a.y -> b.u"`` or that with a delay, ``("a.y -> b.u", delay_s)``.
    """
    pairs = [(one, 0.0) if isinstance(one, str) else one for one in connections]
    scenario = Scenario(
        title="scripted",
        duration_s=duration_s,
        seed=seed,
        components=tuple(
            ComponentSpec(name, "scripted", **keys.get(name, {})) for name in components
        ),
        connections=tuple(
            ConnectionSpec(*(side.strip() for side in text.split("->")), delay)
            for text, delay in pairs
        ),
        events=tuple(events),
        end_on=tuple(end_on),
    )
    return couple(scenario, components)
