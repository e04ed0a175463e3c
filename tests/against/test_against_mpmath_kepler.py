"""Two-body propagation and Lambert's problem against mpmath with 50 digits, over a sweep of
everything a state can be.

The bar: a relative error in position of 1e-12, or, where rounding the inputs alone does more than
that, ten times the condition number times 2.2e-16. The condition number is the sum, over the eight
inputs, of the relative change of the end position for a relative change of that input, taken by
differences in 50 digits.
"""

import mpmath
import numpy as np
import pytest
from exact_cases.two_body import exact_end, exact_functions
from hypothesis import given, strategies as st

from examples import examples
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import propagate_kepler
from opir_core.flight.universal_anomaly import universal_functions

EPSILON = 2.2e-16
BAR = 1e-12
MONTH_S = 30.0 * 86400.0

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture(autouse=True)
def fifty_digits():
    with mpmath.workdps(56):
        yield


def norm(vector):
    return mpmath.sqrt(mpmath.fdot(vector, vector))


def condition_number(state, end):
    """Return the sum over the inputs of relative change of the end position per relative change of
    the input.
    """
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
    state = [mpmath.mpf(float(value)) for value in (*position, *velocity, duration, EARTH_MU_M3_S2)]
    end, _ = exact_end(state)
    error = float(
        norm([mpmath.mpf(float(a)) - b for a, b in zip(found, end, strict=True)]) / norm(end)
    )
    if not error <= BAR:
        assert error <= 10.0 * condition_number(state, end) * EPSILON


def unit_vectors(seed):
    """Return two unit vectors at right angles, the same for the same seed; seed 0 gives the
    axes.
    """
    if seed == 0:
        return np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    axis, second = np.random.default_rng(seed).normal(size=(2, 3))
    axis /= np.linalg.norm(axis)
    second = np.cross(axis, second)
    return axis, second / np.linalg.norm(second)


def powers_of_ten(low, high):
    return st.floats(low, high).map(lambda exponent: 10.0**exponent)


near_one = st.tuples(powers_of_ten(-15.0, -3.0), st.sampled_from([-1.0, 1.0])).map(
    lambda pair: 1.0 + pair[0] * pair[1]
)
eccentricities = st.one_of(
    st.just(0.0), powers_of_ten(-16.0, -1.0), st.floats(0.0, 10.0), near_one, st.just(1.0)
)
durations = st.tuples(powers_of_ten(-6.0, np.log10(MONTH_S)), st.sampled_from([-1.0, 1.0])).map(
    lambda pair: pair[0] * pair[1]
)
seeds = st.integers(0, 10_000)
#: Share of the largest true anomaly: up to 1e-9 short of the asymptote of a hyperbola, of the
#: apocentre of an ellipse.
shares = st.one_of(st.floats(-1.0, 1.0), powers_of_ten(-9.0, -1.0).map(lambda short: -1.0 + short))


@st.composite
def states(draw):
    """Return position and velocity on a conic of drawn eccentricity, pericentre and true
    anomaly.
    """
    e = draw(eccentricities)
    q = draw(powers_of_ten(4.0, 8.0))
    largest = np.pi if e < 1.0 else np.arccos(-1.0 / e) * (1.0 - 1e-9)
    nu = draw(shares) * largest
    p = q * (1.0 + e)
    forward, sideways = unit_vectors(draw(seeds))
    r = p / max(1.0 + e * np.cos(nu), 1e-9)
    position = r * (np.cos(nu) * forward + np.sin(nu) * sideways)
    velocity = np.sqrt(EARTH_MU_M3_S2 / p) * (-np.sin(nu) * forward + (e + np.cos(nu)) * sideways)
    return position, velocity


@st.composite
def straight_states(draw, sideways_share):
    """Return states that rise or fall along the radius, from rest to one and a half times escape
    speed.
    """
    radius = draw(powers_of_ten(6.0, 8.0))
    speed = draw(st.floats(-1.5, 1.5))
    forward, sideways = unit_vectors(draw(seeds))
    velocity = speed * np.sqrt(2.0 * EARTH_MU_M3_S2 / radius)
    return radius * forward, velocity * (forward + draw(sideways_share) * sideways)


@pytest.mark.slow
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
@given(
    st.one_of(states(), straight_states(powers_of_ten(-12.0, -3.0)), straight_states(st.just(0.0))),
    durations,
)
def test_a_long_sweep(state, duration):
    assert_within_the_bar(*state, duration)


@pytest.mark.slow
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
        position = np.array([radius, 0.0, 0.0])
        velocity = speed * np.array([np.sin(angle), np.cos(angle), 0.0])
        for duration in (1e-6, 60.0, 3600.0, -3600.0, MONTH_S):
            assert_within_the_bar(position, velocity, duration)


@examples(100)
@given(st.floats(-400.0, 60.0), powers_of_ten(-8.0, 3.0))
def test_universal_functions(z, scale):
    alpha = np.array([np.sign(z) * scale])
    s = np.array([np.sqrt(abs(z) / scale)])
    result = universal_functions(alpha, s)
    expected = exact_functions(mpmath.mpf(float(alpha[0])), mpmath.mpf(float(s[0])))
    # What rounding s and the function itself do to it, times how often doubling the argument
    # repeats that.
    g0, g1, g2, g3 = (abs(float(value)) for value in expected)
    length = float(s[0])
    sizes = [
        max(1.0, g0) + scale * length * g1,
        g1 + length * g0,
        g2 + length * g1,
        g3 + length * g2,
    ]
    growth = max(1.0, np.sqrt(abs(z)))
    for value, reference, size in zip(result, expected, sizes, strict=True):
        assert abs(value[0] - float(reference)) <= 8.0 * growth * EPSILON * size + 1e-300
