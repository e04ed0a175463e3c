"""Lambert's time of flight for less than one turn, free of cancellation, and its inverse.

In Izzo's form (Celestial Mechanics and Dynamical Astronomy 121, 2015, 1-15) a transfer is two numbers: the time in
units of sqrt(s³ / 2 mu), and lam = ±sqrt(1 - c/s), with chord c and semi-perimeter s, negative the long way round. The
unknown x is below 1 on ellipses, 1 on the parabola and above on hyperbolas. Here it is found as w = 1 + x, and every
difference that can cancel is replaced by c/s over the matching sum, so that a hop of a metre and a vertical throw are
solved as exactly as a quarter of the globe.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.stumpff import universal_functions

_MOST_STEPS = 120

#: A step this small in log w is the last: Newton's method squares it.
_LAST_STEP = 1e-9

#: Beyond this w, fast hyperbolas the long way round have a formula of their own.
_FAST = 2.2

#: Bounds of log w: times of flight from 1e33 to 1e-130 units.
_LEAST, _MOST = -50.0, 300.0

#: Terms (3)_n / (5/2)_n of the series of F(3, 1; 5/2; S), for Q near the parabola.
_SERIES = tuple(float(term) for term in np.cumprod([1.0, *((3.0 + n) / (2.5 + n) for n in range(8))]))
_NEAR_PARABOLA, _AT_PARABOLA = 1e-2, 1e-30


class Transfer(NamedTuple):
    """Shapes of transfers: `lam`, and chord = c/s = 1 - lam² by itself, which a `lam` near ±1 no longer holds."""

    lam: FloatArray
    chord: FloatArray

    def at(self, index: NDArray[np.intp]) -> "Transfer":
        """Return the transfers at these indices."""
        return Transfer(self.lam[index], self.chord[index])

    def one_plus_lam(self) -> FloatArray:
        """Return 1 + lam."""
        return np.where(self.lam < 0.0, self.chord / (1.0 - self.lam), 1.0 + self.lam)

    def one_less_lam(self) -> FloatArray:
        """Return 1 - lam."""
        return np.where(self.lam > 0.0, self.chord / (1.0 + self.lam), 1.0 - self.lam)


def solved_w(transfer: Transfer, time: FloatArray) -> FloatArray:
    """Return w = 1 + x of transfers that take these times; `nan` where none does."""
    log_w = _first_guess(transfer, time)
    low, high = np.full_like(log_w, _LEAST), np.full_like(log_w, _MOST)
    still = (time > 0.0) & np.isfinite(time) & np.isfinite(transfer.lam)
    log_w[~still] = np.nan
    for _ in range(_MOST_STEPS):
        at = np.flatnonzero(still)
        if not at.size:
            break
        flight, slope = _time_and_slope(transfer.at(at), np.exp(log_w[at]))
        late = flight > time[at]
        low[at], high[at] = np.where(late, log_w[at], low[at]), np.where(late, high[at], log_w[at])
        trial = log_w[at] - np.log(flight / time[at]) / slope
        inside = (trial >= low[at]) & (trial <= high[at])
        trial = np.where(inside, trial, 0.5 * (low[at] + high[at]))
        still[at] = np.abs(trial - log_w[at]) > _LAST_STEP
        log_w[at] = trial
    return np.where(still | (log_w >= _MOST - 1.0) | (log_w <= _LEAST + 1.0), np.nan, np.exp(log_w))


def _first_guess(transfer: Transfer, time: FloatArray) -> FloatArray:
    """Return a guess of log w from the times at x = 0 and x = 1 (Izzo 2015)."""
    lam, chord = transfer
    middle = np.arctan2(np.sqrt(chord), lam) + lam * np.sqrt(chord)
    parabolic = 2.0 / 3.0 * transfer.one_less_lam() * (1.0 + lam + lam * lam)
    slow = np.log(middle / time) * (2.0 / 3.0)
    between = np.log(2.0) * np.log(time / middle) / np.log(parabolic / middle)
    fast = np.log(2.0 + 2.5 * parabolic * (parabolic - time) / (time * (1.0 - lam**5)))
    guess = np.where(time >= middle, slow, np.where(time < parabolic, fast, between))
    return np.where((guess > _LEAST) & (guess < _MOST), guess, -0.5)


def y_and_differences(
    transfer: Transfer, w: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return y, y - x, y + x, y - lam x and y + lam x, where y² = chord + lam² x², none of them cancelling."""
    lam, chord = transfer
    x, open_ = w - 1.0, w * (2.0 - w)
    y = np.sqrt(chord + (lam * x) ** 2)
    ahead, same = x > 0.0, lam * x > 0.0
    less_x = np.where(ahead, chord * open_ / (y + x), y - x)
    plus_x = np.where(ahead, y + x, chord * open_ / (y - x))
    less_lam_x = np.where(same, chord / (y + lam * x), y - lam * x)
    plus_lam_x = np.where(same, y + lam * x, chord / (y - lam * x))
    return y, less_x, plus_x, less_lam_x, plus_lam_x


def _time_and_slope(transfer: Transfer, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the time of flight and d log time / d log w.

    time = (eta³ Q + 4 lam eta) / 2 with eta = y - lam x and Q = 4/3 F(3, 1; 5/2; S) (Izzo 2015, after Battin),
    where S = (1 - lam - x eta) / 2 = sin²(u/2) makes Q = (2u - sin 2u) / sin³ u, hyperbolic for negative S.
    """
    y, less_x, plus_x, eta, _ = y_and_differences(transfer, w)
    lam = transfer.lam
    s = 0.5 * eta * less_x / transfer.one_plus_lam()
    backward = (w < 1.0) & (lam > 0.0)
    ratio = np.where(backward, w * (2.0 - w) * (1.0 + lam) / less_x, plus_x / transfer.one_less_lam())
    q, q_slope = _q_and_slope(s, 0.5 * eta * ratio)
    time = 0.5 * eta * (eta * eta * q + 4.0 * lam)
    slope = -0.5 * eta / y * (3.0 * lam * eta * eta * q + 0.5 * eta**4 * q_slope + 4.0 * lam * lam)
    at = np.flatnonzero((lam < 0.0) & (w > _FAST))
    if at.size:
        time[at], slope[at] = _fast_long_way(lam[at], w[at], y[at], eta[at])
    return time, slope * w / time


def _fast_long_way(lam: FloatArray, w: FloatArray, y: FloatArray, eta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the time of flight and its slope in w on hyperbolas the long way round, where Q and lam cancel.

    The form of Lancaster and Blanchard (NASA TN D-5368, 1969).
    """
    x, open_ = w - 1.0, w * (w - 2.0)
    root = np.sqrt(open_)
    time = (x - lam * y - np.arcsinh(eta * root) / root) / open_
    return time, -(3.0 * time * x - 2.0 + 2.0 * lam * lam * lam * x / y) / open_


def _q_and_slope(s: FloatArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Q and dQ/dS at S = sin²(u/2), with its complement cos²(u/2)."""
    bound = s > 0.0
    sign = np.where(bound, 1.0, -1.0)
    size = np.abs(s)
    u = 2.0 * np.where(bound, np.arctan2(np.sqrt(size), np.sqrt(rest)), np.arcsinh(np.sqrt(size)))
    sine_squared = 4.0 * size * rest
    twice_less_sine = universal_functions(sign, 2.0 * u)[3]
    q = np.where(size > _AT_PARABOLA, twice_less_sine / (sine_squared * np.sqrt(sine_squared)), 4.0 / 3.0)
    slope = sign * 2.0 * (4.0 - 3.0 * q * (rest - s)) / sine_squared
    return q, np.where(size > _NEAR_PARABOLA, slope, _series_slope(s))


def _series_slope(s: FloatArray) -> FloatArray:
    total = np.zeros_like(s)
    for n in range(len(_SERIES) - 1, 0, -1):
        total = total * s + n * _SERIES[n]
    return 4.0 / 3.0 * total
