"""Smoothing splines: the smoothest curve that stays as near to values as their noise lets it."""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import BadFileError, StateTable
from opir_readers.interpolation import runs

#: Values farther from the curve than this, in standard deviations, are left out of a second fit.
_OUTLIER = 6.0

#: The fewest values of a run that are smoothed.
_FEWEST = 8


@frozen(eq=False)
class Smoothed:
    """A cubic spline through noisy values: the knots, the root mean square of what it leaves, and
    what it left out.
    """

    spline: object
    residual: float
    outliers: int

    def at(self, time_s: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the curve or a derivative (n,) at times (n,)."""
        from scipy.interpolate import splev

        return np.asarray(splev(time_s, self.spline, der=derivative))


def smoothing_spline(time_s: FloatArray, values: FloatArray, sigma: float) -> Smoothed:
    """Return the spline of values (n,) with a standard deviation; values far off the first fit are
    left out.

    It has the fewest knots with which the squares of the residuals sum to n sigma² (FITPACK
    `curfit`).
    """
    from scipy.interpolate import splrep

    kept = ~_spikes(values, sigma)
    for _ in range(2):
        count = int(np.count_nonzero(kept))
        weights = np.full(count, 1.0 / sigma)
        spline, _, code, _ = splrep(
            time_s[kept], values[kept], w=weights, k=3, s=float(count), full_output=True, quiet=True
        )
        if code > 3:
            raise BadFileError("cannot be smoothed; state another noise")
        off = np.abs(values - _at(spline, time_s))
        outside = kept & (off > _OUTLIER * sigma)
        # A curve that is too stiff for what it is to follow has many large residuals: those are no
        # outliers.
        if not outside.any() or np.count_nonzero(outside) > 0.02 * len(time_s):
            break
        kept &= ~outside
    residual = float(np.sqrt(np.mean((values - _at(spline, time_s))[kept] ** 2)))
    return Smoothed(spline, residual, int(np.count_nonzero(~kept)))


def _spikes(values: FloatArray, sigma: float) -> BoolArray:
    """Return which values (n,) stand apart from two neighbours on either side: misread digits, a
    spline chases them.
    """
    padded = np.pad(values, 2, mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 5)
    low, middle, high = np.percentile(around, [25, 50, 75], axis=1)
    return np.asarray(np.abs(values - middle) > _OUTLIER * sigma + 2.0 * (high - low))


def _at(spline: object, time_s: FloatArray) -> FloatArray:
    from scipy.interpolate import splev

    return np.asarray(splev(time_s, spline))


def rounding_sigma(values: FloatArray) -> float:
    """Return the standard deviation of the rounding of values: of their smallest step; 0 where they
    are not rounded.
    """
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * max(float(np.abs(values).max(initial=0.0)), 1e-300)]
    if not len(steps):
        return 0.0
    quantum = float(steps.min())
    whole = np.abs(values / quantum - np.rint(values / quantum)) < 1e-3
    return quantum / 12.0**0.5 if whole.mean() > 0.99 else 0.0


def speed_rounding_sigma(speed_m_s: FloatArray) -> float:
    """Return the standard deviation of the rounding of speeds: to whole km/h, which webcasts show,
    or as written.
    """
    km_h = speed_m_s * 3.6
    # Published tables cut kilometres an hour to three decimals of a metre a second.
    is_whole = np.abs(km_h - np.rint(km_h)) < 0.01
    return 1.0 / 3.6 / 12.0**0.5 if is_whole.mean() > 0.99 else rounding_sigma(speed_m_s)


def smoothed_table(table: StateTable, noise_m: float) -> StateTable:
    """Return a table on smoothing splines of its positions, with their velocities; a note says what
    was left.

    Each run is smoothed on its own. Raises `BadFileError` for runs with few states.
    """
    position = np.empty_like(table.position_m)
    velocity = np.empty_like(table.position_m)
    left = 0.0
    outliers = 0
    for rows in runs(table):
        if len(rows) < _FEWEST:
            raise BadFileError(
                f"line {table.line_of(int(rows[0]))}: begins {len(rows)} states without a break,"
                " too few to smooth; omit noise_m"
            )
        for axis in range(3):
            fit = smoothing_spline(table.time_s[rows], table.position_m[rows, axis], noise_m)
            position[rows, axis] = fit.at(table.time_s[rows])
            velocity[rows, axis] = fit.at(table.time_s[rows], 1)
            left = left + fit.residual**2 * len(rows)
            outliers = outliers + fit.outliers
    rms = (left / (3.0 * len(table.time_s))) ** 0.5
    more = f", {outliers} coordinates left out" if outliers else ""
    note = f"smoothed to a noise of {noise_m:g} m: {rms:.3g} m rms are left per axis{more}"
    return evolve(table, position_m=position, velocity_m_s=velocity, notes=(*table.notes, note))
