"""What every small FMU is called and can do: the one table behind its XML and its C structure."""

from dataclasses import dataclass, field

UNITS = {"s": "s='1'", "1/s": "s='-1'", "deg": "rad='1' factor='0.017453292519943295'"}
PHASES = ("idle", "climb", "land")
SCALARS_FMI3 = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt32", "Int64", "UInt64")
DRONE_COMMANDS = {"lift": 1.0, "nose": 0.0, "bank": 0.0, "course": 0.0}
INTERVAL = 0.5  # of the clock of `clocked`, s


@dataclass(frozen=True)
class Variable:
    """One variable. ``depends``: of an output, on what; ``hidden``: in the FMU state alone."""

    name: str
    causality: str = "local"
    type: str = "Float64"
    start: object = None
    shape: tuple[int, ...] = ()
    unit: str = ""
    min: float | None = None
    max: float | None = None
    variability: str = ""
    depends: tuple[str, ...] = ()
    derivative_of: str = ""
    attributes: str = ""

    @property
    def initial(self) -> str:
        """Whether the value is computed at the start."""
        return "calculated" if self.start is None else "exact"


def hidden(name: str, kind: str = "Float64", start: object = 0) -> Variable:
    """Return a variable that only the FMU state holds."""
    return Variable(name, "hidden", kind, start)


@dataclass(frozen=True)
class Model:
    """Variables, capabilities by their FMI 3 names, and defines for the C compiler."""

    variables: tuple[Variable, ...]
    capabilities: dict[str, object] = field(default_factory=dict)
    defines: dict[str, object] = field(default_factory=dict)
    scheduled: bool = False
    experiment: str = "stopTime='1'"


STATE = {"canGetAndSetFMUState": True, "canSerializeFMUState": True}
FREE = {"canHandleVariableCommunicationStepSize": True}


def _states(*inputs: Variable, slope: tuple[str, ...]) -> tuple[Variable, ...]:
    return (
        *inputs,
        Variable("x", start=1.0, variability="tunable state"),
        Variable("der(x)", depends=slope, derivative_of="x"),
        Variable("y", "output", depends=("x",)),
    )


def decay(*, STEP=0.01, K=-1.0, **more):
    """Decay: x' = k x + u by Euler with an internal step; settable state x, partial derivatives."""
    k = Variable("k", "parameter", start=K, unit="1/s", variability="tunable")
    u = Variable("u", "input", start=0.0)
    return Model(
        _states(k, u, slope=("k", "u", "x")),
        {**FREE, **STATE, "providesDirectionalDerivatives": True},
        {"STEP": STEP, **more},
    )


def integrator(**more):
    """Integrate: x' = u, exactly."""
    u = Variable("u", "input", start=0.0)
    capabilities = {**FREE, **STATE, "providesDirectionalDerivatives": True}
    return Model(_states(u, slope=("u",)), capabilities, more)


def drone(*, SAVED=True, **more):
    """Fly, linearly: states are start values, nothing is an input but four commands."""
    states = ("north", "east", "height", "u", "v", "w", "phi", "theta", "psi", "p", "q", "r")
    servos = ("servo_thrust", "servo_pitch", "servo_roll", "servo_tail")
    variables = (
        *(Variable(n, "input", start=s) for n, s in DRONE_COMMANDS.items()),
        *(Variable(n, "output", start=30.0 if n == "u" else 0.0) for n in states),
        *(Variable(n, "output") for n in ("v_n", "v_e", "v_d")),
        *(Variable(n, "output", start=1.0 if n == servos[0] else 0.0) for n in servos),
    )
    return Model(variables, STATE if SAVED else {}, more, False, "stopTime='1' stepSize='0.05'")


def relay(**more):
    """Pass on, one step late: y(t + h) = u(t)."""
    variables = (Variable("u", "input", start=0.0), Variable("y", "output", start=0.0))
    return Model(variables, {**FREE, **STATE}, more)


def staircase(*, PERIOD=0.25, **more):
    """Count: y goes up by one at PERIOD, 2 PERIOD, ...; ``calls`` counts the calls of doStep."""
    variables = (
        Variable("y", "output", variability="discrete"),
        Variable("count", "output", "Int32", 0),
        Variable("calls", "output", "Int32", 0),
    )
    events = {"hasEventMode": True, "mightReturnEarlyFromDoStep": True}
    return Model(variables, {**FREE, **STATE, **events}, {"PERIOD": PERIOD, **more})


def fixedstep(*, STEP=0.02, **more):
    """Advance: x' = 1 in steps of STEP: takes multiples of it only."""
    variables = (Variable("y", "output", start=0.0),)
    return Model(variables, {"fixedInternalStepSize": STEP}, {"STEP": STEP, **more})


def clocked(*, SCHEDULED=0, **more):
    """Sample: y = u at the ticks of an input clock (FMI 3 only), in event mode or scheduled."""
    clock = f"intervalVariability='constant' intervalDecimal='{INTERVAL}' priority='1'"
    variables = (
        Variable("tick", "input", "Clock", attributes=clock),
        Variable("u", "input", start=0.0),
        Variable("y", "output", start=0.0),
        Variable("count", "output", "Int32", 0),
    )
    return Model(variables, {**FREE, **STATE, "hasEventMode": True}, more, bool(SCHEDULED))


def faulty(*, STATE_SAVED=0, SERIALIZED=0, VARIABLE=0, **more):
    """Keep time: y = t until what ``FAULT`` says happens; see faulty.c. Flags are capabilities."""
    defines = {"FAULT": "NONE", "WHERE": '"DoStep"', "AT": 3, "TIMES": 1, "LIMIT": 0.0}
    unknown = set(more) - set(defines) - {"DURATION"}
    if unknown:
        raise TypeError(f"faulty: unknown define, got {sorted(unknown)}")
    variables = (
        Variable("u", "input", start=0.0),
        Variable("y", "output", min=-100.0, max=100.0),
        hidden("x"),
        hidden("spoiled"),
        hidden("steps", "Int32"),
    )
    capabilities = {
        "canHandleVariableCommunicationStepSize": bool(VARIABLE),
        "canGetAndSetFMUState": bool(STATE_SAVED or SERIALIZED),
        "canSerializeFMUState": bool(SERIALIZED),
        "hasEventMode": more.get("FAULT") == "EVENT_LOOP",
    }
    return Model(variables, capabilities, {**defines, "DURATION": 0.0, **more})


def feedthrough(*, FMI, STOP=1, **more):
    """Every input of every type is an output of the same instant."""
    rows = [
        ("Float64", "Float64", 0.0, ()),
        ("Int32", "Int32", 0, ()),
        ("Boolean", "Boolean", False, ()),
        ("String", "String", "none", ()),
        ("Enumeration", "Enumeration", 1, ()),
        ("vector", "Float64", 0.0, (3,)),
        ("matrix", "Float64", 0.0, (2, 2)),
    ]
    if FMI == 3:
        rows += [(name, name, 0, ()) for name in SCALARS_FMI3]
        rows += [
            ("Binary", "Binary", "00ff", ()),
            ("integers", "Int32", 0, (2,)),
            ("flags", "Boolean", False, (2,)),
            ("words", "String", "none", (2,)),
        ]
    variables = [
        Variable("gear_ratio", "parameter", start=1.5, variability="fixed"),
        Variable("angle", "parameter", start=90.0, unit="deg", variability="tunable"),
        Variable("label", "parameter", "String", "plain", variability="fixed"),
    ]
    for name, kind, start, shape in rows:
        ends = ("_in", "_out")
        variables.append(Variable(name + ends[0], "input", kind, start, shape))
        variables.append(
            Variable(name + ends[1], "output", kind, None, shape, depends=(name + "_in",))
        )
    passed = " ".join(f"PASS({name})" for name, *_ in rows)
    experiment = f"stopTime='{STOP}' stepSize='0.01'"
    return Model(tuple(variables), {**FREE, **STATE}, {"PASSED": passed, **more}, False, experiment)


MODELS = {
    "decay": decay,
    "drone": drone,
    "integrator": integrator,
    "relay": relay,
    "staircase": staircase,
    "fixedstep": fixedstep,
    "clocked": clocked,
    "faulty": faulty,
    "feedthrough": feedthrough,
}
