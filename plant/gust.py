"""Dryden turbulence at low altitude, MIL-F-8785C: one exact filter step per tick.

Longitudinal gusts have the spectrum of ``1/(1 + T s)`` driven by white noise, lateral and vertical
ones that of ``(1 + sqrt(3) T s)/(1 + T s)^2``, with ``T = L/V``. Both filters are carried at unit
variance and sampled exactly (the state transition and its covariance), so that the variance does
not depend on the step; the intensity multiplies the output.
"""

import math
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from annotated_types import Ge

from plant.variables import Execution, Variable, model_description, parameter_variables, unknown

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

FOOT = 0.3048  # m
LOWEST, HIGHEST = 10.0, 1000.0  # ft, between which the low-altitude model holds
SLOWEST = 1.0  # m/s; frozen turbulence would stand still around a hovering aircraft
SQRT3 = math.sqrt(3.0)


@dataclass(frozen=True)
class DrydenGustParameters:
    """How the wind blows."""

    wind_20ft_mps: Annotated[float, Ge(0), "wind at 20 ft, which sets the turbulence"] = 7.7
    mean_north_mps: Annotated[float, "mean wind, the way the air moves"] = 0.0
    mean_east_mps: Annotated[float, "mean wind, the way the air moves"] = 0.0


class Turbulence(NamedTuple):
    """Intensity (m/s) and length (m) of the horizontal and the vertical gusts."""

    sigma_u: float
    sigma_w: float
    L_u: float
    L_w: float


def turbulence(height_m: float, wind_20ft: float) -> Turbulence:
    """Return the low-altitude turbulence of MIL-F-8785C.

    Departure: outside its range, 10 to 1000 ft above ground, the model is held at the nearer end.
    """
    h = min(max(height_m / FOOT, LOWEST), HIGHEST)
    base = 0.177 + 0.000823 * h
    sigma_w = 0.1 * wind_20ft
    return Turbulence(sigma_w / base**0.4, sigma_w, h / base**1.2 * FOOT, h * FOOT)


def first_order(x: float, d: float, noise: float) -> float:
    """Advance the filter 1/(1 + T s) by ``d = step/T``; x keeps variance 1."""
    return math.exp(-d) * x + math.sqrt(-math.expm1(-2.0 * d)) * noise


def second_order(
    x: tuple[float, float], d: float, noise: tuple[float, float]
) -> tuple[float, float]:
    """Advance the cascade 1/(1 + T s), 1/(1 + T s)^2 by ``d = step/T``.

    White noise keeps x at its stationary covariance P = [[1/2, 1/4], [1/4, 1/4]]; the step adds
    noise of covariance P - F P F' with F = exp(-d) [[1, 0], [d, 1]].
    """
    f2 = math.exp(-2.0 * d)
    q11 = 0.5 * (1.0 - f2)
    q12 = 0.25 - f2 * (0.25 + 0.5 * d)
    q22 = 0.25 - f2 * (0.25 + 0.5 * d + 0.5 * d * d)
    a, b = (math.exp(-d) * x[0], math.exp(-d) * (d * x[0] + x[1]))
    l11 = math.sqrt(q11)
    l21 = q12 / l11 if l11 > 0.0 else 0.0
    l22 = math.sqrt(max(q22 - l21 * l21, 0.0))
    return a + l11 * noise[0], b + l21 * noise[0] + l22 * noise[1]


def transverse(x: tuple[float, float]) -> float:
    """Return the output (1 + sqrt(3) T s)/(1 + T s)^2 of the cascade, of variance 1."""
    return SQRT3 * x[0] + (1.0 - SQRT3) * x[1]


class DrydenGust:
    """Mean wind and Dryden turbulence at the aircraft (sampled, 20 Hz).

    Turbulence is frozen in the moving air: it passes at the airspeed (at least 1 m/s), with
    longitudinal gusts along the horizontal airspeed (along the heading where that is below 1 m/s),
    lateral ones to its right and vertical ones down. It starts stationary, and depends on the seed.
    A gust is held until the next tick.
    """

    execution = Execution("sampled", 20.0)

    def __init__(self, parameters: DrydenGustParameters) -> None:
        self._parameters = parameters
        self._inputs = {row.name: 0.0 for row in _INPUTS}
        self.initialize(start_time=0.0)

    def describe(self) -> "ModelDescription":
        """Return the model description of this instance."""
        rows = [*_INPUTS, *_OUTPUTS, *parameter_variables(self._parameters)]
        return model_description("DrydenGust", "wind with turbulence", rows, has_state=True)

    def initialize(
        self, *, start_time: float, stop_time: float | None = None, seed: int = 0
    ) -> None:
        """Draw the turbulence at the start from its stationary distribution."""
        del stop_time
        self._rng = np.random.default_rng(seed)
        self._time = start_time
        noise = self._rng.standard_normal(5).tolist()
        # an infinite step forgets the state before it
        self._u = first_order(0.0, math.inf, noise[0])
        self._v, self._w = (_stationary((noise[i], noise[i + 1])) for i in (1, 3))
        self._wind = self._ned()

    def set(self, values: Mapping[str, Any]) -> None:
        """Set inputs; they hold until set again."""
        for name, value in values.items():
            if name not in self._inputs:
                raise unknown(name, self._inputs)
            self._inputs[name] = float(value)

    def get(self, names: Sequence[str]) -> dict[str, Any]:
        """Return values at the current instant."""
        values = {**self._inputs, **self._wind}
        try:
            return {name: values[name] for name in names}
        except KeyError as error:
            raise unknown(error.args[0], values) from None

    def step(self, time: float, step_size: float) -> int:
        """Let the turbulence pass from the last tick to this one."""
        del step_size
        elapsed, self._time = time - self._time, time
        if elapsed > 0.0:
            _, _, airspeed = self._airspeed()
            t = self._turbulence()
            noise = self._rng.standard_normal(5).tolist()
            d_u, d_w = (max(airspeed, SLOWEST) * elapsed / length for length in (t.L_u, t.L_w))
            self._u = first_order(self._u, d_u, noise[0])
            self._v = second_order(self._v, d_u, (noise[1], noise[2]))
            self._w = second_order(self._w, d_w, (noise[3], noise[4]))
        self._wind = self._ned()
        return 0

    def terminate(self) -> None:
        """Nothing to release."""

    def get_state(self) -> bytes:
        """Return everything that the next step depends on."""
        hidden = {name: getattr(self, name) for name in _HIDDEN}
        return pickle.dumps((hidden, self._rng.bit_generator.state))

    def set_state(self, state: bytes) -> None:
        """Restore what :meth:`get_state` returned, bit for bit."""
        hidden, generator = pickle.loads(state)  # noqa: S301
        for name in _HIDDEN:
            setattr(self, name, hidden[name])
        self._rng.bit_generator.state = generator

    def _turbulence(self) -> Turbulence:
        return turbulence(self._inputs["clearance"], self._parameters.wind_20ft_mps)

    def _airspeed(self) -> tuple[float, float, float]:
        """Return the velocity through the mean air, north and east, and the airspeed, m/s."""
        north = self._inputs["velocity.north"] - self._parameters.mean_north_mps
        east = self._inputs["velocity.east"] - self._parameters.mean_east_mps
        return north, east, math.hypot(north, east, self._inputs["velocity.down"])

    def _ned(self) -> dict[str, float]:
        p, t = self._parameters, self._turbulence()
        north, east, _ = self._airspeed()
        flow = math.atan2(east, north)
        if math.hypot(north, east) < SLOWEST:
            flow = self._inputs["pose.psi"]
        u, v = t.sigma_u * self._u, t.sigma_u * transverse(self._v)
        return {
            "wind.north": p.mean_north_mps + u * math.cos(flow) - v * math.sin(flow),
            "wind.east": p.mean_east_mps + u * math.sin(flow) + v * math.cos(flow),
            "wind.down": t.sigma_w * transverse(self._w),
        }


def _stationary(noise: tuple[float, float]) -> tuple[float, float]:
    """Return a draw from the stationary distribution of :func:`second_order`."""
    return math.sqrt(0.5) * noise[0], math.sqrt(0.125) * (noise[0] + noise[1])


_HIDDEN = ("_inputs", "_time", "_u", "_v", "_w", "_wind")
_INPUTS = (
    *(Variable(f"pose.{n}", "input", "m", f"position {n}") for n in ("north", "east", "down")),
    Variable("pose.phi", "input", "rad", "roll"),
    Variable("pose.theta", "input", "rad", "pitch"),
    Variable("pose.psi", "input", "rad", "heading"),
    *(
        Variable(f"velocity.{n}", "input", "m/s", f"velocity over ground, {n}")
        for n in ("north", "east", "down")
    ),
    Variable("clearance", "input", "m", "height above ground"),
)
_OUTPUTS = tuple(
    Variable(
        f"wind.{n}",
        "output",
        "m/s",
        f"velocity of the air, {n}",
        variability="discrete",
        depends_on=("pose.psi", "velocity", "clearance"),
    )
    for n in ("north", "east", "down")
)
