"""Velocities of a table against the differences of its positions, and the slip that explains what
they differ by.

Velocities are compared with the rates of positions at each state: the slope there of the parabola
through it and its neighbours. Rates of a boost sampled every 30 s are wrong by tens of metres a
second where stages change, and those of positions rounded to metres at 0.1 s as much. So no fixed
bound shows a slip: the medians over all states are compared of the velocities as given and of the
same velocities mended, slip by slip. Where a mended set fits several times better, that slip is
what happened.
"""

from collections.abc import Iterator
from itertools import permutations, product

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import east_north_up_axes, ecef_to_geodetic
from opir_core.plugin import StateTable
from opir_readers.columns import VELOCITIES
from opir_readers.interpolation import runs

#: A slip explains what velocities and positions differ by if it leaves at most this share of it.
_EXPLAINED = 0.3

#: Slips fit alike if what they leave differs by this share of what there was to explain.
_ALIKE = 0.01

#: Median differences below this, m/s, are not reported: they move a target by metres between
#: states.
_LEAST_M_S = 0.2

#: Unexplained medians are reported above this share of the median speed, and above the median
#: change of rates from state to state.
_UNEXPLAINED = 0.2

#: One state is reported if its velocity is off by this multiple of what rates change by around it,
#: and by this, m/s.
_OUTLIER = 3.0
_LEAST_OUTLIER_M_S = 100.0

#: States nearer to one another than this, s, are thinned out: rounding of positions hides rates
#: between them.
_LEAST_STEP_S = 1.0

#: The most states that are compared: slips show in all.
_MOST_STATES = 2000


@frozen
class VelocitySlip:
    """What velocities differ from positions by: at a line, the figures in m/s, and the likely
    cause, "" for none.

    `residual_m_s` is the median difference that is left once the cause is mended; `is_systematic`
    is for a slip of the whole table, not of a few lines.
    """

    line: int
    difference_m_s: float
    cause: str = ""
    remedy: str = ""
    residual_m_s: float = float("nan")
    is_systematic: bool = True


def velocity_slip(table: StateTable) -> VelocitySlip | None:
    """Return how the velocities of a table contradict its positions, or None where they agree."""
    if table.velocity_m_s is None:
        return None
    rows, rates, turns = _rates(table)
    if len(rows) < 2:
        return None
    off = _length(table.velocity_m_s[rows] - rates)
    worst = int(np.argmax(off))
    median = float(np.median(off))
    if median >= _LEAST_M_S:
        cause, remedy, left = _best(table, rows, rates, _ALIKE * median)
        if left <= _EXPLAINED * median:
            return VelocitySlip(
                table.line_of(int(rows[worst])), float(off[worst]), cause, remedy, left
            )
    speed = float(np.median(_length(rates)))
    if median > max(_UNEXPLAINED * speed, float(np.median(turns)), _LEAST_OUTLIER_M_S):
        return VelocitySlip(table.line_of(int(rows[worst])), float(off[worst]))
    excess = off - np.maximum(_OUTLIER * turns, _LEAST_OUTLIER_M_S)
    if excess.max() > 0.0:
        row = int(np.argmax(excess))
        return VelocitySlip(table.line_of(int(rows[row])), float(off[row]), is_systematic=False)
    return None


def _rates(table: StateTable) -> tuple[RowArray, FloatArray, FloatArray]:
    """Return rows (n,), the rates of their positions (n, 3), m/s, and how much rates change around
    them (n,).
    """
    parts = [_rates_of_run(table, _thinned(table.time_s, rows)) for rows in runs(table)]
    rows, rates, turns = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    stride = -(-len(rows) // _MOST_STATES) or 1
    return rows[::stride], rates[::stride], turns[::stride]


def _rates_of_run(table: StateTable, rows: RowArray) -> tuple[RowArray, FloatArray, FloatArray]:
    if len(rows) < 3:
        return rows[:0], np.empty((0, 3)), np.empty(0)
    step = np.diff(table.time_s[rows])[:, None]
    chord = np.diff(table.position_m[rows], axis=0) / step
    before = step[:-1]
    after = step[1:]
    rates = (chord[:-1] * after + chord[1:] * before) / (before + after)
    return rows[1:-1], rates, _length(np.diff(chord, axis=0))


def _thinned(time_s: FloatArray, rows: RowArray) -> RowArray:
    """Return some of the rows, a second apart or more where there are enough."""
    step_s = (time_s[rows[-1]] - time_s[rows[0]]) / max(len(rows) - 1, 1)
    stride = int(np.ceil(_LEAST_STEP_S / step_s)) if 0.0 < step_s < _LEAST_STEP_S else 1
    return rows[:: max(min(stride, len(rows) // 8), 1)]


def _best(
    table: StateTable, rows: RowArray, rates: FloatArray, alike_m_s: float
) -> tuple[str, str, float]:
    """Return the slip that explains best, its remedy, and the median difference that it leaves,
    m/s.

    Slips that leave as little to within `alike_m_s` fit alike.
    """
    found = [
        (float(np.median(_length(mended - rates))), order, cause, remedy)
        for order, (cause, remedy, mended) in enumerate(_mended(table, rows, rates))
    ]
    least = min(found)[0]
    # Of slips that fit alike the plainest counts, which comes first: an axis of a flat flight may
    # have either sign.
    left, _, cause, remedy = next(row for row in found if row[0] <= 1.2 * least + alike_m_s)
    return cause, remedy, left


_UNITS = {"": 1.0, "km_s": 1e3, "ft_s": 0.3048, "km_h": 1.0 / 3.6, "kn": 1852.0 / 3600.0}
_IN_UNITS = {"km_s": "km/s", "ft_s": "ft/s", "km_h": "km/h", "kn": "knots"}


def _mended(
    table: StateTable, rows: RowArray, rates: FloatArray
) -> Iterator[tuple[str, str, FloatArray]]:
    """Yield the usual slips, the plainest first: cause, remedy, and the velocities without it."""
    assert table.velocity_m_s is not None
    given = table.velocity_m_s[rows]
    place_m = table.position_m[rows]
    time_s = table.time_s[rows]
    where = ecef_to_geodetic(place_m)
    local = east_north_up_axes(where.latitude_rad, where.longitude_rad)
    turning = EARTH_ROTATION_RAD_S * np.stack(
        [-place_m[:, 1], place_m[:, 0], 0.0 * place_m[:, 0]], axis=1
    )
    angle = _angle_of_axes(given, rates + turning, EARTH_ROTATION_RAD_S * (time_s - time_s[0]))
    cosine = np.cos(angle)[:, None]
    sine = np.sin(angle)[:, None]
    for unit, factor in _UNITS.items():
        v = factor * given
        still = np.concatenate(
            [cosine * v[:, :1] + sine * v[:, 1:2], cosine * v[:, 1:2] - sine * v[:, :1], v[:, 2:]],
            1,
        )
        swapped = np.stack([v[:, 1], v[:, 0], -v[:, 2]], axis=1)
        for cause, names, mended in (
            ("", ("vx_ecef", "vy_ecef", "vz_ecef"), v),
            (
                "inertial (with the Earth's rotation)",
                ("vx_inertial", "vy_inertial", "vz_inertial"),
                v - turning,
            ),
            ("inertial, in axes that do not turn with the Earth", (), still - turning),
            ("without the Earth's rotation twice over", (), v + turning),
            ("towards east, north and up", ("v_east", "v_north", "v_up"), _along(v, local)),
            ("towards north, east and down", (), _along(swapped, local)),
            (
                "towards east, north and up of the first place",
                (),
                _along(v, np.broadcast_to(local[:1], local.shape)),
            ),
        ):
            if cause or unit:
                words = " and ".join(filter(None, [cause, f"in {_IN_UNITS[unit]}" if unit else ""]))
                yield words, _renamed(table, names, unit), mended
    yield "of the wrong sign", "", -given
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        if order != (0, 1, 2) or sum(signs) not in (3.0, -3.0):
            axes = ", ".join(
                f"{'-' if sign < 0.0 else ''}v{'xyz'[axis]}"
                for axis, sign in zip(order, signs, strict=True)
            )
            yield (
                f"with axes in another order or sign ({axes} is vx, vy, vz)",
                "",
                given[:, order] * np.array(signs),
            )
    # Rows are within their runs, so that each has a line above and one below.
    for shift, words in ((1, "above"), (-1, "below")):
        yield (
            f"of the line {words}",
            "move the velocities by one line",
            table.velocity_m_s[rows + shift],
        )
    yield from _lagged(given, rates, time_s)


def _angle_of_axes(given: FloatArray, inertial: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the angles (n,) of Earth-fixed axes from the inertial ones of given velocities, by
    least squares.
    """
    east = given[:, 0] + 1j * given[:, 1]
    other = inertial[:, 0] + 1j * inertial[:, 1]
    first = np.angle(np.sum(east * np.conj(other) * np.exp(-1j * turn_rad)))
    angle: FloatArray = first + turn_rad
    return angle


def _lagged(
    given: FloatArray, rates: FloatArray, time_s: FloatArray
) -> Iterator[tuple[str, str, FloatArray]]:
    """Yield velocities of another time: the lag that fits best, by least squares on the rates of
    the rates.
    """
    change = (
        np.gradient(rates, time_s, axis=0)
        if len(rates) > 2 and (np.diff(time_s) > 0.0).all()
        else 0.0 * rates
    )
    weight = float((change * change).sum())
    lag_s = float(((rates - given) * change).sum()) / weight if weight > 0.0 else 0.0
    when = np.clip(time_s + lag_s, time_s[0], time_s[-1])
    mended = np.stack([np.interp(when, time_s, axis) for axis in given.T], axis=1)
    words = (
        f"of a time {abs(lag_s):.2g} s {'earlier' if lag_s > 0.0 else 'later'} than their positions"
    )
    yield words, "", mended


def _renamed(table: StateTable, quantities: tuple[str, ...], unit: str) -> str:
    """Return the column map that reads the velocities rightly, "" where none does."""
    names = [
        table.column_names[name]
        for group in VELOCITIES
        for name in group
        if name in table.column_names
    ]
    pairs = zip(quantities, names, strict=False)
    mapped = ", ".join(f"{quantity}_{unit or 'm_s'}: {name}" for quantity, name in pairs)
    return f"set columns: {{{mapped}}}" if mapped else ""


def _along(velocity_m_s: FloatArray, axes: FloatArray) -> FloatArray:
    return np.asarray((velocity_m_s[:, :, None] * axes).sum(axis=1))


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt((vectors * vectors).sum(axis=1))
