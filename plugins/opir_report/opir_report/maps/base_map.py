"""The ground of a map: sea, land, graticule with labels, and the axes' limits."""

import json
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path as Outline

from opir_core.arrays import FloatArray
from opir_report.maps.clipping import clipped
from opir_report.maps.projections import MapProjection, RegionProjection, WorldProjection, nice_step
from opir_report.maps.spheres import EARTH_RADIUS_KM
from opir_report.palette import COAST, GRID, LAND, MUTED, SEA

_STEPS_DEG = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 30.0)
#: Points of a line of the graticule.
_LINE_POINTS = 121

#: A place along an axis and its label.
Tick = tuple[float, str]


@cache
def coast_rings() -> tuple[FloatArray, ...]:
    """Return the rings of land, closed, latitude and longitude in rad, with land on the left."""
    document = json.loads((Path(__file__).parent / "coast.json").read_text(encoding="utf-8"))
    rings = [
        np.radians(np.array(ring, dtype=np.float64).reshape(-1, 2)[::-1, ::-1] / 10.0)
        for ring in document["rings"]
    ]
    return tuple(
        np.concatenate([ring, ring[:1]]) if (ring[0] != ring[-1]).any() else ring for ring in rings
    )


def filled(axes: Axes, projection: MapProjection, rings: list[FloatArray], **style: Any) -> None:
    """Fill the region on the left of rings (n, 2) of latitudes and longitudes, within the limits of
    the axes.
    """
    limits = axes.get_xlim(), axes.get_ylim()
    curves = [clipped(curve, *limits) for curve in projection.curves(rings)]
    # Closed curves of three points enclose nothing.
    curves = [curve for curve in curves if len(curve) > 3]
    if curves:
        codes = [
            [Outline.MOVETO, *[Outline.LINETO] * (len(curve) - 2), Outline.CLOSEPOLY]
            for curve in curves
        ]
        axes.add_patch(PathPatch(Outline(np.concatenate(curves), np.concatenate(codes)), **style))


def drawn_line(axes: Axes, projection: MapProjection, line: FloatArray, **style: Any) -> None:
    """Draw a line (n, 2) of latitudes and longitudes."""
    gap = np.full((1, 2), np.nan)
    pieces = [piece for segment in projection.lines(line) for piece in (segment, gap)][:-1]
    if pieces:
        axes.plot(*np.concatenate(pieces).T, **style)


def drawn_world(axes: Axes, projection: WorldProjection) -> None:
    """Draw the ground of a map of the whole Earth, which cuts off what is drawn beyond its edge."""
    edge = projection.edge
    axes.patch = PathPatch(Outline(edge), transform=axes.transData, facecolor=SEA, edgecolor="none")
    axes.patch.set_figure(axes.figure)
    (west, south), (east, north) = edge.min(axis=0), edge.max(axis=0)
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal")
    axes.plot(*edge.T, color=MUTED, linewidth=0.8, clip_on=False, zorder=0.8)
    _land(axes, projection)
    _world_graticule(axes, projection)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0.0, labelsize=8)


def _world_graticule(axes: Axes, projection: WorldProjection) -> None:
    """Draw meridians and parallels, labelled below the map and left of it."""
    axes.grid(False)
    west = np.ceil((projection.longitude_deg - 180.0) / 60.0) * 60.0
    meridians = np.arange(west, west + 359.0, 60.0)
    parallels = np.arange(-60.0, 61.0, 30.0)
    latitudes = np.linspace(-90.0, 90.0, _LINE_POINTS)
    longitudes = projection.longitude_deg + np.linspace(-179.9, 179.9, 361)
    for longitude in meridians:
        _draw_grid(axes, projection, latitudes, longitude)
    for latitude in parallels:
        _draw_grid(axes, projection, latitude, longitudes)
    _label_world(axes, projection, meridians, parallels)


def _label_world(
    axes: Axes, projection: WorldProjection, meridians: FloatArray, parallels: FloatArray
) -> None:
    """Label meridians at the south pole and parallels at the left edge."""
    pole = projection.points(np.full(len(meridians), -0.5 * np.pi), np.radians(meridians))
    ticks = zip(pole[:, 0].tolist(), map(longitude_text, meridians), strict=True)
    # The pole is short: labels keep 17 % of the width apart.
    _set_ticks(axes.set_xticks, _separate(ticks, 0.17 * float(np.ptp(axes.get_xlim()))))
    edge = projection.points(np.radians(parallels), np.zeros(len(parallels)))
    _set_ticks(
        axes.set_yticks, zip(edge[:, 1].tolist(), map(latitude_text, parallels), strict=True)
    )


def _draw_grid(
    axes: Axes,
    projection: MapProjection,
    latitude_deg: FloatArray | float,
    longitude_deg: FloatArray | float,
) -> FloatArray:
    """Draw a line of the graticule, of one latitude or one longitude; return it on the map (n,
    2).
    """
    degrees = np.broadcast_arrays(latitude_deg, longitude_deg)
    line = projection.points(*np.radians(degrees))
    axes.plot(*line.T, color=GRID, linewidth=0.6, zorder=0.7)
    return line


def drawn_ground(
    axes: Axes,
    projection: MapProjection,
    places: FloatArray,
    ratio: float,
    least_km: float,
    meridians: int = 9,
) -> None:
    """Draw the ground of a map of points (n, 2): that of the whole Earth, or as `drawn_region`
    does.
    """
    if isinstance(projection, WorldProjection):
        drawn_world(axes, projection)
    else:
        drawn_region(axes, projection, places, ratio, least_km, meridians)


def drawn_region(
    axes: Axes,
    projection: RegionProjection,
    places: FloatArray,
    ratio: float,
    least_km: float,
    meridians: int,
) -> None:
    """Draw the ground of a map of points (n, 2), with a margin and at least so wide.

    `ratio` is width over height, `meridians` the most meridians of the graticule.
    """
    flat = projection.points(places[:, 0], places[:, 1])
    low = flat.min(axis=0)
    high = flat.max(axis=0)
    middle = 0.5 * (low + high)
    span = 1.25 * (high - low)
    width = max(float(span[0]), ratio * float(span[1]), least_km)
    half = 0.5 * np.array([width, width / ratio])
    (west, south), (east, north) = middle - half, middle + half
    axes.set(xlim=(west, east), ylim=(south, north), aspect="equal", facecolor=SEA)
    _land(axes, projection)
    width_deg = width / (EARTH_RADIUS_KM * np.radians(1.0))
    _graticule(axes, projection, nice_step(width_deg, meridians, _STEPS_DEG))
    axes.spines[["top", "right"]].set_visible(True)
    axes.tick_params(length=2.5, labelsize=8)


def _land(axes: Axes, projection: MapProjection) -> None:
    filled(
        axes,
        projection,
        list(coast_rings()),
        facecolor=LAND,
        edgecolor=COAST,
        linewidth=0.5,
        zorder=0.5,
    )


def _graticule(axes: Axes, projection: RegionProjection, step_deg: float) -> None:
    """Draw meridians and parallels, and label them where they cross the lower and the left edge."""
    axes.grid(False)
    (west, east), (south, north) = axes.get_xlim(), axes.get_ylim()
    parallels, meridians = _visible_grid(projection, (west, east), (south, north), step_deg)
    latitudes = np.linspace(max(parallels[0], -89.9), min(parallels[-1], 89.9), _LINE_POINTS)
    longitudes = np.linspace(meridians[0], meridians[-1], _LINE_POINTS)
    x_ticks = [
        (x, longitude_text(longitude))
        for longitude in meridians.tolist()
        for x in _crossings(
            _draw_grid(axes, projection, latitudes, longitude)[:, ::-1], south, west, east
        )
    ]
    y_ticks = [
        (y, latitude_text(latitude))
        for latitude in parallels.tolist()
        for y in _crossings(_draw_grid(axes, projection, latitude, longitudes), west, south, north)
    ]
    _set_ticks(axes.set_xticks, _separate(x_ticks, 0.2 * (east - west)))
    _set_ticks(axes.set_yticks, _separate(y_ticks, 0.0))
    if len(y_ticks) < 2 and len(parallels) > 4:
        _label_inside(axes, projection, parallels)
    axes.set(xlim=(west, east), ylim=(south, north))


def _set_ticks(
    set_ticks: Callable[[list[float], list[str]], object], ticks: Iterable[Tick]
) -> None:
    labels = dict(ticks)
    set_ticks(list(labels), list(labels.values()))


def _separate(ticks: Iterable[Tick], gap: float) -> list[Tick]:
    """Return the ticks that keep a distance from the previous one, in order."""
    separate = list[Tick]()
    for tick in sorted(ticks):
        if not separate or tick[0] - separate[-1][0] >= gap:
            separate.append(tick)
    return separate


def _label_inside(axes: Axes, projection: RegionProjection, parallels: FloatArray) -> None:
    """Write latitudes beside the meridian of the centre, where parallels do not cross the map's
    left edge.
    """
    centre = np.full(len(parallels), projection.centre[1])
    points = projection.points(np.radians(parallels), centre)
    for point, latitude in zip(points, parallels.tolist(), strict=True):
        if abs(latitude) < 90.0:
            axes.annotate(
                latitude_text(latitude),
                point,
                (3, 2),
                textcoords="offset points",
                fontsize=8,
                color=MUTED,
                clip_on=True,
                annotation_clip=True,
            )


def _visible_grid(
    projection: RegionProjection, x: tuple[float, float], y: tuple[float, float], step_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Return the parallels and meridians, degrees, that cover a map; all meridians if it shows a
    pole.
    """
    grid = np.meshgrid(np.linspace(*x, 25), np.linspace(*y, 25))
    places = np.degrees(projection.places(np.stack([values.ravel() for values in grid], axis=1)))
    centre_deg = np.degrees(projection.centre[1])
    east_deg = np.mod(places[:, 1] - centre_deg + 180.0, 360.0) - 180.0
    low = float(east_deg.min()) + centre_deg
    high = float(east_deg.max()) + centre_deg
    poles = projection.points(np.radians(np.array([90.0, -90.0])), np.zeros(2))
    has_pole = np.all((poles > (x[0], y[0])) & (poles < (x[1], y[1])), axis=1)
    if has_pole.any():
        low = -180.0
        high = 180.0 - 2.0 * step_deg
    parallels = (
        -90.0 if has_pole[1] else float(places[:, 0].min()),
        90.0 if has_pole[0] else float(places[:, 0].max()),
    )
    return _multiples(*parallels, step_deg), _multiples(low, high, step_deg)


def _multiples(low: float, high: float, step: float) -> FloatArray:
    """Return the multiples of a step from the last one below to the first one above."""
    return np.arange(np.floor(low / step), np.ceil(high / step) + 1.0) * step


def _crossings(line: FloatArray, edge: float, low: float, high: float) -> list[float]:
    """Return the second coordinates, within [low, high], where a line (n, 2) has its first one
    equal to `edge`.
    """
    distance = line[:, 0] - edge
    rows = np.flatnonzero(distance[:-1] * distance[1:] < 0.0)
    share = distance[rows] / (distance[rows] - distance[rows + 1])
    values = line[rows, 1] + share * (line[rows + 1, 1] - line[rows, 1])
    return [value for value in values.tolist() if low <= value <= high]


def longitude_text(longitude_deg: float) -> str:
    """Return a whole longitude as text, `150° W`."""
    east = (longitude_deg + 180.0) % 360.0 - 180.0
    side = "" if round(east, 2) in (0.0, -180.0, 180.0) else (" E" if east > 0.0 else " W")
    return f"{abs(round(east, 2)):g}°{side}"


def latitude_text(latitude_deg: float) -> str:
    """Return a whole latitude as text, `30° N`."""
    side = "" if round(latitude_deg, 2) == 0.0 else (" N" if latitude_deg > 0.0 else " S")
    return f"{abs(round(latitude_deg, 2)):g}°{side}"
