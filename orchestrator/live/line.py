"""One line that says how a run goes: time, height above ground, speed, cost, real-time factor."""

from collections import deque
from collections.abc import Callable, Mapping
from math import hypot
from time import perf_counter
from typing import Any, cast

from orchestrator.assembly.system import System
from orchestrator.component import Value

EVERY_S = 0.2
WINDOW = 6  # lines over which the real-time factor is taken


class Line:
    """Keeps what the line shows; the scene's roles say which signals they are.

    Parameters
    ----------
    show
        Takes the line, a few times per second of wall-clock time.
    """

    def __init__(self, system: System, show: Callable[[str], None]) -> None:
        scene = system.scenario.scene
        known = {str(port) for ports in system.ports.values() for port in ports.values()}
        planner = scene.get("plan", "").partition(".")[0]
        velocity = scene.get("velocity", "")
        named = {
            "height {:.1f} m": [scene.get("clearance", "")],
            "speed {:.1f} m/s": [f"{velocity}.{axis}" for axis in ("north", "east")],
            "cost {:.3g}": [f"{planner}.cost.after"],
        }
        self._shown = [
            (form, [name.partition(".")[::2] for name in names])
            for form, names in named.items()
            if known.issuperset(names)
        ]
        self._show = show
        self._newest: dict[str, Mapping[str, Value]] = {}
        self._past: deque[tuple[float, int]] = deque(maxlen=WINDOW)

    def outputs(self, component: str, values: Mapping[str, Value]) -> None:
        """Keep a component's newest outputs."""
        self._newest[component] = values

    def update(self, time_ns: int, *, is_paused: bool) -> None:
        """Show the line, if it is time to."""
        now = perf_counter()
        if self._past and now < self._past[-1][0] + EVERY_S:
            return
        self._past.append((now, time_ns))
        self._show(self._text(time_ns, is_paused=is_paused))

    def _text(self, time_ns: int, *, is_paused: bool) -> str:
        parts = [f"t {time_ns / 1e9:.1f} s"]
        for form, names in self._shown:
            if all(component in self._newest for component, _ in names):
                numbers = (cast(Any, self._newest[c][name]) for c, name in names)
                parts.append(form.format(hypot(*numbers) if len(names) > 1 else next(numbers)))
        (then, then_ns), (now, now_ns) = self._past[0], self._past[-1]
        if is_paused:
            parts.append("paused")
        elif now > then:
            parts.append(f"{(now_ns - then_ns) / 1e9 / (now - then):.2f} x real time")
        return ", ".join(parts)
