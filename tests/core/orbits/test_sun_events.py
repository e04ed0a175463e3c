"""Eclipses and outages: directions of a geostationary field, shares of it, and what never meets the
Sun.
"""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from opir_testing import stub_sensor

from opir_core.geometry import is_sunlit, nadir_angle_rad, sun_ecef_m
from opir_core.orbits import (
    CircularConfig,
    OrbitConfig,
    eclipse_intervals,
    orbit_of,
    outage_intervals,
)
from opir_core.orbits.sun_events import cap_overlap_sr

EQUINOX = np.datetime64("2026-03-20T12:00:00")
DAY_S = 86400.0


def geostationary(slot_deg=0.0, exclusion_deg=5.0, field_deg=10.0):
    return stub_sensor(
        slot_deg=slot_deg,
        field_of_regard_half_angle_rad=np.radians(field_deg),
        solar_exclusion_rad=np.radians(exclusion_deg),
    )


def test_around_midnight_the_sun_is_in_the_west_then_in_the_east():
    """Before midnight the Sun has not set far enough: it stands beyond the limb where the day
    ended, in the west.
    """
    outages = outage_intervals(geostationary(), EQUINOX, 0.0, DAY_S)
    eclipse = eclipse_intervals(geostationary().orbit, EQUINOX, 0.0, DAY_S)
    evening, morning = np.degrees(outages.azimuth_rad)
    assert evening == pytest.approx(270.0, abs=4.0)
    assert morning == pytest.approx(90.0, abs=4.0)
    # 15 degrees from nadir is an hour from midnight, whose time the equation of time moves by seven
    # minutes.
    assert outages.start_s[0] == pytest.approx(11.1 * 3600.0, abs=200.0)
    assert outages.stop_s[1] == pytest.approx(13.1 * 3600.0, abs=200.0)
    # The gap is the umbra, at most 70 minutes at geostationary distance.
    assert outages.stop_s[0] == pytest.approx(eclipse.umbra_start_s[0], abs=0.01)
    assert outages.start_s[1] == pytest.approx(eclipse.umbra_stop_s[0], abs=0.01)
    assert 66.0 * 60.0 < eclipse.umbra_stop_s[0] - eclipse.umbra_start_s[0] < 70.0 * 60.0
    assert 2.0 * 60.0 < eclipse.umbra_start_s[0] - eclipse.start_s[0] < 2.5 * 60.0


@pytest.mark.parametrize(
    ("epoch", "azimuth_deg"), [("2026-08-28T12:00:00", 0.0), ("2026-02-14T12:00:00", 180.0)]
)
def test_the_sun_is_north_in_august_and_south_in_february(epoch, azimuth_deg):
    outages = outage_intervals(geostationary(), epoch, 0.0, DAY_S)
    middle = 0.5 * (outages.start_s[0] + outages.stop_s[0])
    at_middle = outage_intervals(geostationary(), epoch, middle - 1.0, middle + 1.0)
    turn_deg = np.degrees(at_middle.azimuth_rad[0, 0]) - azimuth_deg
    assert (turn_deg + 180.0) % 360.0 == pytest.approx(180.0, abs=8.0)


def test_no_exclusion_angle_and_no_time_mean_no_outage():
    assert len(outage_intervals(geostationary(exclusion_deg=0.0), EQUINOX, 0.0, DAY_S).start_s) == 0
    outages = outage_intervals(geostationary(), EQUINOX, 100.0, 100.0)
    assert outages.azimuth_rad.shape == (0, 2)
    assert len(outages.share) == 0
    assert len(outage_intervals(geostationary(), "2026-06-21T00:00:00", 0.0, DAY_S).start_s) == 0


@pytest.mark.parametrize(
    ("altitude_km", "inclination_deg"), [(500.0, 97.4), (1200.0, 60.0), (2000.0, 0.0)]
)
def test_outages_are_the_moments_with_the_sun_near_and_in_view(altitude_km, inclination_deg):
    config = CircularConfig(
        altitude_km=altitude_km, inclination_deg=inclination_deg, lon_asc_node_deg=30.0
    )
    epoch_us = int(EQUINOX.astype("datetime64[us]").astype(np.int64))
    sensor = stub_sensor(
        orbit=orbit_of(OrbitConfig(circular=config), epoch_us),
        field_of_regard_half_angle_rad=1.2,
        solar_exclusion_rad=0.1,
    )
    outages = outage_intervals(sensor, EQUINOX, 0.0, DAY_S)
    time_s = np.random.default_rng(5).uniform(0.0, DAY_S, 20_000)
    inside = np.any(
        (time_s[:, None] > outages.start_s) & (time_s[:, None] < outages.stop_s), axis=1
    )
    position = sensor.orbit.position_ecef_m(time_s)
    sun = sun_ecef_m(time_s, epoch_us)
    expected = (nadir_angle_rad(position, sun) < 1.3) & is_sunlit(position, sun)
    edges = np.concatenate([outages.start_s, outages.stop_s])
    clear = np.min(np.abs(time_s[:, None] - edges), axis=1) > 0.01
    assert 0 < np.count_nonzero(inside) < len(time_s)
    assert np.array_equal(inside[clear], expected[clear])


@given(st.floats(0.02, 3.1), st.floats(0.02, 3.1), st.floats(0.0, np.pi))
@example(3.0, 3.0, 5e-324)
def test_the_overlap_of_cones_is_a_share_of_both(a_rad, b_rad, separation):
    overlap = float(cap_overlap_sr(a_rad, b_rad, separation))
    areas = 4.0 * np.pi * np.sin(0.5 * np.array([a_rad, b_rad])) ** 2
    assert -1e-6 <= overlap <= areas.min() + 1e-6
    assert float(cap_overlap_sr(b_rad, a_rad, separation)) == pytest.approx(overlap, abs=1e-6)
    # What a cone shares with another and with the remaining sphere is the cone.
    remainder = float(cap_overlap_sr(a_rad, np.pi - b_rad, np.pi - separation))
    assert overlap + remainder == pytest.approx(areas[0], abs=1e-6)


@pytest.mark.parametrize(
    ("a_rad", "b_rad", "separation"),
    [(0.17, 0.087, 0.2), (1.9, 0.3, 1.8), (0.5, 0.5, 0.1), (2.5, 2.0, 1.5)],
)
def test_the_overlap_of_cones_is_that_counted(a_rad, b_rad, separation):
    rng = np.random.default_rng(11)
    directions = rng.normal(size=(400_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    axis = np.array([np.sin(separation), 0.0, np.cos(separation)])
    common = (directions[:, 2] > np.cos(a_rad)) & (directions @ axis > np.cos(b_rad))
    share = np.mean(common)
    sigma = 4.0 * np.pi * np.sqrt(share * (1.0 - share) / len(common))
    overlap = float(cap_overlap_sr(a_rad, b_rad, separation))
    assert overlap == pytest.approx(4.0 * np.pi * share, abs=4.5 * sigma)
