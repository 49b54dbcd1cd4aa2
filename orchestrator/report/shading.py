"""Relief as a picture: tints and contours, lit from the upper left, as a PNG with a palette."""

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TINTS, SHADES = 10, 25
LOW, HIGH = (0.80, 0.88, 0.80), (0.99, 0.95, 0.86)  # colours of the lowest and highest tint
CONTOUR = 4  # shades that a contour is darker
NOWHERE = 255  # the palette's transparent entry
LIGHT = np.array([-1.0, 1.0, 1.8]) / np.sqrt(1.0 + 1.0 + 1.8**2)  # to the light: right, up, out
STEEPNESS = 0.4  # rms slope that relief is exaggerated to


def relief(elevation: Array, spacing: float, interval: float) -> bytes:
    """Return a PNG image of ground seen from above.

    Parameters
    ----------
    elevation : (rows, columns) m
        The first row is the upper edge; NaN becomes transparent.
    spacing : float
        Between rows and between columns, m.
    interval : float
        Between contours, m; at most ten of them fit into the range of the elevation.
    """
    unknown = np.isnan(elevation)
    light = np.round(shade(elevation, spacing) * (SHADES - 1))
    level = np.floor(elevation / interval)
    lower = np.minimum(np.roll(level, 1, axis=0), np.roll(level, 1, axis=1))
    upper = np.maximum(np.roll(level, 1, axis=0), np.roll(level, 1, axis=1))
    crossed = (level > lower) | (level < upper)
    crossed[0], crossed[:, 0] = False, False  # they have no neighbour there
    light = np.maximum(light - CONTOUR * crossed, 0)
    tint = level if unknown.all() else np.minimum(level - np.nanmin(level), TINTS - 1)
    index = np.where(unknown, NOWHERE, np.nan_to_num(tint * SHADES + light))
    return png(index.astype(np.uint8), _palette())


def contour_interval(rise: float) -> float:
    """Return a round interval, m, of which fewer than ten fit into a rise, m."""
    rough = max(rise, 0.5) / (TINTS - 2)
    power = 10.0 ** np.floor(np.log10(rough))
    return float(next(m * power for m in (1.0, 2.0, 5.0, 10.0) if m * power >= rough))


def shade(elevation: Array, spacing: float) -> Array:
    """Return how bright ground is under the light, 0 to 1; its slopes are exaggerated.

    Lambert's law. What borders on the unknown counts as level.
    """
    up, right = np.gradient(elevation, spacing)
    slope = np.nan_to_num(np.stack([right, -up]))  # rows run downwards
    rms = float(np.sqrt(np.mean(np.sum(slope**2, axis=0))))
    right, up = slope * min(20.0, STEEPNESS / max(rms, 1e-9))
    facing = (LIGHT[2] - LIGHT[0] * right - LIGHT[1] * up) / np.sqrt(1.0 + right**2 + up**2)
    return np.clip(facing, 0.0, 1.0)


def png(index: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """Return an image of palette indices (rows, columns) as PNG; `palette` is (256, 3) RGB.

    The last entry is transparent. Source: PNG specification, third edition, 11.2.
    """
    rows, columns = index.shape
    filtered = np.zeros((rows, columns + 1), np.uint8)  # each row begins with its filter, none
    filtered[:, 1:] = index
    opacity = np.full(256, 255, np.uint8)
    opacity[NOWHERE] = 0
    parts = [
        (b"IHDR", struct.pack(">2I5B", columns, rows, 8, 3, 0, 0, 0)),
        (b"PLTE", palette.tobytes()),
        (b"tRNS", opacity.tobytes()),
        (b"IDAT", zlib.compress(filtered.tobytes(), 9)),
        (b"IEND", b""),
    ]
    chunks = [
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _palette() -> NDArray[np.uint8]:
    """Return the colours (256, 3), tints times shades."""
    height = np.linspace(0.0, 1.0, TINTS)[:, None, None]
    colour = (1.0 - height) * np.array(LOW) + height * np.array(HIGH)
    light = 0.45 + 0.62 * np.linspace(0.0, 1.0, SHADES)[:, None]
    palette = np.zeros((256, 3), np.uint8)
    mixed = np.clip(colour * light, 0.0, 1.0).reshape(-1, 3)
    palette[: len(mixed)] = np.round(255 * mixed)
    return palette
