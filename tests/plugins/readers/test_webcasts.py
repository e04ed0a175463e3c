"""Telemetry of webcasts: speed and altitude alone give the flight back along its azimuth, and its
burns.
"""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from opir_readers.flights.smoothing import rounding_sigma, smoothing_spline, speed_rounding_sigma
from pyproj import Geod
from read_files import read, recognised, refusal
from scipy.integrate import solve_ivp

from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes

OMEGA = 7.292115e-5
MU = 3.986004418e14
RADIUS = 6_371_000.0
SITE = {"lat_deg": 28.5, "lon_deg": -80.6, "height_m": 5.0, "azimuth_deg": 60.0}
PAD_M = geodetic_to_ecef(*np.radians([28.5, -80.6]), 5.0)
AXES = local_axes(PAD_M[None])[0]
BURNS = [(0.0, 150.0), (162.0, 420.0)]


def states():
    """Return times, ECEF positions and velocities over the Earth of a drag-free ascent with two
    burns, by scipy.

    Thrust is along a direction in the vertical plane of the azimuth, so that nothing but gravity
    and the rotation of the Earth acts across it.
    """
    along = math.sin(math.radians(60.0)) * AXES[0] + math.cos(math.radians(60.0)) * AXES[1]
    omega = np.array([0.0, 0.0, OMEGA])

    def rates(time, state):
        place = state[:3]
        velocity = state[3:]
        up = place / np.linalg.norm(place)
        level = along - up * (along @ up)
        level /= np.linalg.norm(level)
        pitch = max(math.radians(90.0 - 0.55 * max(time - 10.0, 0.0)), math.radians(8.0))
        thrust = 22.0 if time < 150.0 else 14.0 if 162.0 <= time < 420.0 else 0.0
        # Above the pad the direction of flight takes over, as a launcher without yaw steering does.
        flat = velocity - up * (velocity @ up)
        if np.linalg.norm(flat) > 200.0:
            level = flat / np.linalg.norm(flat)
        force = thrust * (math.cos(pitch) * level + math.sin(pitch) * up)
        turning = -2.0 * np.cross(omega, velocity) - np.cross(omega, np.cross(omega, place))
        return [*velocity, *(force - MU * place / np.linalg.norm(place) ** 3 + turning)]

    times = np.arange(0.0, 431.0)
    start = [*PAD_M, 0, 0, 0]
    flight = solve_ivp(rates, (0.0, 430.0), start, t_eval=times, rtol=1e-9, atol=1e-6, max_step=0.5)
    return times, flight.y[:3].T, flight.y[3:].T


@pytest.fixture(scope="module")
def ascent():
    return states()


def telemetry(ascent, form="lines", is_rounded=True):
    times, place, velocity = ascent
    height = ecef_to_geodetic(place).height_m - SITE["height_m"]
    speed = np.linalg.norm(velocity, axis=1)
    if is_rounded:
        speed = np.round(speed * 3.6) / 3.6
        height = np.round(height, -2)
    rows = [
        {"time": t, "velocity": round(v, 3), "altitude": round(h / 1e3, 4)}
        for t, v, h in zip(times.tolist(), speed.tolist(), height.tolist(), strict=True)
    ]
    if form == "lines":
        return "\n".join(map(json.dumps, rows))
    if form == "arrays":
        return json.dumps({name: [row[name] for row in rows] for name in rows[0]})
    if form == "list":
        return json.dumps({"stages": [{"stage": 1, "telemetry": rows}]})
    head = "time,speed_km_h,altitude_km"
    return "\n".join(
        [head, *(f"{row['time']},{row['velocity'] * 3.6:.0f},{row['altitude']}" for row in rows)]
    )


def flight_of(text, **settings):
    return read("webcast", text, site=SITE, **settings)


@pytest.mark.parametrize("form", ["lines", "arrays", "list", "csv"])
def test_the_flight_is_that_of_the_telemetry(ascent, form):
    text = telemetry(ascent, form)
    assert recognised(text) == ["webcast"]
    table = flight_of(text, start_s=50.0)
    times, place, velocity = ascent
    rows = np.searchsorted(table.time_s, times[::10] + 50.0)
    off = np.linalg.norm(table.position_m[rows] - place[::10], axis=1)
    # Rounding to 0.1 km and 1 km/h, and the azimuth of a path that is prescribed: a kilometre a
    # minute of flight.
    assert (off < 300.0 + 15.0 * times[::10]).all(), off
    error_m_s = np.linalg.norm(table.velocity_m_s[rows] - velocity[::10], axis=1)[3:]
    assert np.median(error_m_s) < 30.0


def test_the_turn_by_the_rotation_of_the_earth_matters(ascent):
    # Along the geodesic of the azimuth it would end ten times as far off as it does.
    times, place, _ = ascent
    where = ecef_to_geodetic(place[-1:])
    azimuth, _, distance = Geod(ellps="WGS84").inv(
        -80.6, 28.5, *np.degrees([where.longitude_rad[0], where.latitude_rad[0]])
    )
    straight = math.radians(abs(azimuth - 60.0)) * distance
    text = telemetry(ascent, is_rounded=False)
    table = flight_of(text)
    assert straight > 3.0 * np.linalg.norm(table.position_m[-1] - place[-1])
    assert times[-1] == table.time_s[-1]


def test_burns_are_those_of_the_speed_and_those_of_events(ascent):
    text = telemetry(ascent)
    table = flight_of(text)
    assert table.burns_s.shape == (2, 2)
    np.testing.assert_allclose(table.burns_s, BURNS, rtol=0.0, atol=4.0)
    assert table.burns_s[:, 1] == pytest.approx([150.0, 420.0], abs=2.0)
    events = json.dumps({"meco": 150, "ses1": 162, "seco1": 420, "boostback_start": None})
    reported = flight_of(f"{text}\n{events}", start_s=10.0)
    np.testing.assert_allclose(reported.burns_s, np.array(BURNS) + 10.0)


def test_a_display_of_three_digits_is_smooth_above_a_hundred_kilometres(ascent):
    """Of its steps of a kilometre no spline makes accelerations that the flight does not have."""
    times, _, velocity = ascent
    rows = json.loads(telemetry(ascent, "arrays", is_rounded=False))
    rows["altitude"] = [round(h, 1 if h < 100.0 else 0) for h in rows["altitude"]]
    table = flight_of(json.dumps(rows))
    assert "a noise of 50 to 289 m" in table.notes[1]
    late_s = np.arange(220.0, 400.0)
    flown, read_back = (
        np.linalg.norm(np.gradient(states[np.searchsorted(moments, late_s)], axis=0), axis=1)
        for moments, states in ((times, velocity), (table.time_s, table.velocity_m_s))
    )
    assert np.abs(read_back - flown).mean() < 3.0


def test_what_the_splines_leave_is_reported(ascent):
    table = flight_of(telemetry(ascent))
    assert table.notes[0].startswith("speed smoothed to a noise of 0.0802 m/s: 0.0")
    assert table.notes[1].startswith("altitude smoothed to a noise of 50 m: ")


def test_misread_digits_are_left_out(ascent):
    rows = telemetry(ascent).split("\n")
    wrong = json.loads(rows[200])
    wrong["velocity"] += 1000.0
    rows[200] = json.dumps(wrong)
    table = flight_of("\n".join(rows))
    assert "1 left out" in table.notes[0]
    clean = flight_of(telemetry(ascent))
    assert np.abs(table.position_m - clean.position_m).max() < 200.0


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ('{"time": 1, "velocity": 2, "altitude": 3}', "has 1 rows"),
        ('{"time": [1], "velocity": "x", "altitude": 3}', "has 0 rows"),
        ('{"velocity": 1, "altitude": }', "line 1: is not JSON"),
        (
            json.dumps({"time": [*range(29), 10_000], "velocity": [1] * 30, "altitude": [1] * 30}),
            "30 rows over 10000 s",
        ),
        (
            "time,velocity,altitude\n" + "\n".join(f"{t},{t * 1e6},1" for t in range(30)),
            "check the units",
        ),
    ],
)
def test_what_is_no_telemetry_is_reported(text, reported):
    assert reported in refusal("webcast", text, site=SITE)


def test_a_site_with_azimuth_is_asked_for():
    reason = refusal("webcast", '{"time": 1, "velocity": 2, "altitude": 3}')
    assert "speed and altitude alone have no place: set site" in reason


def test_other_json_and_tables_with_places_are_no_webcasts():
    assert "webcast" not in recognised('{"time": 1, "lat": 2}')
    assert "webcast" not in recognised("time,velocity,altitude,latitude\n")
    assert "webcast" in recognised("time,velocity,altitude\n")


def written(time_s, position_m, names="", *columns):
    """Write a table of positions, and of further columns by their names; return its path."""
    values = np.column_stack([time_s, position_m, *columns]).tolist()
    rows = [",".join(map(repr, row)) for row in values]
    Path("flight.csv").write_text("\n".join([f"time_s,x_ecef_m,y_ecef_m,z_ecef_m{names}", *rows]))
    return "flight.csv"


def test_noise_of_a_table_is_smoothed_to_what_is_stated(imported):
    rng = np.random.default_rng(1)
    time = np.arange(0.0, 120.0, 0.5)
    height = 100.0 + 12.0 * time**2
    place = geodetic_to_ecef(np.full(240, 0.5), np.full(240, -1.4), height)
    noisy = place + rng.normal(0.0, 15.0, place.shape)
    out = imported(written(time, noisy), "--noise-m", "15", "--out", "out.csv")
    smooth = np.loadtxt("out.csv", delimiter=",", skiprows=1)
    noisy_m, smooth_m = (np.sqrt(((p - place) ** 2).mean()) for p in (noisy, smooth[:, 1:4]))
    assert smooth_m < 0.5 * noisy_m
    residual = float(re.search(r"smoothed to a noise of 15 m: (\S+) m rms", out)[1])
    assert residual == pytest.approx(15.0, rel=0.1)
    speed = np.linalg.norm(smooth[:, 4:7], axis=1)[20:-20]
    np.testing.assert_allclose(speed, 24.0 * time[20:-20], rtol=0.0, atol=30.0)


def test_a_flight_without_thrust_shows_no_burn(imported):
    time = np.arange(0.0, 60.0)
    height = 200e3 + 800.0 * time - 0.5 * 9.2 * time**2
    place = geodetic_to_ecef(np.full(60, 0.5), np.full(60, -1.4), height)
    path = written(time, place)
    assert "shows no acceleration" in imported(path, "--burns", "acceleration", code=2)


def test_burns_of_all_and_by_acceleration_of_any_table(ascent, imported):
    times, place, velocity = ascent
    is_burning = (times >= 5.0) & (times < 6.0)
    names = ",vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"
    path = written(times, place, names, velocity, is_burning)
    assert "  burns 5 s to 6 s\n" in imported(path)
    assert "  burns 0 s to 430 s\n" in imported(path, "--burns", "all")
    out = imported(path, "--burns", "acceleration")
    line = next(line for line in out.splitlines() if line.startswith("  burns"))
    burns = np.array(re.findall(r"[\d.]+", line), dtype=np.float64).reshape(-1, 2)
    np.testing.assert_allclose(burns, BURNS, rtol=0.0, atol=2.0)


def test_a_smoothing_spline_has_the_noise_that_is_stated():
    rng = np.random.default_rng(2)
    time = np.linspace(0.0, 10.0, 400)
    values = np.sin(time) + rng.normal(0.0, 0.1, 400)
    fit = smoothing_spline(time, values, 0.1)
    assert fit.residual == pytest.approx(0.1, rel=0.05)
    assert np.abs(fit.at(time) - np.sin(time)).max() < 0.1


def test_noise_of_rounding_is_that_of_its_step():
    """A step over the square root of 12; speeds may be whole km/h in m/s."""
    assert rounding_sigma(np.array([0.1, 0.2, 0.7, 1.2])) == pytest.approx(0.1 / 12**0.5)
    assert rounding_sigma(np.sqrt([2.0, 3.0, 5.0, 70.0])) == pytest.approx(0.0)
    digits = np.array([0.0, 0.4, 0.9, 1.0, 7.3, 12.5, 12.6, 99.9, 101.0, 103.0, 104.0, 170.0])
    steps = np.where(digits < 100.0, 0.1, 1.0)
    np.testing.assert_allclose(rounding_sigma(digits), steps / 12**0.5)
    # Three altitudes above 100 km whose differences are those of the flight, multiples of 7 km.
    few = np.array([0.1, 0.2, 50.3, 99.9, 105.0, 112.0, 119.0])
    np.testing.assert_allclose(rounding_sigma(few)[-3:], 1.0 / 12**0.5)
    speed_m_s = np.array([0.0, 0.277, 0.555, 7.222])
    assert speed_rounding_sigma(speed_m_s) == pytest.approx(1 / 3.6 / 12**0.5)


def test_places_from_a_launch_point_in_a_table():
    text = "time_s,east_m,north_m,up_m\n0,0,0,0\n1,3,4,100\n"
    table = read("csv", text, site=SITE)
    np.testing.assert_allclose(table.position_m[0], PAD_M, atol=1e-6)
    local = (table.position_m[1] - table.position_m[0]) @ AXES.T
    np.testing.assert_allclose(local, [3.0, 4.0, 100.0], atol=1e-6)
    flat = read("csv", "time_s,downrange_km,altitude_km\n0,0,0\n60,30,20\n", site=SITE)
    lon, lat, _ = Geod(ellps="WGS84").fwd(-80.6, 28.5, 60.0, 30_000.0)
    np.testing.assert_allclose(
        flat.position_m[1], geodetic_to_ecef(*np.radians([lat, lon]), 20_005.0), atol=1e-3
    )
    assert "set site" in refusal("csv", text)
    text = "time_s,downrange_km,height_km\n0,0,0\n60,30,20\n"
    reason = refusal("csv", text, site={"lat_deg": 1.0, "lon_deg": 2.0})
    assert "set site.azimuth_deg" in reason


@pytest.mark.parametrize("name", ["time", "velocity", "altitude", "meco"])
def test_a_number_beyond_the_largest_is_none(name):
    rows = [{"time": t, "velocity": 20 * t, "altitude": t * t / 100} for t in range(30)]
    rows[9][name] = 10**400
    table = flight_of("\n".join(map(json.dumps, rows)))
    assert np.isfinite(table.position_m).all()
    assert table.burns_s[0, 1] <= table.time_s[-1]


def with_speeds_in(ascent, metres_a_second):
    """Return telemetry whose speeds, in another unit, are taken for m/s."""
    rows = [json.loads(line) for line in telemetry(ascent).split("\n")]
    for row in rows:
        row["velocity"] = round(row["velocity"] / metres_a_second)
    return "\n".join(map(json.dumps, rows))


@pytest.mark.parametrize(
    ("unit", "metres_a_second"), [("km/h", 1 / 3.6), ("mph", 0.44704), ("ft/s", 0.3048)]
)
def test_speeds_in_other_units_are_refused_by_name(ascent, unit, metres_a_second):
    words = refusal("webcast", with_speeds_in(ascent, metres_a_second), site=SITE)
    assert "speeds" in words
    assert unit in words


def suborbital(metres_a_second, sideways_m_s=0.0):
    """Return telemetry of 70 s of thrust and a coast, that of a vertical flight in closed form.

    Thrust is 20 m/s² beyond gravity, which is that of a sphere in the coast.
    """
    start = [0.0, 0.0]
    found = solve_ivp(
        lambda t, s: [s[1], 20.0 if t < 70.0 else -MU / (RADIUS + s[0]) ** 2],
        (0.0, 240.0),
        start,
        t_eval=np.arange(0.0, 240.5, 1.0),
        max_step=0.5,
        rtol=1e-9,
    )
    height, climb = found.y
    rows = zip(found.t.tolist(), climb.tolist(), height.tolist(), strict=True)
    return "\n".join(
        json.dumps(
            {
                "time": time,
                "velocity": round(math.hypot(speed, sideways_m_s) / metres_a_second),
                "altitude": round(up / 1e3, 1),
            }
        )
        for time, speed, up in rows
    )


def test_a_coast_names_the_unit_of_speeds():
    words = refusal("webcast", suborbital(1 / 3.6), site=SITE)
    assert re.search(r"in km/h, \d\d % .* multiply them by 0.277778", words)
    assert len(flight_of(suborbital(1.0)).time_s) == 241


def test_speeds_with_the_earths_rotation_are_named():
    burn = suborbital(1.0, 408.0).split("\n")[:70]
    words = refusal("webcast", "\n".join(burn), site=SITE)
    assert "408 m/s on the pad: do they contain the Earth's rotation?" in words
