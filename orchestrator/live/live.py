"""A run in a viewer, while it lasts: the recorder's own bytes over a WebSocket on loopback."""

from collections.abc import Callable, Mapping, Sequence
from math import inf
from queue import Empty
from threading import Thread
from time import perf_counter, sleep

import foxglove
from foxglove import StatusLevel
from foxglove.websocket import Capability

from orchestrator.assembly.system import System
from orchestrator.component import Value
from orchestrator.listener import Result
from orchestrator.live.desk import FASTEST, PAUSED, SPEED, Desk, Wish, playback
from orchestrator.live.line import Line
from orchestrator.live.pace import Pace
from orchestrator.recording.feed import Feed
from orchestrator.recording.provenance import EPOCH_NS
from orchestrator.recording.rows import messages
from orchestrator.recording.topics import EVENTS, LOG, Topic
from orchestrator.run.events import Change

HOST = "127.0.0.1"
POLL_S = 0.05  # how long a wait lasts before it looks around
CLOCK_S = 1 / 60  # between broadcasts of the time: more than a viewer draws would fill its queue
JOINING_S = 0.1  # from hearing of a subscription to when the server sends what is subscribed to
LEAVING_S = 0.2  # for the last messages to leave, and again for the viewers


class Live:
    """A listener that shows a run and passes on what viewers ask for.

    Nothing here waits for a viewer: the server keeps a queue for each, drops the oldest messages of
    one that is full, and parts with who does not read at all. ``requests`` is for ``simulate``.

    Parameters
    ----------
    port
        TCP port on loopback; 0 takes a free one.
    speed
        Simulated seconds per second; infinite: as fast as it goes.
    interrupt
        True ends a wait.
    show
        Takes the line that says how it goes, a few times per second.

    Raises
    ------
    OSError
        If the port cannot be listened on.
    ValueError
        If a scene role names nothing to draw.
    """

    wants_wall_clock = True

    def __init__(
        self,
        system: System,
        *,
        port: int = 8765,
        speed: float = 1.0,
        interrupt: Callable[[], bool] = lambda: False,
        show: Callable[[str], None] | None = None,
    ) -> None:
        self._pace = Pace(speed)
        self._desk = Desk(system, speed)
        self._interrupt = interrupt
        self._line = Line(system, show) if show is not None else None
        self._context = foxglove.Context()  # holds channels; not the SDK's own, which lives on
        self._feed = Feed(system, wall_clock=True)
        # before the server: it tells of a channel that is added later before it knows it itself
        self._channels = [self._channel(topic) for topic in self._feed.topics]
        self._feed.start(range(len(self._channels)))
        self._last: dict[int, tuple[float, bytes]] = {}  # by channel: when sent, and the message
        self._joined: set[int] = set()  # channels that somebody has begun to watch
        self._joined_at = 0.0
        self._time_ns = 0
        self._clock_at = 0.0
        self._is_stopped = False
        end_ns = EPOCH_NS + system.schedule.end_ns
        try:
            self._server = foxglove.start_server(
                name=system.scenario.title,
                host=HOST,
                port=port,
                capabilities=[Capability.Time, Capability.Parameters, Capability.PlaybackControl],
                playback_time_range=(EPOCH_NS, end_ns),
                server_listener=self._desk,
                context=self._context,
            )
        except RuntimeError as error:
            raise OSError(f"live: cannot listen on port {port}, got {error}") from error

    @property
    def address(self) -> str:
        """Where viewers connect."""
        return f"ws://{HOST}:{self._server.port}"

    def open(self, system: System, /) -> None:
        """Do nothing: viewers may have come already."""

    def outputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Show outputs."""
        self._feed.outputs(time_ns, component, values)
        if self._line is not None:
            self._line.outputs(component, values)

    def inputs(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Show inputs."""
        self._feed.inputs(time_ns, component, values)

    def parameters(self, time_ns: int, component: str, values: Mapping[str, Value], /) -> None:
        """Show parameters."""
        self._feed.parameters(time_ns, component, values)
        self._desk.take_over(component, values)

    def event(self, time_ns: int, kind: str, component: str, message: str, /) -> None:
        """Show what happened."""
        self._feed.event(time_ns, kind, component, message)

    def log(self, time_ns: int, level: int, name: str, message: str, /) -> None:
        """Show a line of text."""
        self._feed.log(time_ns, level, name, message)

    def wall_clock(self, time_ns: int, component: str, elapsed_s: float, /) -> None:
        """Show the measured duration of a step."""
        self._feed.wall_clock(time_ns, component, elapsed_s)

    def requests(self, time_ns: int, /) -> Sequence[Change]:
        """Send what has been told, wait until `time_ns` is due, and return what to change then."""
        self._send()
        self._time_ns = self._desk.time_ns = time_ns
        changes: list[Change] = []
        while True:
            self._greet()
            wait = self._pace.wait_s(time_ns, perf_counter())
            if self._line is not None:
                self._line.update(time_ns, is_paused=self._pace.is_paused)
            try:
                wish = self._desk.wishes.get(wait > 0, min(wait, POLL_S))
            except Empty:
                if wait <= POLL_S or self._interrupt():
                    return changes
            else:
                changes += self._grant(wish)

    def close(self, result: Result, /) -> None:
        """Send the rest and say how it ended."""
        self._send()
        self._server.publish_status(f"{result.outcome} {result.reason}".strip(), StatusLevel.Info)
        self._tell_playback(is_over=True)
        if any(channel.has_sinks() for channel in self._channels):
            sleep(LEAVING_S)
        self.stop()

    def stop(self) -> None:
        """Part with all viewers; again, it does nothing.

        The server's own `stop` waits for who does not read: it is not waited for.
        """
        if not self._is_stopped:
            self._is_stopped = True
            last = Thread(target=self._server.stop, daemon=True)
            last.start()
            last.join(LEAVING_S)

    def _channel(self, topic: Topic) -> foxglove.Channel:
        schema = foxglove.Schema(name=topic.message, encoding="protobuf", data=topic.descriptors)
        return foxglove.Channel(
            topic.name,
            message_encoding="protobuf",
            schema=schema,
            metadata=dict(topic.metadata),
            context=self._context,
        )

    def _send(self) -> None:
        """Send what was told since the last time: all of it of one instant."""
        now = perf_counter()
        if now > self._clock_at + CLOCK_S:
            self._server.broadcast_time(EPOCH_NS + self._time_ns)
            self._clock_at = now
        told, refusals = self._feed.take()
        for number, log_time, message in messages(told):
            self._last[number] = now, message
            self._channels[number].log(message, log_time=log_time)
        for refusal in refusals:
            self._server.publish_status(f"{refusal}", StatusLevel.Error)

    def _greet(self) -> None:
        """Send the last message of each topic that somebody has begun to watch since.

        The server tells of a subscription before it heeds it, of all that are asked for at once.
        """
        subscribed = self._desk.subscribed
        while not subscribed.empty():
            topic = subscribed.get()
            self._joined |= {n for n, c in enumerate(self._channels) if c.topic() == topic}
            self._joined_at = perf_counter()
        if self._joined and perf_counter() > self._joined_at + JOINING_S:
            self._server.broadcast_time(EPOCH_NS + self._time_ns)
            self._tell_playback()
            for number in sorted(self._joined & self._last.keys()):
                channel, (sent_at, message) = self._channels[number], self._last[number]
                is_state = channel.topic() not in (EVENTS, LOG)  # others do not happen again
                if is_state and sent_at < self._joined_at + JOINING_S / 2:
                    channel.log(message, log_time=EPOCH_NS + self._time_ns)
            self._joined.clear()

    def _grant(self, wish: Wish) -> list[Change]:
        """Change the pace, or return the change to make."""
        if isinstance(wish, Change):
            return [Change(self._time_ns, wish.port, wish.value)]
        if isinstance(wish, ValueError):
            self._server.publish_status(f"{wish}", StatusLevel.Warning)
            return []
        name, value = wish
        self._desk.values[name] = value
        if name == PAUSED:
            self._pace.change(is_paused=value)
        elif name == SPEED:
            self._pace.change(speed=value if value < FASTEST else inf)
        self._tell_playback()
        return []

    def _tell_playback(self, *, is_over: bool = False) -> None:
        pace = self._pace
        self._server.broadcast_playback_state(
            playback(self._time_ns, pace.speed, is_paused=pace.is_paused, is_over=is_over)
        )
