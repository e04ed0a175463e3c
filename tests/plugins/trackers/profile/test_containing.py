"""Radii of ellipses that hold what they say of mixtures and of arcs, against closed forms and against chance."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from opir_trackers.profile.containing import ContainingArcs, containing_sigmas, factors
from opir_trackers.profile.end import DEVIATES, normal_quantiles, normal_rule
from opir_trackers.profile.flight import Moments, off_ground

from examples import examples
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.records import TRACK_CONTAINMENTS
from opir_core.output.events.forge import ForgeEncoder
from opir_core.testing import stub_sensor
from opir_core.testing.doubles import stub_estimates, stub_window

SHARES = np.array(TRACK_CONTAINMENTS)
USUAL = np.sqrt(-2.0 * np.log1p(-SHARES))

#: What ellipses over the lattice's points may be off by: its own statement.
LATTICE = 0.019

#: Where impacts are expected: on the equator, along which what lies east stays so.
MIDDLE = np.array([0.0, -1.2, 900.0])


def covariances(sigmas_m):
    """Return covariances (..., 3, 3) of standard deviations (..., 2) east and north, m."""
    sigmas = np.concatenate([np.asarray(sigmas_m, dtype=float), np.ones((*np.shape(sigmas_m)[:-1], 1))], axis=-1)
    return np.square(sigmas)[..., None] * np.eye(3)


def places(away_m):
    """Return the places (n, 3) that lie so many metres (n, 2) from the middle."""
    return off_ground(np.column_stack([away_m, np.zeros(len(away_m))]), MIDDLE)


def of_parts(away_m, sigmas_m, weights):
    """Return the radii of one impact that is a mixture of normal distributions, and its covariance, m²."""
    away, weights = np.asarray(away_m, dtype=float), np.asarray(weights, dtype=float)
    nodes, _ = normal_rule(len(away))
    impacts = Moments(places(away), covariances(sigmas_m))
    mean = weights @ away
    total = np.einsum("n,nij->ij", weights, covariances(sigmas_m))
    total[:2, :2] += np.einsum("n,ni,nj->ij", weights, away - mean, away - mean)
    told = Moments(places(mean[None]), total[None])
    arcs = ContainingArcs.still(impacts, nodes, normal_quantiles(len(away)))
    return containing_sigmas(arcs, weights, np.zeros(len(away), dtype=np.int64), told)[0], total[:2, :2]


def along_an_arc(law, east_m, moments_m, sigma_m):
    """Return the radii of an impact so far east, m, as a function of when the burn ends says.

    The end has a law of mean 0 and variance 1 (scipy's), which gives the impact `moments_m`: mean and standard
    deviation. Beside the arc it is known to `sigma_m` each way.
    """
    from scipy.stats import norm

    nodes, weights = gauss(law)
    away = np.column_stack([east_m(nodes), np.zeros(5)])
    assert (weights @ east_m(nodes), weights @ east_m(nodes) ** 2) == pytest.approx(
        (moments_m[0], moments_m[0] ** 2 + moments_m[1] ** 2), rel=1e-3, abs=1e-3
    )
    mean, sigma = moments_m
    told = Moments(places(np.array([[mean, 0.0]])), covariances([[np.hypot(sigma, sigma_m), sigma_m]]))
    arcs = ContainingArcs.of(*straight(away, sigma_m), nodes[None], law.ppf(norm.cdf(DEVIATES))[None], np.zeros((1, 5)))
    return containing_sigmas(arcs, np.ones(1), np.zeros(1, dtype=np.int64), told)[0]


def straight(away_m, sigma_m):
    """Return five places (1, 5, 3) metres (5, 2) from the middle, known to sigma, with their sides and bends."""
    return places(away_m)[None], factors(covariances(np.full((1, 5, 2), sigma_m))), np.zeros((1, 5, 2))


def gauss(law):
    """Return Gauss's rule of five nodes of a law, from its moments (Golub and Welsch)."""
    moments = [1.0, *(law.moment(order) for order in range(1, 11))]
    root = np.linalg.cholesky([[moments[row + column] for column in range(6)] for row in range(6)]).T
    ratio = np.diagonal(root, 1)[:5] / np.diagonal(root)[:5]
    middle = ratio - np.append(0.0, ratio[:4])
    side = np.diagonal(root)[1:5] / np.diagonal(root)[:4]
    nodes, axes = np.linalg.eigh(np.diag(middle) + np.diag(side, 1) + np.diag(side, -1))
    return nodes, np.square(axes[0])


def held(radius, within):
    """Return what an ellipse of a radius holds, by quadrature: `within` gives what lies so many sigmas along.

    Across it is a normal distribution of its own.
    """
    from scipy.integrate import quad
    from scipy.stats import norm

    return quad(lambda y: norm.pdf(y) * within(np.sqrt(radius**2 - y**2)), -radius, radius, limit=200)[0]


def test_one_normal_distribution_has_no_radii_of_its_own():
    radii, _ = of_parts([[3e3, 0.0]], [[2e3, 500.0]], [1.0])
    assert np.isnan(radii).all()


def test_parts_that_are_one_normal_distribution_have_its_radii():
    radii, _ = of_parts([[3e3, 0.0]] * 3, [[2e3, 500.0]] * 3, [0.2, 0.5, 0.3])
    assert radii == pytest.approx(USUAL, rel=0.01)


def test_a_straight_arc_through_a_normal_end_is_a_normal_distribution():
    from scipy.stats import norm

    radii = along_an_arc(norm(), lambda z: 20e3 * z, (0.0, 20e3), 6e3)
    # What ellipses of these radii hold of it, 1 - exp(-r²/2).
    assert 1.0 - np.exp(-0.5 * radii**2) == pytest.approx(SHARES, abs=LATTICE)


@pytest.mark.parametrize("ratio", [0.5, 1.5, 4.0])
def test_two_normal_distributions_along_a_line(ratio):
    from scipy.stats import norm

    radii, _ = of_parts([[-ratio * 1e4, 0.0], [ratio * 1e4, 0.0]], [[1e4, 3e3]] * 2, [0.5, 0.5])

    def within(reach):
        half = reach * np.hypot(ratio, 1.0)
        return norm.cdf(half - ratio) - norm.cdf(-half - ratio)

    assert [held(radius, within) for radius in radii] == pytest.approx(SHARES, abs=LATTICE)


@pytest.mark.parametrize("growth", [0.2, 0.5])
def test_an_arc_along_which_impacts_grow_ever_faster_is_lognormal(growth):
    from scipy.stats import norm

    mean, sigma = 1e5 * np.expm1(0.5 * growth**2), 1e5 * np.sqrt(np.exp(2.0 * growth**2) - np.exp(growth**2))
    radii = along_an_arc(norm(), lambda z: 1e5 * np.expm1(growth * z), (mean, sigma), 100.0)

    def within(reach):
        low, high = (max(1.0 + (mean + side * reach * sigma) / 1e5, 1e-9) for side in (-1, 1))
        return norm.cdf(np.log(high) / growth) - norm.cdf(np.log(low) / growth)

    assert [held(radius, within) for radius in radii] == pytest.approx(SHARES, abs=LATTICE)


@pytest.mark.slow
def test_an_end_that_may_come_any_moment_has_the_quantiles_of_its_law():
    from scipy.stats import expon

    radii = along_an_arc(expon(loc=-1.0), lambda z: 1e5 * z, (0.0, 1e5), 100.0)
    shares = [held(radius, lambda reach: np.exp(-max(1.0 - reach, 0.0)) - np.exp(-1.0 - reach)) for radius in radii]
    assert shares == pytest.approx(SHARES, abs=LATTICE)


@pytest.mark.slow
def test_ellipses_of_events_hold_what_they_say_where_an_end_may_come_any_moment():
    from scipy.stats import expon

    law, count = expon(loc=-1.0), 20_000
    radii = along_an_arc(law, lambda z: 1e5 * z, (0.0, 1e5), 2e4)
    sigmas = np.array([np.hypot(1e5, 2e4), 2e4])
    known = stub_estimates(
        1, impact=np.array([0.0, -1.2, 900.0]), impact_covariance=covariances(sigmas), impact_sigmas=radii
    )
    encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor("S", -75.0),), epoch_us=0))
    point = json.loads(encoder.encode(stub_window(1, estimates=known, track=0, estimate=0)))["impact_point"]
    rng = np.random.default_rng(2)
    east = 1e5 * law.rvs(count, random_state=rng) + 2e4 * rng.normal(size=count)
    north = 2e4 * rng.normal(size=count)
    for name, share in (("ellipse", 0.95), ("ellipse_50", 0.5), ("ellipse_90", 0.9)):
        told = point[name]
        bearing = np.radians(told["bearing_deg"])
        along, across = (east * np.sin(b) + north * np.cos(b) for b in (bearing, bearing + 0.5 * np.pi))
        inside = np.square(along / told["semi_major_m"]) + np.square(across / told["semi_minor_m"]) <= 1.0
        assert told["containment"] == share
        assert inside.mean() == pytest.approx(share, abs=LATTICE + 3.3 * np.sqrt(0.25 / count))
    # The usual radius of 50 %, 1.177, would hold seven in ten of them.
    assert np.mean(np.hypot(east / sigmas[0], north / sigmas[1]) <= USUAL[0]) > 0.5 + 2 * LATTICE


def test_what_does_not_come_down_is_no_part_of_what_ellipses_hold():
    from scipy.stats import norm

    nodes, _ = normal_rule(1)
    away = np.column_stack([1e4 * nodes[0], np.zeros(5)])
    place, sides, bend = straight(away, 3e3)
    place[0, 3:], sides[0, 3:] = np.nan, np.nan
    told = Moments(places(np.zeros((1, 2))), covariances([[1e4, 3e3]]))
    arcs = ContainingArcs.of(place, sides, bend, nodes, normal_quantiles(1), np.zeros((1, 5)))
    (radii,) = containing_sigmas(arcs, np.ones(1), np.zeros(1, dtype=np.int64), told)
    # What is nearer to an end that does not come down is left out: beyond half way from 0 to 1.356.
    cut = 0.5 * nodes[0, 3]
    draws = np.random.default_rng(3).normal(size=(200_000, 3))
    draws = draws[draws[:, 0] < cut]
    square = np.square(draws[:, 0] + 0.3 * draws[:, 1]) + np.square(draws[:, 2])
    shares = [np.mean(square <= radius**2) for radius in radii]
    # The cut is known to half the distance of deviates.
    blur = LATTICE + norm.cdf(cut + 0.25) - norm.cdf(cut - 0.25)
    assert shares == pytest.approx(SHARES, abs=blur)


def test_ends_that_are_likelier_hold_more_of_an_ellipse():
    nodes, _ = normal_rule(1)
    sigmas, shift = np.array([1e4, 3e3]), 0.5
    place, sides, bend = straight(np.column_stack([sigmas[0] * nodes[0], np.zeros(5)]), sigmas[1])
    # A normal distribution times exp(shift z) is the same one about the shift.
    told = Moments(places(np.array([[shift * sigmas[0], 0.0]])), covariances([[np.hypot(*sigmas), sigmas[1]]]))
    arcs = ContainingArcs.of(place, sides, bend, nodes, normal_quantiles(1), shift * nodes)
    (radii,) = containing_sigmas(arcs, np.ones(1), np.zeros(1, dtype=np.int64), told)
    assert radii == pytest.approx(USUAL, rel=0.03)


def test_what_is_not_told_has_no_radii():
    nodes, _ = normal_rule(2)
    impacts = Moments(np.full((2, 3), np.nan), np.full((2, 3, 3), np.nan))
    arcs = ContainingArcs.still(impacts, nodes, normal_quantiles(2))
    told = Moments(np.full((1, 3), np.nan), np.full((1, 3, 3), np.nan))
    assert np.isnan(containing_sigmas(arcs, np.full(2, 0.5), np.zeros(2, dtype=np.int64), told)).all()


METRES = st.floats(-4e5, 4e5)
SIGMAS = st.tuples(st.floats(300.0, 1e5), st.floats(300.0, 1e5))


@examples(40)
@given(st.lists(st.tuples(METRES, METRES, SIGMAS, st.floats(0.05, 1.0)), min_size=2, max_size=6))
def test_ellipses_of_a_mixture_hold_what_they_say(parts):
    away, sigmas = np.array([part[:2] for part in parts]), np.array([part[2] for part in parts])
    weights = np.array([part[3] for part in parts])
    weights = weights / weights.sum()
    radii, covariance = of_parts(away, sigmas, weights)
    assert 0.0 < radii[0] < radii[1] < radii[2]
    rng = np.random.default_rng(1)
    which = rng.choice(len(weights), size=20_000, p=weights)
    draws = away[which] + sigmas[which] * rng.normal(size=(20_000, 2)) - weights @ away
    square = np.sum(draws * np.linalg.solve(covariance, draws.T).T, axis=1)
    shares = [np.mean(square <= radius**2) for radius in radii]
    # 4 σ of what 20 000 draws hold, and twice what the lattice may be off by for each part.
    assert shares == pytest.approx(SHARES, abs=4 * np.sqrt(0.25 / 20_000) + 2 * LATTICE)


@given(st.integers(0, 5))
def test_a_track_s_radii_do_not_depend_on_others(seed):
    rng = np.random.default_rng(seed)
    nodes, _ = normal_rule(5)
    impacts = Moments(places(3e4 * rng.normal(size=(5, 2))), covariances(rng.uniform(1e3, 2e4, (5, 2))))
    arcs, row = ContainingArcs.still(impacts, nodes, normal_quantiles(5)), np.array([0, 1, 0, 2, 1])
    told = Moments(places(3e4 * rng.normal(size=(3, 2))), covariances(rng.uniform(2e4, 4e4, (3, 2))))
    weight = np.array([0.4, 0.7, 0.6, 1.0, 0.3])
    every = containing_sigmas(arcs, weight, row, told)
    for track in range(3):
        mine = np.flatnonzero(row == track)
        alone = containing_sigmas(
            arcs.take(mine), weight[mine], np.zeros(len(mine), dtype=np.int64), told.take([track])
        )
        assert alone[0] == pytest.approx(every[track], rel=1e-9, nan_ok=True)
    assert np.isnan(every[2]).all()
