"""Lambert's problem: the two-body arc from one point to another in a given time, less than one
turn.

In Izzo's form (Celestial Mechanics and Dynamical Astronomy 121, 2015, 1-15) a transfer is two
numbers: the time in units of sqrt(s³ / 2 mu), and lam = ±sqrt(1 - c/s), with chord c and
semi-perimeter s, negative the long way round. The unknown x is below 1 on ellipses, 1 on the
parabola and above on hyperbolas. Here w = 1 + x is solved for, and every difference that can cancel
is replaced by c/s over the matching sum, so that a hop of a metre and a vertical throw are as
accurate as a quarter of the globe.
"""

from math import isfinite
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import flat_states
from opir_core.flight.universal_anomaly import cross, dot, length, universal_functions

_MOST_STEPS = 120

#: A step this small in log w is the last: Newton's method converges quadratically.
_LAST_STEP = 1e-9

#: Beyond this w, fast hyperbolas the long way round have a formula of their own.
_FAST = 2.2

#: Bounds of log w: times of flight from 1e33 to 1e-130 units.
_LEAST = -50.0
_MOST = 300.0

#: Terms (3)_n / (5/2)_n of the series of F(3, 1; 5/2; S), for Q near the parabola.
_SERIES = tuple(
    float(term) for term in np.cumprod([1.0, *((3.0 + n) / (2.5 + n) for n in range(8))])
)
_NEAR_PARABOLA = 1e-2
_AT_PARABOLA = 1e-30


class Transfer(NamedTuple):
    """Shapes of transfers: `lam`, and chord = c/s = 1 - lam², which is lost to rounding in a `lam`
    near ±1.
    """

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
    """Return w = 1 + x of transfers with these times of flight; `nan` without a solution."""
    # A guess of log w from the times at x = 0 and x = 1 (Izzo 2015).
    lam, chord = transfer
    middle = np.arctan2(np.sqrt(chord), lam) + lam * np.sqrt(chord)
    parabolic = 2.0 / 3.0 * transfer.one_less_lam() * (1.0 + lam + lam * lam)
    slow = np.log(middle / time) * (2.0 / 3.0)
    between = np.log(2.0) * np.log(time / middle) / np.log(parabolic / middle)
    fast = np.log(2.0 + 2.5 * parabolic * (parabolic - time) / (time * (1.0 - lam**5)))
    guess = np.where(time >= middle, slow, np.where(time < parabolic, fast, between))
    log_w = np.where((guess > _LEAST) & (guess < _MOST), guess, -0.5)
    low = np.full_like(log_w, _LEAST)
    high = np.full_like(log_w, _MOST)
    still = (time > 0.0) & np.isfinite(time) & np.isfinite(transfer.lam)
    log_w[~still] = np.nan
    for _ in range(_MOST_STEPS):
        at = np.flatnonzero(still)
        if not at.size:
            break
        flight, slope = _time_and_slope(transfer.at(at), np.exp(log_w[at]))
        late = flight > time[at]
        low[at] = np.where(late, log_w[at], low[at])
        high[at] = np.where(late, high[at], log_w[at])
        trial = log_w[at] - np.log(flight / time[at]) / slope
        inside = (trial >= low[at]) & (trial <= high[at])
        trial = np.where(inside, trial, 0.5 * (low[at] + high[at]))
        still[at] = np.abs(trial - log_w[at]) > _LAST_STEP
        log_w[at] = trial
    return np.where(still | (log_w >= _MOST - 1.0) | (log_w <= _LEAST + 1.0), np.nan, np.exp(log_w))


def y_and_differences(
    transfer: Transfer, w: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return y, y - x, y + x, y - lam x and y + lam x, where y² = chord + lam² x², without
    cancellation.
    """
    lam, chord = transfer
    x = w - 1.0
    open_ = w * (2.0 - w)
    y = np.sqrt(chord + (lam * x) ** 2)
    ahead = x > 0.0
    same = lam * x > 0.0
    less_x = np.where(ahead, chord * open_ / (y + x), y - x)
    plus_x = np.where(ahead, y + x, chord * open_ / (y - x))
    less_lam_x = np.where(same, chord / (y + lam * x), y - lam * x)
    plus_lam_x = np.where(same, y + lam * x, chord / (y - lam * x))
    return y, less_x, plus_x, less_lam_x, plus_lam_x


def _time_and_slope(transfer: Transfer, w: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the time of flight and d log time / d log w.

    time = (eta³ Q + 4 lam eta) / 2 with eta = y - lam x and Q = 4/3 F(3, 1; 5/2; S) (Izzo 2015,
    after Battin), where S = (1 - lam - x eta) / 2 = sin²(u/2) makes Q = (2u - sin 2u) / sin³ u,
    hyperbolic for negative S.
    """
    y, less_x, plus_x, eta, _ = y_and_differences(transfer, w)
    lam = transfer.lam
    s = 0.5 * eta * less_x / transfer.one_plus_lam()
    backward = (w < 1.0) & (lam > 0.0)
    ratio = np.where(
        backward, w * (2.0 - w) * (1.0 + lam) / less_x, plus_x / transfer.one_less_lam()
    )
    q, q_slope = _q_and_slope(s, 0.5 * eta * ratio)
    time = 0.5 * eta * (eta * eta * q + 4.0 * lam)
    slope = -0.5 * eta / y * (3.0 * lam * eta * eta * q + 0.5 * eta**4 * q_slope + 4.0 * lam * lam)
    at = np.flatnonzero((lam < 0.0) & (w > _FAST))
    if at.size:
        time[at], slope[at] = _fast_long_way(lam[at], w[at], y[at], eta[at])
    return time, slope * w / time


def _fast_long_way(
    lam: FloatArray, w: FloatArray, y: FloatArray, eta: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the time of flight and its slope in w on hyperbolas the long way round, where Q and
    lam cancel.

    The form of Lancaster and Blanchard (NASA TN D-5368, 1969).
    """
    x = w - 1.0
    open_ = w * (w - 2.0)
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
    q = np.where(
        size > _AT_PARABOLA, twice_less_sine / (sine_squared * np.sqrt(sine_squared)), 4.0 / 3.0
    )
    slope = sign * 2.0 * (4.0 - 3.0 * q * (rest - s)) / sine_squared
    total = np.zeros_like(s)
    for n in range(len(_SERIES) - 1, 0, -1):
        total = total * s + n * _SERIES[n]
    return q, np.where(size > _NEAR_PARABOLA, slope, 4.0 / 3.0 * total)


Way = Literal["short", "long", "prograde", "retrograde"]


def lambert(
    position_1_m: ArrayLike,
    position_2_m: ArrayLike,
    duration_s: ArrayLike,
    mu_m3_s2: float = EARTH_MU_M3_S2,
    way: Way = "short",
) -> tuple[FloatArray, FloatArray]:
    """Return the velocities, m/s, at both ends of the arc from one position to the other in
    `duration_s`.

    Positions have shape (..., 3), in an inertial frame centred on the attracting body; leading axes
    broadcast with the shape of `duration_s`. `way` is "short" (by less than half a turn), "long"
    (by more), or round the z axis, "prograde" (counter-clockwise seen from +z) or "retrograde"; in
    a plane that contains the z axis, prograde is the short way. Two points on one ray from the
    centre, or a point and itself, are joined by the straight line, up and down again for times long
    enough.

    `nan` where no unique arc exists: opposite points and the long way between points on one ray,
    which define no plane; times not above zero; a point in the centre; inputs that are not finite.
    Source: Izzo (2015), rearranged against cancellation.
    """
    if way not in get_args(Way):
        raise ValueError(f"way must be one of {', '.join(get_args(Way))}, got {way!r}")
    if not (isfinite(mu_m3_s2) and mu_m3_s2 > 0.0):
        raise ValueError(f"mu_m3_s2 must be positive and finite, got {mu_m3_s2}")
    first, second, duration, shape = flat_states(position_1_m, position_2_m, duration_s)
    with np.errstate(all="ignore"):
        velocities = _velocities(first.T.copy(), second.T.copy(), duration, mu_m3_s2, way)
    v1, v2 = (np.where(np.isfinite(velocities).all(axis=(0, 1)), v, np.nan) for v in velocities)
    return v1.T.reshape(*shape, 3), v2.T.reshape(*shape, 3)


def _velocities(
    first: FloatArray, second: FloatArray, duration: FloatArray, mu: float, way: Way
) -> tuple[FloatArray, FloatArray]:
    """Return velocities at both ends, (3, n), of arcs between positions (3, n)."""
    r1 = length(first)
    r2 = length(second)
    across = second - first
    along = second + first
    chord = length(across)
    semi = 0.5 * (r1 + r2 + chord)
    direction_1 = first / r1
    direction_2 = second / r2
    half_cosine = 0.5 * length(direction_1 + direction_2)
    half_sine = 0.5 * length(direction_1 - direction_2)
    normal, sense = _normal_and_sense(first, across, along, way)
    mean = np.sqrt(r1) * np.sqrt(r2)
    transfer = Transfer(sense * mean * half_cosine / semi, chord / semi)
    w = solved_w(transfer, duration * np.sqrt(2.0 * mu / semi) / semi)
    inward = np.where(chord > 0.0, -dot(across, along) / ((r1 + r2) * chord), 0.0)
    sideways = np.where(chord > 0.0, 2.0 * mean * half_sine / chord, 0.0)
    less, plus, y_plus_lam_x = _combinations(transfer, w)
    scale = np.sqrt(0.5 * mu * semi)
    radial_1 = (less - inward * plus) / r1
    radial_2 = -(less + inward * plus) / r2
    tangential = sideways * y_plus_lam_x
    return (
        scale * (radial_1 * direction_1 + tangential / r1 * cross(normal, direction_1)),
        scale * (radial_2 * direction_2 + tangential / r2 * cross(normal, direction_2)),
    )


def _combinations(transfer: Transfer, w: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return lam y - x, lam y + x and y + lam x, without cancellation."""
    lam, chord = transfer
    x = w - 1.0
    y, _, _, _, y_plus_lam_x = y_and_differences(transfer, w)
    product = chord * (lam * lam - x * x * (1.0 + lam * lam))
    same = lam * x > 0.0
    less = np.where(same, product / (lam * y + x), lam * y - x)
    plus = np.where(same, lam * y + x, product / (lam * y - x))
    return less, plus, y_plus_lam_x


def _normal_and_sense(
    first: FloatArray, across: FloatArray, along: FloatArray, way: Way
) -> tuple[FloatArray, FloatArray]:
    """Return the unit vector about which the arc turns, and 1 for the short way, -1 for the long.

    Points on one ray have no normal: it is zero for the short way, where none is needed, and
    otherwise nan.
    """
    nearer = np.where(dot(across, across) < dot(along, along), across, along)
    normal = cross(first, nearer)
    size = length(normal)
    upward = normal[2] >= 0.0
    short = {"short": np.True_, "long": np.False_, "prograde": upward, "retrograde": ~upward}[way]
    sense = np.where(short, 1.0, -1.0) * np.ones_like(size)
    on_one_ray = (size == 0.0) & (dot(across, across) < dot(along, along)) & (sense > 0.0)
    normal = sense * normal / size
    up = first / length(first)
    for _ in range(
        2
    ):  # between points that are almost opposite the product is noise, most of it along `first`
        normal = normal - dot(normal, up) * up
        normal = normal / length(normal)
    return np.where(on_one_ray, 0.0, normal), sense
