"""What viewers ask for: heard on the server's threads, put in line for the run."""

from collections.abc import Mapping, Sequence
from queue import SimpleQueue
from typing import Any

import numpy as np
from foxglove.websocket import (
    ChannelView,
    Client,
    Parameter,
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
    ServerListener,
)

from orchestrator.assembly.settable import accepted, bounds, tunables
from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.run.events import Change

PAUSED, SPEED = "paused", "speed"  # no component's: their parameters have a dot
FASTEST = 1000.0  # stands for as fast as it goes: viewers know no infinite speed

Wish = Change | tuple[str, Any] | ValueError  # a tunable, pause or speed, or what is refused


class Desk(ServerListener):
    """Answers at once from what it knows; nothing here touches the run.

    Attributes
    ----------
    values : dict
        Of every tunable parameter by full name, and of ``paused`` and ``speed``; kept by the run.
    time_ns : int
        Simulated time; kept by the run.
    wishes, subscribed : SimpleQueue
        What is asked for, and topics that somebody has begun to watch.
    """

    def __init__(self, system: System, speed: float) -> None:
        self._ports = tunables(system.ports)
        self._bounds = bounds(system.plans)
        self.time_ns = 0
        self.values: dict[str, Any] = {PAUSED: False, SPEED: min(speed, FASTEST)}
        self.wishes: SimpleQueue[Wish] = SimpleQueue()
        self.subscribed: SimpleQueue[str] = SimpleQueue()

    def take_over(self, component: str, values: Mapping[str, Value]) -> None:
        """Note parameters of a component."""
        named = {f"{component}.{name}": value for name, value in values.items()}
        self.values |= {name: value for name, value in named.items() if name in self._ports}

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Note who may need the last message of a topic."""
        del client
        self.subscribed.put(channel.topic)

    def on_get_parameters(
        self, client: Client, param_names: Sequence[str], request_id: str | None = None
    ) -> list[Parameter]:
        """Return the named parameters, or all."""
        del client, request_id
        return [
            _parameter(n, self.values[n]) for n in param_names or self.values if n in self.values
        ]

    def on_set_parameters(
        self, client: Client, parameters: Sequence[Parameter], request_id: str | None = None
    ) -> list[Parameter]:
        """Put changes in line; return them as they will be, and those refused as they are."""
        del client, request_id
        made: list[Parameter] = []
        for one in parameters:
            value = self.values.get(one.name)
            try:
                value = self._ask(one.name, one.get_value())
            except (ValueError, TypeError) as error:
                self.wishes.put(ValueError(f"{one.name}: {error}"))
            if value is not None:
                made.append(_parameter(one.name, value))
        return made

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState:
        """Pause or play, at a speed; there is no way back in time."""
        asked = playback_control_request
        is_paused = asked.playback_command == PlaybackCommand.Pause
        self.wishes.put((PAUSED, is_paused))
        speed = asked.playback_speed if asked.playback_speed > 0 else self.values[SPEED]
        self.wishes.put((SPEED, float(speed)))
        return playback(self.time_ns, speed, is_paused=is_paused, request_id=asked.request_id)

    def _ask(self, name: str, raw: object) -> object:
        """Put one change in line and return its value.

        Raises
        ------
        ValueError
            If it cannot be made.
        """
        if name in self._ports:
            value = accepted(self._ports[name], raw, self._bounds)
            self.wishes.put(Change(-1, self._ports[name], value))
            return value
        if name == PAUSED and isinstance(raw, bool):
            self.wishes.put((PAUSED, raw))
        elif (
            name == SPEED and not isinstance(raw, bool) and isinstance(raw, int | float) and raw > 0
        ):
            self.wishes.put((SPEED, float(raw)))
        else:
            known = name in self.values
            wanted = "true or false, or a speed above 0" if known else f"one of {list(self.values)}"
            raise ValueError(f"cannot be set, got {raw!r}, expected {wanted}")
        return raw


def playback(
    time_ns: int,
    speed: float,
    *,
    is_paused: bool = False,
    is_over: bool = False,
    request_id: str | None = None,
) -> PlaybackState:
    """Return how the run goes, as the protocol says it."""
    going = PlaybackStatus.Paused if is_paused else PlaybackStatus.Playing
    return PlaybackState(
        status=PlaybackStatus.Ended if is_over else going,
        current_time=EPOCH_NS + time_ns,
        playback_speed=min(speed, FASTEST),
        did_seek=False,
        request_id=request_id,
    )


def _parameter(name: str, value: Any) -> Parameter:
    return Parameter(name, value=value.tolist() if isinstance(value, np.ndarray) else value)
