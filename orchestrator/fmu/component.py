"""An FMU as a component: the contract of ``orchestrator/component.py`` over FMI's calls."""

import json
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import Gt

from orchestrator.component import Status, Value
from orchestrator.errors import nearest
from orchestrator.fmu import state as states
from orchestrator.fmu.buffers import Read, Write, reader, writer
from orchestrator.fmu.clocks import Clock, clocks
from orchestrator.fmu.description import preferred_rate
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.events import Events, start_clocks, tick
from orchestrator.fmu.fmi3 import Fmi3
from orchestrator.fmu.fmu import Described, Fmu, describe
from orchestrator.fmu.start import start_values
from orchestrator.fmu.stepping import advance
from orchestrator.fmu.values import copied, from_json, is_same, to_json
from orchestrator.fmu.variables import Variable

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

RATE_HZ = 10.0  # of an FMU that says nothing about it


@dataclass(frozen=True)
class FmuParameters:
    """How an FMU is taken in. Its own parameters are among the ``start`` values."""

    file: Annotated[Path, "the FMU, or the folder of an unpacked one"]
    start: Annotated[Mapping[str, Any], "start values by variable"] = field(
        default_factory=dict[str, Any]
    )
    kind: Annotated[
        Literal["", "continuous", "sampled"], "when it runs; as the FMU says if empty"
    ] = ""
    arrays: Annotated[
        bool | None, "gather scalars u[1], u[2] into arrays; as the FMU says if null"
    ] = None
    scheduled: Annotated[bool, "prefer FMI 3 scheduled execution to co-simulation"] = False
    event_mode: Annotated[bool, "handle FMI 3 events in event mode, where it is offered"] = True
    stop_time: Annotated[bool, "tell the FMU when the run will end"] = True
    tolerance: Annotated[Annotated[float, Gt(0)] | None, "relative, for its solver"] = None
    log: Annotated[bool, "debug logging"] = False
    validate: Annotated[bool, "refuse a description that breaks the standard"] = True


@dataclass(frozen=True)
class FmuExecution:
    """When an FMU runs; ``internal_step_s`` divides every communication step, if it is given."""

    kind: Literal["continuous", "sampled"]
    rate_hz: float
    interface: int = 1
    internal_step_s: float | None = None


class FmuComponent:
    """An FMU of FMI 2.0 or 3.0, for co-simulation or scheduled execution.

    The FMU is unpacked, loaded and instantiated at once, so that whatever is wrong with it shows
    before a run. A temporary folder is removed by ``terminate``, or with the component.

    Parameters
    ----------
    latency_s : float
        Handed to the FMU if it has a parameter of this name.
    instance_name : str
        Under which it logs.

    Raises
    ------
    ValueError
        In one line, if it is no FMU that can be simulated here, or a start value does not fit.
    """

    def __init__(
        self, parameters: FmuParameters, *, latency_s: float = 0.0, instance_name: str = "fmu"
    ) -> None:
        self._parameters = parameters
        described = describe_fmu(parameters)
        try:
            self._start = _start(described, parameters, latency_s)
            fmu = Fmu(described)
            self._instance = fmu.instantiate(
                instance_name, is_logging=parameters.log, event_mode=parameters.event_mode
            )
        except BaseException:
            described.close()
            raise
        self._calls = self._instance.calls
        self._finalizer = weakref.finalize(self, _close, self._instance, described)
        self._description = described.description
        self._variables = described.variables
        self._is_ours = described.annotation is not None
        self.execution = execution(described, parameters)
        self._writers: dict[tuple[str, ...], Write] = {}
        self._readers: dict[tuple[str, ...], Read] = {}
        self._last_set: Mapping[str, Value] | None = None
        self._last_size = 0
        self._last_get: Sequence[str] = ()
        self._last_write: Write = self._write_now
        self._last_read: Read = dict[str, Value]
        self._given: dict[str, Value] = {}  # before initialize
        self._is_initialized = False
        self._reached: float | None = None  # where the last step stopped short
        self._held: dict[str, Value] = {}  # inputs that wait for a clock, or were set at an event
        self._clocks: list[Clock] = []
        self._events: Events | None = None
        instance, self._scheduled = self._instance, None
        if isinstance(instance, Fmi3) and (instance.has_events or described.is_scheduled):
            self._clocks = clocks(described.description)
            if described.is_scheduled:
                self._scheduled = instance
            else:
                self._events = Events(
                    instance,
                    self._clocks,
                    self._write_clocked,
                    is_variable=described.interface.canHandleVariableCommunicationStepSize,
                )

    def describe(self) -> "ModelDescription":
        """Return the FMU's own description, with arrays gathered where they are."""
        return self._description

    def initialize(self, *, start_time: float, stop_time: float | None, seed: int) -> None:
        """Set start values and inputs, and make the outputs valid.

        A parameter ``seed`` of an FMU of our own exporter takes the seed.
        """
        instance, given = self._instance, {**self._start, **self._given}
        if self._is_ours and "seed" in self._variables and "seed" not in given:
            given["seed"] = _seed(self._variables["seed"], seed)
        stop = stop_time if self._parameters.stop_time else None
        instance.set_up(start_time, stop, self._parameters.tolerance)
        inputs = {n for n in given if self._variables[n].causality == "input"}
        self._write_now({n: value for n, value in given.items() if n not in inputs})
        instance.enter_initialization_mode()
        self._write_now({n: given[n] for n in given if n in inputs})
        instance.exit_initialization_mode()
        self._held = {n: given[n] for n in inputs}
        if self._events is not None:
            self._events.start(start_time)
        elif self._scheduled is not None:
            start_clocks(self._scheduled, self._clocks, start_time)
        self._is_initialized = True

    def set(self, values: Mapping[str, Value], /) -> None:
        """Take inputs and tunable parameters.

        With event mode, discrete ones that have changed are an event at once, and those of a clock
        wait for its tick.
        """
        if values is self._last_set and len(values) == self._last_size:
            try:  # a run passes the same mapping again and again
                self._last_write(values)
            except KeyError:
                pass  # it holds other names by now
            else:
                return
        names = tuple(values)
        write = self._writers.get(names)
        if write is None:
            write = self._writers[names] = self._writer(names)
        write(values)
        self._last_set, self._last_size = values, len(values)
        self._last_write = self._writers[names]  # the first write may have made a faster one

    def get(self, names: Sequence[str], /) -> dict[str, Value]:
        """Return variables as they are now."""
        if names is self._last_get:  # a run asks with the same tuple again and again
            return self._last_read()
        wanted = tuple(names)
        read = self._readers.get(wanted)
        if read is None:
            read = self._readers[wanted] = reader(self._instance, self._known(wanted))
        if isinstance(names, tuple):  # nothing else is sure to hold the same names next time
            self._last_get, self._last_read = names, read
        return read()

    def step(self, time: float, step_size: float, /) -> int:
        """Step, through early returns and events, from where the last step has ended.

        That is ``time``, unless the FMU refused it: what was missed is then made up for.
        """
        if not self._calls.is_usable:
            return Status.FATAL
        if self._scheduled is not None:
            return self._activate(self._scheduled, time + step_size)
        instance = self._instance
        first = None
        if self._reached is None and self._events is None:
            first = instance.do_step(time, step_size)
            if not first:
                return first
        start = time if self._reached is None else self._reached
        end = time + step_size
        status, reached = advance(
            instance, start, end, longest=step_size, events=self._events, first=first
        )
        self._reached = None if reached == end else reached
        if status == Status.FATAL:  # nobody will terminate it
            self._finalizer()
        return status

    def terminate(self) -> None:
        """End and free the FMU, and remove what was unpacked."""
        self._finalizer()

    def get_state(self) -> bytes:
        """Return the FMU's state and the adapter's."""
        self._instance.allow_restoring()
        data = states.to_bytes(self._instance.calls, self._instance.state_functions)
        return json.dumps(self._adapter_state()).encode() + b"\0" + data

    def set_state(self, state: bytes, /) -> None:
        """Go back to a state of ``get_state``."""
        own, _, data = state.partition(b"\0")
        states.from_bytes(self._instance.calls, self._instance.state_functions, data)
        self._take_adapter_state(json.loads(own))

    def snapshot(self) -> object:
        """Return a state in the FMU's own memory: fast, of this instance only, to be released."""
        self._instance.allow_restoring()
        state = states.save(self._instance.calls, self._instance.state_functions)
        return state, self._adapter_state()

    def rewind(self, snapshot: object) -> None:
        """Go back to a snapshot, as often as needed."""
        state, own = snapshot  # pyright: ignore[reportGeneralTypeIssues, reportUnknownVariableType]
        states.restore(self._instance.calls, self._instance.state_functions, state)
        self._take_adapter_state(own)

    def release(self, snapshot: object) -> None:
        """Free a snapshot's memory."""
        state, _ = snapshot  # pyright: ignore[reportGeneralTypeIssues, reportUnknownVariableType]
        states.release(self._instance.calls, self._instance.state_functions, state)

    def _adapter_state(self) -> dict[str, Any]:
        held = {n: to_json(v) for n, v in self._held.items()} if self._events is not None else {}
        clocks = [asdict(clock) for clock in self._clocks]
        next_event = self._instance.next_event if isinstance(self._instance, Fmi3) else 0.0
        return {"reached": self._reached, "held": held, "clocks": clocks, "event": next_event}

    def _take_adapter_state(self, own: Mapping[str, Any]) -> None:
        self._reached = own["reached"]
        self._held = {n: from_json(self._variables[n], v) for n, v in own["held"].items()}
        for clock, saved in zip(self._clocks, own["clocks"], strict=True):
            for key, value in saved.items():
                setattr(clock, key, value)
        if isinstance(self._instance, Fmi3):
            self._instance.next_event = own["event"]

    def _known(self, names: Sequence[str]) -> list[Variable]:
        for name in names:
            if name not in self._variables:
                near = nearest(name, list(self._variables))
                raise KeyError(f"unknown variable {name!r}{near}")
        return [self._variables[name] for name in names]

    def _writer(self, names: tuple[str, ...]) -> Write:
        """Return what sets these variables, now that they are seen together for the first time."""
        for one in self._known(names):
            is_tunable = one.causality == "parameter" and one.variability == "tunable"
            if one.causality != "input" and not is_tunable:
                what = f"{one.variability} {one.causality}"
                raise ValueError(f"{one.name!r} cannot be set, got {what}, expected an input")
        if self._events is None:
            write = writer(self._instance, self._known(names)) if names else _nothing

            def write_plain(values: Mapping[str, Value]) -> None:
                if not self._is_initialized:
                    self._keep(values)
                else:
                    write(values)
                    self._writers[names] = write  # from now on without asking

            return write_plain
        return self._event_writer(names, self._events)

    def _event_writer(self, names: tuple[str, ...], events: Events) -> Write:
        """Return what sets variables of an FMU in event mode: FMI 3 allows it in event mode alone.

        Floats that are continuous can be set between steps as well.
        """
        variables = self._known(names)
        clocked = {one.name for one in variables if one.clocks}
        discrete = [n.name for n in variables if n.variability != "continuous" and not n.clocks]
        direct = [n for n in variables if n.name not in clocked and n.name not in discrete]
        write = writer(self._instance, direct) if direct else _nothing
        write_discrete = writer(self._instance, [self._variables[n] for n in discrete])

        def write_all(values: Mapping[str, Value]) -> None:
            if not self._is_initialized:
                self._keep(values)
                return
            write(values)
            changed = any(not is_same(values[n], self._held.get(n)) for n in discrete)
            self._held |= {n: copied(values[n]) for n in (*discrete, *clocked)}
            if changed:
                events.handle(write=lambda: write_discrete(values))

        return write_all

    def _write_clocked(self, ticking: Sequence[int]) -> None:
        """Set the inputs that belong to clocks which tick now."""
        self._write_now(
            {n: v for n, v in self._held.items() if set(ticking) & set(self._variables[n].clocks)}
        )

    def _write_now(self, values: Mapping[str, Value]) -> None:
        if values:
            writer(self._instance, self._known(tuple(values)))(values)

    def _keep(self, values: Mapping[str, Value]) -> None:
        self._given |= {name: copied(value) for name, value in values.items()}

    def _activate(self, instance: Fmi3, end: float) -> int:
        """Run the model partitions whose clocks tick before ``end``, in the order of time."""
        near = 1e-9 * abs(end) + 1e-12
        for _ in range(len(self._clocks) * MOST_TICKS):
            clock = min(
                self._clocks, key=lambda one: one.next, default=None
            )  # the first by priority
            if clock is None or clock.next >= end - near:
                return Status.OK
            instance.activate(clock.reference, clock.next)
            tick(instance, clock)
        raise FmuError(f"clocks tick too often, got {MOST_TICKS} ticks before t = {end} s")


MOST_TICKS = 100_000  # of a clock in one communication step


def describe_fmu(parameters: FmuParameters, only: Sequence[str] | None = None) -> Described:
    """Unpack the FMU of parameters and read its description; to be closed."""
    return describe(
        parameters.file,
        only=only,
        arrays=parameters.arrays,
        scheduled=parameters.scheduled,
        validate=parameters.validate,
    )


def execution(described: Described, parameters: FmuParameters) -> FmuExecution:
    """Return when an FMU runs."""
    own = described.annotation
    kind = "sampled" if described.is_scheduled else own.kind if own is not None else "continuous"
    rate = preferred_rate(described.description, own, is_scheduled=described.is_scheduled)
    internal = described.interface.fixedInternalStepSize
    return FmuExecution(parameters.kind or kind, rate or RATE_HZ, internal_step_s=internal)


def _start(described: Described, parameters: FmuParameters, latency_s: float) -> dict[str, Value]:
    values, wrong = start_values(described.description, described.variables, parameters.start)
    if wrong:
        name, what = next(iter(wrong.items()))
        raise ValueError(f"start: {name}: {what}")
    latency = described.variables.get("latency_s")
    if latency is not None and latency.causality == "parameter" and latency.kind == "float":
        values.setdefault("latency_s", latency_s)
    return values


def _seed(variable: Variable, seed: int) -> Value:
    """Return a component's seed as a value of a parameter, cut where that is of 32 bits."""
    if variable.kind == "string":
        return str(seed)
    return seed if variable.function in ("Int64", "UInt64") else seed & 0x7FFFFFFF


def _close(instance: Any, described: Described) -> None:
    try:
        instance.terminate()
    finally:
        described.close()


def _nothing(_: Mapping[str, Value]) -> None:
    pass
