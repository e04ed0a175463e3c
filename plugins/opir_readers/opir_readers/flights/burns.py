"""Burns that an acceleration shows: what is left of it without gravity, along the velocity."""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import BadFileError, StateTable
from opir_readers.interpolation import interpolant, runs
from opir_readers.states import MOST_BURNS

_J2 = 1.08262668e-3

#: Thrust accelerates by at least this, m/s²; what is left of noise and of gravity's higher terms is
#: less.
LEAST_THRUST_M_S2 = 2.0

#: Above this height, m, drag is no longer like thrust against the velocity, as of a boostback.
AIRLESS_M = 60_000.0

#: Half of the time over which accelerations are averaged, s, and the shortest burns and gaps that
#: are separated, s.
_HALF_S = 1.0
_SHORTEST_S = 3.0


def with_burns_of_acceleration(table: StateTable) -> StateTable:
    """Return a table whose burns are those that its accelerations show; raises `BadFileError` where
    there are none.
    """
    burns = burns_s(table.time_s, is_thrusting(table))
    if not len(burns):
        raise BadFileError(
            f"shows no acceleration above {LEAST_THRUST_M_S2:g} m/s² along its flight: no burn"
        )
    if len(burns) > MOST_BURNS:
        raise BadFileError(
            f"shows {len(burns)} burns by its acceleration, more than {MOST_BURNS}; smooth it with"
            f" noise_m"
        )
    listed = ", ".join(
        f"{start - table.time_s[0]:.1f} to {end - table.time_s[0]:.1f} s"
        for start, end in burns.tolist()
    )
    return evolve(
        table,
        burns_s=burns,
        notes=(*table.notes, f"burns by acceleration, from the first state: {listed}"),
    )


def is_thrusting(table: StateTable) -> BoolArray:
    """Return at which states (n,) the specific force is that of thrust."""
    force, speed_axis = _specific_force(table)
    along = (force * speed_axis).sum(axis=1)
    size = np.sqrt((force * force).sum(axis=1))
    is_high = ecef_to_geodetic(table.position_m).height_m > AIRLESS_M
    return np.asarray((along > LEAST_THRUST_M_S2) | (is_high & (size > LEAST_THRUST_M_S2)))


def _specific_force(table: StateTable) -> tuple[FloatArray, FloatArray]:
    """Return accelerations without gravity, m/s², and unit vectors of the velocity, (n, 3), at the
    states.
    """
    curve = interpolant([table])
    force = np.zeros_like(table.position_m)
    axis = np.zeros_like(table.position_m)
    for rows in runs(table):
        time_s = table.time_s[rows]
        if len(rows) < 2:
            continue
        half = min(
            max(_HALF_S, float(np.median(np.diff(time_s)))), 0.25 * float(time_s[-1] - time_s[0])
        )
        middle = np.clip(time_s, time_s[0] + half, time_s[-1] - half)
        zero = np.zeros(len(rows), dtype=np.intp)
        (before, _), (at, velocity), (after, _) = (
            curve.state(zero, middle + shift) for shift in (-half, 0.0, half)
        )
        acceleration = (after - 2.0 * at + before) / half**2
        velocity = (after - before) / (2.0 * half)
        force[rows] = acceleration + _rotating(at, velocity) - _gravity(at)
        axis[rows] = (
            velocity / np.maximum(np.sqrt((velocity * velocity).sum(axis=1)), 1e-9)[:, None]
        )
    return force, axis


def _rotating(position_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Return by how much accelerations in space exceed those over the turning Earth: Coriolis and
    centripetal.
    """
    x = position_m[:, 0]
    y = position_m[:, 1]
    vx = velocity_m_s[:, 0]
    vy = velocity_m_s[:, 1]
    omega = EARTH_ROTATION_RAD_S
    return np.stack(
        [-2 * omega * vy - omega**2 * x, 2 * omega * vx - omega**2 * y, np.zeros_like(x)], axis=1
    )


def _gravity(position_m: FloatArray) -> FloatArray:
    """Return gravitation with the Earth's flattening (J2), m/s²."""
    radius = np.sqrt((position_m * position_m).sum(axis=1))[:, None]
    sine2 = (position_m[:, 2:] / radius) ** 2
    scale = 1.5 * _J2 * (EARTH_EQUATORIAL_RADIUS_M / radius) ** 2
    factors = np.concatenate(
        [1.0 + scale * (1.0 - 5.0 * sine2)] * 2 + [1.0 + scale * (3.0 - 5.0 * sine2)], axis=1
    )
    return np.asarray(-EARTH_MU_M3_S2 / radius**3 * position_m * factors)


def burns_s(time_s: FloatArray, is_burning: BoolArray) -> FloatArray:
    """Return burns (k, 2) from states that thrust; short burns and short gaps are taken for
    noise.
    """
    edge = np.diff(np.concatenate([[0], is_burning.astype(np.int8), [0]]))
    starts = np.flatnonzero(edge > 0)
    ends = np.flatnonzero(edge < 0) - 1
    spans: list[list[float]] = []
    for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
        start = _edge_s(time_s, first, first - 1)
        end = _edge_s(time_s, last, last + 1)
        if spans and start - spans[-1][1] < _SHORTEST_S:
            spans[-1][1] = end
        else:
            spans.append([start, end])
    return np.array([span for span in spans if span[1] - span[0] >= _SHORTEST_S]).reshape(-1, 2)


def _edge_s(time_s: FloatArray, inside: int, outside: int) -> float:
    """Return the middle between the last state inside of a burn and the next one, or the end of the
    table.
    """
    if not 0 <= outside < len(time_s):
        return float(time_s[inside])
    return 0.5 * float(time_s[inside] + time_s[outside])
