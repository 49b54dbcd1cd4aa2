"""One component in a run: takes over inputs, steps, and publishes its outputs."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, cast

from orchestrator.assembly.clock import SECOND
from orchestrator.assembly.description import Port, mismatch, plain
from orchestrator.assembly.system import Link, Operation, Schedule
from orchestrator.component import Instance, Value
from orchestrator.errors import RAISED, ComponentDied, ComponentTimeout, CouplingError
from orchestrator.failure import failure, refusal
from orchestrator.run.finite import finiteness, nonfinite
from orchestrator.run.policies import Policies, Step, restarting, retrying
from orchestrator.run.ranges import outsiders
from orchestrator.run.report import Ended, Report, at
from orchestrator.run.wiring import gather
from orchestrator.scenario.records import ComponentSpec

Values = Mapping[str, Value]
ZERO = 0  # the one object that nearly every step answers: None and False are others


class Participant:
    """The run-time side of one component. Times are whole ns.

    Attributes
    ----------
    values : mapping
        The outputs that are valid now; replaced at every publishing, never changed.
    """

    def __init__(
        self,
        instance: Instance,
        spec: ComponentSpec,
        ports: Mapping[str, Port],
        schedule: Schedule,
        links: Sequence[Link],
        report: Report,
        *,
        end_on: Sequence[str] = (),
    ) -> None:
        self.name = spec.name
        self.values: Values = {}
        self._ports = ports
        self._outputs = tuple(n for n, port in ports.items() if port.causality == "output")
        self._end_on = tuple(end_on)
        self._links = [link for link in links if link.target.component == spec.name]
        self._step_size = schedule.period_ns[spec.name] / SECOND
        self._latency = schedule.latency_ns[spec.name]
        self._pending: deque[tuple[int, Values]] = deque()  # results that become valid later
        self._history: deque[tuple[int, Values]] = deque()  # what delayed connections ask for
        self._longest_delay = max(
            (x.delay_ns for x in links if x.source.component == spec.name and not x.is_plain),
            default=-1,
        )
        self._is_in_service = True  # False for good once a failed component is held
        self._may_read = True  # False while a policy holds the outputs of the last step
        self._outside = outsiders(ports)
        self._types: list[type] = []  # of outputs that were taken as they are
        self._is_usual = _usual(finiteness(ports), self._outside)
        self._report = report
        self._publish = tuple(listener.outputs for listener in report.listeners)
        self._clocks = tuple(x.wall_clock for x in report.listeners if x.wants_wall_clock)
        self._deadline_s = spec.deadline_s
        self._is_timed = bool(self._clocks) or spec.deadline_s is not None
        self._elapsed_s = 0.0
        self._tries: list[int] = []
        self._instance = instance
        self._policies = Policies(instance, spec, report)
        self._inputs: Callable[[int], Values] = lambda _: {}
        component: Any = instance.component
        self._set, self._get, step = component.set, component.get, component.step
        self._is_stepped_once = (
            spec.on_error != "restart" and spec.on_discard != "retry" and spec.deadline_s is None
        )
        if spec.on_error == "restart":
            self._set, self._get, step = (
                restarting(call, component.restart, self._policies.restarted)
                for call in (self._set, self._get, step)
            )
        if spec.on_discard == "retry":
            step = retrying(component, step, self._tries)
        self._has_stepped = self._stepper(self._timed(step) if self._is_timed else step)

    def initialize(self, inputs: Values, stop_time: float, seed: int) -> None:
        """Initialize with ``inputs`` and take over the first outputs.

        Raises
        ------
        CouplingError, ComponentDied, ComponentTimeout
            If a call fails, or an output is missing or not what the description says.
        """
        instance, call = self._instance, "set"
        try:
            if inputs:
                instance.set(inputs)
            call = "initialize"
            instance.initialize(start_time=0.0, stop_time=stop_time, seed=seed)
            call = "get"
            values: Values = dict(instance.get(self._outputs))
        except (ComponentDied, ComponentTimeout):
            raise
        except RAISED as error:
            what = (refusal if call == "initialize" else failure)(error, instance.component, call)
            raise CouplingError(what) from error
        self.values = self._converted(values)
        instance.enter_step_mode()

    def wire(self, participants: Mapping[str, "Participant"]) -> None:
        """Connect the inputs to what the participants publish."""
        tell = tuple(listener.inputs for listener in self._report.listeners)
        self._inputs = gather(self._links, participants, self.name, tell)

    def call(
        self, operation: Operation, participants: Mapping[str, "Participant"], *, is_last: bool
    ) -> Callable[[int], None]:
        """Return the function of time that carries out one operation of the schedule."""
        if operation.kind == "read":
            return self._reader(operation, participants, is_last=is_last)
        return {"release": self.release, "sample": self.sample, "advance": self.advance}[
            operation.kind
        ]

    def halves(self) -> tuple[Callable[[int], None], Callable[[int], None]] | None:
        """Return what begins and what finishes an advance, so that others can step in between.

        None where that cannot be: the component lives in this process, a policy may step it again,
        or there is a deadline, which waiting for others must not count against.
        """
        component: Any = self._instance.component
        if not (self._is_stepped_once and hasattr(component, "begin_step")):
            return None
        has_begun = False

        def begin(time_ns: int) -> None:
            nonlocal has_begun
            has_begun = False
            if not self._is_in_service:
                return
            inputs = self._inputs(time_ns)
            start = perf_counter()
            call = "set"
            try:
                if inputs:
                    self._set(inputs)
                call = "step"
                component.begin_step(time_ns / SECOND, self._step_size)
            except RAISED as error:
                self._fail(time_ns, call, error)
            else:
                has_begun = True
            self._elapsed_s = perf_counter() - start

        def finish(time_ns: int) -> None:
            if not has_begun:
                self._may_read = False
                return
            start = perf_counter()
            try:
                status = component.finish_step()
            except RAISED as error:
                self._fail(time_ns, "step", error)
                return
            self._elapsed_s += perf_counter() - start
            self._may_read = self._is_done(time_ns, status)

        return begin, finish

    def value_at(self, time_ns: int, name: str) -> Value | None:
        """Return an output as it was valid at a time, None before the first publishing."""
        for published, values in reversed(self._history):
            if published <= time_ns:
                return values[name]
        return None

    def change(self, time_ns: int, name: str, value: Value) -> None:
        """Set an unconnected input or tunable parameter between steps."""
        if self._is_in_service:
            try:
                self._set({name: value})
            except RAISED as error:
                self._fail(time_ns, "set", error)

    def advance(self, time_ns: int) -> None:
        """Step a continuous component; its outputs are read when the end of the step is reached."""
        self._may_read = self._has_stepped(time_ns)

    def sample(self, time_ns: int) -> None:
        """Step a sampled component; its outputs become valid after its latency."""
        if not self._has_stepped(time_ns):
            return
        try:
            values = self._get(self._outputs)
        except RAISED as error:
            self._fail(time_ns, "get", error)
            return
        if self._latency:
            self._pending.append((time_ns + self._latency, values))
        else:
            self.publish(time_ns, values)

    def release(self, time_ns: int) -> None:
        """Publish the result that becomes valid now, if there is one."""
        if self._pending and self._pending[0][0] == time_ns:
            self.publish(time_ns, self._pending.popleft()[1])

    def publish(self, time_ns: int, values: Values, is_last: bool = True) -> None:
        """Make outputs valid, unless one is not finite; the last of an instant is told."""
        try:
            if [*map(type, values.values())] != self._types:  # quicker than a tuple
                values = self._converted(values)
            fault = None if self._is_usual(values) else self._fault(values)
        except RAISED as error:
            self._fail(time_ns, "get", error)
            return
        if fault is not None and not self._is_let_pass(time_ns, *fault):
            return
        self.values = values
        if self._longest_delay >= 0:
            self._remember(time_ns)
        if is_last:
            for publish in self._publish:
                publish(time_ns, self.name, values)
            for name in self._end_on:
                if values[name]:
                    item = self._ports[name].items.get(cast(int, values[name]))
                    if item is None:
                        fault = mismatch(self._ports[name], values[name])
                        self._fail(time_ns, "get", CouplingError(f"output {name!r}: {fault}"))
                        return
                    raise Ended(item, f"{at(self.name, time_ns)}: {name!r} is {item!r}")

    def _converted(self, values: Values) -> Values:
        """Return outputs as the contract has them; what need not be converted is known next time.

        Raises
        ------
        CouplingError
            If one is missing or is not what the description says.
        """
        converted: dict[str, Any] = {}
        for name in self._outputs:
            port = self._ports[name]
            value = plain(port, values[name]) if name in values else None
            fault = mismatch(port, value) if name in values else "is missing"
            if fault is not None:
                raise CouplingError(f"output {name!r}: {fault}")
            converted[name] = value
        if any(value is not values[name] for name, value in converted.items()):
            return converted
        self._types = [*map(type, values.values())]
        return values

    def _fault(self, values: Values) -> tuple[str | None, list[tuple[Port, Value]]]:
        """Return what is not finite, else which outputs are out of range."""
        wrong = nonfinite(self._ports, values)
        beyond = () if wrong or self._outside is None else self._outside(values)
        return wrong, [(self._ports[name], values[name]) for name in beyond]

    def _is_let_pass(
        self, time_ns: int, wrong: str | None, beyond: list[tuple[Port, Value]]
    ) -> bool:
        """Deal with a fault; return whether the outputs count all the same."""
        if wrong is not None:
            self._policies.found_nonfinite(time_ns, wrong)
            return False
        return not beyond or self._policies.found_out_of_range(time_ns, beyond)

    def _reader(
        self, operation: Operation, participants: Mapping[str, "Participant"], *, is_last: bool
    ) -> Callable[[int], None]:
        """Return the call that reads outputs after taking over the inputs they pass on."""
        names = operation.outputs
        is_all = len(names) == len(self._outputs)
        through = [link for link in self._links if link.target.name in operation.inputs]
        take = gather(through, participants, self.name, ()) if through else None
        set_, get, publish = self._set, self._get, self.publish

        def read(time_ns: int) -> None:
            if not self._may_read:
                return
            call = "set"
            try:
                if take is not None and (inputs := take(time_ns)):
                    set_(inputs)
                call = "get"
                values = get(names) if is_all else {**self.values, **get(names)}
            except RAISED as error:
                self._fail(time_ns, call, error)
            else:
                publish(time_ns, values, is_last)

        return read

    def _stepper(self, step: Step) -> Callable[[int], bool]:
        """Return what takes over the inputs and steps; false where a policy holds the outputs."""
        set_, size, tries, is_timed = self._set, self._step_size, self._tries, self._is_timed
        zero = ZERO

        def has_stepped(time_ns: int) -> bool:
            if not self._is_in_service:
                return False
            inputs = self._inputs(time_ns)
            call = "set"
            try:
                if inputs:
                    set_(inputs)
                call = "step"
                status = step(time_ns / SECOND, size)
            except RAISED as error:
                self._fail(time_ns, call, error)
                return False
            while tries:
                self._policies.tried_again(time_ns, tries.pop(0))
            return (status is zero and not is_timed) or self._is_done(time_ns, status)

        return has_stepped

    def _is_done(self, time_ns: int, status: int) -> bool:
        """Deal with a status and with the time taken; return whether the outputs may be read."""
        if status is not ZERO and not self._policies.answered(time_ns, status):
            self._is_in_service = self._instance.state == "stepping"
            return False
        return not self._is_timed or self._is_in_time(time_ns)

    def _fail(self, time_ns: int, call: str, error: BaseException) -> None:
        self._is_in_service = self._may_read = False
        self._policies.failed(time_ns, call, error)

    def _is_in_time(self, time_ns: int) -> bool:
        """Tell the measured time of a step; False where an overrun holds the outputs."""
        for tell in self._clocks:
            tell(time_ns, self.name, self._elapsed_s)
        if self._deadline_s is None or self._elapsed_s <= self._deadline_s:
            return True
        return self._policies.overran(time_ns, self._elapsed_s)

    def _timed(self, step: Step) -> Step:
        def timed_step(time: float, step_size: float) -> int:
            begin = perf_counter()
            status = step(time, step_size)
            self._elapsed_s = perf_counter() - begin
            return status

        return timed_step

    def _remember(self, time_ns: int) -> None:
        history = self._history
        if history and history[-1][0] == time_ns:
            history.pop()
        history.append((time_ns, self.values))
        while len(history) > 1 and history[1][0] <= time_ns - self._longest_delay:
            history.popleft()


def _usual(
    is_finite: Callable[[Values], bool], outside: Callable[[Values], Sequence[str]] | None
) -> Callable[[Values], bool]:
    """Return a quick test that outputs are finite and within their bounds."""
    if outside is None:
        return is_finite
    return lambda values: is_finite(values) and not outside(values)
