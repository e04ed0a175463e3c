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

#: Longest step along an edge of the map of the whole Earth, degrees.
_STEP_DEG = 2.0


def equal_earth(
    latitude_deg: FloatArray, longitude_deg: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return map coordinates (…) of places, in radii of the sphere; areas on the map are those on
    the sphere.

    Source: B. Šavrič, T. Patterson and B. Jenny, International Journal of Geographical Information
    Science 33 (2019) 454.
    """
    half_root_3 = 0.5 * np.sqrt(3.0)
    angle = np.arcsin(half_root_3 * np.sin(np.radians(latitude_deg)))
    square = angle * angle
    sixth = square**3
    a1, a2, a3, a4 = (1.340264, -0.081106, 0.000893, 0.003796)
    slope = a1 + 3.0 * a2 * square + sixth * (7.0 * a3 + 9.0 * a4 * square)
    x = np.radians(longitude_deg) * np.cos(angle) / (half_root_3 * slope)
    return x, angle * (a1 + a2 * square + sixth * (a3 + a4 * square))


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
        """Return a line once for each turn of the map that it meets, cut at the map's edge."""
        return [self._flat(turn) for turn in _repeated(self._unrolled(refined(line)))]

    def curves(self, rings: Sequence[FloatArray]) -> list[FloatArray]:
        """Return rings once for each turn of the map that they meet; those round a pole are closed
        along the pole.
        """
        fine = [refined(ring) for ring in rings]
        closed = [_closed_at_pole(self._unrolled(ring), turns(ring)) for ring in fine]
        closed += _background(
            fine, sum(_signed_area(_cylindrical(ring)) for ring in closed), _world_deg
        )
        bounds = (-180.0, 180.0), (-90.0, 90.0)
        curves = [clipped(curve, *bounds) for ring in closed for curve in _repeated(ring)]
        return [self._flat(dense(curve, _STEP_DEG)) for curve in curves if len(curve)]

    def _degrees(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return degrees east of the central meridian, in [-180, 180), and degrees north: (n,
        2).
        """
        east = np.degrees(longitude_rad) - self.longitude_deg
        wrapped = np.mod(east + 180.0, 360.0) - 180.0
        return np.stack([wrapped, np.degrees(latitude_rad)], axis=-1)

    def _flat(self, degrees: FloatArray) -> FloatArray:
        return np.stack(equal_earth(degrees[:, 1], degrees[:, 0]), axis=-1)

    def _unrolled(self, line: FloatArray) -> FloatArray:
        places = self._degrees(line[:, 0], line[:, 1])
        places[:, 0] = np.unwrap(places[:, 0], period=360.0)
        return places


def _world_deg(sense: int) -> FloatArray:
    """Return the edge (n, 2) of the whole Earth in degrees, counter-clockwise for 1, clockwise for
    -1.
    """
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    return (corners * (180.0, 90.0))[::sense]


def _cylindrical(flat: FloatArray) -> FloatArray:
    """Return points (n, 2) in degrees on the cylindrical equal-area map of a sphere of radius 1."""
    return np.stack([np.radians(flat[:, 0]), np.sin(np.radians(flat[:, 1]))], axis=1)


def _closed_at_pole(flat: FloatArray, around: int) -> FloatArray:
    """Return a ring in degrees; one that goes round a pole is closed along that on its left."""
    if not around:
        return flat
    pole_deg = 90.0 * around
    return np.concatenate([flat, [[flat[-1, 0], pole_deg], [flat[0, 0], pole_deg]], flat[:1]])


def _background(
    rings: Sequence[FloatArray], flat_sr: float, edge: Callable[[int], FloatArray]
) -> list[FloatArray]:
    """Return the map's edge as often as the curves of rings need it to be filled where the region
    is, and only there.

    On the map rings enclose the area `flat_sr`, which differs from that of their region by whole
    spheres: by one if the region holds the map's edge, as rings round a hole do.
    """
    sphere_sr = 4.0 * np.pi
    # Areas a little below zero come from rounding.
    region_sr = np.mod(sum(area_sr(ring) for ring in rings) + 1e-3, sphere_sr) - 1e-3
    missing = round((region_sr - flat_sr) / sphere_sr)
    return [edge(1 if missing > 0 else -1)] * abs(missing)


def _repeated(line: FloatArray) -> list[FloatArray]:
    """Return a line moved by whole turns to each place where it meets the map."""
    west = float(line[:, 0].min())
    east = float(line[:, 0].max())
    turns_east = range(
        int(np.ceil((-180.0 - east) / 360.0)), int(np.floor((180.0 - west) / 360.0)) + 1
    )
    return [line + np.array([360.0 * turn, 0.0]) for turn in turns_east]


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
        return [segment for segment in np.split(flat, leaps) if len(segment) > 1]

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
        # Near the point opposite to the centre a short edge goes around the map.
        for _ in range(40):
            flat = self.points(fine[:, 0], fine[:, 1])
            length_km = np.linalg.norm(np.diff(flat, axis=0), axis=1)
            edges = np.flatnonzero(length_km > 0.2 * EARTH_RADIUS_KM)
            if not len(edges):
                break
            unit = unit_vectors(fine[:, 0], fine[:, 1])
            middles = latitudes_longitudes(unit[edges] + unit[edges + 1])
            fine = np.insert(fine, edges + 1, middles, axis=0)
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


def nice_step(span: float, count: int, steps: Sequence[float]) -> float:
    """Return the smallest of ascending steps, at most `count` of which fill a span, or the largest."""
    return next((step for step in steps if span / step <= count), steps[-1])
