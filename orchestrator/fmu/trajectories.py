"""Fly one instance of an FMU from one state after the other, by calls that were prepared once.

A sample is three calls: set the commands, step, get the values. Each sample has memory of its own,
so that a trajectory is one pass over a list of calls, with no line of Python between them.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from ctypes import c_void_p
from itertools import pairwise
from operator import call
from struct import Struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from orchestrator.component import Status, Value
from orchestrator.fmu import state as states
from orchestrator.fmu.buffers import writer
from orchestrator.fmu.errors import FmuError
from orchestrator.fmu.fmu import Fmu
from orchestrator.fmu.instance import FmuInstance
from orchestrator.fmu.roles import Group, Roles, joined
from orchestrator.fmu.stepping import advance
from orchestrator.fmu.variables import Variable, blocks

Floats = NDArray[np.float64]
Calls = list[Callable[[], int]]
Origin = Floats | bytes
"""Where a trajectory starts: at a measured state (n,), or at a saved state of the FMU."""
_COUNT = Struct("<q")  # of samples since initialization, in front of a saved state
SHARED = 8  # samples: a shorter common beginning is flown again


class Flown(NamedTuple):
    """``values`` (r, H, N) of what is read, in the controller's units, and ``valid`` (N,)."""

    values: Floats
    valid: NDArray[np.bool_]


class Trajectories:
    """One instance of an FMU, initialized.

    Parameters
    ----------
    start : mapping
        Start values.
    period : float
        Sample period, s.

    Raises
    ------
    FmuError
        If the FMU refuses to be initialized, or to save its state.
    """

    def __init__(self, fmu: Fmu, roles: Roles, start: Mapping[str, Value], period: float) -> None:
        self._instance: FmuInstance = fmu.instantiate("prediction", event_mode=False)
        self._variables = fmu.described.variables
        self._roles, self._start, self._period = roles, start, period
        self._read = joined(roles.state, roles.velocity, roles.actuator)
        self._settable = [roles.state.names.index(name) for name in roles.settable.names]
        live = roles.settable if roles.is_live else Group()
        self._held = joined(live, roles.wind, roles.bias)
        self._hold, self._set_held = self._memory(self._held.variables, 1, is_set=True)
        restart = (roles.restart,) if live.names and roles.restart is not None else ()
        flag, self._restart = self._memory(restart, 2, is_set=True)  # to true, and to false
        flag[0] = True
        self._capacity = self._samples = 0
        self._prepare(1)
        try:
            self._initialize({})
            self._instance.allow_restoring()
            self._initial = self._save()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the instance."""
        self._instance.terminate()

    def initial(self) -> tuple[bytes, Floats, Floats]:
        """Return the FMU's state after initialization, what is read then, and the commands."""
        self._restore(self._initial)
        self._samples = 0
        commands, get = self._memory(self._roles.command.variables, 1, is_set=False)
        self._check(get)
        return self.saved(), self.now(), commands[0] * self._roles.command.factors

    def saved(self) -> bytes:
        """Return the present state of the FMU, as the last trajectory has left it."""
        data = states.to_bytes(self._instance.calls, self._instance.state_functions)
        return _COUNT.pack(self._samples) + data

    def now(self, saved: bytes | None = None) -> Floats:
        """Return what is read at present, or in a saved state."""
        if saved is not None:
            self._load(saved)
        self._check(self._get[:1])
        return self._values[0] * self._read.factors

    def fly(self, origin: Origin, commands: Floats, wind: Floats, bias: Floats) -> Flown:
        """Fly commands (N, H, m) from one origin in an air that moves, m/s, under a bias, m/s2.

        What begins like the first goes on from where the first was then.

        Raises
        ------
        FmuError
            If the FMU can be used no more; a step that is refused makes a trajectory invalid.
        """
        N, H, _ = commands.shape
        self._prepare(H)
        commands = commands / self._roles.command.factors
        values, valid = np.empty((len(self._read.names), H, N)), np.empty((H, N), np.bool_)
        parts = _parts(commands)
        stops = [*np.unique(parts[parts > 0]).tolist(), H]
        with self._begun(origin, wind, bias) as begun:
            kept = {0: begun}
            try:
                for n in range(N):
                    first = int(parts[n])
                    values[:, :first, n], valid[:first, n] = values[:, :first, 0], valid[:first, 0]
                    self._commands[:H] = commands[n]
                    self._restore(kept[first])
                    is_plain = True
                    for begin, end in pairwise([first, *(stops if n == 0 else [H])]):
                        is_plain = is_plain and self._run(self._calls(begin, end))
                        if is_plain and end < H:
                            kept[end] = self._save()
                    if self._said() or not is_plain:
                        self._restore(kept[first])
                        self._step_by_step(first, H)
                        parts *= n > 0  # then nothing goes on from the first one
                    values[:, first:, n] = self._values[first:H].T
                    valid[first:, n] = self._valid[first:H].all(axis=1)
            finally:
                for part in [*kept][1:]:
                    self._release(kept[part])
        self._samples += H
        values *= np.array(self._read.factors)[:, None, None]
        is_finite = np.isfinite(values).reshape(-1, N).all(axis=0)
        return Flown(values, np.logical_and(valid.all(axis=0), is_finite))

    def differentiate(
        self, origin: Floats, commands: Floats, wind: Floats, bias: Floats
    ) -> tuple[Flown, Floats]:
        """Fly commands (1, H, m), and return the derivatives of every step too: (H, n + m, r).

        Of what is read at its end, by the state at its beginning and by the commands.

        Raises
        ------
        FmuError
            If the FMU refuses one.
        """
        by = joined(self._roles.settable, self._roles.command)
        H = commands.shape[1]
        derivatives = np.zeros((H, len(by.names), len(self._read.names)))
        memory = np.zeros(derivatives.shape[1:])
        partials = self._instance.partials(
            [one.references[0] for one in self._read.variables],
            [one.references[0] for one in by.variables],
            memory,
        )
        flown = self.fly(origin, commands, wind, bias)
        with self._begun(origin, wind, bias) as begun:
            self._restore(begun)
            for k in range(H):
                if not self._run(self._calls(k, k + 1)):
                    return flown._replace(valid=np.zeros(1, np.bool_)), derivatives
                self._check(partials)
                derivatives[k] = memory
        derivatives *= np.array(self._read.factors) / np.array(by.factors)[:, None]
        return flown, derivatives

    @contextmanager
    def _begun(self, origin: Origin, wind: Floats, bias: Floats) -> Generator[c_void_p]:
        """Hold the FMU's state at an origin, in its air, before the first step."""
        roles = self._roles
        self._samples = 0
        if isinstance(origin, bytes):
            self._load(origin)
        elif roles.is_live:
            self._restore(self._initial)
        else:
            factors = np.array(roles.settable.factors)
            values = (origin[self._settable] / factors).tolist()
            names = [one.name for one in roles.settable.variables]
            self._instance.reset()
            self._initialize(dict(zip(names, values, strict=True)))
        if wind.any() and not roles.wind.names:
            raise ValueError(
                f"wind: the FMU has no such input, got {wind.tolist()} m/s, expected 0"
            )
        state = origin[self._settable] if roles.is_live and not isinstance(origin, bytes) else ()
        held = [*state, *(wind if roles.wind.names else ()), *(bias if roles.bias.names else ())]
        self._hold[0] = np.array(held) / self._held.factors
        self._check([*self._set_held, *self._restart[:1]])
        self._times[:] = self._period * (self._samples + np.arange(len(self._times)))
        begun = self._save()
        try:
            yield begun
        finally:
            self._release(begun)

    def _initialize(self, settable: Mapping[str, Value]) -> None:
        """Initialize, at time 0."""
        instance, given = self._instance, {**self._start, **settable}
        inputs = {n: v for n, v in given.items() if self._variables[n].causality == "input"}
        others = {n: v for n, v in given.items() if n not in inputs}
        instance.set_up(0.0, None, None)
        writer(instance, [self._variables[n] for n in others])(others) if others else None
        instance.enter_initialization_mode()
        writer(instance, [self._variables[n] for n in inputs])(inputs) if inputs else None
        instance.exit_initialization_mode()

    def _run(self, calls: Calls) -> bool:
        """Call until one has more to say than OK; return whether none had."""
        status = next(filter(None, map(call, calls)), 0)
        self._instance.calls.note(status)
        return not status

    def _step_by_step(self, first: int, end: int) -> None:
        """Fly with early returns and warnings; from a refused step on values are NaN."""
        period, k = self._period, first
        try:
            for k in range(first, end):
                self._check(self._set[k : k + 1])
                time = float(self._times[k])
                status, _ = advance(self._instance, time, time + period, longest=period)
                if status > Status.WARNING:
                    break
                self._check([*self._got(k), *(self._restart[1:] if k == 0 else ())])
            else:
                return
        except FmuError:
            if not self._instance.calls.is_usable:
                raise
        self._values[k:end] = np.nan

    def _got(self, k: int) -> Calls:
        """Return the calls that read sample k."""
        return [self._get[k], *self._get_valid[k : k + 1]]

    def _check(self, calls: Calls) -> None:
        for one in calls:
            if status := one():
                self._instance.calls.check("prediction: a call", status)

    def _load(self, saved: bytes) -> None:
        """Go back to what :meth:`saved` returned."""
        (self._samples,) = _COUNT.unpack_from(saved)
        functions = self._instance.state_functions
        states.from_bytes(self._instance.calls, functions, saved[_COUNT.size :])

    def _save(self) -> c_void_p:
        return states.save(self._instance.calls, self._instance.state_functions)

    def _restore(self, state: c_void_p) -> None:
        states.restore(self._instance.calls, self._instance.state_functions, state)

    def _release(self, state: c_void_p) -> None:
        states.release(self._instance.calls, self._instance.state_functions, state)

    def _calls(self, begin: int, end: int) -> Calls:
        """Return the calls of the samples from ``begin`` to before ``end``."""
        return self._flat[self._places[begin] : self._places[end]]

    def _prepare(self, samples: int) -> None:
        """Make memory and calls for so many samples."""
        if samples <= self._capacity:
            return
        self._capacity = samples
        roles = self._roles
        flag = () if roles.valid is None else (roles.valid,)
        self._commands, self._set = self._memory(roles.command.variables, samples, is_set=True)
        self._values, self._get = self._memory(self._read.variables, samples, is_set=False)
        self._valid, self._get_valid = self._memory(flag, samples, is_set=False)
        self._times = np.zeros(samples)
        steps, self._said = self._instance.steps(self._times, self._period)
        self._flat: Calls = []
        self._places = [0]
        for k in range(samples):
            self._flat += [self._set[k], steps[k], *self._got(k)]
            if k == 0:
                self._flat += self._restart[1:]
            self._places.append(len(self._flat))

    def _memory(
        self, variables: Sequence[Variable], samples: int, *, is_set: bool
    ) -> tuple[NDArray[Any], Calls]:
        """Return memory for variables of one type, a row per sample, and the calls that use it."""
        if not variables:
            return np.ones((samples, 0)), []
        (block,) = blocks(variables)
        memory = np.zeros((samples, block.size), self._instance.new_buffer(block).code)
        calls: Calls = []
        for row in memory:
            buffer = self._instance.new_buffer(block)
            buffer.values = type(buffer.values).from_buffer(row)
            transfer = self._instance.setter(buffer) if is_set else self._instance.getter(buffer)
            calls.append(transfer.call)
        return memory, calls


def _parts(commands: Floats) -> NDArray[np.int64]:
    """Return with which sample each trajectory leaves the first one, (N,); 0 where that is soon."""
    differs = (commands != commands[0]).any(axis=2)
    parts = np.where(differs.any(axis=1), differs.argmax(axis=1), 0)
    return np.where(parts < SHARED, 0, parts)
