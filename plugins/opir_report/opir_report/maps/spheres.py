"""Lines and rings on the sphere: refinement, caps, enclosed area. Angles are in rad, rings have
their inside left.
"""

import numpy as np

from opir_core.arrays import FloatArray

#: The mean radius of the Earth, km: maps take the Earth for a sphere.
EARTH_RADIUS_KM = 6371.0088
_TURN = 2.0 * np.pi


def unit_vectors(latitude_rad: FloatArray, longitude_rad: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) of points (n,)."""
    flat = np.cos(latitude_rad)
    return np.stack(
        [flat * np.cos(longitude_rad), flat * np.sin(longitude_rad), np.sin(latitude_rad)], axis=-1
    )


def latitudes_longitudes(unit: FloatArray) -> FloatArray:
    """Return latitude and longitude (n, 2) of vectors (n, 3), which need not be of unit length."""
    latitude = np.arctan2(unit[..., 2], np.hypot(unit[..., 0], unit[..., 1]))
    return np.stack([latitude, np.arctan2(unit[..., 1], unit[..., 0])], axis=-1)


def refined(line: FloatArray, step_rad: float = 0.02) -> FloatArray:
    """Return a line (n, 2) of latitude and longitude with points along its great circles at most a
    step apart.
    """
    unit = unit_vectors(line[:, 0], line[:, 1])
    if len(unit) < 2:
        return line
    angle = 2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(unit[1:] - unit[:-1], axis=1), 0.0, 1.0))
    steps = np.ceil(angle / step_rad).clip(1).astype(np.int64)
    edge = np.repeat(np.arange(len(steps)), steps)
    share = (np.arange(len(edge)) - (np.cumsum(steps) - steps)[edge]) / steps[edge]
    # Interpolated along the arc, not the chord; the sine of a zero angle divides nothing.
    sine = np.where(angle > 0.0, np.sin(angle), 0.0)[edge]
    is_point = sine == 0.0
    divisor = np.where(is_point, 1.0, sine)
    start_weight = np.where(is_point, 1.0, np.sin((1.0 - share) * angle[edge]) / divisor)
    end_weight = np.where(is_point, 0.0, np.sin(share * angle[edge]) / divisor)
    points = start_weight[:, None] * unit[edge] + end_weight[:, None] * unit[edge + 1]
    return np.concatenate([latitudes_longitudes(points), line[-1:]])


def cap(
    latitude_rad: float, longitude_rad: float, radius_rad: float, points: int = 181
) -> FloatArray:
    """Return the edge (points, 2) of a spherical cap about a centre, closed."""
    bearing = -np.linspace(0.0, _TURN, points)
    sine = np.sin(radius_rad)
    cosine = np.cos(radius_rad)
    latitude = np.arcsin(
        np.clip(
            np.sin(latitude_rad) * cosine + np.cos(latitude_rad) * sine * np.cos(bearing), -1.0, 1.0
        )
    )
    east = np.sin(bearing) * sine * np.cos(latitude_rad)
    longitude = longitude_rad + np.arctan2(east, cosine - np.sin(latitude_rad) * np.sin(latitude))
    return np.stack([latitude, np.mod(longitude + np.pi, _TURN) - np.pi], axis=1)


def turns(ring: FloatArray) -> int:
    """Return how often a closed ring (n, 2) goes round the poles, eastward positive."""
    step = np.mod(np.diff(ring[:, 1]) + np.pi, _TURN) - np.pi
    return round(float(step.sum()) / _TURN)


def area_sr(ring: FloatArray) -> float:
    """Return the solid angle on the left of a closed ring (n, 2), sr, in [0, 4 pi).

    The integral of -sin(latitude) over longitude (Chamberlain and Duquette, JPL 07-03, 2007), with
    a hemisphere added where the ring goes round a pole.
    """
    step = np.mod(np.diff(ring[:, 1]) + np.pi, _TURN) - np.pi
    sines = 0.5 * (np.sin(ring[1:, 0]) + np.sin(ring[:-1, 0]))
    around = _TURN if turns(ring) else 0.0
    return float(np.mod(around - np.sum(sines * step), 2.0 * _TURN))
