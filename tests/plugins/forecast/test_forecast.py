"""Forecasts: calibration on the own law with SciPy's impacts, and what must agree in one record."""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from boost_law import HYPOTHESES, MODEL, NAMES, OUTCOMES, STAGES
from opir_forecast import BoostEstimates, burning_on
from opir_forecast.forecast import forecasts
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.marginals import burn_ends
from opir_forecast.outcomes import Outcomes
from opir_forecast.planar_boost import drawn_stages, ranges_m
from opir_forecast.stage_history import StageHistory
from plain_boosts import MU, RADIUS_M, SPIN
from scipy.integrate import solve_ivp

from opir_core.flight import Forces
from opir_core.geometry import ecef_to_geodetic

POINT_MASS = Forces(zonal=())
SIGMA = np.repeat([100.0, 15.0, 0.5, 0.001], [3, 3, 3, 1])
NONE = NAMES.index("none of these")
SLV = NAMES.index("SLV")
HGV = NAMES.index("HGV")


def states(height_m: Any, speed_m_s: Any, angle_rad: Any) -> np.ndarray:
    """Return inertial states (n, 6) over the equator, flying east relative to the ground."""
    height, speed, angle = np.broadcast_arrays(
        *map(np.atleast_1d, (height_m, speed_m_s, angle_rad))
    )
    zero = np.zeros(len(height))
    place = np.stack([RADIUS_M + height, zero, zero], axis=1)
    velocity = np.stack([speed * np.sin(angle), speed * np.cos(angle), zero], axis=1)
    return np.concatenate([place, velocity + np.cross(SPIN, place)], axis=1)


def estimated(
    state: np.ndarray, seed: int, force: Any = 0.0, growth: Any = 0.0, burning: float = 0.0
) -> BoostEstimates:
    """Return estimates of states with forces along the velocity, with errors of `SIGMA`."""
    count = len(state)
    air = state[:, 3:] - np.cross(SPIN, state[:, :3])
    push = np.broadcast_to(force, count)[:, None] * air / np.linalg.norm(air, axis=1)[:, None]
    mean = np.concatenate([state, push, np.broadcast_to(growth, count)[:, None]], axis=1)
    mean = mean + np.random.default_rng(seed).normal(size=mean.shape) * SIGMA
    covariance = np.tile(np.diag(SIGMA**2), (count, 1, 1))
    times_s = np.full(count, 0.05)
    share = np.full(count, burning)
    number = np.arange(count)
    return BoostEstimates.of_moments(
        number, mean, covariance, share, times_s, times_s, len(OUTCOMES.hypotheses)
    )


def history(since_s: Any, *stages: list[float], dark_s: float | None = None) -> StageHistory:
    """Return the history of a track at time 0 that has burnt for a time, after earlier stages."""
    logs = np.full((1, STAGES, 4), np.nan)
    for number, stage in enumerate(stages):
        logs[0, number, : len(stage)] = np.log(stage)
    return burning_since([since_s], logs, dark_s)


def burning_since(since_s: Any, logs: np.ndarray, dark_s: float | None = None) -> StageHistory:
    """Return histories at time 0 of stages that have burnt for times, after earlier ones."""
    count = len(logs)
    begun = StageHistory.begun(np.arange(count), 0.0)
    ignition_s = -np.asarray(since_s, dtype=float)
    begun = evolve(begun, logs=logs, ignition_s=ignition_s, ignition_sigma_s=np.full(count, 0.3))
    return begun if dark_s is None else evolve(begun, dark_since_s=np.array([-dark_s]))


def forecast(
    estimates: BoostEstimates,
    stages: StageHistory,
    away_m: Any = 1e5,
    log: Any = None,
    outcomes: Outcomes = OUTCOMES,
) -> LaunchForecasts:
    """Return the forecasts of tracks launched so far west, m, without reports of types."""
    count = len(estimates)
    east = -np.broadcast_to(away_m, count) / RADIUS_M
    launch = np.stack([np.zeros(count), east, -stages.ignition_s], axis=1)
    log = np.zeros((count, len(outcomes.hypotheses))) if log is None else log
    estimates = evolve(estimates, launch=launch, log_likelihood=log)
    dark_s = np.where(stages.is_dark, -stages.dark_since_s, 0.0)
    return forecasts(outcomes, estimates, stages, dark_s, 0.0, POINT_MASS)


def impacts_of(state: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return latitudes and longitudes (n, 2) of impacts on the equator of a round Earth, by SciPy;
    nan without one.
    """

    def rates(_time_s: float, state: np.ndarray) -> np.ndarray:
        return np.concatenate([state[3:], -MU / np.linalg.norm(state[:3]) ** 3 * state[:3]])

    def ground(_time_s: float, state: np.ndarray) -> float:
        return float(ecef_to_geodetic(state[None, :3]).height_m[0])

    ground.terminal = True
    ground.direction = -1.0  # type: ignore[attr-defined]
    places = np.full((len(state), 2), np.nan)
    for row, (start, start_s) in enumerate(zip(state, time_s.tolist(), strict=True)):
        fall = solve_ivp(rates, (0.0, 9000.0), start, events=ground, rtol=1e-8, atol=1e-2)
        if len(fall.t_events[0]):
            x, y = fall.y_events[0][0][:2]
            turned = np.arctan2(y, x) - SPIN[2] * (start_s + fall.t_events[0][0])
            places[row] = 0.0, float(np.arctan2(np.sin(turned), np.cos(turned)))
    return places


class Flights:
    """Flights of the law of missiles at random instants of their burns, as often as the classes
    say.
    """

    def __init__(self, count: int, seed: int) -> None:
        rng = np.random.default_rng(seed)
        drawn = 20 * count
        stages = drawn_stages(MODEL, 0, drawn, rng)
        steering = burning_on.drawn_steering(drawn, MODEL.data, seed)
        range_m = ranges_m(burn_ends(stages, steering))
        weight = np.where(np.isfinite(range_m), OUTCOMES.missiles(range_m).sum(axis=1), 0.0)
        rows = rng.choice(drawn, count, p=weight / weight.sum())
        stages = type(stages)(*(column[rows] for column in stages))
        steering = steering.take(rows)
        stage = rng.integers(0, np.sum(stages.burn_s > 0.0, axis=1))
        present = np.arange(count), stage
        starts = stages.starts_s
        self.since = rng.uniform(0.3, 0.95, count) * stages.burn_s[present]
        time_s = starts[present] + self.since
        burnt = np.clip(time_s[:, None] - starts, 0.0, stages.burn_s)
        gap = np.where(burnt > 0.0, stages.gap_s, 0.0)
        x, y, u, v = burn_ends(stages._replace(burn_s=burnt, gap_s=gap), steering)
        radius = np.hypot(x, y)
        speed = np.hypot(u, v)
        self.state = states(radius - RADIUS_M, speed, np.arcsin((x * u + y * v) / (radius * speed)))
        self.away_m = RADIUS_M * np.arctan2(x, y)
        mass = np.maximum(1.0 - stages.growth_per_s * burnt, 0.02)
        force = stages.first_m_s2 / mass
        growth = stages.growth_per_s / mass
        self.force = force[present]
        self.growth = growth[present]
        burn = np.where(starts < time_s[:, None], stages.burn_s - burnt, stages.burn_s)
        start = np.maximum(starts - time_s[:, None], 0.0)
        burns = burning_on.RemainingBurns(start, burn, force, growth, time_s)
        still = np.zeros((STAGES, burning_on.STEPS, count, 2))
        out, out_s, _ = burning_on.flown_on(self.state, burns, steering, still)
        self.impact = impacts_of(out, out_s)
        ratio = -np.log(1.0 - stages.growth_per_s * stages.burn_s)
        with np.errstate(divide="ignore"):
            next_gap = np.log(np.roll(stages.gap_s, -1, axis=1))
            self.logs = np.stack(
                [np.log(stages.burn_s), np.log(stages.first_m_s2), ratio, next_gap], axis=2
            )
        self.logs[np.arange(STAGES) >= stage[:, None]] = np.nan


@pytest.mark.slow
def test_flights_of_the_law_fall_into_the_stated_shares() -> None:
    flights = Flights(150, 12)
    estimates = estimated(flights.state, 13, flights.force, flights.growth, 1.0)
    stages = burning_since(flights.since, flights.logs)
    rows = zip(
        forecast(estimates, stages, flights.away_m).impact_regions, flights.impact, strict=True
    )
    inside = [
        [region.contains(*impact) for region in regions[:3]]
        for regions, impact in rows
        if regions and np.isfinite(impact[0])
    ]
    assert len(inside) > 110
    share = np.mean(inside, axis=0)
    # Three standard deviations of a share of 120: 14, 8 and 6 %; kernels and tilts make regions
    # somewhat wide.
    assert 0.36 < share[0] < 0.75
    assert share[1] > 0.82
    assert share[2] > 0.89


def test_the_columns_of_a_forecast_agree() -> None:
    state = states([2e4, 4e4, 6e4], [900.0, 1800.0, 3000.0], 0.8)
    estimates = estimated(state, 3, [30.0, 35.0, 40.0], 0.012, 0.7)
    result = forecast(estimates, burning_since([50.0, 60.0, 70.0], np.full((3, STAGES, 4), np.nan)))
    assert result.given_launch.sum(axis=1) == pytest.approx(np.ones(3))
    is_possible = [hypothesis.is_launch or hypothesis.group == "none" for hypothesis in HYPOTHESES]
    assert not result.given_launch[:, ~np.array(is_possible)].any()
    assert np.all(result.given_launch[:, NONE] <= 0.05)
    for regions, comes_down in zip(
        result.impact_regions, result.probability_comes_down, strict=True
    ):
        assert len(regions) == 3
        assert regions[0].condition == "comes down"
        assert 0.0 < regions[0].probability <= comes_down + 1e-9
        assert all(region.effective_samples >= 8.0 for region in regions)


def areas_km2(result: LaunchForecasts) -> dict[str, float]:
    """Return the areas of the largest regions of the first track, by condition."""
    return {region.condition: region.area_km2 for region in result.impact_regions[0]}


def test_a_dark_target_has_a_region_for_each_condition() -> None:
    """Relights fade with the time in the dark."""
    estimates = estimated(states(6e4, 2500.0, 0.7), 4)
    chances = []
    for dark_s in (2.0, 10.0, 40.0):
        result = forecast(estimates, history(70.0 + dark_s, [70.0, 20.0, 2.7], dark_s=dark_s))
        areas = areas_km2(result)
        assert next(iter(areas)) == "burn over" or dark_s < 5.0
        if "relights" in areas:
            assert areas["relights"] > 10.0 * areas["burn over"]
        chances.append(result.probability_relights[0])
    assert chances[0] > 1.5 * chances[1] > 3.0 * chances[2] > 0.0


def test_a_slow_long_burn_near_orbital_speed_goes_to_orbit() -> None:
    booster = [155.0, 13.0, 3.0, 11.0]
    burning = estimated(states(1.7e5, 6000.0, 0.03), 5, 16.0, 0.0026, 1.0)
    result = forecast(burning, history(250.0, booster), 1e6)
    assert result.given_launch[0, SLV] > 0.9
    assert all(region.area_km2 > 1e4 for region in result.impact_regions[0])
    orbiting = estimated(states(2.2e5, 7500.0, 0.0), 5)
    result = forecast(orbiting, history(400.0, booster, [380.0, 8.0, 3.8], dark_s=20.0), 2e6)
    assert result.given_launch[0, SLV] > 0.9
    assert result.in_orbit[0] > 0.6


@pytest.mark.parametrize("since_s", [200.0, 400.0, 800.0, 1600.0])
def test_a_boost_unlike_any_raises_none_of_these(since_s: float) -> None:
    """Whether the burn is four or thirty times as long as a usual one at this force, it does not
    sharpen a class.

    The bound is ten times the prior. By the declared priors it cannot be more than a half: as many
    vehicles of known classes have odd stages as are none of these.
    """
    slow = estimated(states(3e4, 500.0, 0.5), 6, 4.0, 0.0002, 1.0)
    result = forecast(slow, history(since_s))
    assert result.given_launch[0, NONE] > 10.0 * OUTCOMES.prior[NONE]
    assert OUTCOMES.odd == pytest.approx(OUTCOMES.prior[NONE], rel=0.05)


def test_a_track_that_burnt_in_another_direction_may_be_none() -> None:
    """It comes down all the same."""
    estimates = estimated(states(6e4, 2000.0, 0.7), 11)
    over = history(90.0, [60.0, 20.0, 2.0], dark_s=30.0)
    plain, turned = (
        forecast(estimates, evolve(over, free_odds=np.array([odds]))) for odds in (1.0, 500.0)
    )
    assert plain.given_launch[0, NONE] < 0.05
    assert turned.given_launch[0, NONE] > 5.0 * plain.given_launch[0, NONE]
    region = turned.impact_regions[0][2]
    assert region.condition == "burn over"
    assert region.probability > 0.9
    assert region.area_km2 == pytest.approx(plain.impact_regions[0][2].area_km2, rel=0.2)


def test_a_burn_in_another_direction_has_no_region() -> None:
    estimates = estimated(states(6e4, 2000.0, 0.7), 12, burning=1.0)
    free = evolve(estimates, burn_share=np.array([[0.02, 0.0, 0.98]]))
    regions = forecast(free, history(90.0)).impact_regions[0]
    assert not regions or regions[0].probability < 0.2


def test_reported_types_move_classes_and_regions() -> None:
    estimates = estimated(states(3e4, 1500.0, 0.8), 7, 35.0, 0.012, 1.0)
    srbm = np.array([name == "SRBM" for name in NAMES])
    plain, reported = (
        forecast(estimates, history(55.0), log=log * srbm[None]) for log in (0.0, 5.0)
    )
    assert reported.given_launch[0, srbm] > plain.given_launch[0, srbm]
    assert areas_km2(reported)["comes down"] < areas_km2(plain)["comes down"]


#: The burn of a glider, which ends level, 10 s ago.
GLIDER = history(160.0, [150.0, 20.0, 3.5], dark_s=10.0)


def test_a_level_end_of_the_burn_is_that_of_a_glider() -> None:
    """Its region is its reach: at L/D of 2.5 some 4 600 km.

    R/2 · 2.5 · ln((1 - (1.5/7.9)²) / (1 - (5.3/7.9)²)).
    """
    result = forecast(estimated(states(5e4, 5300.0, 0.0), 8), GLIDER, 4e5)
    assert result.given_launch[0, HGV] > 0.3
    assert result.impact_regions[0][2].contains(0.0, 4.6e6 / RADIUS_M)


def test_regions_hold_gliders_of_low_probability_too() -> None:
    """A glider that is one seventh of the descents with their burn over is more than a region of
    95 % leaves out.
    """
    reports = -7.0 * (np.array(NAMES) == "HGV")[None]
    result = forecast(estimated(states(5e4, 5300.0, 0.0), 8), GLIDER, 4e5, reports)
    assert 0.02 < result.given_launch[0, HGV] < 0.1
    regions = result.impact_regions[0]
    over = [region for region in regions if region.condition == "burn over"]
    assert over[2].contains(0.0, 3.5e6 / RADIUS_M)
    assert not over[0].contains(0.0, 3.5e6 / RADIUS_M)
    stated = sum(region.probability for region in regions if region.containment == 0.95)
    assert stated == pytest.approx(result.probability_comes_down[0])


@pytest.mark.parametrize(("has_launchers", "name"), [(True, "SLV"), (False, "none of these")])
def test_a_particle_in_orbit_is_a_space_launch(has_launchers: bool, name: str) -> None:
    """Whatever its stages; without a class of launchers it is none of these."""
    hypotheses = tuple(
        hypothesis for hypothesis in HYPOTHESES if has_launchers or hypothesis.group != "orbit"
    )
    result = forecast(
        estimated(states(2.0e5, 7400.0, 0.0), 9),
        history(620.0, [500.0, 12.0, 5.0], dark_s=120.0),
        2e6,
        outcomes=Outcomes(MODEL, hypotheses),
    )
    column = [hypothesis.name for hypothesis in hypotheses].index(name)
    assert result.given_launch[0, column] > 0.95
    assert not has_launchers or result.given_launch[0, NONE] < 0.02
