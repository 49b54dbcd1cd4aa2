"""A component that lives in another process, to be used like any other."""

import pickle
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from orchestrator.assembly.description import KINDS
from orchestrator.assembly.plan import Plan
from orchestrator.component import Execution, Status, Value
from orchestrator.failure import Origin
from orchestrator.isolation.process import Process
from orchestrator.isolation.unchanged import frozen, is_new
from orchestrator.scenario.marks import KeyPath

FAREWELL_S = 10.0  # to terminate, where no timeout is given
MAKING_S = 300.0  # to make a component, at least, where one is: kernels may have to be compiled


class Remote:
    """A component made from ``plans`` in a process of its own, which starts at once.

    One exchange per step: inputs are kept until then, and the answer brings all outputs. Every call
    may raise ``ComponentDied`` or ``ComponentTimeout``; the process is gone then.

    Parameters
    ----------
    plans : sequence of Plan
        Of the component and of all resources that it needs, in the order of making.
    path : tuple
        Of the component among them.
    timeout_s : float, optional
        How long the process may take to answer, s; five minutes, if that is more, until it is made.
    keeps_state : bool
        Whether to save the state with every step, for :meth:`restart`.

    Raises
    ------
    ValueError
        If the plans cannot go to another process.
    """

    def __init__(
        self,
        plans: Sequence[Plan],
        path: KeyPath,
        *,
        timeout_s: float | None = None,
        keeps_state: bool = False,
    ) -> None:
        if any(plan.factory.__module__ == "__main__" for plan in plans):
            raise ValueError("isolation: not possible, got a part of a script, expected a module's")
        try:
            self._plans = pickle.dumps(list(plans), 5)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise ValueError(f"isolation: cannot go to another process, {error}") from error
        self._path = path
        self._timeout_s = timeout_s
        self._keeps_state = keeps_state
        self._made: tuple[Execution, Any] | None = None
        self._start_arguments: tuple[Any, ...] = ()  # of initialize
        self._start_inputs: dict[str, Value] = {}
        self._held: dict[str, Value] = {}  # everything ever set, if a restart may need it
        self._outputs: tuple[str, ...] = ()
        self._values: dict[str, Value] = {}
        self._failure: Exception | None = None  # of the component's last get
        self._is_stale = False  # whether something that is no input was set after the last read
        self._state: bytes | None = None
        self._start()

    def _start(self) -> None:
        """Start the process and leave it to make the component."""
        self._process = Process()
        self._pending: dict[str, Value] = {}  # inputs that go with the next request
        self._given: dict[str, NDArray[Any]] = {}  # arrays that the other side has, or will have
        if self._timeout_s is not None:
            self._process.limit(max(self._timeout_s, MAKING_S))
        self._process.request("make", self._plans, self._path, self._keeps_state)

    def made(self) -> tuple[Execution, Any]:
        """Wait until the component has been made; return its execution and description.

        Raises
        ------
        ScenarioError
            If its constructor, or that of a resource, refuses.
        """
        if self._made is None:
            self._made = made = self._process.answer()
            variables = [v for v in made[1].modelVariables if v.type in KINDS]
            outputs = [v for v in variables if v.causality == "output"]
            inputs = [v for v in variables if v.causality == "input"]
            self._inputs = {v.name for v in inputs}
            self._has_arrays = any(v.dimensions for v in inputs)
            self._outputs = tuple(v.name for v in outputs)
            self._arrays = [v.name for v in outputs if v.dimensions]
            return made
        return self._made

    @property
    def execution(self) -> Execution:
        """See :class:`orchestrator.component.Component`, as for all that follows."""
        return self.made()[0]

    def describe(self) -> Any:
        """Return the description that the process sent."""
        return self.made()[1]

    def initialize(self, *, start_time: float, stop_time: float | None, seed: int) -> None:
        """Initialize; the first outputs come with the answer."""
        self.made()
        self._process.limit(self._timeout_s)
        self._start_inputs = dict(self._held)
        self._start_arguments = (self._outputs, self._arrays, start_time, stop_time, seed)
        self._take(self._ask("initialize", *self._start_arguments))

    def set(self, values: Mapping[str, Value], /) -> None:
        """Keep inputs for the next request; anything else, which may be refused, goes at once."""
        if not values.keys() <= self._inputs:
            self._ask("set", dict(values))
            self._is_stale = True
            self._held.update(
                {n: frozen(np.copy(v)) if np.ndim(v) else v for n, v in values.items()}
            )
        elif not self._has_arrays:
            self._pending.update(values)
        else:
            for name, value in values.items():
                if isinstance(value, np.ndarray):
                    if not is_new(self._given, name, value):
                        continue
                    self._pending[name] = self._given[name]
                else:
                    self._pending[name] = value
        if self._keeps_state:
            self._held.update(self._pending)

    def get(self, names: Sequence[str], /) -> dict[str, Value]:
        """Return what the last answer brought; ask again where something was set since."""
        if self._pending or self._is_stale:
            self._take(self._ask("read"))
        if self._failure is not None:
            raise self._failure
        if names == self._outputs:
            return self._values.copy()
        try:
            return {name: self._values[name] for name in names}
        except KeyError:
            return self._ask("get", names)

    def step(self, time: float, step_size: float, /) -> int:
        """Step; the process of a component that answers Fatal is ended."""
        self.begin_step(time, step_size)
        return self.finish_step()

    def begin_step(self, time: float, step_size: float, /) -> None:
        """Have a step begun and do not wait: others can step meanwhile."""
        self._request("step", time, step_size)

    def finish_step(self) -> int:
        """Wait for the step that was begun, and return its status."""
        status, results = self._process.answer()
        if results is not None:
            self._take(results)
        elif status == Status.FATAL:
            self._process.close()
        return status

    def terminate(self) -> None:
        """Terminate and end the process, by force where it does not answer."""
        try:
            if self._process.is_open and not self._process.is_busy:
                self._process.limit(self._timeout_s or FAREWELL_S)
                self._ask("terminate")
        finally:
            self._process.close()

    def get_state(self) -> bytes:
        """Return the state."""
        return self._ask("get_state")

    def set_state(self, state: bytes, /) -> None:
        """Go back to a state; inputs may be part of it."""
        self._ask("set_state", state)
        self._given.clear()
        self._is_stale = True

    def snapshot(self) -> int:
        """Keep the state over there, by the quickest means, and return a number for it."""
        return self._ask("snapshot")

    def rewind(self, checkpoint: int, /) -> None:
        """Go back to what was kept."""
        self._ask("rewind", checkpoint)
        self._given.clear()
        self._is_stale = True

    def release(self, checkpoint: int, /) -> None:
        """Forget what was kept."""
        self._ask("release", checkpoint)

    def restart(self) -> None:
        """Go on in a new process from the state after the last good step, with the same inputs."""
        held, state = dict(self._held), self._state
        self._process.close()
        self._start()
        self._process.answer()
        self._process.limit(self._timeout_s)
        self._pending = dict(self._start_inputs)
        self._take(self._ask("initialize", *self._start_arguments))
        self._ask("set_state", state)
        self._is_stale = True
        self._pending = held
        self._state = state

    def _take(self, results: Any) -> None:
        """Take over the outputs of an answer, and the state if it is there."""
        found, state = results
        self._is_stale = False
        if state is not None:
            self._state = state
        if isinstance(found, tuple):
            error, origin = found
            error.__cause__ = Origin(*origin)
            self._failure = error
            return
        self._failure = None
        values = dict(zip(self._outputs, found, strict=True))
        for name in self._arrays:
            new = values[name]
            values[name] = self._values.get(name) if new is None else frozen(new)
        self._values = values

    def _ask(self, verb: str, *arguments: object) -> Any:
        """Return the answer to one request."""
        self._request(verb, *arguments)
        return self._process.answer()

    def _request(self, verb: str, *arguments: object) -> None:
        """Make a request, which brings the inputs that were set."""
        inputs, self._pending = self._pending, {}
        self._process.request(verb, *arguments, inputs=inputs)
