"""Forecasts: burns flown on against SciPy, states given features against Kalman's, and calibration on the own prior."""

import numpy as np
import pytest
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast import burning_on, matching
from opir_trackers.forecast.forecast import forecasts
from opir_trackers.forecast.prior_boosts import STAGES, prior_boosts
from scipy.integrate import solve_ivp

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.forces import Forces
from opir_core.geometry import ecef_to_geodetic

RADIUS_M, MU = 6378137.0, 3.986004418e14
SPIN = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
POINT_MASS = Forces(zonal=())


def states_of(rows: np.ndarray) -> np.ndarray:
    """Return inertial states (n, 6) over the equator, flying east, with the features of instants of the prior."""
    height, speed, angle, _ = prior_boosts().features[rows].T
    place = np.zeros((len(rows), 3))
    place[:, 0] = RADIUS_M + height
    velocity = np.stack([speed * np.sin(angle), speed * np.cos(angle), np.zeros(len(rows))], axis=1)
    return np.concatenate([place, velocity + np.cross(SPIN, place)], axis=1)


@pytest.mark.slow
def test_burns_flown_on_are_those_of_another_integrator() -> None:
    prior = prior_boosts()
    rng = np.random.default_rng(3)
    late = np.flatnonzero(prior.time_s > 40.0)
    rows = rng.choice(late, 30, replace=False)
    programs, since = prior.programs.take(prior.boost[rows]), prior.time_s[rows]
    start = states_of(rows)
    still = np.zeros((STAGES, burning_on.STEPS, 30, 2))
    after, later = burning_on.flown_on(start, burning_on.remaining(programs, since, np.ones(30)), still)
    errors = []
    for k in range(30):
        one = programs.take(np.array([k]))
        starts = one.starts_s[0]
        ends = starts + one.burn_s[0]

        def rates(time_s: float, state: np.ndarray, one=one, starts=starts, ends=ends) -> np.ndarray:  # type: ignore[no-untyped-def]
            size = sum(
                one.acceleration_m_s2[0, s] / (1.0 - one.growth_per_s[0, s] * (time_s - starts[s]))
                for s in range(STAGES)
                if starts[s] <= time_s < ends[s]
            )
            place, air = state[:3], state[3:] - np.cross(SPIN, state[:3])
            ahead = air / np.linalg.norm(air)
            side = np.cross(ahead, place)
            down = np.cross(ahead, side / np.linalg.norm(side))
            lead = one.leads(np.array([time_s]))[0]
            push = size * (np.cos(lead) * ahead + np.sin(lead) * down)
            return np.concatenate([state[3:], -MU / np.linalg.norm(place) ** 3 * place + push])

        now, state = float(since[k]), start[k]
        edges = sorted({*starts[one.burn_s[0] > 0.0].tolist(), *ends[one.burn_s[0] > 0.0].tolist()})
        for edge in [edge for edge in edges if edge > now]:
            state, now = solve_ivp(rates, (now, edge), state, rtol=1e-8, atol=1e-3, max_step=5.0).y[:, -1], edge
        assert later[k] == pytest.approx(now - since[k], abs=1e-9)
        errors.append(np.linalg.norm(after[k, 3:] - state[3:]))
    # Five steps a burn: a fraction of what the kernel leaves open.
    assert np.median(errors) < 2.0
    assert np.quantile(errors, 0.9) < 60.0


def test_what_has_burnt_out_stays() -> None:
    prior = prior_boosts()
    rows = np.arange(5)
    burns = burning_on.remaining(prior.programs.take(prior.boost[rows]), np.full(5, 1e4), np.ones(5))
    state = states_of(rows)
    after, later = burning_on.flown_on(state, burns, np.zeros((STAGES, burning_on.STEPS, 5, 2)))
    assert np.array_equal(after, state)
    assert not later.any()


def test_states_given_features_are_those_of_a_linear_update() -> None:
    """Mean and covariance of many draws against Kalman's update by the features, written with other equations."""
    state = np.concatenate([states_of(np.array([60000]))[0], [20.0, 15.0, 0.0, 0.01]])
    side = np.diag([300.0] * 3 + [40.0] * 3 + [2.0] * 3 + [0.002])
    (part,) = matching.parts_of(state, side)
    chosen = part.features + np.array([400.0, 30.0, 0.02, 1.0])
    rng = np.random.default_rng(8)
    count = 20000
    drawn = matching.drawn_states(
        [part], np.zeros(count, dtype=np.int64), np.tile(chosen, (count, 1)), rng.normal(size=(count, 14)), 1.0
    )
    slope = np.linalg.solve(side, part.changes).T
    noise = np.diag(matching.kernel_variance(part.features, 4))
    information = np.linalg.inv(side @ side.T) + slope.T @ np.linalg.solve(noise, slope)
    covariance = np.linalg.inv(information)
    mean = state + covariance @ slope.T @ np.linalg.solve(noise, chosen - part.features)
    sigma = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(drawn.mean(axis=0) - mean) < 5.0 * sigma / np.sqrt(count))
    assert np.allclose(np.cov(drawn.T) / np.outer(sigma, sigma), covariance / np.outer(sigma, sigma), atol=0.05)


def test_parts_along_one_line_of_sight_add_up_to_the_whole() -> None:
    state = np.concatenate([states_of(np.array([60000]))[0], [20.0, 15.0, 0.0, 0.01]])
    side = np.diag([60e3, 100.0, 100.0] + [400.0] * 3 + [2.0] * 3 + [0.002])
    parts = matching.parts_of(state, side)
    weight = np.exp([part.log_weight for part in parts])
    weight /= weight.sum()
    means = np.stack([part.state for part in parts])
    assert len(parts) > 5
    assert weight @ means == pytest.approx(state, rel=1e-9)
    spread = sum(
        w * (p.side @ p.side.T + np.outer(p.state - state, p.state - state)) for w, p in zip(weight, parts, strict=True)
    )
    assert spread == pytest.approx(side @ side.T, rel=0.02, abs=1e-3)


@pytest.mark.slow
def test_flights_of_the_own_prior_fall_into_the_stated_shares_of_regions() -> None:
    """Boosts are drawn as often as the prior says, at random instants, and seen with small errors."""
    prior = prior_boosts()
    rng = np.random.default_rng(12)
    weight = np.exp(prior.log_weight)[prior.boost]
    weight[prior.time_s < 20.0] = 0.0
    rows = rng.choice(len(prior.boost), 120, p=weight / weight.sum())
    state = states_of(rows)
    air = state[:, 3:] - np.cross(SPIN, state[:, :3])
    force = prior.features[rows, 3:] * air / np.linalg.norm(air, axis=1)[:, None]
    sigma = np.array([200.0] * 3 + [30.0] * 3 + [1.0] * 3 + [0.002])
    mean = np.concatenate([state, force, np.full((120, 1), 0.01)], axis=1) + rng.normal(size=(120, 10)) * sigma
    estimates = ModeEstimates(
        np.tile([1.0, 0.0], (120, 1)),
        mean,
        np.tile(np.diag(1.0 / sigma), (120, 1, 1)),
        mean[:, :6],
        np.tile(np.diag(1.0 / sigma[:6]), (120, 1, 1)),
        np.tile([20.0, 20.0, 0.1], (120, 1)),
    )
    programs, since = prior.programs.take(prior.boost[rows]), prior.time_s[rows]
    launch = np.stack([np.full(120, np.nan), np.full(120, np.nan), -since], axis=1)
    found = forecasts(estimates, np.zeros(120), launch, np.full(120, 0.5), np.zeros((120, 3)), 0.0, POINT_MASS)
    still = np.zeros((STAGES, burning_on.STEPS, 120, 2))
    out, later = burning_on.flown_on(state, burning_on.remaining(programs, since, np.ones(120)), still)
    impact = impacts_of(out, later)
    known = np.flatnonzero(
        [len(regions) > 0 and np.isfinite(place[0]) for regions, place in zip(found.regions, impact, strict=True)]
    )
    assert len(known) > 100
    inside = np.array([[region.contains(*impact[row]) for region in found.regions[row]] for row in known])
    share = inside.mean(axis=0)
    # Three standard deviations of a share of a hundred: 15, 9 and 7 %; kernels and tilts make regions somewhat wide.
    assert 0.35 < share[0] < 0.75
    assert share[1] > 0.81
    assert share[2] > 0.88


def impacts_of(state: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return latitudes and longitudes (n, 2) of impacts on the equator of a round Earth, by SciPy; nan without one."""

    def rates(_time_s: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[3:], -MU / np.linalg.norm(state[:3]) ** 3 * state[:3]])

    def ground(_time_s: float, state: np.ndarray) -> float:
        return float(ecef_to_geodetic(state[None, :3]).height_m[0])

    ground.terminal, ground.direction = True, -1.0  # type: ignore[attr-defined]
    places = []
    for one, start_s in zip(state, time_s.tolist(), strict=True):
        fall = solve_ivp(rates, (0.0, 9000.0), one, events=ground, rtol=1e-8, atol=1e-2)
        if not len(fall.t_events[0]):
            places.append([np.nan, np.nan])
            continue
        x, y = fall.y_events[0][0][:2]
        turned = np.arctan2(y, x) - EARTH_ROTATION_RAD_S * (start_s + fall.t_events[0][0])
        places.append([0.0, float(np.arctan2(np.sin(turned), np.cos(turned)))])
    return np.array(places)
