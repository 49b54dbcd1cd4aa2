"""What Rerun shows of a recording: the scene, followed from behind, with plots and states beside.

Series are fields of the recorded messages, by selectors: nothing is recorded twice.
"""

from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import ComponentSourceKind, VisualizerComponentMapping

from orchestrator.recording.frames import MAP
from orchestrator.viewing.plots import Contents, Field, Plot, flight_plots, states, update_plots

CRAFT = "/scene/craft/fuselage"
COLORS = (0x3B82F6FF, 0xF59E0BFF, 0x14B8A6FF, 0xB05CFFFF, 0xE5484DFF, 0xA1A1AAFF)
FAINT = 0x8B8D98FF
EYE = (-26.0, -14.0, 9.0)  # m from the craft, east, north and up
HIDDEN = ("/scene/terrain_points", "/scene/pose", "/scene/plan")  # drawn better by others


def blueprint(contents: Contents, position: tuple[float, float, float]) -> rrb.Blueprint:
    """Return the blueprint of a recording whose craft starts at a position in m, ENU."""
    pages = {"flight": flight_plots(contents), "updates": update_plots(contents)}
    below: list[Any] = [rrb.TextLogView(origin="/log", name="log")]
    if states(contents):
        below.insert(0, rrb.StateTimelineView(origin="/states", name="states"))
    left = rrb.Vertical(_scene(position), rrb.Horizontal(*below), row_shares=[4, 1])
    tabs = [
        rrb.Vertical(*(_series(plot) for plot in plots), name=name)
        for name, plots in pages.items()
        if plots
    ]
    whole = rrb.Horizontal(left, rrb.Tabs(*tabs), column_shares=[3, 2]) if tabs else left
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


def _scene(position: tuple[float, float, float]) -> rrb.Spatial3DView:
    x, y, z = position
    eye = rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=(x + EYE[0], y + EYE[1], z + EYE[2]),
        look_target=position,
        tracking_entity=CRAFT,
    )
    hidden = [f"- {topic}/**" for topic in HIDDEN]
    return rrb.Spatial3DView(
        name="flight",
        origin="/",
        contents=["+ /scene/**", "+ /tf", *hidden],
        spatial_information=rrb.SpatialInformation(target_frame=MAP),
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
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop),
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
