"""Components small enough to see through: a glider over flat ground, and who steers it."""

# ruff: noqa: D102  (the methods are the contract's)

import os
import signal
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Le, Len

from plant.variables import Execution, Variable, model_description, parameter_variables

SCENARIO = """\
title: A glider
duration_s: 10
resources:
  ground: {use: small_components:Ground, parameters: {file: ground.txt}}
components:
  glider:
    use: small_components:Glider
    rate_hz: 20
    parameters:
      altitude_m: 90
      ground: ${ground}
  pilot:
    use: small_components:Pilot
    parameters: {gain_per_s: 0.5}
connections:
  - glider.state -> pilot.state
  - {from: pilot.command, to: glider.command, delay_s: 0.05}
events:
  - {at_s: 5, set: pilot.height_m, value: 50.0}
scene: {clearance: glider.clearance, height_agl: pilot.height_m}
end_on: [glider.outcome]
"""
GROUND = "10"  # the elevation in ground.txt


@dataclass(frozen=True)
class GroundParameters:
    """What the ground is like."""

    file: Annotated[Path, "text file that holds the elevation, m"]
    offset_m: Annotated[float, "added to the elevation"] = 0.0


class Ground:
    """A resource: flat ground."""

    def __init__(self, parameters: GroundParameters) -> None:
        text = parameters.file.read_text()
        try:
            self.elevation = float(text) + parameters.offset_m
        except ValueError:
            raise ValueError(f"file: truncated, got {text!r}, expected an elevation") from None


class Link:
    """A resource that needs another and takes no parameters."""

    def __init__(self, *, other) -> None:
        self.other = other


@dataclass(frozen=True)
class Wing:
    """A part of the glider."""

    span_m: Annotated[float, Ge(0), "tip to tip"] = 2.0
    chord_m: Annotated[float, Ge(0), "front to back"] = 0.1

    def __post_init__(self):
        if self.chord_m > self.span_m:
            raise ValueError(
                f"chord_m: above the span, got {self.chord_m} m, expected up to {self.span_m} m"
            )


@dataclass(frozen=True)
class GliderParameters:
    """What the glider is like."""

    altitude_m: Annotated[float, Ge(0), Le(1000), "at the start"] = 100.0
    speed_mps: Annotated[float, Ge(0), "of the air"] = 20.0
    crew: Annotated[int, Ge(0), "people"] = 1
    has_gear: Annotated[bool, "whether there are wheels"] = False
    preset: Annotated[Literal["club", "racer"], "what it was built for"] = "club"
    wing: Annotated[Wing, "the main one"] = field(default_factory=Wing)
    start_m: Annotated[tuple[float, float], "north, east"] = (0.0, 0.0)
    waypoints_m: Annotated[tuple[tuple[float, float], ...], "north, east of each"] = ()
    trim_deg: Annotated[float | None, "None finds it"] = None


def known(values, names):
    """Raise KeyError for what is not among the names."""
    for name in values:
        if name not in names:
            raise KeyError(f"no variable {name!r}, expected one of {sorted(names)}")


class Glider:
    """Continuous: climbs as told, flies north at its speed, collides with the ground."""

    execution = Execution("continuous", 20.0)

    def __init__(self, parameters: GliderParameters, *, ground: Ground | None = None) -> None:
        self.parameters = parameters
        self.elevation = ground.elevation if ground else 0.0
        if parameters.altitude_m < self.elevation:
            raise ValueError(
                f"altitude_m: below ground, got {parameters.altitude_m} m, "
                f"expected {self.elevation} m or more"
            )
        self.climb = 0.0
        self.north, self.altitude = parameters.start_m[0], parameters.altitude_m

    def describe(self):
        return model_description(
            "Glider",
            "a point that climbs as it is told",
            [
                Variable("command.climb", "input", "m/s", "rate of climb"),
                Variable("state.north", "output", "m", "position"),
                Variable("state.altitude", "output", "m", "position"),
                Variable("state.climb", "output", "m/s", "now", depends_on=("command.climb",)),
                Variable("clearance", "output", "m", "above ground"),
                Variable("trail", "output", "m", "altitude, three times", shape=(3,)),
                Variable("outcome", "output", "1", "how", start=0, items=("flying", "collision")),
                *parameter_variables(self.parameters),
            ],
        )

    def initialize(self, *, start_time, stop_time, seed):
        pass

    def set(self, values):
        known(values, {"command.climb"})
        self.climb = values.get("command.climb", self.climb)

    def get(self, names):
        values = {
            "state.north": self.north,
            "state.altitude": self.altitude,
            "state.climb": self.climb,
            "clearance": self.altitude - self.elevation,
            "trail": np.full(3, self.altitude),
            "outcome": int(self.altitude < self.elevation),
        }
        known(names, values)
        return {name: values[name] for name in names}

    def step(self, time, step_size):
        self.north += step_size * self.parameters.speed_mps
        self.altitude += step_size * self.climb
        return 0

    def terminate(self):
        pass


class Keeper(Glider):
    """A glider that keeps what it was given."""

    def __init__(self, parameters: GliderParameters, *, ground: Ground) -> None:
        super().__init__(parameters, ground=ground)
        self.ground = ground


@dataclass(frozen=True)
class PilotParameters:
    """What the pilot wants."""

    height_m: Annotated[float, Le(1000), "altitude to hold"] = 100.0
    gain_per_s: Annotated[float, Ge(0), "climb per altitude error"] = 0.5
    names: Annotated[list[str], Len(0, 2), "of the crew"] = field(default_factory=list)


class Pilot:
    """Sampled: steers towards an altitude."""

    execution = Execution("sampled", 2.0)

    def __init__(self, parameters: PilotParameters, *, latency_s: float = 0.0) -> None:
        self.parameters = parameters
        self.latency_s = latency_s
        self.values = {
            "state.north": 0.0,
            "state.altitude": 0.0,
            "state.climb": 0.0,
            "trail": np.zeros(2),
            "height_m": parameters.height_m,
        }
        self.climb = 0.0

    def describe(self):
        return model_description(
            "Pilot",
            "steers towards an altitude",
            [
                Variable("state.north", "input", "m", "position"),
                Variable("state.altitude", "input", "m", "position"),
                Variable("state.climb", "input", "m/s", "now"),
                Variable("trail", "input", "m", "altitudes", shape=(2,)),
                Variable("command.climb", "output", "m/s", "rate", depends_on=("state",)),
                *parameter_variables(self.parameters, tunable=["height_m"]),
            ],
        )

    def initialize(self, *, start_time, stop_time, seed):
        self.step(start_time, 0.0)

    def set(self, values):
        known(values, self.values)
        self.values |= values

    def get(self, names):
        known(names, {"command.climb"})
        return dict.fromkeys(names, self.climb)

    def step(self, time, step_size):
        error = self.values["height_m"] - self.values["state.altitude"]
        self.climb = self.parameters.gain_per_s * error
        return 0

    def terminate(self):
        pass


class Interrupter(Pilot):
    """A pilot who presses Ctrl-C after one second."""

    def step(self, time, step_size):
        if time >= 1.0:
            os.kill(os.getpid(), signal.SIGINT)
        return super().step(time, step_size)


class Refuser(Pilot):
    """A pilot who cannot start."""

    def initialize(self, *, start_time, stop_time, seed):
        raise ValueError("start outside the terrain, got north 5 m, expected up to 3 m")


class Failing(Pilot):
    """A pilot who fails in flight."""

    def step(self, time, step_size):
        return 3 if time >= 1.0 else 0


def broken(parameters: PilotParameters) -> Pilot:
    """Fail as only a defect can."""
    raise RuntimeError("a defect")


not_callable = 3
