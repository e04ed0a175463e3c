"""Forecasts: calibration on the own law with SciPy's impacts, and what must agree in one record."""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast import burning_on
from opir_trackers.forecast.burning_on import RemainingBurns, drawn_steering
from opir_trackers.forecast.forecast import forecasts
from opir_trackers.forecast.launch_forecasts import LaunchForecasts
from opir_trackers.forecast.marginals import burn_ends
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.planar_boost import drawn_stages, ranges_m
from opir_trackers.forecast.stage_history import StageHistory
from opir_trackers.forecast.vehicles import (
    MISSILE,
    STAGES,
    VehicleStages,
    vehicle_model,
)
from scipy.integrate import solve_ivp

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.forces import Forces
from opir_core.geometry import ecef_to_geodetic
from opir_core.scene import core_hypotheses

RADIUS_M = 6378137.0
MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
POINT_MASS = Forces(zonal=())
HYPOTHESES = core_hypotheses()
NAMES = [one.name for one in HYPOTHESES]
OUTCOMES = Outcomes(vehicle_model(), HYPOTHESES)
SIGMA = np.array([100.0] * 3 + [15.0] * 3 + [0.5] * 3 + [0.001])


def states(height_m: Any, speed_m_s: Any, angle_rad: Any) -> np.ndarray:
    """Return inertial states (n, 6) over the equator, flying east relative to the ground."""
    height, speed, angle = np.broadcast_arrays(
        *map(np.atleast_1d, (height_m, speed_m_s, angle_rad))
    )
    place = np.zeros((len(height), 3))
    place[:, 0] = RADIUS_M + height
    velocity = np.stack(
        [speed * np.sin(angle), speed * np.cos(angle), np.zeros(len(height))], axis=1
    )
    return np.concatenate([place, velocity + np.cross(SPIN, place)], axis=1)


def estimated(
    state: np.ndarray, force: Any, growth: Any, burning: float, rng: np.random.Generator
) -> ModeEstimates:
    """Return estimates of states with forces along the velocity, with errors of `SIGMA`."""
    count = len(state)
    air = state[:, 3:] - np.cross(SPIN, state[:, :3])
    push = np.broadcast_to(force, count)[:, None] * air / np.linalg.norm(air, axis=1)[:, None]
    mean = np.concatenate([state, push, np.broadcast_to(growth, count)[:, None]], axis=1)
    mean = mean + rng.normal(size=mean.shape) * SIGMA
    root = np.tile(np.diag(1.0 / SIGMA), (count, 1, 1))
    weight = np.tile([burning, 1.0 - burning], (count, 1))
    rate = np.tile([400.0, 20.0, 0.05], (count, 1))
    return ModeEstimates(weight, mean, root, mean[:, :6], root[:, :6, :6], rate)


def burning_since(since_s: Any, logs: np.ndarray) -> StageHistory:
    """Return histories at time 0 of stages that have burnt for times, after earlier ones."""
    count = len(logs)
    begun = StageHistory.begun(np.arange(count), 0.0)
    since = np.broadcast_to(np.asarray(since_s, dtype=float), count)
    return evolve(begun, logs=logs, ignition_s=-since, ignition_sigma_s=np.full(count, 0.3))


def no_stages(count: int) -> np.ndarray:
    return np.full((count, STAGES, 4), np.nan)


def forecast(
    estimates: ModeEstimates,
    history: StageHistory,
    dark_s: float = 0.0,
    away_m: Any = 1e5,
    log: Any = None,
) -> LaunchForecasts:
    """Return the forecasts of tracks launched so far west, m, without reports of types."""
    count = len(estimates)
    east = -np.broadcast_to(away_m, count) / RADIUS_M
    launch = np.stack([np.zeros(count), east, -history.ignition_s], axis=1)
    log = np.zeros((count, len(HYPOTHESES))) if log is None else log
    return forecasts(
        OUTCOMES, estimates, history, np.full(count, dark_s), launch, log, 0.0, POINT_MASS
    )


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
    for row, (one, start_s) in enumerate(zip(state, time_s.tolist(), strict=True)):
        fall = solve_ivp(rates, (0.0, 9000.0), one, events=ground, rtol=1e-8, atol=1e-2)
        if len(fall.t_events[0]):
            x, y = fall.y_events[0][0][:2]
            turned = np.arctan2(y, x) - EARTH_ROTATION_RAD_S * (start_s + fall.t_events[0][0])
            places[row] = 0.0, float(np.arctan2(np.sin(turned), np.cos(turned)))
    return places


class Flights:
    """Flights of the law of missiles at random instants of their burns, as often as the classes
    say.
    """

    def __init__(self, count: int, seed: int) -> None:
        model = vehicle_model()
        rng = np.random.default_rng(seed)
        drawn = 20 * count
        stages = drawn_stages(model, MISSILE, drawn, rng)
        steering = drawn_steering(drawn, model.data, seed)
        range_m = ranges_m(burn_ends(stages, steering))
        weight = np.where(np.isfinite(range_m), OUTCOMES.missiles(range_m).sum(axis=1), 0.0)
        rows = rng.choice(drawn, count, p=weight / weight.sum())
        stages = VehicleStages(*(column[rows] for column in stages))
        steering = steering.take(rows)
        used = np.sum(stages.burn_s > 0.0, axis=1)
        self.stage = rng.integers(0, used)
        each = np.arange(count)
        starts = stages.starts_s
        self.since = rng.uniform(0.3, 0.95, count) * stages.burn_s[each, self.stage]
        now = starts[each, self.stage] + self.since
        burnt = np.clip(now[:, None] - starts, 0.0, stages.burn_s)
        gap = np.where(burnt > 0.0, stages.gap_s, 0.0)
        x, y, u, v = burn_ends(stages._replace(burn_s=burnt, gap_s=gap), steering)
        radius = np.hypot(x, y)
        speed = np.hypot(u, v)
        self.state = states(radius - RADIUS_M, speed, np.arcsin((x * u + y * v) / (radius * speed)))
        self.away_m = RADIUS_M * np.arctan2(x, y)
        left = np.where(starts < now[:, None], stages.burn_s - burnt, stages.burn_s)
        shrink = np.maximum(1.0 - stages.growth_per_s * burnt, 0.02)
        size = stages.first_m_s2 / shrink
        growth = stages.growth_per_s / shrink
        self.force = size[each, self.stage]
        self.growth = growth[each, self.stage]
        burns = RemainingBurns(np.maximum(starts - now[:, None], 0.0), left, size, growth, now)
        still = np.zeros((STAGES, burning_on.STEPS, count, 2))
        out, later, _ = burning_on.flown_on(self.state, burns, steering, still)
        self.impact = impacts_of(out, later)
        ratio = -np.log(1.0 - stages.growth_per_s * stages.burn_s)
        after = np.concatenate([stages.gap_s[:, 1:], np.zeros((count, 1))], axis=1)
        with np.errstate(divide="ignore"):
            self.logs = np.stack(
                [np.log(stages.burn_s), np.log(stages.first_m_s2), ratio, np.log(after)], axis=2
            )
        self.logs[np.arange(STAGES) >= self.stage[:, None]] = np.nan


@pytest.mark.slow
def test_flights_of_the_own_law_fall_into_the_stated_shares_of_regions() -> None:
    flights = Flights(150, 12)
    rng = np.random.default_rng(13)
    seen = estimated(flights.state, flights.force, flights.growth, 1.0, rng)
    found = forecast(seen, burning_since(flights.since, flights.logs), away_m=flights.away_m)
    known = [
        row
        for row in range(150)
        if found.impact_regions[row] and np.isfinite(flights.impact[row, 0])
    ]
    assert len(known) > 110
    inside = np.array(
        [
            [region.contains(*flights.impact[row]) for region in found.impact_regions[row][:3]]
            for row in known
        ]
    )
    share = inside.mean(axis=0)
    # Three standard deviations of a share of 120: 14, 8 and 6 %; kernels and tilts make regions
    # somewhat wide.
    assert 0.36 < share[0] < 0.75
    assert share[1] > 0.82
    assert share[2] > 0.89


def test_what_is_said_of_a_track_agrees() -> None:
    rng = np.random.default_rng(3)
    seen = estimated(
        states([2e4, 4e4, 6e4], [900.0, 1800.0, 3000.0], 0.8), [30.0, 35.0, 40.0], 0.012, 0.7, rng
    )
    found = forecast(seen, burning_since([50.0, 60.0, 70.0], no_stages(3)))
    assert found.given_launch.sum(axis=1) == pytest.approx(np.ones(3))
    able = np.array([one.is_launch or one.group == "none" for one in HYPOTHESES])
    assert not found.given_launch[:, ~able].any()
    assert np.all(found.given_launch[:, NAMES.index("none of these")] <= 0.05)
    for row in range(3):
        regions = found.impact_regions[row]
        assert len(regions) == 3
        assert regions[0].condition == "comes down"
        assert 0.0 < regions[0].probability <= found.probability_comes_down[row] + 1e-9
        assert all(region.effective_samples >= 8.0 for region in regions)


def test_a_dark_target_has_a_region_for_each_condition_and_relights_fade() -> None:
    rng = np.random.default_rng(4)
    seen = estimated(states(6e4, 2500.0, 0.7), 0.0, 0.0, 0.0, rng)
    logs = no_stages(1)
    logs[0, 0, :3] = np.log([70.0, 20.0, 2.7])
    chances = []
    for dark_s in (2.0, 10.0, 40.0):
        history = evolve(burning_since(70.0 + dark_s, logs), dark_since_s=np.array([-dark_s]))
        found = forecast(seen, history, dark_s)
        assert found.impact_regions[0][0].condition == "burn over" or dark_s < 5.0
        areas = {
            region.condition: region.area_km2
            for region in found.impact_regions[0]
            if region.containment == 0.95
        }
        if "relights" in areas:
            assert areas["relights"] > 10.0 * areas["burn over"]
        chances.append(found.probability_relights[0])
    assert chances[0] > 1.5 * chances[1] > 3.0 * chances[2] > 0.0


def test_a_slow_long_burn_near_the_speed_of_an_orbit_goes_there_without_a_small_region() -> None:
    rng = np.random.default_rng(5)
    logs = no_stages(1)
    logs[0, 0] = np.log([155.0, 13.0, 3.0, 11.0])
    seen = estimated(states(1.7e5, 6000.0, 0.03), 16.0, 0.0026, 1.0, rng)
    found = forecast(seen, burning_since(250.0, logs), away_m=1e6)
    assert found.given_launch[0, NAMES.index("SLV")] > 0.9
    assert all(region.area_km2 > 1e4 for region in found.impact_regions[0])
    orbiting = estimated(states(2.2e5, 7500.0, 0.0), 0.0, 0.0, 0.0, rng)
    logs[0, 1, :3] = np.log([380.0, 8.0, 3.8])
    over = evolve(burning_since(400.0, logs), dark_since_s=np.array([-20.0]))
    after = forecast(orbiting, over, 20.0, away_m=2e6)
    assert after.given_launch[0, NAMES.index("SLV")] > 0.9
    assert after.in_orbit[0] > 0.6


@pytest.mark.parametrize("since_s", [200.0, 400.0, 800.0, 1600.0])
def test_a_boost_unlike_any_raises_none_of_these(since_s: float) -> None:
    """Whether the burn is four or thirty times as long as a usual one at this force, it does not
    sharpen a class.

    The bound is ten times the prior. By the declared priors it cannot be more than a half: as many
    vehicles of known classes have odd stages as are none of these.
    """
    rng = np.random.default_rng(6)
    none = NAMES.index("none of these")
    slow = estimated(states(3e4, 500.0, 0.5), 4.0, 0.0002, 1.0, rng)
    found = forecast(slow, burning_since(since_s, no_stages(1)))
    assert found.given_launch[0, none] > 10.0 * OUTCOMES.prior[none]
    assert OUTCOMES.odd == pytest.approx(OUTCOMES.prior[none], rel=0.05)


def test_a_track_that_has_burnt_in_another_direction_may_be_none_of_these_and_comes_down_all_the_same() -> (
    None
):
    seen = estimated(states(6e4, 2000.0, 0.7), 0.0, 0.0, 0.0, np.random.default_rng(11))
    logs = no_stages(1)
    logs[0, 0, :3] = np.log([60.0, 20.0, 2.0])
    over = evolve(burning_since(90.0, logs), dark_since_s=np.array([-30.0]))
    plain, turned = (
        forecast(seen, evolve(over, free_odds=np.array([odds])), 30.0) for odds in (1.0, 500.0)
    )
    column = NAMES.index("none of these")
    assert plain.given_launch[0, column] < 0.05
    assert turned.given_launch[0, column] > 5.0 * plain.given_launch[0, column]
    region = turned.impact_regions[0][2]
    assert region.condition == "burn over"
    assert region.probability > 0.9
    assert region.area_km2 == pytest.approx(plain.impact_regions[0][2].area_km2, rel=0.2)


def test_a_burn_in_another_direction_leads_nowhere_that_a_region_could_say() -> None:
    seen = estimated(states(6e4, 2000.0, 0.7), 0.0, 0.0, 1.0, np.random.default_rng(12))
    free = evolve(seen, burn_share=np.array([[0.02, 0.0, 0.98]]))
    found = forecast(free, burning_since(90.0, no_stages(1)))
    assert not found.impact_regions[0] or found.impact_regions[0][0].probability < 0.2


def test_reported_types_move_classes_and_regions() -> None:
    rng = np.random.default_rng(7)
    seen = estimated(states(3e4, 1500.0, 0.8), 35.0, 0.012, 1.0, rng)
    log = np.zeros((1, len(HYPOTHESES)))
    log[0, NAMES.index("SRBM")] = 5.0
    plain, reported = (
        forecast(seen, burning_since(55.0, no_stages(1)), log=one) for one in (None, log)
    )
    column = NAMES.index("SRBM")
    assert reported.given_launch[0, column] > plain.given_launch[0, column]
    assert reported.impact_regions[0][2].area_km2 < plain.impact_regions[0][2].area_km2


def test_a_level_end_of_the_burn_is_that_of_a_glider_whose_region_is_its_reach() -> None:
    rng = np.random.default_rng(8)
    seen = estimated(states(5e4, 5300.0, 0.0), 0.0, 0.0, 0.0, rng)
    logs = no_stages(1)
    logs[0, 0, :3] = np.log([150.0, 20.0, 3.5])
    found = forecast(
        seen, evolve(burning_since(160.0, logs), dark_since_s=np.array([-10.0])), 10.0, away_m=4e5
    )
    assert found.given_launch[0, NAMES.index("HGV")] > 0.3
    # At L/D of 2.5 some 4 600 km: R/2 · 2.5 · ln((1 - (1.5/7.9)²) / (1 - (5.3/7.9)²)).
    assert found.impact_regions[0][2].contains(0.0, 4.6e6 / RADIUS_M)


def test_regions_hold_gliders_of_low_probability_too() -> None:
    """A glider that is one seventh of what comes down with its burn over is more than a region of
    95 % leaves out.
    """
    logs = no_stages(1)
    logs[0, 0, :3] = np.log([150.0, 20.0, 3.5])
    over = evolve(burning_since(160.0, logs), dark_since_s=np.array([-10.0]))
    reports = np.zeros((1, len(HYPOTHESES)))
    reports[0, NAMES.index("HGV")] = -7.0
    seen = estimated(states(5e4, 5300.0, 0.0), 0.0, 0.0, 0.0, np.random.default_rng(8))
    found = forecast(seen, over, 10.0, away_m=4e5, log=reports)
    assert 0.02 < found.given_launch[0, NAMES.index("HGV")] < 0.1
    main = [region for region in found.impact_regions[0] if region.condition == "burn over"]
    assert main[2].contains(0.0, 3.5e6 / RADIUS_M)
    assert not main[0].contains(0.0, 3.5e6 / RADIUS_M)
    stated = sum(
        region.probability for region in found.impact_regions[0] if region.containment == 0.95
    )
    assert stated == pytest.approx(found.probability_comes_down[0])


def test_what_is_precisely_in_orbit_is_a_space_launch_whatever_its_stages_and_none_where_none_is_known() -> (
    None
):
    logs = no_stages(1)
    logs[0, 0, :3] = np.log([500.0, 12.0, 5.0])
    state = states(2.0e5, 7400.0, 0.0)
    over = evolve(burning_since(620.0, logs), dark_since_s=np.array([-120.0]))
    found = forecast(
        estimated(state, 0.0, 0.0, 0.0, np.random.default_rng(9)), over, 120.0, away_m=2e6
    )
    assert found.given_launch[0, NAMES.index("SLV")] > 0.95
    assert found.given_launch[0, NAMES.index("none of these")] < 0.02
    rest = tuple(one for one in HYPOTHESES if one.group != "orbit")
    seen = estimated(state, 0.0, 0.0, 0.0, np.random.default_rng(9))
    launch = np.array([[0.0, -2e6 / RADIUS_M, -620.0]])
    without = Outcomes(vehicle_model(), rest)
    left = forecasts(
        without, seen, over, np.array([120.0]), launch, np.zeros((1, len(rest))), 0.0, POINT_MASS
    ).given_launch
    assert left[0, [one.name for one in rest].index("none of these")] > 0.95
