"""A viewer: a client of the Foxglove WebSocket protocol that keeps all it hears."""

import json
import struct
import threading
from contextlib import ExitStack

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

SUBPROTOCOL = "foxglove.sdk.v1"
MESSAGE, TIME, PLAYBACK = 1, 2, 5  # first bytes of what a server sends; all else is JSON
CONTROL = 3  # and of what a client sends


class Viewer:
    """Subscribes to whatever is offered, on a thread of its own.

    Attributes
    ----------
    said : list
        Everything in JSON, in order.
    channels : dict
        What was offered, by topic.
    messages : dict
        (log time, bytes) by topic; one that comes twice in a row is kept once.
    """

    def __init__(self, address, *, subscribes=True):
        self.said, self.channels, self.messages, self.times, self.states = [], {}, {}, [], []
        self.subscribes = subscribes
        self._topics = {}
        self._heard = threading.Condition()
        self._open = ExitStack()
        self._socket = self._open.enter_context(
            connect(address, subprotocols=[SUBPROTOCOL], max_size=None)
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        self.wait(lambda: self.said)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._open.close()
        self._thread.join()

    def send(self, **message):
        """Send a request."""
        self._socket.send(json.dumps(message))

    def set(self, **parameters):
        """Ask for values; underscores at the end of a name's first word stand for the dot."""
        named = [
            {"name": name.replace("__", "."), "value": value} for name, value in parameters.items()
        ]
        self.send(op="setParameters", parameters=named, id="set")

    def control(self, command, speed):
        """Ask to play (0) or to pause (1)."""
        self._socket.send(struct.pack("<BBfBQI", CONTROL, command, speed, 0, 0, 2) + b"id")

    def subscribe(self, topics):
        """Watch topics that were offered."""
        wanted = [
            {"id": len(self._topics) + k, "channelId": self.channels[topic]["id"]}
            for k, topic in enumerate(topics)
        ]
        self._topics |= {one["id"]: topic for one, topic in zip(wanted, topics, strict=True)}
        for topic in topics:
            self.messages.setdefault(topic, [])
        self.send(op="subscribe", subscriptions=wanted)

    def wait(self, condition, timeout=20):
        """Wait until something has been heard."""
        with self._heard:
            assert self._heard.wait_for(condition, timeout), "the viewer waits in vain"

    def answers(self, op):
        """Return what was said of one kind."""
        return [one for one in self.said if one["op"] == op]

    def _listen(self):
        try:
            for data in self._socket:
                with self._heard:
                    self._hear(data)
                    self._heard.notify_all()
        except ConnectionClosed:
            pass

    def _hear(self, data):
        if isinstance(data, str):
            said = json.loads(data)
            self.said.append(said)
            if said["op"] == "advertise":
                new = {channel["topic"]: channel for channel in said["channels"]}
                self.channels |= new
                if self.subscribes:
                    self.subscribe(list(new))
        elif data[0] == MESSAGE:
            _, subscription, time = struct.unpack_from("<BIQ", data)
            heard = self.messages[self._topics[subscription]]
            if not heard or heard[-1] != (time, data[13:]):
                heard.append((time, data[13:]))
        elif data[0] == TIME:
            self.times.append(struct.unpack_from("<BQ", data)[1])
        elif data[0] == PLAYBACK:
            self.states.append(struct.unpack_from("<BBQf", data)[1:])
