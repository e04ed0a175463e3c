"""The maps of a run: the launches with their predicted impact regions, and the whole Earth with
fields of view.
"""

from itertools import chain, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_above, legend_entry, legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.base_map import drawn_ground, drawn_line, drawn_world
from opir_report.maps.projections import MapProjection, WorldProjection, fitting_projection
from opir_report.maps.spheres import cap
from opir_report.palette import INK, MUTED, PAPER, SERIES, Hue
from opir_report.plots.flights import satellite_track
from opir_report.plots.impact import draw_region
from opir_report.run_facts import WIDE_KM2, RunFacts, mapped_rings

#: Width over height of a map.
RATIO = 1.9
_DASHED = (0, (4, 2))
_LAUNCH = legend_entry("launch", marker="o", linestyle="", markersize=5)
_IMPACT = legend_entry("impact", marker="x", linestyle="", markersize=6, markeredgewidth=1.6)
_PREDICTED = legend_entry(
    "predicted impact, 95 % region",
    marker="D",
    markerfacecolor=PAPER,
    linestyle="",
    markersize=5,
)
#: Wide regions are left out with their points.
_WIDE = legend_entry(f"over {1e-6 * WIDE_KM2:g} million km²: not drawn", linestyle="")


def launch_map(axes: Axes, facts: RunFacts, tracks: FigureData) -> Axes:
    """Draw the launches: true ground tracks, launch and impact points, and the last predicted
    impact regions.
    """
    rows = facts.last_with_impact.values()
    regions = [mapped_rings(facts.run.tracks, row) for row in rows]
    places = np.concatenate([_flight_points(facts, tracks), *chain(*filter(None, regions))])
    if not len(places):
        return without_data(axes, "the scene has no launches")
    projection = fitting_projection(places)
    drawn_ground(axes, projection, places, RATIO, least_km=600.0)
    draw_flights(axes, projection, facts, tracks)
    _draw_predictions(axes, projection, facts)
    predicted = [_PREDICTED] if facts.last_with_impact else []
    wide = [_WIDE] if None in regions else []
    legend_of(axes, facts.hues.legend, [_LAUNCH, _IMPACT, *predicted, *wide])
    return axes


def world_map(axes: Axes, facts: RunFacts, tracks: FigureData, views: FigureData) -> Axes:
    """Draw the whole Earth: satellites, the edges of their fields of view, and the launches' ground
    tracks.
    """
    projection = WorldProjection.about(_flight_points(facts, tracks))
    drawn_world(axes, projection)
    _draw_sensors(axes, projection, facts, views)
    draw_flights(axes, projection, facts, tracks)
    return axes


def _places(data: FigureData) -> FloatArray:
    """Return latitudes and longitudes (n, 2), rad, of rows."""
    degrees = np.stack([data["latitude_deg"], data["longitude_deg"]], axis=1)
    return np.radians(degrees.astype(np.float64))


def _flight_points(facts: RunFacts, tracks: FigureData) -> FloatArray:
    """Return points (n, 2), rad, of the ground tracks of launches, with their impacts."""
    impacts = [facts.true_point(target, "impact") for target in range(facts.launches)]
    places = np.concatenate([_places(tracks), np.array(impacts).reshape(-1, 2)])
    return places[np.isfinite(places).all(axis=1)]


def draw_flights(
    axes: Axes, projection: MapProjection, facts: RunFacts, tracks: FigureData
) -> None:
    """Draw ground tracks, thick while the target burns, with launch and impact points."""
    for target, name in enumerate(facts.ids):
        track = tracks.at("target_id", name)
        line = _places(track)
        hue = facts.hues.of_target[target]
        _draw_flight(axes, projection, line, track["is_burning"].astype(np.bool_), hue)
        _draw_point(axes, projection, line[0], color=hue.colour, marker="o", markersize=5)
        impact = np.array(facts.true_point(target, "impact"))
        style: dict[str, Any] = {"marker": "x", "markersize": 7, "markeredgewidth": 1.8}
        _draw_point(axes, projection, impact, color=hue.colour, **style)


def _draw_flight(
    axes: Axes, projection: MapProjection, line: FloatArray, is_burning: FloatArray, hue: Hue
) -> None:
    """Draw the ground track (n, 2) of a target in parts, each from the end of the previous one."""
    changes = np.flatnonzero(np.diff(is_burning)) + 1
    for start, end in pairwise([0, *changes.tolist(), len(line)]):
        style: dict[str, Any] = (
            {"linewidth": 2.6} if is_burning[start] else {"linewidth": 1.2, "linestyle": hue.dashes}
        )
        segment = line[max(start - 1, 0) : end]
        drawn_line(axes, projection, segment, color=hue.colour, zorder=3, **style)


def _draw_point(axes: Axes, projection: MapProjection, place: FloatArray, **style: Any) -> None:
    if np.isfinite(place).all():
        axes.plot(*projection.points(place[:1], place[1:]).T, linestyle="", zorder=4, **style)


def _draw_predictions(axes: Axes, projection: MapProjection, facts: RunFacts) -> None:
    """Draw the predicted impact points and the largest regions of the last estimates, unless these
    are too wide for a map.
    """
    tracks = facts.run.tracks
    for target, row in facts.last_with_impact.items():
        colour = facts.hues.of_target[target].colour
        rings = mapped_rings(tracks, row)
        if rings is None:
            continue
        draw_region(axes, projection, rings, colour, alpha=0.25, linewidth=0.9)
        style = {"color": colour, "marker": "D", "markersize": 4.5, "markerfacecolor": PAPER}
        _draw_point(axes, projection, tracks.impact[row, :2], **style)


def _draw_sensors(
    axes: Axes, projection: MapProjection, facts: RunFacts, views: FigureData
) -> None:
    """Draw the sensors, by type, with the edge of the ground that each can see."""
    colours = {
        name: SERIES[number % len(SERIES)]
        for number, name in enumerate(views.levels("sensor_type"))
    }
    rows = np.unique(facts.run.detections.sensor).tolist()
    detecting = {facts.run.sensors[row].id for row in rows}
    radii = np.radians(views["radius_deg"])
    for sensor, place, radius in zip(facts.plan.sensors, _places(views), radii, strict=True):
        edge = cap(float(place[0]), float(place[1]), float(radius))
        track = satellite_track(facts.plan, sensor)
        is_detecting = sensor.id in detecting
        _draw_sensor(axes, projection, edge, track, colours[sensor.type], is_detecting=is_detecting)
        style = {"color": colours[sensor.type], "fillstyle": "full" if is_detecting else "none"}
        _draw_point(axes, projection, place, marker="s", markersize=5, **style)
    _label_sensors(axes, projection, views)
    marks = [
        legend_entry(name, colour, marker="s", linestyle=_DASHED, markersize=5)
        for name, colour in colours.items()
    ]
    silent = legend_entry(
        "no detection", MUTED, marker="s", fillstyle="none", linestyle="", markersize=5
    )
    legend_above(axes, [*marks, silent])


def _draw_sensor(
    axes: Axes,
    projection: MapProjection,
    edge: FloatArray,
    track: FloatArray,
    colour: str,
    *,
    is_detecting: bool,
) -> None:
    """Draw the edge of a field of view and the ground track of a satellite; both are faint without
    detections.
    """
    style = {
        "color": colour,
        "linewidth": 1.1 if is_detecting else 0.7,
        "alpha": 1.0 if is_detecting else 0.45,
        "zorder": 1.5,
    }
    drawn_line(axes, projection, edge, linestyle=_DASHED, **style)
    if len(track) > 1:
        drawn_line(axes, projection, track, **style)


def _label_sensors(axes: Axes, projection: MapProjection, views: FigureData) -> None:
    """Write the ids of up to 16 sensors, in turn above and below, from west to east."""
    if len(views) > 16:
        return
    points = projection.points(*_places(views).T)
    for rank, row in enumerate(np.argsort(points[:, 0], kind="stable").tolist()):
        is_above = bool(rank % 2)
        axes.annotate(
            views["sensor_id"][row],
            points[row],
            textcoords="offset points",
            xytext=(0, 5 if is_above else -5),
            va="bottom" if is_above else "top",
            fontsize=8,
            color=INK,
            ha="center",
            zorder=6,
        )
