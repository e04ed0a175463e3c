"""Smoothing splines: the smoothest curve that stays as near to values as their noise lets it."""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import BadFileError, StateTable
from opir_readers.interpolation import runs

#: Values farther from the curve than this, in standard deviations, are left out of a second fit.
_OUTLIER = 6.0

#: Most digits that rounded values have.
_DIGITS = 9.0

#: The fewest values of a run that are smoothed.
_FEWEST = 8


@frozen(eq=False)
class Smoothed:
    """A cubic spline through noisy values: the knots, the root mean square of the residuals, and
    the number of outliers.
    """

    spline: object
    residual: float = 0.0
    outliers: int = 0

    def at(self, time_s: FloatArray, derivative: int = 0) -> FloatArray:
        """Return the curve or a derivative (n,) at times (n,)."""
        from scipy.interpolate import splev

        return splev(time_s, self.spline, der=derivative)


def smoothing_spline(time_s: FloatArray, values: FloatArray, sigma: FloatArray | float) -> Smoothed:
    """Return the spline of values (n,) with standard deviations (n,), or one; values far off the
    first fit are left out.

    It has the fewest knots with which the squares of the residuals sum to n sigma² (FITPACK
    `curfit`).
    """
    sigma = np.broadcast_to(sigma, values.shape)
    is_fitted = ~_spikes(values, sigma)
    for _ in range(2):
        fit = _fitted(time_s[is_fitted], values[is_fitted], sigma[is_fitted])
        residual = values - fit.at(time_s)
        is_outlier = is_fitted & (np.abs(residual) > _OUTLIER * sigma)
        # A curve that is too stiff for what it is to follow has many large residuals: those are no
        # outliers.
        if not is_outlier.any() or np.count_nonzero(is_outlier) > 0.02 * len(time_s):
            break
        is_fitted &= ~is_outlier
    rms = float(np.sqrt(np.mean(residual[is_fitted] ** 2)))
    return Smoothed(fit.spline, rms, int(np.count_nonzero(~is_fitted)))


def _fitted(time_s: FloatArray, values: FloatArray, sigma: FloatArray) -> Smoothed:
    from scipy.interpolate import splrep

    spline, _, code, _ = splrep(
        time_s, values, w=1.0 / sigma, k=3, s=float(len(values)), full_output=True, quiet=True
    )
    if code > 3:
        raise BadFileError("cannot be smoothed; check its numbers, or state another noise_m")
    return Smoothed(spline)


def _spikes(values: FloatArray, sigma: FloatArray) -> BoolArray:
    """Return which values (n,) stand apart from two neighbours on either side: misread digits, a
    spline chases them.
    """
    padded = np.pad(values, 2, mode="edge")
    neighbours = np.lib.stride_tricks.sliding_window_view(padded, 5)
    low, middle, high = np.percentile(neighbours, [25, 50, 75], axis=1)
    return np.abs(values - middle) > _OUTLIER * sigma + 2.0 * (high - low)


def rounding_sigma(values: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of the rounding of values to powers of ten, 0 where they
    are not rounded.

    Displays of three digits show 0.1 below 100 and 1 above: each order of magnitude has the step of
    its values and of larger ones, but at most ten times that of the order below, for few values may
    be round by chance.
    """
    order = np.floor(np.log10(np.maximum(np.abs(values), 1e-300)))
    orders, group = np.unique(order[values != 0.0], return_inverse=True)
    if not len(orders):
        return np.zeros(len(values))
    step = np.array([_step(values[order >= least], least) for least in orders])
    for row, digits in enumerate(np.diff(orders), 1):
        step[row] = min(step[row], step[row - 1] * 10.0**digits)
    sigma = np.full(len(values), step[0])
    sigma[values != 0.0] = step[group]
    return sigma / 12.0**0.5


def _step(values: FloatArray, order: float) -> float:
    """Return the largest power of ten, up to one, of which nearly all values are multiples; 0 if
    there is none.
    """
    powers = 10.0 ** np.arange(order, order - _DIGITS, -1.0)
    return next((power for power in powers.tolist() if _are_whole(values / power, 1e-3)), 0.0)


def _are_whole(values: FloatArray, tolerance: float) -> bool:
    """Whether nearly all values (n,) are whole numbers."""
    return bool((np.abs(values - np.rint(values)) < tolerance).mean() > 0.99)


def speed_rounding_sigma(speed_m_s: FloatArray) -> FloatArray:
    """Return the standard deviations (n,) of the rounding of speeds: to whole km/h, which webcasts
    show, or as written.
    """
    # Published tables cut kilometres an hour to three decimals of a metre a second.
    if _are_whole(speed_m_s * 3.6, 0.01):
        return np.full(len(speed_m_s), 1.0 / 3.6 / 12.0**0.5)
    return rounding_sigma(speed_m_s)


def smoothed_table(table: StateTable, noise_m: float) -> StateTable:
    """Return a table on smoothing splines of its positions, with their velocities; a note gives the
    residuals.

    Each run is smoothed on its own. Raises `BadFileError` for runs with few states.
    """
    position = np.empty_like(table.position_m)
    velocity = np.empty_like(table.position_m)
    squares = 0.0
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
            squares = squares + fit.residual**2 * len(rows)
            outliers = outliers + fit.outliers
    rms = (squares / (3.0 * len(table.time_s))) ** 0.5
    more = f", {outliers} coordinates left out" if outliers else ""
    note = f"smoothed to a noise of {noise_m:g} m: {rms:.3g} m rms are left per axis{more}"
    return evolve(table, position_m=position, velocity_m_s=velocity, notes=(*table.notes, note))
