"""Launch points: paths followed back to rest on the ground."""

import numpy as np
import pytest
from opir_estimation import PredictedMeasurements
from opir_forecast.launch_points import (
    EDGES_S,
    FirstMotion,
    LaunchDelayPrior,
    LaunchPoints,
    delays_at_once,
    launches,
    log_unreported,
    updated_points,
)

from opir_core.geometry import geodetic_to_ecef, local_axes

SITE = geodetic_to_ecef(np.radians(5.0), np.radians(20.0), 0.0)
EAST, NORTH, UP = local_axes(SITE)
SPIN = 7.292115e-5 * np.array([-SITE[1], SITE[0], 0.0])
PULL = -(7.292115e-5**2) * np.array([SITE[0], SITE[1], 0.0])


def risen(since: float) -> np.ndarray:
    """Return the derivatives (5, 3) of a path that left the site from rest, with 12 m/s² upward and
    2 eastward.
    """
    gain = 12.0 * UP + 2.0 * EAST + PULL
    place = SITE + SPIN * since + 0.5 * gain * since**2
    return np.stack([place, SPIN + gain * since, gain, np.zeros(3), np.zeros(3)])


def prior_of(runs: int, period_s: float) -> LaunchDelayPrior:
    """Return the prior for one sensor that misses nothing, and a motion of which nothing was
    known.
    """
    zero = np.zeros(runs)
    wide = np.full(runs, 1e9)
    nothing = FirstMotion(zero, zero, zero, 0.0, (wide, wide, 1.0, 0.1))
    unreported = log_unreported(np.array([period_s]), np.array([1.0 - 1e-12]))
    looks = delays_at_once(unreported, np.ones((runs, 1), dtype=np.bool_))
    return LaunchDelayPrior(looks, nothing, 0.5)


def test_a_path_is_followed_back_to_where_it_left_the_ground() -> None:
    """Its velocity is known, so it gives the time of the launch; what is not known of the place
    stays.
    """
    side = np.zeros((1, 12, 12))
    side[0, :3, :3] = 100.0 * np.eye(3)
    seen = np.array([2.0])
    prior = prior_of(1, 0.1)
    found = launches(PredictedMeasurements(8.0, risen(8.0)[None], side), seen, prior, 0.0)
    assert np.degrees(found.place[0, :2]) == pytest.approx([5.0, 20.0], abs=2e-4)
    assert found.place[0, 2] == pytest.approx(0.0, abs=0.1)
    assert np.sqrt(np.diag(found.covariance[0])[:2]) == pytest.approx(100.0, rel=0.01)
    # A speed known to 1 m/s at 12 m/s² is a time known to 0.08 s; times are 0.4 s apart here.
    assert 0.08 < np.sqrt(found.covariance[0, 2, 2]) < 0.3
    assert np.linalg.eigvalsh(found.covariance[0]).min() > 0.0
    high = PredictedMeasurements(
        8.0, (risen(8.0) + np.array([300e3 * UP, *np.zeros((4, 3))]))[None], side
    )
    assert np.isnan(launches(high, seen, prior, 0.0).place).all()


@pytest.mark.parametrize("height_m", [1500.0, 3000.0])
def test_a_launch_from_high_land_is_no_earlier_launch_from_the_sea(height_m: float) -> None:
    side = np.zeros((1, 12, 12))
    side[0, :3, :3] = 100.0 * np.eye(3)
    side[0, 3:6, 3:6] = 5.0 * np.eye(3)
    path = risen(8.0)
    path[0] += height_m * UP
    known = PredictedMeasurements(8.0, path[None], side)
    seen = np.array([0.05])
    prior = prior_of(1, 0.1)
    found = launches(known, seen, prior, 0.0)
    assert np.degrees(found.place[0, :2]) == pytest.approx([5.0, 20.0], abs=2e-4)
    assert found.place[0, 2] == pytest.approx(0.0, abs=0.5)
    at_sea = launches(known, seen, prior._replace(inland=0.0), 0.0)
    assert np.isnan(at_sea.place[0, 2])


@pytest.mark.slow
def test_launches_are_as_sure_as_they_say() -> None:
    """3000 from half at sea level, half as high as land is, at 1 m/s about rest, seen at once or up
    to 80 s late.
    """
    rng = np.random.default_rng(8)
    runs = 3000
    now_s = 90.0
    pause_s = 0.4
    first_s = np.where(
        rng.random(runs) < 0.5, rng.uniform(0.0, pause_s, runs), rng.uniform(0.0, 80.0, runs)
    )
    sigma = np.repeat([60.0, 10.0, 0.1, 0.005], 3)
    path = np.tile(risen(now_s), (runs, 1, 1))
    drift = rng.normal(size=(runs, 3))
    kind = rng.choice(3, runs, p=[0.5, 0.35, 0.15])
    height = rng.normal(
        np.array([0.0, 500.0, 1800.0])[kind], np.array([100.0, 300.0, 1000.0])[kind]
    )
    path[:, 0] += height[:, None] * UP + drift * now_s
    path[:, 1] += drift
    path[:, :4] += (sigma * rng.normal(size=(runs, 12))).reshape(runs, 4, 3)
    found = launches(
        PredictedMeasurements(now_s, path, np.tile(np.diag(sigma), (runs, 1, 1))),
        first_s,
        prior_of(runs, pause_s),
        0.0,
    )
    known = np.isfinite(found.place[:, 2])
    assert known.mean() > 0.999
    off = found.place[known, 2] / np.sqrt(found.covariance[known, 2, 2])
    assert np.abs(off.mean()) < 3.3 / np.sqrt(runs)
    assert np.mean(off**2) == pytest.approx(1.0, abs=0.15)
    plane = (geodetic_to_ecef(*found.place[known, :2].T, 0.0) - SITE) @ np.stack([EAST, NORTH]).T
    square = np.einsum(
        "ni,nij,nj->n", plane, np.linalg.inv(found.covariance[known][:, :2, :2]), plane
    )
    assert np.mean(square) / 2.0 == pytest.approx(1.0, abs=0.1)
    assert np.mean(square < 5.99) == pytest.approx(0.95, abs=3.3 * np.sqrt(0.95 * 0.05 / runs))


def test_first_detections_at_once_are_the_first_of_periodic_looks() -> None:
    """Two sensors, phases unknown, each look missed by chance: as drawn."""
    rng = np.random.default_rng(9)
    period_s = np.array([0.5, 10.0])
    chance = np.array([0.6, 0.9])
    looks = rng.uniform(size=(20000, 2)) + rng.geometric(chance, (20000, 2)) - 1.0
    drawn = np.min(looks * period_s, axis=1)
    sees = np.array([[True, True], [False, True]])
    stated = delays_at_once(log_unreported(period_s, chance), sees)
    for row, delay in ((0, drawn), (1, looks[:, 1] * period_s[1])):
        found = np.histogram(delay, EDGES_S)[0] / 20000
        assert np.abs(found - stated[row]).max() < 4.0 * np.sqrt(0.25 / 20000)
        assert stated[row].sum() == pytest.approx(1.0, abs=1e-6)


def test_a_late_detection_is_weighed_against_what_was_known_before() -> None:
    """A path followed back for 60 s is as uncertain as the prior of the filter: the launch time
    keeps its own prior.
    """
    sigma = 1e4, 1e3, 10.0, 0.3
    path = np.array([SITE + 1e4 * UP, SPIN, 8.0 * UP + PULL, 0.2 * UP, np.zeros(3)])
    known = PredictedMeasurements(0.0, path[None], np.diag(np.repeat(sigma, 3))[None])
    prior = prior_of(1, 0.1)
    motion = FirstMotion(
        np.array([1e4]),
        np.zeros(1),
        np.array([8.0]),
        0.2,
        (np.full(1, sigma[0]), np.full(1, sigma[1]), *sigma[2:]),
    )
    found = launches(known, np.zeros(1), LaunchDelayPrior(prior.at_once, motion, 0.5), 0.25)
    # Half at once, half uniform over 80 s: mean 20 s.
    assert found.place[0, 2] == pytest.approx(-20.0, abs=0.2)
    assert launches(known, np.zeros(1), prior, 0.25).place[0, 2] > -15.0


def test_a_launch_reported_anew_replaces_what_was_reported_before_however_sure_that_was() -> None:
    known = LaunchPoints(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    fresh = LaunchPoints(
        np.array([[1.0, 2.0, 3.0], [np.nan] * 3]), np.tile(4.0 * np.eye(3), (2, 1, 1))
    )
    reported = updated_points(known, fresh)
    assert reported.place.tolist() == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]
    assert reported.covariance[:, 0, 0].tolist() == [4.0, 1.0]
