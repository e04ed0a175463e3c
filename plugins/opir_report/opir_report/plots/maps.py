"""The maps of a run: the launches with their predicted impact regions, and the whole Earth with
fields of view.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_above, legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.base_map import drawn_ground, drawn_line, drawn_world, filled
from opir_report.maps.projections import MapProjection, WorldProjection, fitting_projection
from opir_report.maps.spheres import cap
from opir_report.palette import INK, MUTED, PAPER, SERIES
from opir_report.plots.flights import satellite_track
from opir_report.run_facts import RunFacts, containment_rings

#: Width over height of a map, and the least width of a map of launches, km.
RATIO = 1.9
_LEAST_KM = 600.0
#: Sensors with a label on the map; more would hide each other.
_LABELLED = 16
_DETECTING: dict[str, Any] = {"linewidth": 1.1, "alpha": 1.0}
_SILENT: dict[str, Any] = {"linewidth": 0.7, "alpha": 0.45}
_LAUNCH = Line2D([], [], color=INK, marker="o", linestyle="", markersize=5, label="launch")
_IMPACT = Line2D(
    [], [], color=INK, marker="x", linestyle="", markersize=6, markeredgewidth=1.6, label="impact"
)
_PREDICTED = Line2D(
    [],
    [],
    color=INK,
    marker="D",
    markerfacecolor=PAPER,
    linestyle="",
    markersize=5,
    label="predicted impact, 95 % region",
)


def launch_map(axes: Axes, facts: RunFacts, tracks: FigureData) -> Axes:
    """Draw the launches: true ground tracks, launch and impact points, and the last predicted
    impact regions.
    """
    places = np.concatenate([_flown(facts, tracks), *_outer_regions(facts)])
    if not len(places):
        return without_data(axes, "the scene has no launches")
    projection = fitting_projection(places)
    drawn_ground(axes, projection, places, RATIO, _LEAST_KM)
    _draw_flights(axes, projection, facts, tracks)
    _draw_regions(axes, projection, facts)
    marks = [_LAUNCH, _IMPACT, *([_PREDICTED] if facts.last_with_impact else [])]
    legend_of(axes, facts.hues.legend, marks)
    return axes


def world_map(axes: Axes, facts: RunFacts, tracks: FigureData, views: FigureData) -> Axes:
    """Draw the whole Earth: satellites, the edges of their fields of view, and the launches' ground
    tracks.
    """
    projection = WorldProjection.about(_flown(facts, tracks))
    drawn_world(axes, projection)
    _draw_sensors(axes, projection, facts, views)
    _draw_flights(axes, projection, facts, tracks)
    return axes


def _flown(facts: RunFacts, tracks: FigureData) -> FloatArray:
    """Return points (n, 2), rad, of the ground tracks of launches, with their impacts."""
    flown = np.radians(
        np.stack([tracks["latitude_deg"], tracks["longitude_deg"]], axis=1).astype(np.float64)
    )
    impacts = [facts.true_point(target, "impact") for target in range(facts.launches)]
    places = np.concatenate([flown.reshape(-1, 2), np.array(impacts).reshape(-1, 2)])
    known: FloatArray = places[np.isfinite(places).all(axis=1)]
    return known


def _outer_regions(facts: RunFacts) -> list[FloatArray]:
    """Return the rings (n, 2), rad, of the largest predicted regions of the last estimates."""
    return [
        ring
        for row in facts.last_with_impact.values()
        for _, rings in list(containment_rings(facts.run.tracks, row).values())[-1:]
        for ring in rings
    ]


def _draw_flights(
    axes: Axes, projection: MapProjection, facts: RunFacts, tracks: FigureData
) -> None:
    """Draw ground tracks, thick while the target burns, with launch and impact points."""
    for target, name in enumerate(facts.ids):
        own = tracks.where(tracks["target_id"] == name)
        line = np.radians(np.stack([own["latitude_deg"], own["longitude_deg"]], axis=1))
        hue = facts.hues.of_target[target]
        is_burning = own["is_burning"].astype(np.bool_)
        for part in np.split(np.arange(len(line)), np.flatnonzero(np.diff(is_burning)) + 1):
            thick = (
                {"linewidth": 2.6}
                if is_burning[part[0]]
                else {"linewidth": 1.2, "linestyle": hue.dashes}
            )
            # Each part begins where the one before ends.
            drawn_line(
                axes,
                projection,
                line[max(part[0] - 1, 0) : part[-1] + 1],
                color=hue.colour,
                zorder=3,
                **thick,
            )
        _draw_point(axes, projection, line[0], color=hue.colour, marker="o", markersize=5)
        impact = np.array(facts.true_point(target, "impact"))
        _draw_point(
            axes,
            projection,
            impact,
            color=hue.colour,
            marker="x",
            markersize=7,
            markeredgewidth=1.8,
        )


def _draw_point(axes: Axes, projection: MapProjection, place: FloatArray, **style: Any) -> None:
    if np.isfinite(place).all():
        axes.plot(*projection.points(place[:1], place[1:]).T, linestyle="", zorder=4, **style)


def _draw_regions(axes: Axes, projection: MapProjection, facts: RunFacts) -> None:
    """Draw the predicted impact points and the largest regions of the last estimates."""
    for target, row in facts.last_with_impact.items():
        colour = facts.hues.of_target[target].colour
        regions = containment_rings(facts.run.tracks, row)
        for _, rings in list(regions.values())[-1:]:
            filled(axes, projection, rings, facecolor=colour, alpha=0.25, linewidth=0.0, zorder=2)
            filled(
                axes,
                projection,
                rings,
                facecolor="none",
                edgecolor=colour,
                linewidth=0.9,
                zorder=2.1,
            )
        style = {"color": colour, "marker": "D", "markersize": 4.5, "markerfacecolor": PAPER}
        _draw_point(axes, projection, facts.run.tracks.impact[row, :2], **style)


def _draw_sensors(
    axes: Axes, projection: MapProjection, facts: RunFacts, views: FigureData
) -> None:
    """Draw the sensors, by type, with the edge of the ground that each can see."""
    types = list(dict.fromkeys(views["sensor_type"].tolist()))
    detecting = {
        facts.run.sensors[each].id for each in np.unique(facts.run.detections.sensor).tolist()
    }
    for row, sensor in enumerate(facts.plan.sensors):
        colour = SERIES[types.index(sensor.type) % len(SERIES)]
        place = np.radians([views["latitude_deg"][row], views["longitude_deg"][row]])
        is_seen = sensor.id in detecting
        style = {
            "color": colour,
            "linewidth": 1.1 if is_seen else 0.7,
            "alpha": 1.0 if is_seen else 0.45,
            "zorder": 1.5,
        }
        radius = float(np.radians(views["radius_deg"][row]))
        drawn_line(
            axes,
            projection,
            cap(float(place[0]), float(place[1]), radius),
            linestyle=(0, (4, 2)),
            **style,
        )
        track = satellite_track(facts.plan, sensor)
        if len(track) > 1:
            drawn_line(axes, projection, track, **style)
        _draw_point(
            axes,
            projection,
            place,
            color=colour,
            marker="s",
            markersize=5,
            fillstyle="full" if is_seen else "none",
        )
    _label_sensors(axes, projection, views)
    marks = [
        Line2D(
            [],
            [],
            color=SERIES[number % len(SERIES)],
            marker="s",
            linestyle=(0, (4, 2)),
            markersize=5,
            label=name,
        )
        for number, name in enumerate(types)
    ]
    quiet = Line2D(
        [],
        [],
        color=MUTED,
        marker="s",
        fillstyle="none",
        linestyle="",
        markersize=5,
        label="no detection",
    )
    legend_above(axes, [*marks, quiet])


def _label_sensors(axes: Axes, projection: MapProjection, views: FigureData) -> None:
    """Write the ids of a few sensors, in turn above and below, from west to east."""
    if len(views) > _LABELLED:
        return
    places = projection.points(*np.radians([views["latitude_deg"], views["longitude_deg"]]))
    for rank, row in enumerate(np.argsort(places[:, 0], kind="stable").tolist()):
        above: dict[str, Any] = (
            {"xytext": (0, 5), "va": "bottom"} if rank % 2 else {"xytext": (0, -5), "va": "top"}
        )
        name = views["sensor_id"][row]
        style: dict[str, Any] = {"fontsize": 8, "color": INK, "ha": "center", "zorder": 6}
        axes.annotate(name, places[row], textcoords="offset points", **above, **style)
