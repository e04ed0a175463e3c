"""Map projections: an equirectangular one of the whole Earth and an azimuthal equidistant one about a centre.

Both take latitudes and longitudes in rad. `lines` and `rings` are correct across the antimeridian and the poles: a line
is cut where the map's edge is, and a filled region never turns inside out.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from opir_core.arrays import FloatArray
from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr, latitudes_longitudes, refined, turns, unit_vectors

_HALF_TURN_DEG = 180.0


class MapProjection(Protocol):
    """A projection: map coordinates of points, lines and regions."""

    def points(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return map coordinates (n, 2)."""

    def lines(self, line: FloatArray) -> list[FloatArray]:
        """Return the parts (k, 2) of a line (n, 2) of latitudes and longitudes."""

    def rings(self, ring: FloatArray) -> list[FloatArray]:
        """Return the closed curves (k, 2) that, filled by the nonzero rule, show what lies left of a ring (n, 2)."""


class WorldProjection:
    """The equirectangular projection: degrees east of a central meridian, and degrees of latitude."""

    def __init__(self, longitude_rad: float = 0.0) -> None:
        self.longitude_deg = float(np.degrees(longitude_rad))

    def points(self, latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
        """Return degrees east of the central meridian, in [-180, 180), and degrees north: (n, 2)."""
        east = np.degrees(longitude_rad) - self.longitude_deg
        wrapped = np.mod(east + _HALF_TURN_DEG, 2 * _HALF_TURN_DEG) - _HALF_TURN_DEG
        return np.stack([wrapped, np.degrees(latitude_rad)], axis=-1)

    def lines(self, line: FloatArray) -> list[FloatArray]:
        """Return a line once for each turn of the map that it meets; the axes cut the rest."""
        return _repeated(self._unrolled(refined(line)))

    def rings(self, ring: FloatArray) -> list[FloatArray]:
        """Return a ring once for each turn of the map that it meets; one round a pole is closed along the pole."""
        flat = self._unrolled(refined(ring))
        around = turns(ring)
        if around:
            pole_deg = 90.0 * around
            flat = np.concatenate([flat, [[flat[-1, 0], pole_deg], [flat[0, 0], pole_deg]], flat[:1]])
        return _repeated(flat)

    def _unrolled(self, line: FloatArray) -> FloatArray:
        places = self.points(line[:, 0], line[:, 1])
        places[:, 0] = np.unwrap(places[:, 0], period=2 * _HALF_TURN_DEG)
        return places


def _repeated(line: FloatArray) -> list[FloatArray]:
    """Return a line moved by whole turns to each place where it meets the map."""
    west, east = float(line[:, 0].min()), float(line[:, 0].max())
    first = int(np.ceil((-_HALF_TURN_DEG - east) / (2 * _HALF_TURN_DEG)))
    last = int(np.floor((_HALF_TURN_DEG - west) / (2 * _HALF_TURN_DEG)))
    return [line + np.array([2 * _HALF_TURN_DEG * turn, 0.0]) for turn in range(first, last + 1)]


class RegionProjection:
    """The azimuthal equidistant projection: km east and north of a centre; distances from the centre are true."""

    def __init__(self, latitude_rad: float, longitude_rad: float) -> None:
        self.centre = latitude_rad, longitude_rad
        sine, cosine = np.sin(latitude_rad), np.cos(latitude_rad)
        east = np.array([-np.sin(longitude_rad), np.cos(longitude_rad), 0.0])
        up = np.array([cosine * np.cos(longitude_rad), cosine * np.sin(longitude_rad), sine])
        self._axes = np.stack([east, np.cross(up, east), up])

    @classmethod
    def about(cls, places: FloatArray) -> "RegionProjection":
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
        """Return latitudes and longitudes (n, 2) of points (n, 2) in km, the inverse of `points`."""
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

    def rings(self, ring: FloatArray) -> list[FloatArray]:
        """Return a ring, with the edge of the map first where the region holds the point opposite to the centre."""
        fine = refined(ring)
        flat = self.points(fine[:, 0], fine[:, 1])
        is_clockwise = _signed_area(flat) < 0.0
        if is_clockwise and area_sr(ring) < 2.0 * np.pi:
            angle = np.linspace(0.0, 2.0 * np.pi, 361)
            edge = 1.01 * np.pi * EARTH_RADIUS_KM * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            return [edge, flat]
        return [flat]


def _signed_area(flat: FloatArray) -> float:
    x, y = flat.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def nice_step(span: float, parts: int, steps: Sequence[float]) -> float:
    """Return the smallest of ascending steps that divides a span into at most so many parts, or the largest."""
    return next((step for step in steps if span / step <= parts), steps[-1])
