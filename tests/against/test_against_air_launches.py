"""Air launches against closed forms: the state at ignition, the pull-up, the constant climb, the
speed, and the fall of another integrator.
"""

import numpy as np
import pytest
from pyproj import Geod, Transformer
from scipy.integrate import quad, solve_ivp

import opir_core as opir
from opir_core.errors import OpirError
from opir_core.flight import boost_profile

GEOD = Geod(ellps="WGS84")
TO_GEODETIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
LAUNCH = {"lat_deg": 20.0, "lon_deg": 50.0, "height_m": 10_000.0, "time_s": 5.0}


def plan(launch=LAUNCH, **changes):
    target = {
        "id": "A1",
        "model": "air-launch",
        "type": "SRBM",
        "heading_deg": 60.0,
        "launch": launch,
    }
    return opir.compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "air",
                "epoch": "2026-04-01T12:00:00Z",
                "duration_s": 60.0,
                "sensors": [{"model": "generic-scanner", "id": "S1", "orbital_slot_deg": 50.0}],
                "targets": [{**target, **changes}],
            }
        )
    )


def positions(flown, times_s):
    rows = np.zeros(len(times_s), np.int32)
    return flown.targets.position_ecef_m(rows, np.asarray(times_s, float))


def states(flown, times_s, step_s=0.02):
    """Return heights, speeds and flight path angles at times, by differences."""
    times_s = np.asarray(times_s, float)
    place = positions(flown, times_s)
    velocity = (positions(flown, times_s + step_s) - positions(flown, times_s - step_s)) / (
        2 * step_s
    )
    east, north, height = TO_GEODETIC.transform(*place.T)
    latitude, longitude = np.radians(north), np.radians(east)
    up = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    speed = np.linalg.norm(velocity, axis=1)
    angle = np.degrees(np.arcsin(np.sum(velocity * up, axis=1) / speed))
    return height, speed, angle, (east, north)


def speed_m_s(elapsed_s, start=240.0):
    profile = boost_profile("SRBM")
    k = profile.speed_shape
    ratio = np.expm1(k * elapsed_s / profile.burn_time_s) / np.expm1(k)
    return start + profile.burnout_speed_m_s * ratio


def test_it_ignites_in_level_flight_and_speeds_up_as_its_class():
    flown = plan()
    first = positions(flown, [5.0])[0]
    east, north, height = TO_GEODETIC.transform(*first)
    assert (east, north) == pytest.approx((50.0, 20.0), abs=1e-9)
    assert height == pytest.approx(10_000.0, abs=1e-4)
    times_s = np.array([5.05, 20.0, 40.0, 69.9])
    _, speed, angle, places = states(flown, times_s)
    assert speed == pytest.approx(speed_m_s(times_s - 5.0), rel=1e-5)
    assert angle[0] == pytest.approx(0.0, abs=0.5)
    course = GEOD.inv(50.0, 20.0, places[0][1], places[1][1])[0]
    assert course == pytest.approx(60.0, abs=0.05)
    truth = flown.targets.truth()[0]
    assert truth["launch"] == {"lat_deg": 20.0, "lon_deg": 50.0, "height_m": 10_000.0}
    assert truth["burnout_s"] == pytest.approx(5.0 + boost_profile("SRBM").burn_time_s)


def test_it_pulls_up_with_its_acceleration_and_holds_its_climb():
    flown = plan(climb_deg=40.0, pull_m_s2=25.0)
    pull_s = 0.5 * np.pi * np.radians(40.0) * 240.0 / 25.0
    times_s = 5.0 + np.array([0.1, 0.5 * pull_s, pull_s + 1.0, 40.0])
    height, _, angle, _ = states(flown, times_s)
    turned = np.degrees(25.0 / 240.0) * 0.1
    assert angle[0] == pytest.approx(turned, rel=0.02)
    assert angle[1] == pytest.approx(40.0 * np.sin(0.25 * np.pi), abs=0.02)
    # The geodetic vertical differs from that of the launch plane by under a hundredth of a degree.
    assert angle[2:] == pytest.approx(40.0, abs=0.02)

    def climb(elapsed_s):
        share = min(elapsed_s / pull_s, 1.0)
        return speed_m_s(elapsed_s) * np.sin(np.radians(40.0) * np.sin(0.5 * np.pi * share))

    expected = quad(climb, 0.0, pull_s)[0] + quad(climb, pull_s, 40.0)[0]
    assert height[3] - 10_000.0 == pytest.approx(expected, rel=1e-3)


def test_it_comes_down_where_free_flight_leads():
    flown = plan(climb_deg=30.0)
    truth = flown.targets.truth()[0]
    burnout = truth["burnout"]
    assert truth["impact"]["height_m"] == pytest.approx(0.0, abs=1e-3)
    spin = np.array([0.0, 0.0, 7.292115e-5])

    def rates(_time, state):
        position, velocity = state[:3], state[3:]
        gravity = -3.986004418e14 / np.linalg.norm(position) ** 3 * position
        turning = -2.0 * np.cross(spin, velocity) - np.cross(spin, np.cross(spin, position))
        return np.concatenate([velocity, gravity + turning])

    def height(_time, state):
        return TO_GEODETIC.transform(*state[:3])[2]

    height.terminal = True
    start = [*burnout["position_ecef_m"], *burnout["velocity_ecef_m_s"]]
    fall = solve_ivp(rates, (0.0, 1000.0), start, events=height, rtol=1e-10, atol=1e-6)
    assert truth["impact"]["time_s"] - truth["burnout_s"] == pytest.approx(fall.t[-1], abs=1e-3)
    place = TO_GEODETIC.transform(*fall.y[:3, -1])
    impact = truth["impact"]
    assert GEOD.inv(*place[:2], impact["lon_deg"], impact["lat_deg"])[2] < 2.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"launch": {**LAUNCH, "height_m": 40_000.0}}, ["targets[0].launch.height_m", "30000"]),
        ({"speed_m_s": 3000.0}, ["targets[0].speed_m_s", "1500"]),
        ({"climb_deg": 0.0}, ["targets[0].climb_deg"]),
        ({"type": "SLV"}, ["targets[0].type", "SLV has the model orbit, not air-launch"]),
        ({"speed_gain_m_s": 9000.0}, ["targets[0].speed_gain_m_s"]),
        ({"aim": {"lat_deg": 0.0, "lon_deg": 0.0}}, ["targets[0]", "aim"]),
    ],
)
def test_bad_settings_are_refused_with_their_place(changes, words):
    with pytest.raises(OpirError) as caught:
        plan(**changes)
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_what_stays_in_orbit_is_refused_with_the_way_out():
    with pytest.raises(OpirError, match="does not come down within a day; lower speed_gain_m_s"):
        plan(
            launch={**LAUNCH, "height_m": 30_000.0},
            type="ICBM",
            climb_deg=5.0,
            speed_gain_m_s=7500.0,
            burn_time_s=900.0,
            speed_m_s=1500.0,
        )
