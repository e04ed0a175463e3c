"""Two-body propagation and Lambert's problem against mpmath with 50 digits, over a sweep of everything a state can be.

The bar: a relative error in position of 1e-12, or, where rounding the inputs alone does more than that, ten times the
condition number times 2.2e-16. The condition number is the sum, over the eight inputs, of the relative change of the
end position for a relative change of that input, taken by differences in 50 digits.
"""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples import examples
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import kepler_status, propagate_kepler
from opir_core.flight.lambert_solver import lambert
from opir_core.flight.universal_anomaly import universal_functions

EPSILON = 2.2e-16
BAR = 1e-12
MONTH_S = 30.0 * 86400.0

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(autouse=True)
def fifty_digits():
    with mpmath.workdps(56):
        yield


def exact_functions(alpha, s):
    """Return G0..G3 to 50 digits, by their closed forms with digits to spare for what cancels."""
    z = alpha * s * s
    lost = 0 if z == 0 else max(0, int(-2.0 * mpmath.log10(abs(z))))
    with mpmath.workdps(56 + lost):
        if z == 0:
            return mpmath.mpf(1), s, s * s / 2, s**3 / 6
        k = mpmath.sqrt(abs(alpha))
        cosine, sine = (mpmath.cos, mpmath.sin) if z > 0 else (mpmath.cosh, mpmath.sinh)
        c, d = cosine(k * s), sine(k * s)
        return c, d / k, (1 - c) / alpha, (s - d / k) / alpha


def exact_anomaly(r, eta, beta, mu, time):
    """Return the anomaly at a time, by Newton's method in a bracket; time rises with it."""

    def late(s):
        g = exact_functions(beta, s)
        return r * g[1] + eta * g[2] + mu * g[3] - time, r * g[0] + eta * g[1] + mu * g[2]

    low, high = mpmath.mpf(0), mpmath.cbrt(time / mu)
    while late(high)[0] < 0:
        low, high = high, 2 * high
    s, before = (low + high) / 2, mpmath.inf
    for _ in range(2000):
        excess, slope = late(s)
        low, high = (s, high) if excess < 0 else (low, s)
        step = excess / slope if slope > 0 else mpmath.inf
        good = low < s - step < high and abs(excess) < before / 2
        moved = s - step if good else (low + high) / 2
        before = abs(excess) if good else mpmath.inf
        if abs(moved - s) <= abs(s) * mpmath.mpf(10) ** -54 or low == high:
            return moved
        s = moved
    raise AssertionError("the reference did not converge")


def exact_end(state):
    """Return the end position and velocity of (x, y, z, vx, vy, vz, duration, mu), all mpmath numbers."""
    position, velocity, duration, mu = state[:3], state[3:6], state[6], state[7]
    if duration == 0:
        return position, velocity
    sense = 1 if duration > 0 else -1
    r = mpmath.sqrt(mpmath.fdot(position, position))
    eta = sense * mpmath.fdot(position, velocity)
    beta = 2 * mu / r - mpmath.fdot(velocity, velocity)
    time = abs(duration)
    if beta > 0:
        period = 2 * mpmath.pi * mu / beta ** (mpmath.mpf(3) / 2)
        time -= period * mpmath.floor(time / period)
    g0, g1, g2, _ = exact_functions(beta, exact_anomaly(r, eta, beta, mu, time)) if time else (1, 0, 0, 0)
    end = r * g0 + eta * g1 + mu * g2
    f, g = 1 - mu * g2 / r, sense * (r * g1 + eta * g2)
    f_rate, g_rate = -sense * mu * g1 / (r * end), 1 - mu * g2 / end
    pairs = list(zip(position, velocity, strict=True))
    return [f * x + g * v for x, v in pairs], [f_rate * x + g_rate * v for x, v in pairs]


def norm(vector):
    return mpmath.sqrt(mpmath.fdot(vector, vector))


def condition_number(state, end):
    """Return the sum over the inputs of relative change of the end position per relative change of the input."""
    small = mpmath.mpf(10) ** -20
    total = mpmath.mpf(0)
    for index, value in enumerate(state):
        if value != 0:
            moved = list(state)
            moved[index] = value * (1 + small)
            total += norm([a - b for a, b in zip(exact_end(moved)[0], end, strict=True)]) / small
    return float(total / norm(end))


def assert_within_the_bar(position, velocity, duration):
    found, _ = propagate_kepler(position, velocity, duration)
    assert kepler_status(position, velocity, duration) == 0
    state = [mpmath.mpf(float(value)) for value in (*position, *velocity, duration, EARTH_MU_M3_S2)]
    end, _ = exact_end(state)
    error = float(norm([mpmath.mpf(float(a)) - b for a, b in zip(found, end, strict=True)]) / norm(end))
    if not error <= BAR:
        assert error <= 10.0 * condition_number(state, end) * EPSILON


def unit_vectors(seed):
    """Return two unit vectors at right angles, the same for the same seed; seed 0 gives the axes."""
    if seed == 0:
        return np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    first, second = np.random.default_rng(seed).normal(size=(2, 3))
    first /= np.linalg.norm(first)
    second = np.cross(first, second)
    return first, second / np.linalg.norm(second)


def powers_of_ten(low, high):
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


near_one = st.tuples(powers_of_ten(-15.0, -3.0), st.sampled_from([-1.0, 1.0])).map(lambda pair: 1.0 + pair[0] * pair[1])
eccentricities = st.one_of(st.just(0.0), powers_of_ten(-16.0, -1.0), st.floats(0.0, 10.0), near_one, st.just(1.0))
durations = st.tuples(powers_of_ten(-6.0, np.log10(MONTH_S)), st.sampled_from([-1.0, 1.0])).map(
    lambda pair: pair[0] * pair[1]
)
seeds = st.integers(0, 10_000)
#: Share of the largest true anomaly: up to 1e-9 short of the asymptote of a hyperbola, of the apocentre of an ellipse.
shares = st.one_of(st.floats(-1.0, 1.0), powers_of_ten(-9.0, -1.0).map(lambda short: -1.0 + short))


@st.composite
def states(draw):
    """Return position and velocity on a conic of drawn eccentricity, pericentre and true anomaly."""
    e, q = draw(eccentricities), draw(powers_of_ten(4.0, 8.0))
    largest = np.pi if e < 1.0 else np.arccos(-1.0 / e) * (1.0 - 1e-9)
    nu = draw(shares) * largest
    p = q * (1.0 + e)
    ahead, sideways = unit_vectors(draw(seeds))
    r = p / max(1.0 + e * np.cos(nu), 1e-9)
    position = r * (np.cos(nu) * ahead + np.sin(nu) * sideways)
    velocity = np.sqrt(EARTH_MU_M3_S2 / p) * (-np.sin(nu) * ahead + (e + np.cos(nu)) * sideways)
    return position, velocity


@st.composite
def straight_states(draw, sideways_share):
    """Return states that rise or fall along the radius, from rest to one and a half times escape speed."""
    radius, speed = draw(powers_of_ten(6.0, 8.0)), draw(st.floats(-1.5, 1.5))
    ahead, sideways = unit_vectors(draw(seeds))
    velocity = speed * np.sqrt(2.0 * EARTH_MU_M3_S2 / radius)
    return radius * ahead, velocity * (ahead + draw(sideways_share) * sideways)


@examples(80)
@given(states(), durations)
def test_every_conic(state, duration):
    assert_within_the_bar(*state, duration)


@examples(40)
@given(states(), durations)
def test_the_way_back(state, duration):
    """From where an arc ends, back to where it began: states that no generator would think of."""
    position, velocity = propagate_kepler(*state, duration)
    assert_within_the_bar(position, velocity, -duration)


@examples(40)
@given(straight_states(st.just(0.0)), durations)
def test_straight_up_and_down(state, duration):
    assert_within_the_bar(*state, duration)


@examples(40)
@given(straight_states(powers_of_ten(-12.0, -3.0)), durations)
def test_nearly_straight(state, duration):
    assert_within_the_bar(*state, duration)


@pytest.mark.slow
@examples(2000)
@given(st.one_of(states(), straight_states(powers_of_ten(-12.0, -3.0)), straight_states(st.just(0.0))), durations)
def test_a_long_sweep(state, duration):
    assert_within_the_bar(*state, duration)


@pytest.mark.parametrize(
    "excess",
    [
        0.0,
        *(
            pytest.param(sign * 10.0**-n, marks=[] if n % 4 == 0 else pytest.mark.slow)
            for n in range(3, 17)
            for sign in (-1, 1)
        ),
    ],
)
def test_around_the_parabola(excess):
    radius = 6578e3
    speed = np.sqrt(2.0 * EARTH_MU_M3_S2 / radius) * (1.0 + 0.25 * excess)
    for angle in (0.0, 0.7, -0.7, 1.5):
        position, velocity = np.array([radius, 0.0, 0.0]), speed * np.array([np.sin(angle), np.cos(angle), 0.0])
        for duration in (1e-6, 60.0, 3600.0, -3600.0, MONTH_S):
            assert_within_the_bar(position, velocity, duration)


@examples(100)
@given(st.floats(-400.0, 60.0), powers_of_ten(-8.0, 3.0))
def test_universal_functions(z, scale):
    alpha, s = np.array([np.sign(z) * scale]), np.array([np.sqrt(abs(z) / scale)])
    found = universal_functions(alpha, s)
    expected = exact_functions(mpmath.mpf(float(alpha[0])), mpmath.mpf(float(s[0])))
    # What rounding s and the function itself do to it, times how often doubling the argument repeats that.
    g0, g1, g2, g3 = (abs(float(value)) for value in expected)
    length = float(s[0])
    sizes = [max(1.0, g0) + scale * length * g1, g1 + length * g0, g2 + length * g1, g3 + length * g2]
    growth = max(1.0, np.sqrt(abs(z)))
    for value, reference, size in zip(found, expected, sizes, strict=True):
        assert abs(value[0] - float(reference)) <= 8.0 * growth * EPSILON * size + 1e-300


@examples(40)
@given(straight_states(powers_of_ten(-3.0, 1.0)), st.floats(1.0, 3600.0))
def test_lambert_arrives(state, duration):
    """The velocities found carry the start to the end, in 50 digits, as nearly as rounding them allows."""
    aim, _ = propagate_kepler(*state, duration)
    found, _ = lambert(state[0], aim, duration)
    start = [mpmath.mpf(float(value)) for value in (*state[0], *found, duration, EARTH_MU_M3_S2)]
    end, _ = exact_end(start)
    error = float(norm([mpmath.mpf(float(a)) - b for a, b in zip(aim, end, strict=True)]) / norm(end))
    assert error <= 1e-13 or error <= 20.0 * condition_number(start, end) * EPSILON
