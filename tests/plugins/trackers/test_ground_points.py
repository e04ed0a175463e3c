"""Launches, impacts and types of `imm`'s tracks."""

import numpy as np
import pytest
from opir_trackers.filter.estimates import PredictedMeasurements
from opir_trackers.ground_points import GroundPoints, impacts, launches, updated_points
from opir_trackers.imm.report import type_log_likelihoods, type_posterior

from opir_core.estimation.lines_of_sight import earth_rotated
from opir_core.flight.forces import J2, Forces
from opir_core.flight.kepler import propagate_kepler
from opir_core.flight.propagation import impact
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.testing.doubles import stub_sensor

STATE = np.array([4.1e6, 3.9e6, 3.3e6, 500.0, 2500.0, 4500.0])


@pytest.mark.parametrize("forces", [Forces(zonal=()), J2])
def test_impacts_spread_as_a_cloud_of_states_does(forces: Forces) -> None:
    """The covariance of 4000 propagated states, within 5 standard errors of a variance."""
    sigma = np.repeat([300.0, 2.0], 3)
    rng, runs, time_s = np.random.default_rng(3), 4000, 100.0
    points = impacts(STATE[None], np.diag(sigma**2)[None], time_s, forces)
    cloud = STATE + sigma * rng.normal(size=(runs, 6))
    flight, fell = impact(cloud[:, :3], cloud[:, 3:], forces=Forces(zonal=()))
    ground = earth_rotated(fell, -(time_s + flight))
    centre = geodetic_to_ecef(points.place[0, 0], points.place[0, 1], 0.0)
    plane = (ground - ground.mean(axis=0)) @ local_axes(centre)[:2].T
    flat = np.column_stack([plane, flight - flight.mean()])
    observed, told = np.cov(flat.T), points.covariance[0]
    turn = np.linalg.inv(np.linalg.cholesky(told))
    assert np.abs(turn @ observed @ turn.T - np.eye(3)).max() < 5.0 * np.sqrt(2.0 / runs)
    exact, there = impact(STATE[:3], STATE[3:], forces=forces)
    where = ecef_to_geodetic(earth_rotated(there[None], -(time_s + np.atleast_1d(exact))))
    assert points.place[0] == pytest.approx([where.latitude_rad[0], where.longitude_rad[0], time_s + float(exact)])


@pytest.mark.parametrize("since_s", [-0.05, 0.05, 1.0, 5.0, 12.0])
def test_the_impact_of_what_has_come_down_is_where_it_came_down(since_s: float) -> None:
    """Below the ground the arc goes on through the Earth; the place it came down at stays, and how surely."""
    covariance, kepler = np.diag(np.repeat([300.0, 2.0], 3) ** 2)[None], Forces(zonal=())
    flight, fell = impact(STATE[:3], STATE[3:], forces=kepler)
    after = np.concatenate(propagate_kepler(STATE[:3], STATE[3:], flight + since_s))
    told = impacts(after[None], covariance, 50.0 + float(flight) + since_s, kepler)
    where = ecef_to_geodetic(earth_rotated(fell[None], -(50.0 + np.atleast_1d(flight))))
    assert told.place[0, :2] == pytest.approx([where.latitude_rad[0], where.longitude_rad[0]], abs=1e-12)
    assert told.place[0, 2] == pytest.approx(50.0 + float(flight), abs=1e-6)
    before = np.concatenate(propagate_kepler(STATE[:3], STATE[3:], flight - 1.0))
    there = impacts(before[None], covariance, 49.0 + float(flight), kepler).covariance
    assert told.covariance == pytest.approx(there, rel=0.02)


def test_no_impact_is_told_without_how_sure_it_is() -> None:
    """Where a standard deviation of speed makes an orbit of a fall, some of what the state may be never comes down."""
    state = np.array([7.0e6, 0.0, 0.0, 0.0, 6800.0, 0.0])
    covariance = np.diag(np.repeat([1e3, 1.5e3], 3) ** 2)
    told = impacts(np.stack([state, STATE]), np.stack([covariance, np.diag(np.repeat([300.0, 2.0], 3) ** 2)]), 0.0, J2)
    assert np.isnan(told.place[0]).all()
    assert np.isnan(told.covariance[0]).all()
    assert np.isfinite(told.place[1]).all()
    assert np.isfinite(told.covariance[1]).all()


def test_no_ellipse_is_told_of_impacts_that_bend_away_from_it_or_go_round_the_earth() -> None:
    """Along a ridge of positions and speeds that go together impacts lie on a bow: what is told holds a cloud."""
    kepler, across = Forces(zonal=()), np.diag(np.repeat([300.0, 2.0], 3) ** 2)
    ridge = np.array([0.0, 24.0, 32.0, 0.0, -0.8, 0.6])
    reach = np.array([0.0, 50.0, 100.0, 150.0, 200.0, 250.0, 300.0])
    spread = across + reach[:, None, None] ** 2 * np.outer(ridge, ridge)
    told = impacts(np.tile(STATE, (len(reach), 1)), spread, 0.0, kepler)
    known = np.flatnonzero(np.isfinite(told.place).all(axis=1))
    assert 3 <= len(known) < len(reach)
    assert known.tolist() == list(range(len(known)))
    flight, fell = impact(STATE[:3], STATE[3:], forces=kepler)
    middle = earth_rotated(fell[None], -np.atleast_1d(flight))[0]
    rng, shares = np.random.default_rng(4), []
    for row in known:
        cloud = rng.multivariate_normal(STATE, spread[row], 4000)
        later, there = impact(cloud[:, :3], cloud[:, 3:], forces=kepler)
        plane = (earth_rotated(there, -np.asarray(later)) - middle) @ local_axes(middle)[:2].T
        square = np.sum(plane @ np.linalg.inv(told.covariance[row, :2, :2]) * plane, axis=1)
        shares.append(np.mean(square < 5.99))
    # The most that is told bends by a standard deviation of the ellipse across the bow.
    assert min(shares[:3]) > 0.93
    assert min(shares) > 0.75
    wide = impacts(STATE[None], np.diag(np.repeat([3e5, 900.0], 3) ** 2)[None], 0.0, kepler)
    assert np.isnan(wide.place).all()


SITE = geodetic_to_ecef(np.radians(5.0), np.radians(20.0), 0.0)
EAST, NORTH, UP = local_axes(SITE)
SPIN = 7.292115e-5 * np.array([-SITE[1], SITE[0], 0.0])
PULL = -(7.292115e-5**2) * np.array([SITE[0], SITE[1], 0.0])


def risen(since: float) -> np.ndarray:
    """Return the derivatives (5, 3) of a path that left the site from rest, with 12 m/s² upward and 2 eastward."""
    gain = 12.0 * UP + 2.0 * EAST + PULL
    place = SITE + SPIN * since + 0.5 * gain * since**2
    return np.stack([place, SPIN + gain * since, gain, np.zeros(3), np.zeros(3)])


def test_a_path_is_followed_back_to_where_it_left_the_ground() -> None:
    """Its velocity is known, so it gives the time of the launch; what is not known of the place stays."""
    side = np.zeros((1, 12, 12))
    side[0, :3, :3] = 100.0 * np.eye(3)
    seen, pause = np.array([2.0]), np.array([0.1])
    found = launches(PredictedMeasurements(8.0, risen(8.0)[None], side), seen, pause, 0.0)
    assert np.degrees(found.place[0, :2]) == pytest.approx([5.0, 20.0], abs=2e-4)
    assert found.place[0, 2] == pytest.approx(0.0, abs=0.1)
    assert np.sqrt(np.diag(found.covariance[0])[:2]) == pytest.approx(100.0, rel=0.01)
    # A speed known to 1 m/s at 12 m/s² is a time known to 0.08 s; times are 0.4 s apart here.
    assert 0.08 < np.sqrt(found.covariance[0, 2, 2]) < 0.3
    assert np.linalg.eigvalsh(found.covariance[0]).min() > 0.0
    high = PredictedMeasurements(8.0, (risen(8.0) + np.array([300e3 * UP, *np.zeros((4, 3))]))[None], side)
    assert np.isnan(launches(high, seen, pause, 0.0).place).all()


def test_launches_are_as_sure_as_they_say() -> None:
    """3000 from 100 m about the ellipsoid and 1 m/s about rest, seen at once or up to 80 s late."""
    rng, runs, now_s, pause_s = np.random.default_rng(8), 3000, 90.0, 0.4
    first_s = np.where(rng.random(runs) < 0.5, rng.exponential(pause_s, runs), rng.uniform(0.0, 80.0, runs))
    sigma = np.repeat([60.0, 10.0, 0.1, 0.005], 3)
    path = np.tile(risen(now_s), (runs, 1, 1))
    drift = rng.normal(size=(runs, 3))
    path[:, 0] += 100.0 * rng.normal(size=(runs, 1)) * UP + drift * now_s
    path[:, 1] += drift
    path[:, :4] += (sigma * rng.normal(size=(runs, 12))).reshape(runs, 4, 3)
    found = launches(
        PredictedMeasurements(now_s, path, np.tile(np.diag(sigma), (runs, 1, 1))), first_s, np.full(runs, pause_s), 0.0
    )
    known = np.isfinite(found.place[:, 2])
    assert known.mean() > 0.999
    off = found.place[known, 2] / np.sqrt(found.covariance[known, 2, 2])
    assert np.abs(off.mean()) < 3.3 / np.sqrt(runs)
    assert np.mean(off**2) == pytest.approx(1.0, abs=0.15)
    plane = (geodetic_to_ecef(*found.place[known, :2].T, 0.0) - SITE) @ np.stack([EAST, NORTH]).T
    square = np.einsum("ni,nij,nj->n", plane, np.linalg.inv(found.covariance[known][:, :2, :2]), plane)
    assert np.mean(square) / 2.0 == pytest.approx(1.0, abs=0.1)
    assert np.mean(square < 5.99) == pytest.approx(0.95, abs=3.3 * np.sqrt(0.95 * 0.05 / runs))


def test_each_sensor_counts_once_for_the_type() -> None:
    confusion = {
        "ICBM": {"ICBM": 0.8, "IRBM": 0.1, "SRBM": 0.02, "UNKNOWN": 0.08},
        "IRBM": {"ICBM": 0.12, "IRBM": 0.72, "SRBM": 0.08, "UNKNOWN": 0.08},
        "SRBM": {"ICBM": 0.03, "IRBM": 0.1, "SRBM": 0.77, "UNKNOWN": 0.1},
    }
    evidence = type_log_likelihoods(
        [stub_sensor("A", confusion=confusion), stub_sensor("B", confusion=confusion), stub_sensor()]
    )
    unknown = REPORTED_TYPES.index("UNKNOWN")
    told = type_posterior(np.array([[0, -1, -1], [0, 0, 2], [-1, unknown, -1]]), evidence)
    assert told[0] == pytest.approx(np.array([0.8, 0.12, 0.03, 0.0]) / 0.95)
    assert told[1] == pytest.approx(np.array([0.64, 0.0144, 0.0009, 0.0]) / 0.6553)
    assert told[2].tolist() == [0.0, 0.0, 0.0, 1.0]


def test_a_launch_told_anew_replaces_what_was_told_before_however_sure_that_was() -> None:
    known = GroundPoints(np.zeros((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    fresh = GroundPoints(np.array([[1.0, 2.0, 3.0], [np.nan] * 3]), np.tile(4.0 * np.eye(3), (2, 1, 1)))
    told = updated_points(known, fresh)
    assert told.place.tolist() == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]
    assert told.covariance[:, 0, 0].tolist() == [4.0, 1.0]
