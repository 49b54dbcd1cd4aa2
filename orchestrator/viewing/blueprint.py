"""What Rerun shows of a recording: the scene, followed from behind, with plots and states beside.

Without a scene the plots take its place.

Series are fields of the recorded messages, by selectors: nothing is recorded twice.
"""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from orchestrator.viewing.plots import Contents, Field, Plot, pages, scene, states

CHASE = "chase"  # a frame that goes along and turns, but does not tilt: x ahead, y left, z up
COLORS = (0x3B82F6FF, 0xF59E0BFF, 0x14B8A6FF, 0xB05CFFFF, 0xE5484DFF, 0xA1A1AAFF)
FAINT = 0x8B8D98FF
EYE, AHEAD = (-9.0, 9.0, 3.4), (3.0, 0.0, -2.6)  # m, in that frame
HIDDEN = ("/scene/terrain_points", "/scene/pose", "/scene/plan")  # drawn better by others


def blueprint(contents: Contents) -> rrb.Blueprint:
    """Return the blueprint of a recording."""
    tabs = [
        rrb.Vertical(*(_series(plot) for plot in plots), name=name)
        for name, plots in pages(contents).items()
    ]
    below: list[Any] = [rrb.TextLogView(origin="/log", name="log")]
    if states(contents):
        below.insert(0, rrb.StateTimelineView(origin="/states", name="states"))
    whole: Any = rrb.Horizontal(*below)
    if drawn := scene(contents):
        whole = rrb.Vertical(_scene(), whole, row_shares=[7, 2])
    if tabs and drawn:
        whole = rrb.Horizontal(whole, rrb.Tabs(*tabs), column_shares=[3, 2])
    elif tabs:
        whole = rrb.Vertical(rrb.Tabs(*tabs), whole, row_shares=[7, 2])
    time = rrb.TimePanel(timeline="message_log_time", state="collapsed")
    return rrb.Blueprint(
        whole, time, rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden")
    )


def line_path(plot: Plot, label: str) -> str:
    """Return the entity of a value that stays."""
    return rr.new_entity_path(["lines", plot.title, plot.unit, label])


def state_path(field: Field) -> str:
    """Return the entity of the texts of an enumeration."""
    return rr.new_entity_path(["states", field.label])


def _scene() -> rrb.Spatial3DView:
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital, position=EYE, look_target=AHEAD, eye_up=(0.0, 0.0, 1.0)
    )
    hidden = [f"- {topic}/**" for topic in HIDDEN]
    return rrb.Spatial3DView(
        name="scene",
        origin="/",
        contents=["+ /scene/**", "+ /tf", "+ /chase", *hidden],
        spatial_information=rrb.SpatialInformation(target_frame=CHASE),
        eye_controls=eye,
        background=rrb.Background(color=(176, 205, 235)),
        line_grid=False,
    )


def _series(plot: Plot) -> rrb.TimeSeriesView:
    """Return the view of one plot."""
    overrides: dict[Any, list[Any]] = {}
    for k, field in enumerate(plot.fields):
        overrides.setdefault(field.topic, []).append(_line(field, COLORS[k % len(COLORS)]))
    lines = [line_path(plot, label) for label in plot.lines]
    return rrb.TimeSeriesView(
        name=f"{plot.title} [{plot.unit}]",
        origin="/",
        contents=[*overrides, *lines],
        overrides=overrides,
        plot_legend=rrb.PlotLegend(rrb.Corner2D.RightTop),
    )


def _line(field: Field, color: int) -> Any:
    """Return the visualizer that draws one field of a topic's messages."""
    mapping = VisualizerComponentMapping(
        target="Scalars:scalars",
        source_kind=ComponentSourceKind.SourceComponent,
        source_component=f"{field.message}:message",
        selector=f".{field.name}",
    )
    return rr.SeriesLines(names=field.label, colors=[color], widths=1.5).visualizer(
        mappings=[mapping]
    )
