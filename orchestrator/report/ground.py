"""The ground of a recorded flight: made again from its scenario, or what was recorded of it."""

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from numpy.typing import NDArray
from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

from orchestrator.assembly.make import make
from orchestrator.assembly.plans import REFERENCE, make_plans
from orchestrator.errors import ScenarioError
from orchestrator.playback.replay import foreign
from orchestrator.recording.provenance import specification_hashes
from orchestrator.recording.reader import Recording
from orchestrator.recording.scene_terrain import POINT
from orchestrator.scenario.load import load_text

Array = NDArray[np.float64]
"""Elevation, m, at points given in m north and east; NaN where it is not known."""
Elevation = Callable[[Array, Array], Array]
"""Corners of a region: least and largest north, least and largest east, m."""
Region = tuple[float, float, float, float]

POINTS = "/scene/terrain_points"
MOST_CELLS = 4_000_000  # of what was recorded


@dataclass(frozen=True)
class Ground:
    """Elevation of posts: north (n,) and east (m,) in ascending order, elevation (n, m); m."""

    source: str
    north: Array
    east: Array
    elevation: Array

    def over(self, region: Region) -> Elevation:
        """Return the elevation in a region, smooth where it is known throughout."""
        south, top, west, right = region
        rows, columns = _within(self.north, south, top), _within(self.east, west, right)
        north, east, posts = self.north[rows], self.east[columns], self.elevation[rows, columns]
        if min(posts.shape) < 2:
            return lambda north, _: np.full(north.shape, np.nan)
        if np.isnan(posts).any() or min(posts.shape) < 4:
            linear = RegularGridInterpolator((north, east), posts, "linear", False, np.nan)
            return lambda north, east: linear(np.stack([north, east], axis=-1))
        spline = RectBivariateSpline(north, east, posts)

        def smooth(n: Array, e: Array) -> Array:
            inside = (n >= north[0]) & (n <= north[-1]) & (e >= east[0]) & (e <= east[-1])
            return np.where(inside, spline.ev(n, e), np.nan)

        return smooth


def ground(recording: Recording) -> Ground | None:
    """Return the ground that a flight was flown over, as well as it can be known here."""
    return _made_again(recording) or _drawn(recording) or _sensed(recording)


def _made_again(recording: Recording) -> Ground | None:
    """Return the terrain of the scene, if it is ours to make and what it was made of is here."""
    role = REFERENCE.fullmatch(recording.scene.get("terrain", ""))
    if role is None:
        return None
    name = role[1]
    try:
        scenario = load_text(json.dumps(recording.scenario), recording.path)
        wanted = tuple(spec for spec in scenario.resources if spec.name == name)
        only = replace(scenario, resources=wanted, components=())
        if not wanted or foreign(only):
            return None
        plans = make_plans(only)
        path = ("resources", name)
        is_same = specification_hashes(plans)[path] == recording.provenance.get(
            f"resources.{name}.sha256"
        )
        if not is_same or not all(_is_ours(plan.factory) for plan in plans):
            return None
        north, east, elevation = make(plans)[path].surface()
    except (ScenarioError, OSError):
        return None
    return Ground("terrain of the scenario", north, east, elevation)


def _is_ours(factory: object) -> bool:
    """Whether something is a class with a surface: nothing else is called."""
    return isinstance(factory, type) and hasattr(factory, "surface")


def _drawn(recording: Recording) -> Ground | None:
    """Return the posts that were recorded for viewers, a grid in ENU with holes."""
    topic = recording.topics.get(POINTS)
    if topic is None or not topic.raw:
        return None
    data = PointCloud.FromString(topic.raw[0][1]).data
    points = np.frombuffer(data[: len(data) // POINT.itemsize * POINT.itemsize], POINT)
    north, row = np.unique(points["y"].astype(np.float64), return_inverse=True)
    east, column = np.unique(points["x"].astype(np.float64), return_inverse=True)
    if len(north) * len(east) > MOST_CELLS:
        return None
    elevation = np.full((len(north), len(east)), np.nan)
    elevation[row, column] = points["z"]
    return Ground("terrain as recorded for viewers", north, east, elevation)


def _sensed(recording: Recording) -> Ground | None:
    """Return the mean elevation of the cells that a sensor reported, in squares of its cell size.

    A scan is a group with the members north, east, elevation (arrays, a ring), count of all cells
    ever delivered, and cell_size.
    """
    group = recording.scene.get("scan") or _scan(recording)
    members = [f"{group}.{each}" for each in ("north", "east", "elevation", "cell_size", "count")]
    if not group or not all(name in recording.signals for name in members):
        return None
    north, east, elevation, size, count = (recording[name][1] for name in members)
    cell = float(size[-1]) if len(size) and size.ndim == 1 else 0.0
    if north.ndim != 2 or not north.shape == east.shape == elevation.shape or not cell > 0:
        return None
    known = np.isfinite(north + east) & (np.arange(north.shape[1]) < count[:, None])
    if not known.any():
        return None
    row, column = np.round(north[known] / cell), np.round(east[known] / cell)
    rows = np.arange(row.min(), row.max() + 1)
    columns = np.arange(column.min(), column.max() + 1)
    if len(rows) * len(columns) > MOST_CELLS:
        return None
    flat = ((row - rows[0]) * len(columns) + (column - columns[0])).astype(np.intp)
    shape = (len(rows), len(columns))
    count = np.bincount(flat, minlength=shape[0] * shape[1]).reshape(shape)
    total = np.bincount(flat, elevation[known], minlength=shape[0] * shape[1]).reshape(shape)
    with np.errstate(invalid="ignore"):
        return Ground("cells that the sensor reported", rows * cell, columns * cell, total / count)


def _scan(recording: Recording) -> str:
    """Return the group that looks like a scan, where the scene names none."""
    names = (name for name in recording.signals if re.search(r"\bscan\.cell_size$", name))
    return next(names, "").removesuffix(".cell_size")


def _within(posts: Array, low: float, high: float) -> slice:
    """Return the posts around an interval, three more on each side."""
    first = int(np.searchsorted(posts, low)) - 3
    last = int(np.searchsorted(posts, high)) + 3
    return slice(max(first, 0), max(last, 0))
