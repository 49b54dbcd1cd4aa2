"""The component contract: verbs here, nouns from FMPy's ``ModelDescription``, and the life cycle.

Components satisfy these protocols by shape alone; they do not import this module. Everything that
may be called when is in one table, ``LIFE_CYCLE``, which :class:`Instance` enforces.

A value is of its variable's type: a float for Float64, an int for Int64 and enumerations, a bool
for Boolean, an array of exactly that type (float64, int64) and of the described shape where there is
one. For a scalar output an int or a numpy scalar does too, if nothing is lost: it becomes a float,
int or bool before anybody sees it. A bool is no number, an array of one element no scalar.
"""

from collections.abc import Mapping, Sequence
from enum import IntEnum
from numbers import Integral, Real
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

from numpy.typing import NDArray

from orchestrator.errors import RAISED, CouplingError
from orchestrator.failure import failure

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

Value = float | int | bool | str | bytes | NDArray[Any]

INTERFACE = 1  # version of this contract


class Status(IntEnum):
    """FMI's answers to ``step``."""

    OK = 0
    WARNING = 1  # the step is done, something is worth telling
    DISCARD = 2  # the step is refused: nothing has advanced
    ERROR = 3  # the component cannot go on; others can
    FATAL = 4  # the component must not be called again, not even to terminate


def is_status(answer: object) -> bool:
    """Return whether a step's answer is a ``Status``: 0 to 4, but no bool."""
    is_number = isinstance(answer, int | Integral) and not isinstance(answer, bool)
    return is_number and cast(int, answer) in range(5)


class Execution(Protocol):
    """What FMI has no word for: when a component runs."""

    @property
    def kind(self) -> Literal["continuous", "sampled"]:
        """``continuous``: inputs at t, outputs at t + h. ``sampled``: outputs at t + latency."""
        ...

    @property
    def rate_hz(self) -> float:
        """Preferred rate, steps per simulated second."""
        ...

    @property
    def interface(self) -> int:
        """Version of the contract the component was written for."""
        ...


class Component(Protocol):
    """Anything that can be coupled: native, an FMU, a recording.

    Everything structural (names, shapes, units) is known once the constructor returns. Times are
    simulated seconds. Any exception counts as ``Status.ERROR``.
    """

    @property
    def execution(self) -> Execution:
        """When it runs; constant."""
        ...

    def describe(self) -> "ModelDescription":
        """Return names, causality, units, shapes, start values and direct feed-through.

        May be called at any time; pure; the same in every call.
        """
        ...

    def initialize(self, *, start_time: float, stop_time: float | None, seed: int) -> None:
        """Make the outputs valid at ``start_time``.

        Called once, before any ``get`` or ``step``. Inputs and parameters may have been set. All
        randomness derives from ``seed``.
        """
        ...

    def set(self, values: Mapping[str, Value], /) -> None:
        """Take copies of inputs and tunable parameters.

        Called before ``initialize`` or between steps, never during one, with at least one of them
        and not always with all: what is not there stays. An unknown name is a KeyError that says
        the nearest one.
        """
        ...

    def get(self, names: Sequence[str], /) -> dict[str, Value]:
        """Return copies of the named variables at the current instant; no side effect.

        Called after ``initialize``. An unknown name is a KeyError that says the nearest one.
        """
        ...

    def step(self, time: float, step_size: float, /) -> int:
        """Advance from ``time`` by ``step_size``, both in seconds, and return a ``Status``: 0 to 4.

        ``time`` is where the last step ended. A sampled component computes its outputs from the
        inputs at ``time``; they hold until its next step.
        """
        ...

    def terminate(self) -> None:
        """Let go of whatever is held. May be called at any time and twice."""
        ...


class Restorable(Component, Protocol):
    """A component whose description says ``canSerializeFMUstate``."""

    def get_state(self) -> bytes:
        """Return everything that decides the future: states, random generators, warm starts."""
        ...

    def set_state(self, state: bytes, /) -> None:
        """Go back to a state of an equally constructed component, of another process too.

        Called after ``initialize``. What follows is the same to the last bit.
        """
        ...


# state -> {call: state afterwards}; what is not here is refused
LIFE_CYCLE: dict[str, dict[str, str]] = {
    "created": {"set": "created", "initialize": "initialized", "terminate": "terminated"},
    "initialized": {
        "set": "initialized",
        "get": "initialized",
        "step": "stepping",
        "get_state": "initialized",
        "set_state": "stepping",
        "terminate": "terminated",
    },
    "stepping": {
        "set": "stepping",
        "get": "stepping",
        "step": "stepping",
        "get_state": "stepping",
        "set_state": "stepping",
        "terminate": "terminated",
    },
    "error": {"terminate": "terminated"},
    "fatal": {"terminate": "fatal"},
    "terminated": {"terminate": "terminated"},
}


_VERBS = ("describe", "initialize", "set", "get", "step", "terminate")


class Instance:
    """A component under a name, called only as ``LIFE_CYCLE`` permits.

    The run loop checks once, by :meth:`enter_step_mode`, and then calls the component itself.
    """

    def __init__(self, name: str, component: Component) -> None:
        self.name = name
        self.component = component
        self.state = "created"
        self._description: ModelDescription | None = None

    @property
    def description(self) -> "ModelDescription":
        """The component's model description, asked for once.

        Raises
        ------
        CouplingError
            If it has none, or is no component.
        """
        if self._description is None:
            component: Any = self.component
            missing = [name for name in _VERBS if not callable(getattr(component, name, None))]
            if missing:
                raise CouplingError(
                    f"component {self.name!r}: no {', '.join(missing)}, got {_kind(component)}, "
                    f"expected {', '.join(_VERBS)}"
                )
            try:
                described = component.describe()
            except RAISED as error:
                what = failure(error, component, "describe")
                raise CouplingError(f"component {self.name!r}: {what}") from error
            if not hasattr(described, "modelVariables"):
                raise CouplingError(
                    f"component {self.name!r}: describe answered {described!r}, "
                    "expected a ModelDescription"
                )
            self._description = described
        return cast("ModelDescription", self._description)

    @property
    def execution(self) -> Execution:
        """When the component runs.

        Raises
        ------
        CouplingError
            If it does not say.
        """
        component: Any = self.component
        try:
            found = component.execution
        except RAISED as error:
            what = failure(error, component, "execution")
            raise CouplingError(f"component {self.name!r}: {what}") from error
        has_all = all(hasattr(found, name) for name in ("kind", "rate_hz", "interface"))
        if not (has_all and isinstance(found.rate_hz, Real)):
            raise CouplingError(
                f"component {self.name!r}: wrong execution, got {found!r}, "
                "expected one with kind, rate_hz (a number) and interface"
            )
        return found

    @property
    def is_restorable(self) -> bool:
        """Whether the description advertises ``get_state`` and ``set_state``."""
        co_simulation = self.description.coSimulation
        return co_simulation is not None and co_simulation.canSerializeFMUstate

    def _enter(self, call: str) -> None:
        """Move to the state after ``call``, or refuse it."""
        permitted = LIFE_CYCLE[self.state]
        if call not in permitted:
            allowed = [state for state, calls in LIFE_CYCLE.items() if call in calls]
            raise CouplingError(
                f"component {self.name!r}: {call} is not permitted, got state {self.state!r}, "
                f"expected {' or '.join(repr(state) for state in allowed)}"
            )
        self.state = permitted[call]

    def initialize(self, *, start_time: float, stop_time: float | None, seed: int) -> None:
        """See :meth:`Component.initialize`."""
        self._enter("initialize")
        try:
            self.component.initialize(start_time=start_time, stop_time=stop_time, seed=seed)
        except BaseException:
            self.fail()
            raise

    def set(self, values: Mapping[str, Value]) -> None:
        """See :meth:`Component.set`."""
        self._enter("set")
        self.component.set(values)

    def get(self, names: Sequence[str]) -> dict[str, Value]:
        """See :meth:`Component.get`."""
        self._enter("get")
        return self.component.get(names)

    def step(self, time: float, step_size: float) -> int:
        """See :meth:`Component.step`; Error, Fatal and an exception end the life cycle."""
        self._enter("step")
        try:
            status = self.component.step(time, step_size)
        except BaseException:
            self.fail()
            raise
        if not is_status(status):
            self.fail()
            raise CouplingError(f"step answered {status!r}, expected a status 0 to 4")
        if status >= Status.ERROR:
            self.fail(fatal=status == Status.FATAL)
        return status

    def get_state(self) -> bytes:
        """See :meth:`Restorable.get_state`."""
        self._enter("get_state")
        return cast(Restorable, self.component).get_state()

    def set_state(self, state: bytes) -> None:
        """See :meth:`Restorable.set_state`."""
        self._enter("set_state")
        cast(Restorable, self.component).set_state(state)

    def terminate(self) -> None:
        """See :meth:`Component.terminate`; does nothing twice, nor after Fatal."""
        before = self.state
        self._enter("terminate")
        if before not in ("terminated", "fatal"):
            self.component.terminate()

    def enter_step_mode(self) -> Component:
        """Return the component itself, for the caller that keeps the order from here on.

        Such a caller reports a failed step by :meth:`fail`.
        """
        self._enter("step")
        return self.component

    def fail(self, *, fatal: bool = False) -> None:
        """Note that the component cannot go on."""
        self.state = "fatal" if fatal else "error"


def _kind(component: object) -> str:
    """Return the name of a component's class, and where that begins."""
    from inspect import getsourcefile, getsourcelines

    kind = type(component)
    try:
        file, line = getsourcefile(kind), getsourcelines(kind)[1]
    except (OSError, TypeError):  # of C, or typed in
        return kind.__qualname__
    return f"{kind.__qualname__} ({PurePath(file or '').name}:{line})"
