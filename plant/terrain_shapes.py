"""Made terrain: analytic shapes, and sums of random plane waves.

A wave sum makes both the fractal ground and the *synthetic sub-grid roughness*, which stands in for
what an elevation model of 30 to 90 m spacing cannot hold.
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Shape = Literal["flat", "step", "ramp", "cosine_ridges", "fractal"]

EXPONENT = 1.2  # of amplitude over wavelength
ROUGHNESS_WAVES = 60
ROUGHNESS_WAVELENGTHS = (20.0, 150.0)  # m
FRACTAL_WAVES = 200
FRACTAL_BAND = 16.0  # longest over shortest wavelength: four octaves


def made_ground(
    shape: Shape,
    north: Floats,
    east: Floats,
    *,
    height: float,
    start: float,
    run: float,
    slope: float,
    wavelength: float,
    bearing: float,
    seed: int,
) -> Floats:
    """Return the rise (len(north), len(east)) of a shape above its foot; m and rad.

    Parameters
    ----------
    shape
        ``step``: quintic rise from 0 to ``height`` over ``run``; ``ramp``: straight at the angle
        ``slope`` up to ``height``; ``cosine_ridges``: 0 to ``height`` every ``wavelength``; each
        from ``start`` on along ``bearing``. ``fractal``: plane waves no longer than ``wavelength``
        with the rms of ridges of that ``height``, mean 0.
    """
    if shape == "fractal":
        return plane_waves(
            north,
            east,
            rms=height / math.sqrt(8.0),
            wavelengths=(wavelength / FRACTAL_BAND, wavelength),
            count=FRACTAL_WAVES,
            seed=seed,
        )
    along = np.add.outer(north * math.cos(bearing), east * math.sin(bearing))
    x = np.maximum(along - start, 0.0)
    if shape == "step":
        s = np.minimum(x / run, 1.0)
        return height * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    if shape == "ramp":
        return np.minimum(x * math.tan(slope), height)
    if shape == "cosine_ridges":
        return 0.5 * height * (1.0 - np.cos(2.0 * math.pi * x / wavelength))
    return np.zeros_like(x)


def roughness(north: Floats, east: Floats, *, rms: float, seed: int) -> Floats:
    """Return synthetic sub-grid roughness (len(north), len(east)), m: 60 waves of 20 to 150 m."""
    return plane_waves(
        north,
        east,
        rms=rms,
        wavelengths=ROUGHNESS_WAVELENGTHS,
        count=ROUGHNESS_WAVES,
        seed=seed,
    )


def plane_waves(
    north: Floats,
    east: Floats,
    *,
    rms: float,
    wavelengths: tuple[float, float],
    count: int,
    seed: int,
) -> Floats:
    """Return (len(north), len(east)) of ``count`` cosine waves, m, of mean 0 and the given rms.

    Directions and phases are uniform, wavelengths log-uniform between the two given, amplitudes
    proportional to ``wavelength**1.2`` and scaled to ``rms`` over the whole plane. The ground at a
    point depends on the seed only, not on the grid around it.
    """
    rng = np.random.default_rng(seed)
    shortest, longest = wavelengths
    length = shortest * (longest / shortest) ** rng.random(count)
    direction = rng.uniform(0.0, 2.0 * math.pi, count)
    phase = rng.uniform(0.0, 2.0 * math.pi, count)
    amplitude = length**EXPONENT
    amplitude *= rms / math.sqrt(0.5 * float(np.sum(amplitude**2)))
    k = 2.0 * math.pi / length
    a = np.outer(north, k * np.cos(direction)) + phase
    b = np.outer(east, k * np.sin(direction))
    # cos(a + b) as two products; einsum, not BLAS, so that threads cannot change the sum
    left = np.hstack([amplitude * np.cos(a), -amplitude * np.sin(a)])
    right = np.hstack([np.cos(b), np.sin(b)])
    return np.einsum("iw,jw->ij", left, right)
