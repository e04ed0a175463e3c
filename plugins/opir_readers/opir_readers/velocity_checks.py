"""Velocities of a table against the differences of its positions, and the slip that explains the
differences.

Velocities are compared with the rates of positions at each state: the slope there of the parabola
through it and its neighbours. Rates of a boost sampled every 30 s are wrong by tens of metres a
second where stages change, and those of positions rounded to metres at 0.1 s as much. So no fixed
bound shows a slip: the medians over all states are compared of the velocities as given and of the
same velocities mended, slip by slip. Where a mended set fits several times better, that slip is
what happened.
"""

from collections.abc import Iterator
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.plugin import StateTable
from opir_readers.celestial_frames import earth_rotation_m_s, turned
from opir_readers.columns import INERTIAL_VELOCITY, LOCAL_VELOCITY, SPEEDS, VELOCITIES, xyz
from opir_readers.frames import along_axes, axes_at, lengths
from opir_readers.interpolation import runs


@frozen
class SlipLimits:
    """When velocities are reported, and a slip explains them."""

    #: A slip explains the difference of velocities and positions if it leaves at most this share.
    explained: float = 0.3
    #: Slips fit alike if their residuals differ by this share of the difference to explain.
    alike: float = 0.01
    #: Median differences below this, m/s, are not reported: they move a target by metres between
    #: states.
    least_m_s: float = 0.2
    #: Unexplained medians are reported above this share of the median speed, and above the median
    #: change of rates from state to state.
    unexplained: float = 0.2
    #: One state is reported if its velocity is off by this multiple of the change of rates around
    #: it,
    outlier: float = 3.0
    #: and by this, m/s.
    least_outlier_m_s: float = 100.0
    #: States nearer to one another than this, s, are thinned out: rounding of positions hides rates
    #: between them.
    least_step_s: float = 1.0
    #: The most states that are compared: slips show in all.
    most_states: int = 2000


_LIMITS = SlipLimits()


@frozen
class VelocitySlip:
    """The difference of velocities from positions at a line, m/s, and the likely cause, "" for
    none.

    `residual_m_s` is the median difference that is left once the cause is mended; `is_systematic`
    is for a slip of the whole table, not of a few lines.
    """

    line: int
    difference_m_s: float
    cause: str = ""
    remedy: str = ""
    residual_m_s: float = float("nan")
    is_systematic: bool = True


class _Rates(NamedTuple):
    """Rows (n,), the rates of their positions (n, 3), m/s, and the change of rates around them
    (n,).
    """

    rows: RowArray
    rates: FloatArray
    turns: FloatArray


class _Mended(NamedTuple):
    """Velocities (n, 3), m/s, without a slip: its cause and remedy."""

    cause: str
    remedy: str
    velocity_m_s: FloatArray


def velocity_slip(table: StateTable) -> VelocitySlip | None:
    """Return how the velocities of a table contradict its positions, or None where they agree."""
    if table.velocity_m_s is None:
        return None
    rows, rates, turns = _rates(table)
    if len(rows) < 2:
        return None
    difference = lengths(table.velocity_m_s[rows] - rates)

    def slip_at(row: np.intp, **described: Any) -> VelocitySlip:
        return VelocitySlip(table.line_of(int(rows[row])), float(difference[row]), **described)

    worst = np.argmax(difference)
    median = float(np.median(difference))
    if median >= _LIMITS.least_m_s:
        slip, residual = _best(table, rows, rates, _LIMITS.alike * median)
        if residual <= _LIMITS.explained * median:
            return slip_at(worst, cause=slip.cause, remedy=slip.remedy, residual_m_s=residual)
    share_m_s = _LIMITS.unexplained * float(np.median(lengths(rates)))
    if median > max(share_m_s, float(np.median(turns)), _LIMITS.least_outlier_m_s):
        return slip_at(worst)
    excess = difference - np.maximum(_LIMITS.outlier * turns, _LIMITS.least_outlier_m_s)
    outlier = np.argmax(excess)
    return slip_at(outlier, is_systematic=False) if excess[outlier] > 0.0 else None


def _rates(table: StateTable) -> _Rates:
    parted = [_rates_of_run(table, _thinned(table.time_s, rows)) for rows in runs(table)]
    rows, rates, turns = (np.concatenate(columns) for columns in zip(*parted, strict=True))
    stride = -(-len(rows) // _LIMITS.most_states) or 1
    return _Rates(rows[::stride], rates[::stride], turns[::stride])


def _rates_of_run(table: StateTable, rows: RowArray) -> _Rates:
    if len(rows) < 3:
        return _Rates(rows[:0], np.empty((0, 3)), np.empty(0))
    step = np.diff(table.time_s[rows])[:, None]
    chord = np.diff(table.position_m[rows], axis=0) / step
    rates = (chord[:-1] * step[1:] + chord[1:] * step[:-1]) / (step[:-1] + step[1:])
    return _Rates(rows[1:-1], rates, lengths(np.diff(chord, axis=0)))


def _thinned(time_s: FloatArray, rows: RowArray) -> RowArray:
    """Return some of the rows, a second apart or more where there are enough."""
    step_s = (time_s[rows[-1]] - time_s[rows[0]]) / max(len(rows) - 1, 1)
    least_s = _LIMITS.least_step_s
    stride = int(np.ceil(least_s / step_s)) if 0.0 < step_s < least_s else 1
    return rows[:: max(min(stride, len(rows) // 8), 1)]


def _best(
    table: StateTable, rows: RowArray, rates: FloatArray, alike_m_s: float
) -> tuple[_Mended, float]:
    """Return the slip that explains best, and the median difference without it, m/s.

    Slips whose differences are within `alike_m_s` fit alike.
    """
    slips = list(_mended(table, rows, rates))
    residuals = [float(np.median(lengths(slip.velocity_m_s - rates))) for slip in slips]
    # Of slips that fit alike the plainest counts, which comes first: an axis of a flat flight may
    # have either sign.
    limit = 1.2 * min(residuals) + alike_m_s
    row = next(row for row, residual in enumerate(residuals) if residual <= limit)
    return slips[row], residuals[row]


def _mended(table: StateTable, rows: RowArray, rates: FloatArray) -> Iterator[_Mended]:
    """Yield the velocities of rows without the usual slips, the plainest first."""
    assert table.velocity_m_s is not None
    velocity = table.velocity_m_s[rows]
    for unit, factor in SPEEDS.items():
        for cause, names, mended in _frames(table, rows, factor * velocity, rates):
            text = {"kn": "knots"}.get(unit, unit.replace("_", "/"))
            words = [cause, "" if unit == "m_s" else f"in {text}"]
            if any(words):
                remedy = _renamed(table, names, unit)
                yield _Mended(" and ".join(filter(None, words)), remedy, mended)
    yield _Mended("of the wrong sign", "", -velocity)
    yield from _other_axes(velocity)
    # Rows are within their runs, so that each has a line above and one below.
    for shift, side in ((1, "above"), (-1, "below")):
        neighbours = table.velocity_m_s[rows + shift]
        yield _Mended(f"of the line {side}", "move the velocities by one line", neighbours)
    yield _lagged(velocity, rates, table.time_s[rows])


def _frames(
    table: StateTable, rows: RowArray, velocity: FloatArray, rates: FloatArray
) -> Iterator[tuple[str, tuple[str, ...], FloatArray]]:
    """Yield the velocities of rows in ECEF from each usual frame: its words, "" for ECEF, and the
    quantities of its columns.
    """
    axes = axes_at(table.position_m[rows])
    rotation = earth_rotation_m_s(table.position_m[rows])
    turn_rad = EARTH_ROTATION_RAD_S * (table.time_s[rows] - table.time_s[rows[0]])
    angle = _angle_of_axes(velocity, rates + rotation, turn_rad)
    north_east_down = velocity[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    yield "", xyz("v{}_ecef"), velocity
    yield "inertial (with the Earth's rotation)", INERTIAL_VELOCITY, velocity - rotation
    still = turned(velocity, [("z", angle)])
    yield "inertial, in axes that do not turn with the Earth", (), still - rotation
    yield "without the Earth's rotation twice over", (), velocity + rotation
    yield "towards east, north and up", LOCAL_VELOCITY, along_axes(velocity, axes)
    yield "towards north, east and down", (), along_axes(north_east_down, axes)
    mended = along_axes(velocity, axes[:1])
    yield "towards east, north and up of the first place", (), mended


def _angle_of_axes(velocity: FloatArray, rates: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the angles (n,) of Earth-fixed axes from the inertial ones of velocities (n, 3).

    They turn by `turn_rad` (n,) from the first row on, whose angle fits inertial rates (n, 3) in
    Earth-fixed axes best.
    """
    east = velocity[:, 0] + 1j * velocity[:, 1]
    fixed = rates[:, 0] + 1j * rates[:, 1]
    first = np.angle(np.sum(east * np.conj(fixed) * np.exp(-1j * turn_rad)))
    angle: FloatArray = first + turn_rad
    return angle


def _other_axes(velocity: FloatArray) -> Iterator[_Mended]:
    """Yield velocities with axes in another order or sign."""
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order != (0, 1, 2) or sum(signs) not in (3.0, -3.0):
            axes = ", ".join(
                f"{'-' if sign < 0.0 else ''}v{'xyz'[axis]}"
                for axis, sign in zip(order, signs, strict=True)
            )
            words = f"with axes in another order or sign ({axes} is vx, vy, vz)"
            yield _Mended(words, "", velocity[:, order] * np.array(signs))


def _lagged(velocity: FloatArray, rates: FloatArray, time_s: FloatArray) -> _Mended:
    """Return velocities of another time: the lag that fits best, by least squares on the rates of
    the rates.
    """
    change = 0.0 * rates
    if len(rates) > 2 and (np.diff(time_s) > 0.0).all():
        change = np.gradient(rates, time_s, axis=0)
    weight = float((change * change).sum())
    lag_s = float(((rates - velocity) * change).sum()) / weight if weight > 0.0 else 0.0
    lagged_s = np.clip(time_s + lag_s, time_s[0], time_s[-1])
    mended = np.stack([np.interp(lagged_s, time_s, axis) for axis in velocity.T], axis=1)
    side = "earlier" if lag_s > 0.0 else "later"
    return _Mended(f"of a time {abs(lag_s):.2g} s {side} than their positions", "", mended)


def _renamed(table: StateTable, quantities: tuple[str, ...], unit: str) -> str:
    """Return the column map that reads the velocities rightly, "" where none does."""
    names = [
        table.column_names[name]
        for group in VELOCITIES
        for name in group
        if name in table.column_names
    ]
    pairs = zip(quantities, names, strict=False)
    mapped = ", ".join(f"{quantity}_{unit}: {name}" for quantity, name in pairs)
    return f"set columns: {{{mapped}}}" if mapped else ""
