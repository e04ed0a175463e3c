"""Burns that an acceleration shows: specific forces, without gravity, along the velocity."""

from collections.abc import Iterable

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.geometry import components, dot, ecef_to_geodetic, vector
from opir_core.plugin import BadFileError, StateTable
from opir_readers.frames import lengths
from opir_readers.interpolation import interpolant, runs
from opir_readers.states import MOST_BURNS

_J2 = 1.08262668e-3

#: Thrust accelerates by at least this, m/s²; what is left of noise and of gravity's higher terms is
#: less.
LEAST_THRUST_M_S2 = 2.0

#: Above this height, m, drag is no longer like thrust against the velocity, as of a boostback.
AIRLESS_M = 60_000.0

#: The shortest burns and gaps that are separated, s.
_SHORTEST_S = 3.0

#: Start and end, s.
Span = tuple[float, float]


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
            " noise_m"
        )
    listed = spans_text(burns - table.time_s[0])
    note = f"burns by acceleration, from the first state: {listed}"
    return evolve(table, burns_s=burns, notes=(*table.notes, note))


def spans_text(spans_s: FloatArray) -> str:
    """Return spans (k, 2), s, for a note."""
    return ", ".join(f"{start:.1f} to {end:.1f} s" for start, end in spans_s.tolist())


def is_thrusting(table: StateTable) -> BoolArray:
    """Return at which states (n,) the specific force is that of thrust."""
    force, speed_axis = _specific_force(table)
    along = dot(force, speed_axis)
    is_high = ecef_to_geodetic(table.position_m).height_m > AIRLESS_M
    is_strong = lengths(force) > LEAST_THRUST_M_S2
    return (along > LEAST_THRUST_M_S2) | (is_high & is_strong)


def _specific_force(table: StateTable) -> tuple[FloatArray, FloatArray]:
    """Return accelerations without gravity, m/s², and unit vectors of the velocity, (n, 3), at the
    states.
    """
    curve = interpolant([table])
    force = np.zeros_like(table.position_m)
    axis = np.zeros_like(table.position_m)
    for rows in runs(table):
        if len(rows) < 2:
            continue
        time_s = table.time_s[rows]
        half_s = _half_interval_s(time_s)
        middle_s = np.clip(time_s, time_s[0] + half_s, time_s[-1] - half_s)
        before, middle, after = (
            curve.at(middle_s + shift_s)[0] for shift_s in (-half_s, 0.0, half_s)
        )
        acceleration = (after - 2.0 * middle + before) / half_s**2
        velocity = (after - before) / (2.0 * half_s)
        force[rows] = acceleration + _rotating(middle, velocity) - _gravity(middle)
        axis[rows] = velocity / np.maximum(lengths(velocity), 1e-9)[:, None]
    return force, axis


def _half_interval_s(time_s: FloatArray) -> float:
    """Return half of the time over which accelerations are averaged: a second or more."""
    step_s = float(np.median(np.diff(time_s)))
    return min(max(1.0, step_s), 0.25 * float(time_s[-1] - time_s[0]))


def _rotating(position_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Return the excess of accelerations in space over those over the turning Earth: Coriolis and
    centripetal.
    """
    x, y, _ = components(position_m)
    vx, vy, _ = components(velocity_m_s)
    omega = EARTH_ROTATION_RAD_S
    return vector(-2 * omega * vy - omega**2 * x, 2 * omega * vx - omega**2 * y, 0.0)


def _gravity(position_m: FloatArray) -> FloatArray:
    """Return gravitation with the Earth's flattening (J2), m/s²."""
    radius = lengths(position_m)
    sine2 = (position_m[:, 2] / radius) ** 2
    scale = 1.5 * _J2 * (EARTH_EQUATORIAL_RADIUS_M / radius) ** 2
    level = 1.0 + scale * (1.0 - 5.0 * sine2)
    factors = vector(level, level, 1.0 + scale * (3.0 - 5.0 * sine2))
    return (-EARTH_MU_M3_S2 / radius**3)[:, None] * position_m * factors


def spans_of(is_inside: BoolArray) -> tuple[RowArray, RowArray]:
    """Return the first and the last rows (k,) of each stretch of true values (n,)."""
    edge = np.diff(np.concatenate([[0], is_inside.astype(np.int8), [0]]))
    return np.flatnonzero(edge > 0), np.flatnonzero(edge < 0) - 1


def joined_spans(spans: Iterable[Span], gap_s: float) -> list[Span]:
    """Return spans in order, those that are no more than a gap apart as one."""
    joined = list[Span]()
    for start, end in sorted(spans):
        if joined and start <= joined[-1][1] + gap_s:
            joined[-1] = joined[-1][0], max(end, joined[-1][1])
        else:
            joined.append((start, end))
    return joined


def burns_s(time_s: FloatArray, is_burning: BoolArray) -> FloatArray:
    """Return burns (k, 2) from states that thrust; short burns and short gaps are taken for
    noise.
    """
    starts, ends = spans_of(is_burning)
    spans = list[Span]()
    for first_row, last_row in zip(starts.tolist(), ends.tolist(), strict=True):
        start = _edge_s(time_s, first_row, first_row - 1)
        end = _edge_s(time_s, last_row, last_row + 1)
        if spans and start - spans[-1][1] < _SHORTEST_S:
            spans[-1] = spans[-1][0], end
        else:
            spans.append((start, end))
    return np.array([span for span in spans if span[1] - span[0] >= _SHORTEST_S]).reshape(-1, 2)


def _edge_s(time_s: FloatArray, inside: int, outside: int) -> float:
    """Return the middle between the outermost state inside of a burn and the next one outside, or
    the end of the table.
    """
    if not 0 <= outside < len(time_s):
        return float(time_s[inside])
    return 0.5 * float(time_s[inside] + time_s[outside])
