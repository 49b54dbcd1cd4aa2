"""A layout for Lichtblick and Foxglove: the scene, followed, with plots, states and log beside.

Without a scene the plots take its place.

The form is that of Lichtblick's layout files; every path in it is a field of the recording.
"""

import json
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

from orchestrator.recording.frames import BODY
from orchestrator.recording.topics import LOG
from orchestrator.viewing.plots import Contents, Field, Plot, pages, scene, states

NAME = "lichtblick-layout.json"  # of the attachment
COLORS = ("#3b82f6", "#f59e0b", "#14b8a6", "#b05cff", "#e5484d", "#a1a1aa")
FAINT = "#8b8d98"
CAMERA = {
    "perspective": True, "distance": 24, "phi": 68, "thetaOffset": 20,
    "targetOffset": [0, 0, 0], "target": [0, 0, 0], "targetOrientation": [0, 0, 0, 1],
    "fovy": 45, "near": 0.2, "far": 20000,
}  # fmt: skip
SETTINGS: Mapping[str, Mapping[str, Any]] = {  # of topics that need more than to be visible
    "/scene/pose": {"type": "axis", "axisScale": 2},
    "/scene/plan": {"type": "line"},
    "/scene/terrain_points": {"colorMode": "rgba-fields", "pointSize": 2},
    "/scene/sensed": {"colorMode": "rgba-fields", "pointSize": 4},
}
TWICE = ("/scene/terrain_points", "/scene/pose", "/scene/plan")  # drawn better by others


def layout(contents: Contents) -> dict[str, Any]:
    """Return the layout as plain data."""
    panels: dict[str, Any] = {"RosOut!log": _log()}
    tree: Any = "RosOut!log"
    if enumerations := states(contents):
        panels["StateTransitions!states"] = {
            "paths": [_series(field) for field in enumerations],
            "isSynced": True,
        }
        tree = _split("row", "StateTransitions!states", tree, 55)
    if drawn := scene(contents):
        panels["3D!scene"] = _scene(drawn)
        tree = _split("column", "3D!scene", tree, 76)
    tabs: list[dict[str, Any]] = []
    number = count(1)
    for title, plots in pages(contents).items():
        named = {f"Plot!{next(number)}": _plot(plot) for plot in plots}
        panels |= named
        tabs.append({"title": title, "layout": _column(list(named))})
    if tabs:
        panels["Tab!plots"] = {"activeTabIdx": 0, "tabs": tabs}
        beside = _split("row", tree, "Tab!plots", 58)
        tree = beside if drawn else _split("column", "Tab!plots", tree, 76)
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": tree,
    }


def layout_json(contents: Contents) -> bytes:
    """Return the layout as a file."""
    return json.dumps(layout(contents), indent=1, ensure_ascii=False).encode()


def _scene(drawn: Sequence[str]) -> dict[str, Any]:
    """Return the 3D panel: all that there is to be seen is visible."""
    return {
        "lichtblickPanelTitle": "flight",
        "followTf": BODY,
        "followMode": "follow-position",
        "scene": {
            "backgroundColor": "#b0cdeb",
            "transforms": {"enablePreloading": True, "axisScale": 0},
        },
        "cameraState": CAMERA,
        "topics": {
            name: {"visible": name not in TWICE, **SETTINGS.get(name, {})} for name in drawn
        },
        "layers": {},
    }


def _plot(plot: Plot) -> dict[str, Any]:
    title = f"{plot.title} [{plot.unit}]"
    series = [
        {**_series(field), "color": COLORS[k % len(COLORS)]} for k, field in enumerate(plot.fields)
    ]
    lines = [
        {
            "value": f"{value:g}",
            "enabled": True,
            "timestampMethod": "receiveTime",
            "label": f"{label} [{plot.unit}]",
            "color": FAINT,
        }
        for label, value in plot.lines.items()
    ]
    return {
        "lichtblickPanelTitle": title,
        "foxglovePanelTitle": title,
        "paths": [*series, *lines],
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _series(field: Field) -> dict[str, Any]:
    return {
        "value": f"{field.topic}.{field.name}",
        "enabled": True,
        "timestampMethod": "receiveTime",
        "label": field.label,
    }


def _log() -> dict[str, Any]:
    return {"topicToRender": LOG, "minLogLevel": 1, "searchTerms": []}


def _column(panels: Sequence[str]) -> Any:
    """Return panels below each other, equally high."""
    first, *others = panels
    return _split("column", first, _column(others), 100 / len(panels)) if others else first


def _split(direction: str, first: Any, second: Any, percentage: float) -> dict[str, Any]:
    return {
        "direction": direction,
        "splitPercentage": percentage,
        "first": first,
        "second": second,
    }
