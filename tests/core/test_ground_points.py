"""Launches, impacts and types of the stereo filter's tracks."""

import numpy as np
import pytest

from opir_core.flight.forces import J2, Forces
from opir_core.flight.impact_event import impact
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes
from opir_core.scene import REPORTED_TYPES
from opir_core.testing.doubles import stub_sensor
from opir_core.tracking.ground_points import impacts, launches
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import turned
from opir_core.tracking.stereo_report import evidence_of, type_posterior

STATE = np.array([4.1e6, 3.9e6, 3.3e6, 500.0, 2500.0, 4500.0])


@pytest.mark.parametrize("forces", [Forces(zonal=()), J2])
def test_impacts_spread_as_a_cloud_of_states_does(forces: Forces) -> None:
    """The covariance of 4000 propagated states, within 5 standard errors of a variance."""
    sigma = np.repeat([300.0, 2.0], 3)
    rng, runs, time_s = np.random.default_rng(3), 4000, 100.0
    points = impacts(STATE[None], np.diag(sigma**2)[None], time_s, forces)
    cloud = STATE + sigma * rng.normal(size=(runs, 6))
    flight, fell = impact(cloud[:, :3], cloud[:, 3:], forces=Forces(zonal=()))
    ground = turned(fell, -(time_s + flight))
    centre = geodetic_to_ecef(points.place[0, 0], points.place[0, 1], 0.0)
    plane = (ground - ground.mean(axis=0)) @ local_axes(centre)[:2].T
    flat = np.column_stack([plane, flight - flight.mean()])
    observed, told = np.cov(flat.T), points.covariance[0]
    turn = np.linalg.inv(np.linalg.cholesky(told))
    assert np.abs(turn @ observed @ turn.T - np.eye(3)).max() < 5.0 * np.sqrt(2.0 / runs)
    exact, there = impact(STATE[:3], STATE[3:], forces=forces)
    where = ecef_to_geodetic(turned(there[None], -(time_s + np.atleast_1d(exact))))
    assert points.place[0] == pytest.approx([where.latitude_rad[0], where.longitude_rad[0], time_s + float(exact)])


def test_a_path_is_followed_back_to_where_it_left_the_ground() -> None:
    site = geodetic_to_ecef(np.radians(5.0), np.radians(20.0), 0.0)
    east, _, up = local_axes(site)
    since = 8.0
    derivative = np.zeros((1, 5, 3))
    spin = 7.292115e-5 * np.array([-site[1], site[0], 0.0])
    derivative[0, 0] = site + spin * since + (6.0 * up + 1.0 * east) * since**2
    derivative[0, 1] = spin + 2.0 * (6.0 * up + 1.0 * east) * since
    derivative[0, 2] = 2.0 * (6.0 * up + 1.0 * east)
    side = np.zeros((1, 12, 12))
    side[0, :3, :3] = 100.0 * np.eye(3)
    found = launches(Outlook(since, derivative, side))
    assert np.degrees(found.place[0, :2]) == pytest.approx([5.0, 20.0], abs=2e-4)
    assert found.place[0, 2] == pytest.approx(0.0, abs=1.5)
    assert np.sqrt(np.diag(found.covariance[0])[:2]).min() > 99.0
    # To rise by 100 m from rest at 12 m/s² takes 4.08 s; the path was found some tenths of a second after its start.
    assert np.sqrt(found.covariance[0, 2, 2]) == pytest.approx(np.sqrt(2.0 * 100.0 / 12.0), rel=0.25)
    assert np.linalg.eigvalsh(found.covariance[0]).min() > 0.0
    high = Outlook(since, derivative + np.array([300e3 * up, *np.zeros((4, 3))]), side)
    assert np.isnan(launches(high).place).all()


def test_each_sensor_counts_once_for_the_type() -> None:
    confusion = {
        "ICBM": {"ICBM": 0.8, "IRBM": 0.1, "SRBM": 0.02, "UNKNOWN": 0.08},
        "IRBM": {"ICBM": 0.12, "IRBM": 0.72, "SRBM": 0.08, "UNKNOWN": 0.08},
        "SRBM": {"ICBM": 0.03, "IRBM": 0.1, "SRBM": 0.77, "UNKNOWN": 0.1},
    }
    evidence = evidence_of(
        [stub_sensor("A", confusion=confusion), stub_sensor("B", confusion=confusion), stub_sensor()]
    )
    unknown = REPORTED_TYPES.index("UNKNOWN")
    told = type_posterior(np.array([[0, -1, -1], [0, 0, 2], [-1, unknown, -1]]), evidence)
    assert told[0] == pytest.approx(np.array([0.8, 0.12, 0.03, 0.0]) / 0.95)
    assert told[1] == pytest.approx(np.array([0.64, 0.0144, 0.0009, 0.0]) / 0.6553)
    assert told[2].tolist() == [0.0, 0.0, 0.0, 1.0]
