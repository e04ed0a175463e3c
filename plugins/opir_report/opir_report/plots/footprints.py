"""Where narrow fields looked on the ground: what a director sent them to, from time to time."""

from collections.abc import Hashable, Iterator, Sequence
from functools import cached_property

import numpy as np
from matplotlib.axes import Axes

from opir_core.arrays import FloatArray
from opir_core.cli import grouped
from opir_core.geometry import WGS84, ecef_to_geodetic, intersection_with_ellipsoid
from opir_core.plugin import Sensor
from opir_report.canvas import legend_entry, legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.maps.base_map import drawn_ground, drawn_line
from opir_report.maps.projections import fitting_projection
from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr
from opir_report.palette import MUTED
from opir_report.plots.directing import PLACE, watched_parts
from opir_report.plots.maps import RATIO, draw_flights
from opir_report.plots.modes import OWN, CommandedSpan, commanded_spans, purpose
from opir_report.run_facts import RunFacts

#: Points of an outline, and the dashes of modes in their order.
_POINTS = 73
_DASHES = ("-", "--", ":", "-.")
#: Purposes whose edges are labelled, and those that are drawn, at most.
_LABELLED = 8
_DRAWN = 40
_COLUMNS = (
    "sensor_id",
    "mode",
    "track_id",
    "target_id",
    "from_s",
    "half_angle_deg",
    "latitude_deg",
    "longitude_deg",
    "far_km",
    "ground_km2",
)


class _Footprint:
    """The narrow field of a sensor as it begins to look at a point (3,), ECEF, m."""

    def __init__(self, sensor: Sensor, commanded: CommandedSpan, point_m: Sequence[float]) -> None:
        self.sensor_id = sensor.id
        self.commanded = commanded
        self._orbit = sensor.orbit
        self._point_m = point_m

    @property
    def half_angle_rad(self) -> float:
        """The half angle of the field."""
        pointing = self.commanded.span.sensor.pointing
        assert pointing is not None
        return pointing.half_angle_rad

    @cached_property
    def sensor_m(self) -> FloatArray:
        """The position (3,) of the sensor."""
        return self._orbit.position_ecef_m(np.array([self.commanded.span.from_s]))[0]

    @cached_property
    def middle_m(self) -> FloatArray:
        """The point (3,) at which the axis meets the ground; nan where it passes the Earth."""
        return intersection_with_ellipsoid(self.sensor_m, self._point_m - self.sensor_m)

    @property
    def is_on_ground(self) -> bool:
        """Whether the axis meets the ground."""
        return bool(np.isfinite(self.middle_m).all())

    @cached_property
    def edge(self) -> FloatArray:
        """The edge (`_POINTS`, 2) on the ground, rad, closed, with its inside left: where rays pass
        the Earth, its limb.
        """
        axis = self._point_m - self.sensor_m
        axis /= np.linalg.norm(axis)
        across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        turn = -np.linspace(0.0, 2.0 * np.pi, _POINTS)[:, None]
        aside = np.cos(turn) * across + np.sin(turn) * np.cross(axis, across)
        rays = np.cos(self.half_angle_rad) * axis + np.sin(self.half_angle_rad) * aside
        ground_m = intersection_with_ellipsoid(self.sensor_m, rays)
        passes = np.isnan(ground_m)
        place = ecef_to_geodetic(np.where(passes, _on_limb(self.sensor_m, rays), ground_m))
        return np.stack([place.latitude_rad, place.longitude_rad], axis=1)


def footprints(facts: RunFacts) -> FigureData:
    """Return the narrow fields on the ground at the first and the last command of one purpose:
    sensor_id, mode, track_id, target_id, from_s, half_angle_deg, latitude_deg, longitude_deg,
    far_km, ground_km2.

    At `from_s` the axis of the field meets the ground at latitude and longitude, `far_km` from the
    sensor, and `ground_km2` of the ground are in the field. Fields whose axis passes the Earth are
    left out, and commands of files before version 1.2, which have no place.
    """
    rows = (_row(facts, footprint) for ends in _purposes(facts) for footprint in ends)
    return FigureData.of_rows(_COLUMNS, rows)


def _row(facts: RunFacts, footprint: _Footprint) -> tuple[object, ...]:
    commanded = footprint.commanded
    place = ecef_to_geodetic(footprint.middle_m)
    return (
        footprint.sensor_id,
        commanded.mode,
        commanded.track,
        facts.target_ids.get(commanded.track, ""),
        commanded.span.from_s,
        float(np.degrees(footprint.half_angle_rad)),
        float(np.degrees(place.latitude_rad)),
        float(np.degrees(place.longitude_rad)),
        1e-3 * float(np.linalg.norm(footprint.middle_m - footprint.sensor_m)),
        EARTH_RADIUS_KM**2 * area_sr(footprint.edge),
    )


def _footprints(facts: RunFacts) -> Iterator[_Footprint]:
    """Yield the narrow fields of commands that were looked at, by sensor and time."""
    for sensor in facts.run.sensors:
        if sensor.pointing is None:
            continue
        for commanded in commanded_spans(facts, sensor):
            in_mode, _, from_s, until_s = commanded.span
            point_m = None if commanded.record is None else commanded.record.position_ecef_m
            is_seen = in_mode.is_narrow and watched_parts(sensor, from_s, until_s)
            if point_m is not None and is_seen:
                yield _Footprint(sensor, commanded, point_m)


def footprint_map(axes: Axes, facts: RunFacts, tracks: FigureData) -> Axes:
    """Draw the edges of narrow fields on the ground at the first and the last command of one
    purpose, over the launches' ground tracks; not where the axis passes the Earth.
    """
    purposes = _purposes(facts)
    if not purposes:
        return without_data(axes, "no narrow field was pointed at the ground")
    omission_count = max(len(purposes) - _DRAWN, 0)
    purposes = purposes[:_DRAWN]
    places = np.concatenate([footprint.edge for ends in purposes for footprint in ends])
    projection = fitting_projection(places)
    drawn_ground(axes, projection, places, RATIO, least_km=600.0)
    draw_flights(axes, projection, facts, tracks)
    dashes = _dashes([ends[0].commanded.mode for ends in purposes])
    hue_of = dict(zip(facts.ids, facts.hues.of_target, strict=True))
    for ends in purposes:
        commanded = ends[0].commanded
        hue = hue_of.get(facts.target_ids.get(commanded.track, ""), PLACE)
        style = {"color": hue.colour, "linestyle": dashes[commanded.mode], "zorder": 3}
        for footprint in ends:
            drawn_line(axes, projection, footprint.edge, linewidth=1.2, **style)
        if len(purposes) <= _LABELLED:
            label = f"{ends[0].sensor_id} from {commanded.span.from_s:.0f} s"
            edge = projection.points(*ends[0].edge.T)
            top = edge[edge[:, 1].argmax()]
            axes.annotate(label, top, (0, 2), textcoords="offset points", ha="center", fontsize=8)
    marks = [
        legend_entry(f"edge, {mode}", MUTED, linestyle=dash, linewidth=1.2)
        for mode, dash in dashes.items()
    ]
    if omission_count:
        marks.append(legend_entry(f"{grouped(omission_count)} more are not drawn", linestyle=""))
    legend_of(axes, facts.hues.legend, marks)
    return axes


def _purposes(facts: RunFacts) -> list[list[_Footprint]]:
    """Return the first and the last footprint of each purpose of which the axis meets the ground."""
    purposes: dict[Hashable, list[_Footprint]] = {}
    for footprint in _footprints(facts):
        key = footprint.sensor_id, purpose(footprint.commanded)
        purposes.setdefault(key, []).append(footprint)
    return [ends for places in purposes.values() if (ends := _ends(places))]


def _ends(footprints: Sequence[_Footprint]) -> list[_Footprint]:
    """Return the first and the last footprint of which the axis meets the ground."""
    ways = footprints, reversed(footprints)
    ends = [next((place for place in way if place.is_on_ground), None) for way in ways]
    return list(dict.fromkeys(filter(None, ends)))


def _dashes(modes: list[str]) -> dict[str, str]:
    """Return the dashes of the edges by mode, the sensors' own settings first."""
    ordered = sorted(set(modes), key=lambda mode: (mode != OWN, mode))
    return {mode: _DASHES[number % len(_DASHES)] for number, mode in enumerate(ordered)}


def _on_limb(sensor_m: FloatArray, rays: FloatArray) -> FloatArray:
    """Return the points (n, 3) of the limb towards which rays (n, 3) pass the Earth, ECEF, m."""
    # With axes scaled to 1 the ellipsoid is a sphere, and lines stay lines.
    axes_m = [WGS84.equatorial_radius_m, WGS84.equatorial_radius_m, WGS84.polar_radius_m]
    sensor = sensor_m / axes_m
    distance = np.linalg.norm(sensor)
    up = sensor / distance
    ray = rays / axes_m
    across = ray - (ray @ up)[:, None] * up
    across /= np.linalg.norm(across, axis=1)[:, None]
    cosine = 1.0 / distance
    return (cosine * up + np.sqrt(1.0 - cosine**2) * across) * axes_m
