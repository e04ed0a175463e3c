"""The marginal likelihoods of lines of sight, against multivariate normals written out line by
line.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import LinesOfSight
from opir_forecast.launch_points import grounds
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.motion_priors import MotionPriors
from opir_trackers.onset.motion_statistics import (
    BOLIDE,
    GROUND,
    LAUNCH,
    NOISE,
    NONE,
    MotionStatistics,
)
from opir_trackers.onset.posterior import GroupPosterior, log_evidence
from scipy.stats import multivariate_normal

from opir_core.geometry import geodetic_to_ecef, local_axes

PLACE = geodetic_to_ecef(
    np.array([np.radians(33.0)]), np.array([np.radians(55.0)]), np.array([0.0])
)[0]
SENSORS = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([40.0, 90.0])])
SIGMA_RAD = 20e-6


def lines_to(points, time_s, sensor, rng, sigma_rad=SIGMA_RAD):
    """Return noisy lines of sight of sensors (n,) to points (n, 3) in ECEF."""
    along = points - SENSORS[sensor]
    range_m = np.linalg.norm(along, axis=1)[:, None]
    direction = along / range_m + sigma_rad * rng.standard_normal(along.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    sigma = np.full(len(time_s), sigma_rad)
    return LinesOfSight(
        time_s, sensor.astype(np.int32), np.arange(len(time_s)), SENSORS[sensor], direction, sigma
    )


def statistics_of(lines, reference_m, clutter=-np.inf):
    fresh = MotionStatistics.fresh(reference_m[None], 0.0, np.zeros(1), np.full(5, 0.2))
    return fresh.with_lines(np.zeros(len(lines), dtype=np.int64), lines, np.full(2, clutter))


def normal_log_likelihoods(lines, reference_m, priors):
    """Return log densities of the angles of all lines at once, less those of lines without
    error.
    """
    axes = local_axes(PLACE[None])[0]
    rows = []
    measured = []
    for time_s, origin, direction in zip(
        lines.time_s, lines.origin_ecef_m, lines.direction_ecef, strict=True
    ):
        ahead = reference_m - origin
        range_m = np.linalg.norm(ahead)
        towards = ahead / range_m
        across = np.linalg.svd(towards[None])[2][1:]
        powers = [1.0, time_s, time_s**2 / 2.0, time_s**3 / 6.0]
        rows.append(np.hstack([power * across @ axes.T for power in powers]) / range_m)
        crossed = origin + direction * (range_m / (direction @ towards))
        measured.append(across @ (crossed - PLACE) / range_m)
    design = np.vstack(rows)
    seen = np.concatenate(measured)
    noise = SIGMA_RAD**2 * np.eye(len(seen))
    found = []
    for mean, root in zip(priors.mean, priors.root, strict=True):
        spread = design @ root @ root.T @ design.T + noise
        found.append(multivariate_normal(design @ mean, spread).logpdf(seen))
    return np.array(found) + len(seen) * 0.5 * np.log(2.0 * np.pi * SIGMA_RAD**2)


def test_evidence_is_that_of_normals_in_the_space_of_angles():
    rng = np.random.default_rng(1)
    time_s = np.sort(rng.uniform(0.0, 12.0, 9))
    up = local_axes(PLACE[None])[0, 2]
    points = PLACE + 4.0 * time_s[:, None] ** 2 * up
    reference_m = PLACE + 2500.0 * up
    lines = lines_to(points, time_s, rng.integers(0, 2, 9), rng)
    priors = MotionPriors.of(HypothesesConfig())
    evidence = log_evidence(priors, statistics_of(lines, reference_m))[0]
    # Above the reference point "up" is the same; the axes of its foot are those of the place.
    assert evidence == pytest.approx(
        normal_log_likelihoods(lines, reference_m, priors), abs=1e-3, rel=1e-6
    )


def test_lines_add_up_in_any_portions():
    rng = np.random.default_rng(2)
    time_s = np.sort(rng.uniform(0.0, 5.0, 40))
    lines = lines_to(np.tile(PLACE, (40, 1)), time_s, rng.integers(0, 2, 40), rng)
    owner = rng.integers(-1, 3, 40)
    fresh = MotionStatistics.fresh(np.tile(PLACE, (3, 1)), 0.0, np.zeros(3), np.full(5, 0.2))
    clutter = np.zeros(2)
    at_once = fresh.with_lines(owner, lines, clutter)
    halves = fresh.with_lines(owner[:17], lines.take(slice(17)), clutter)
    halves = halves.with_lines(owner[17:], lines.take(slice(17, None)), clutter)
    for one, other in zip(at_once.of_motion(), halves.of_motion(), strict=True):
        assert one == pytest.approx(other, rel=1e-9)
    assert at_once.lines.tolist() == [np.count_nonzero(owner == row) for row in range(3)]


def groups_of(points, time_s, sensor, rng, *, clutter=-np.inf, gone=False, pause_s=0.1):
    posterior = GroupPosterior.of(HypothesesConfig(), np.exp(np.full(2, clutter)), np.ones(2))
    lines = lines_to(points, time_s, sensor, rng)
    statistics = statistics_of(lines, points[0], clutter)
    age = np.array([np.ptp(time_s)])
    return posterior.probabilities(statistics, age, np.array([pause_s]), np.array([gone]))[0]


TIME_S = np.arange(0.0, 20.0, 0.1)
EAST, NORTH, UP = local_axes(PLACE[None])[0]

#: Height, m, velocity, m/s, acceleration, m/s², duration, s, of motions, and what each is.
MOTIONS = {
    "fire": (0.0, 0.0 * UP, 0.0 * UP, 10.0, GROUND),
    "lift-off": (0.0, 0.0 * UP, 8.0 * UP, 20.0, LAUNCH),
    "out of cloud": (10e3, 350.0 * UP, 12.0 * UP + 5.0 * EAST, 10.0, LAUNCH),
    "second stage": (180e3, 4000.0 * EAST + 600.0 * UP, 12.0 * EAST - 3.0 * UP, 10.0, LAUNCH),
    "aircraft": (11e3, 240.0 * EAST, 0.0 * UP, 20.0, NONE),
    "balloon": (20e3, 0.0 * UP, 0.0 * UP, 20.0, NONE),
    "re-entry": (60e3, 5900.0 * EAST - 1000.0 * UP, -50.0 * EAST, 20.0, NONE),
    "bolide": (45e3, 10e3 * NORTH - 14e3 * UP, -500.0 * NORTH + 700.0 * UP, 2.0, BOLIDE),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_two_sensors_tell_what_moves_how(name):
    height_m, velocity, acceleration, until_s, group = MOTIONS[name]
    time_s = np.repeat(TIME_S[until_s > TIME_S], 2)
    path = (
        PLACE + height_m * UP + np.outer(time_s, velocity) + np.outer(0.5 * time_s**2, acceleration)
    )
    sensor = np.tile([0, 1], len(time_s) // 2)
    probability = groups_of(path, time_s, sensor, np.random.default_rng(5))
    assert probability[group] > 0.9
    assert probability[NOISE] == 0.0
    assert probability.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("height_m", [6e3, 10e3, 14e3])
@pytest.mark.parametrize("gone", [False, True])
def test_a_flash_is_no_launch_to_two_sensors(height_m, gone):
    """Lightning stands above the ground for half a second, which tells nothing of its motion."""
    time_s = np.repeat(TIME_S[TIME_S < 0.5], 2)
    points = np.tile(PLACE + height_m * UP, (len(time_s), 1))
    sensor = np.tile([0, 1], len(time_s) // 2)
    launched = [
        groups_of(points, time_s, sensor, np.random.default_rng([31, seed]), gone=gone)[LAUNCH]
        for seed in range(20)
    ]
    assert max(launched) < 0.5


@pytest.mark.parametrize("height_m", [0.0, 3e3, 4e3, 5e3, 6e3])
@pytest.mark.parametrize("until_s", [1.0, 3.0, 8.0])
def test_a_fire_on_high_land_is_no_launch_to_two_sensors(height_m, until_s):
    time_s = np.repeat(TIME_S[until_s > TIME_S], 2)
    points = np.tile(PLACE + height_m * UP, (len(time_s), 1))
    sensor = np.tile([0, 1], len(time_s) // 2)
    launched = [
        groups_of(points, time_s, sensor, np.random.default_rng([32, seed]))[LAUNCH]
        for seed in range(20)
    ]
    assert max(launched) < 0.5


@pytest.mark.parametrize("speed_m_s", [350.0, 450.0, 550.0])
@pytest.mark.parametrize("turn_m_s2", [0.0, 10.0])
@pytest.mark.parametrize("climb_m_s", [0.0, 100.0])
@pytest.mark.parametrize("until_s", [10.0, 18.0])
def test_a_supersonic_aircraft_is_no_launch_to_two_sensors(
    speed_m_s, turn_m_s2, climb_m_s, until_s
):
    time_s = np.repeat(TIME_S[until_s > TIME_S], 2)
    sensor = np.tile([0, 1], len(time_s) // 2)
    launched = []
    for seed in range(8):
        course = seed * np.pi / 4.0 + turn_m_s2 / speed_m_s * np.arange(len(time_s) // 2) * 0.1
        steps = 0.1 * speed_m_s * np.column_stack([np.sin(course), np.cos(course)])
        over = np.repeat(np.cumsum(steps, axis=0), 2, axis=0) @ np.array([EAST, NORTH])
        points = PLACE + over + (9e3 + climb_m_s * time_s)[:, None] * UP
        rng = np.random.default_rng([34, seed])
        launched.append(groups_of(points, time_s, sensor, rng)[LAUNCH])
    assert max(launched) < 0.5


def test_one_sensor_tells_a_launch_from_aircraft_by_its_speed_at_first():
    """What rises from rest has no speed at first; aircraft have."""
    time_s = TIME_S
    points = PLACE + 4.5 * np.square(time_s)[:, None] * UP
    sensor = np.zeros(len(time_s), dtype=int)
    launched = [
        groups_of(points, time_s, sensor, np.random.default_rng([35, seed]))[LAUNCH]
        for seed in range(20)
    ]
    assert np.median(launched) > 0.95


@pytest.mark.parametrize("height_m", [0.0, 1.5e3, 5e3])
def test_what_stands_is_where_lines_and_kinds_of_ground_agree(height_m):
    """A mixture over kinds of ground, each by the covariances of place and lines (Kalman's
    form).
    """
    rng = np.random.default_rng(33)
    sensor = np.arange(12) % 2
    lines = lines_to(np.tile(PLACE + height_m * UP, (12, 1)), np.arange(12.0), sensor, rng)
    reference_m = PLACE + 2000.0 * UP
    statistics = statistics_of(lines, reference_m)
    kinds = np.array(grounds(0.5))
    spread = np.linalg.inv(statistics.static_information[0])
    measured = spread @ statistics.static_pull[0]
    chances = []
    places = []
    spreads = []
    for share, mean_m, sigma_m in kinds:
        prior = np.diag([1e10, 1e10, sigma_m**2])
        middle = np.array([0.0, 0.0, mean_m - 2000.0])
        gain = prior @ np.linalg.inv(prior + spread)
        chances.append(share * multivariate_normal(middle, prior + spread).pdf(measured))
        places.append(middle + gain @ (measured - middle))
        spreads.append(prior - gain @ prior)
    chance = np.array(chances) / np.sum(chances)
    mean = chance @ np.array(places)
    covariance = sum(
        share * (own + np.outer(place - mean, place - mean))
        for share, place, own in zip(chance, places, spreads, strict=True)
    )
    position, found = statistics.static_estimates(kinds, 1e5)
    axes = local_axes(PLACE[None])[0]
    assert axes @ (position[0] - reference_m) == pytest.approx(mean, abs=1.0)
    assert axes @ found[0] @ axes.T == pytest.approx(covariance, rel=1e-3, abs=10.0)


@pytest.mark.parametrize("speed_m_s", [8.0, 20.0, 100.0])
def test_what_goes_straight_on_over_the_ground_is_no_launch_to_one_sensor(speed_m_s):
    """A glint, a ship or a train: it does not gain speed as all that is powered does."""
    time_s = np.arange(0.0, 40.0, 0.1)
    path = PLACE + np.outer(time_s, speed_m_s * (0.6 * EAST + 0.8 * NORTH))
    sensor = np.zeros(len(time_s), dtype=np.int64)
    probability = groups_of(path, time_s, sensor, np.random.default_rng(8))
    assert probability[LAUNCH] < 0.2


def test_light_that_goes_out_at_once_is_less_probably_a_launch():
    time_s = np.arange(0.0, 1.5, 0.1)
    path = PLACE + 45e3 * UP + np.outer(time_s, 2e3 * NORTH - 3e3 * UP)
    sensor = np.zeros(len(time_s), dtype=np.int64)
    lit, out = (
        groups_of(path, time_s, sensor, np.random.default_rng(9), gone=gone)
        for gone in (False, True)
    )
    # Mean times of 5 and 100 s.
    assert out[LAUNCH] / out[BOLIDE] == pytest.approx(lit[LAUNCH] / lit[BOLIDE] / 20.0)
    assert out[LAUNCH] < lit[LAUNCH]


def test_false_alarms_scattered_over_a_gate_are_noise():
    rng = np.random.default_rng(6)
    time_s = 10.0 * np.arange(6)
    clutter = np.log(100.0)
    scattered = PLACE + 15e3 * (
        rng.standard_normal((6, 1)) * EAST + rng.standard_normal((6, 1)) * NORTH
    )
    sensor = np.zeros(6, dtype=np.int64)
    assert groups_of(scattered, time_s, sensor, rng, clutter=clutter, pause_s=10.0)[NOISE] > 0.95
    together = np.tile(PLACE, (6, 1))
    assert groups_of(together, time_s, sensor, rng, clutter=clutter, pause_s=10.0)[GROUND] > 0.95


def test_lines_of_two_sources_say_nothing_of_a_motion():
    """A false alarm 20 km off does not make a fire a launch: its lines begin anew."""
    rng = np.random.default_rng(7)
    points = np.tile(PLACE, (60, 1))
    points[0] += 20e3 * EAST
    lines = lines_to(points, 0.1 * np.arange(60), rng.integers(0, 2, 60), rng)
    posterior = GroupPosterior.of(HypothesesConfig(), np.full(2, 1.0), np.ones(2))
    mixed = statistics_of(lines, PLACE, 0.0)
    assert mixed.are_unlike_any_motion().all()
    anew = posterior.assessed(mixed, 6.0, np.array([0.0]), np.array([6.0]), np.array([0.1]))
    assert anew.lines.tolist() == [0.0]
    assert anew.epoch_s.tolist() == [6.0]
    assert not statistics_of(lines.take(slice(1, None)), PLACE, 0.0).are_unlike_any_motion().any()


@pytest.mark.parametrize("step_s", [0.5, 1.0, 2.0, 5.0, 10.0])
def test_a_fire_that_is_seen_for_long_is_assessed_every_five_seconds_or_every_step(step_s):
    rng = np.random.default_rng(13)
    lines = lines_to(np.tile(PLACE, (60, 1)), 0.5 * np.arange(60), rng.integers(0, 2, 60), rng)
    posterior = GroupPosterior.of(HypothesesConfig(), np.full(2, 1.0), np.ones(2))
    known = statistics_of(lines, PLACE, 0.0)
    assessed = []
    for tick_s in np.arange(25.3, 65.0, step_s):
        stale = evolve(known, probability=np.full((1, 5), 0.2) * [[1.0, 4.0, 0.0, 0.0, 0.0]])
        now = posterior.assessed(
            stale, tick_s, np.zeros(1), np.full(1, tick_s - 0.05), np.array([0.1]), step_s
        )
        if now.probability is not stale.probability:
            assessed.append(tick_s)
    assert len(assessed) > 2
    assert np.abs(np.diff(assessed) - max(5.0, step_s)).max() < step_s


def test_a_launch_that_may_be_one_is_assessed_every_second():
    rng = np.random.default_rng(14)
    lines = lines_to(np.tile(PLACE, (60, 1)), 0.5 * np.arange(60), rng.integers(0, 2, 60), rng)
    posterior = GroupPosterior.of(HypothesesConfig(), np.full(2, 1.0), np.ones(2))
    known = statistics_of(lines, PLACE, 0.0)
    for tick_s in np.arange(21.0, 25.0):
        doubtful = evolve(known, probability=np.array([[0.0, 0.9, 0.0, 0.1, 0.0]]))
        now = posterior.assessed(doubtful, tick_s, np.zeros(1), np.full(1, tick_s), np.array([0.1]))
        assert now.probability[0, GROUND] > 0.99
