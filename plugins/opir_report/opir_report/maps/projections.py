"""Map projections: an equal-area one of the whole Earth and an azimuthal equidistant one about a
centre.

Both take latitudes and longitudes in rad. `lines` and `curves` are correct across the antimeridian
and the poles: a line is cut where the map's edge is, and a filled region never turns inside out.
"""

from collections.abc import Callable, Sequence
from typing import Self

import numpy as np

from opir_core.arrays import FloatArray
from opir_report.maps.clipping import clipped, dense
from opir_report.maps.spheres import (
    EARTH_RADIUS_KM,
    area_sr,
    latitudes_longitudes,
    refined,
    turns,
    unit_vectors,
)

_HALF_TURN_DEG = 180.0
_POLE_DEG = 90.0
_SPHERE_SR = 4.0 * np.pi
#: Areas between this one and zero come from rounding, sr.
_ROUNDING_SR = 1e-3
#: Longest step along an edge of the map of the whole Earth, degrees.
_STEP_DEG = 2.0
#: Longest step on an azimuthal map, Earth's radii, and the halvings that reach it: near the point
#: opposite to the centre a short edge goes far around the map.
_LONGEST_STEP = 0.2
_HALVINGS = 40
#: The polynomial of the Equal Earth projection, and half the root of 3.
_EQUAL_EARTH = (1.340264, -0.081106, 0.000893, 0.003796)
_HALF_ROOT_3 = 0.5 * np.sqrt(3.0)


def equal_earth(
    latitude_deg: FloatArray, longitude_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return map coordinates (…) of places, in radii of the sphere; areas on the map are those on
    the sphere.

    Source: B. Šavrič, T. Patterson and B. Jenny, International Journal of Geographical Information
    Science 33 (2019) 454.
    """
    angle = np.arcsin(_HALF_ROOT_3 * np.sin(np.radians(latitude_deg)))
    square = angle * angle
    sixth = square**3
    first, second, third, fourth = _EQUAL_EARTH
    slope = first + 3.0 * second * square + sixth * (7.0 * third + 9.0 * fourth * square)
    x = np.radians(longitude_deg) * np.cos(angle) / (_HALF_ROOT_3 * slope)
    return x, angle * (first + second * square + sixth * (third + fourth * square))


class WorldProjection:
    """The Equal Earth projection of the whole Earth about a central meridian, in radii of the
    Earth.
    """

    def __init__(self, longitude_rad: float = 0.0) -> None:
        self.longitude_deg = float(np.degrees(longitude_rad))

    @classmethod
    def about(cls, places: FloatArray) -> Self:
        """Return the projection about the mean longitude of points (n, 2), in whole 30 degrees; of
        none about 0.
        """
        longitude = RegionProjection.about(places).centre[1] if len(places) else 0.0
        return cls(float(np.radians(30.0 * np.round(np.degrees(longitude) / 30.0))))

    @property
    def edge(self) -> FloatArray:
        """The closed edge of the map (n, 2)."""
        return self._flat(dense(_world_deg(1), _STEP_DEG))

    def points(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return map coordinates (n, 2), of the antimeridian at the left edge."""
        return self._flat(self._degrees(latitude_rad, longitude_rad))

    def lines(self, line: FloatArray) -> list[FloatArray]:
        """Return a line once for each turn of the map that it meets; the map's edge cuts the
        rest.
        """
        return [self._flat(part) for part in _repeated(self._unrolled(refined(line)))]

    def curves(self, rings: Sequence[FloatArray]) -> list[FloatArray]:
        """Return rings once for each turn of the map that they meet; those round a pole are closed
        along the pole.
        """
        fine = [refined(ring) for ring in rings]
        closed = [_closed_at_pole(self._unrolled(ring), turns(ring)) for ring in fine]
        closed += _background(
            fine, sum(_signed_area(_cylindrical(ring)) for ring in closed), _world_deg
        )
        bounds = (-_HALF_TURN_DEG, _HALF_TURN_DEG), (-_POLE_DEG, _POLE_DEG)
        parts = [clipped(part, *bounds) for ring in closed for part in _repeated(ring)]
        return [self._flat(dense(part, _STEP_DEG)) for part in parts if len(part)]

    def _degrees(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return degrees east of the central meridian, in [-180, 180), and degrees north: (n,
        2).
        """
        east = np.degrees(longitude_rad) - self.longitude_deg
        wrapped = np.mod(east + _HALF_TURN_DEG, 2 * _HALF_TURN_DEG) - _HALF_TURN_DEG
        return np.stack([wrapped, np.degrees(latitude_rad)], axis=-1)

    def _flat(self, degrees: FloatArray) -> FloatArray:
        return np.stack(equal_earth(degrees[:, 1], degrees[:, 0]), axis=-1)

    def _unrolled(self, line: FloatArray) -> FloatArray:
        places = self._degrees(line[:, 0], line[:, 1])
        places[:, 0] = np.unwrap(places[:, 0], period=2 * _HALF_TURN_DEG)
        return places


def _world_deg(sense: int) -> FloatArray:
    """Return the edge (n, 2) of the whole Earth in degrees, counter-clockwise for 1, clockwise for
    -1.
    """
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    return (corners * (_HALF_TURN_DEG, _POLE_DEG))[::sense]


def _cylindrical(flat: FloatArray) -> FloatArray:
    """Return points (n, 2) in degrees on the cylindrical equal-area map of a sphere of radius 1."""
    return np.stack([np.radians(flat[:, 0]), np.sin(np.radians(flat[:, 1]))], axis=1)


def _closed_at_pole(flat: FloatArray, around: int) -> FloatArray:
    """Return a ring in degrees; one that goes round a pole is closed along that on its left."""
    if not around:
        return flat
    pole_deg = _POLE_DEG * around
    return np.concatenate([flat, [[flat[-1, 0], pole_deg], [flat[0, 0], pole_deg]], flat[:1]])


def _background(
    rings: Sequence[FloatArray], flat_sr: float, edge: Callable[[int], FloatArray]
) -> list[FloatArray]:
    """Return the map's edge as often as the curves of rings need it to be filled where the region
    is, and only there.

    On the map rings enclose the area `flat_sr`, which differs from that of their region by whole
    spheres: by one if the region holds the map's edge, as rings round a hole do.
    """
    region_sr = (
        np.mod(sum(area_sr(ring) for ring in rings) + _ROUNDING_SR, _SPHERE_SR) - _ROUNDING_SR
    )
    missing = round((region_sr - flat_sr) / _SPHERE_SR)
    return [edge(1 if missing > 0 else -1)] * abs(missing)


def _repeated(line: FloatArray) -> list[FloatArray]:
    """Return a line moved by whole turns to each place where it meets the map."""
    west = float(line[:, 0].min())
    east = float(line[:, 0].max())
    first = int(np.ceil((-_HALF_TURN_DEG - east) / (2 * _HALF_TURN_DEG)))
    last = int(np.floor((_HALF_TURN_DEG - west) / (2 * _HALF_TURN_DEG)))
    return [line + np.array([2 * _HALF_TURN_DEG * turn, 0.0]) for turn in range(first, last + 1)]


class RegionProjection:
    """The azimuthal equidistant projection: km east and north of a centre; distances from the
    centre are true.
    """

    def __init__(self, latitude_rad: float, longitude_rad: float) -> None:
        self.centre = latitude_rad, longitude_rad
        sine = np.sin(latitude_rad)
        cosine = np.cos(latitude_rad)
        east = np.array([-np.sin(longitude_rad), np.cos(longitude_rad), 0.0])
        up = np.array([cosine * np.cos(longitude_rad), cosine * np.sin(longitude_rad), sine])
        self._axes = np.stack([east, np.cross(up, east), up])

    @classmethod
    def about(cls, places: FloatArray) -> Self:
        """Return the projection about the mean direction of points (n, 2)."""
        mean = unit_vectors(places[:, 0], places[:, 1]).mean(axis=0)
        if np.linalg.norm(mean) == 0.0:
            return cls(0.0, 0.0)
        latitude, longitude = latitudes_longitudes(mean).tolist()
        return cls(latitude, longitude)

    def points(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return km east and north of the centre, (n, 2)."""
        x, y, z = np.moveaxis(unit_vectors(latitude_rad, longitude_rad) @ self._axes.T, -1, 0)
        sine = np.hypot(x, y)
        scale = EARTH_RADIUS_KM * np.arctan2(sine, z) / np.maximum(sine, 1e-300)
        return np.stack([x * scale, y * scale], axis=-1)

    def places(self, flat: FloatArray) -> FloatArray:
        """Return latitudes and longitudes (n, 2) of points (n, 2) in km, the inverse of
        `points`.
        """
        distance = np.hypot(flat[:, 0], flat[:, 1])
        angle = np.minimum(distance / EARTH_RADIUS_KM, np.pi)
        scale = np.sin(angle) / np.maximum(distance, 1e-300)
        local = np.stack([flat[:, 0] * scale, flat[:, 1] * scale, np.cos(angle)], axis=1)
        return latitudes_longitudes(local @ self._axes)

    def lines(self, line: FloatArray) -> list[FloatArray]:
        """Return a line in parts, cut where it passes the point opposite to the centre."""
        fine = refined(line)
        flat = self.points(fine[:, 0], fine[:, 1])
        leaps = np.flatnonzero(np.linalg.norm(np.diff(flat, axis=0), axis=1) > EARTH_RADIUS_KM) + 1
        return [part for part in np.split(flat, leaps) if len(part) > 1]

    def curves(self, rings: Sequence[FloatArray]) -> list[FloatArray]:
        """Return rings, with the edge of the map where the region holds the point opposite to the
        centre.
        """
        fine = [self._refined(ring) for ring in rings]
        flat = [self.points(ring[:, 0], ring[:, 1]) for ring in fine]
        return flat + _background(
            fine, sum(_signed_area(_equal_area(curve)) for curve in flat), _disk_edge_km
        )

    def _refined(self, ring: FloatArray) -> FloatArray:
        """Return a ring with points along its edges, so close that none is a chord across the
        map.
        """
        fine = refined(ring)
        for _ in range(_HALVINGS):
            flat = self.points(fine[:, 0], fine[:, 1])
            far = np.flatnonzero(
                np.linalg.norm(np.diff(flat, axis=0), axis=1) > _LONGEST_STEP * EARTH_RADIUS_KM
            )
            if not len(far):
                break
            unit = unit_vectors(fine[:, 0], fine[:, 1])
            fine = np.insert(fine, far + 1, latitudes_longitudes(unit[far] + unit[far + 1]), axis=0)
        return fine


#: A projection has `points`, map coordinates (n, 2) of points; `lines`, the parts (k, 2) of a line
#: (n, 2) on the map; `curves`, closed ones (k, 2) that, filled by the nonzero rule, show the region
#: on the left of rings (n, 2).
MapProjection = WorldProjection | RegionProjection


def fitting_projection(places: FloatArray) -> MapProjection:
    """Return the azimuthal projection about points (n, 2); that of the whole Earth if one is beyond
    its horizon.
    """
    region = RegionProjection.about(places)
    farthest_km = np.linalg.norm(region.points(places[:, 0], places[:, 1]), axis=1).max()
    return region if farthest_km <= 0.5 * np.pi * EARTH_RADIUS_KM else WorldProjection.about(places)


def _disk_edge_km(sense: int) -> FloatArray:
    """Return the edge (n, 2) of an azimuthal map, counter-clockwise for 1, clockwise for -1."""
    angle = sense * np.linspace(0.0, 2.0 * np.pi, 361)
    return 1.01 * np.pi * EARTH_RADIUS_KM * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _equal_area(flat: FloatArray) -> FloatArray:
    """Return points (n, 2) of an azimuthal equidistant map on the equal-area one of a sphere of
    radius 1.
    """
    distance = np.linalg.norm(flat, axis=1, keepdims=True) / EARTH_RADIUS_KM
    return 2.0 * np.sin(0.5 * distance) / np.maximum(distance, 1e-300) * flat / EARTH_RADIUS_KM


def _signed_area(flat: FloatArray) -> float:
    x, y = flat.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def nice_step(span: float, parts: int, steps: Sequence[float]) -> float:
    """Return the smallest of ascending steps that divides a span into at most `parts` parts, or the
    largest.
    """
    return next((step for step in steps if span / step <= parts), steps[-1])
