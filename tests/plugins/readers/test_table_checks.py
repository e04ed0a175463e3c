"""A table that contradicts itself, or its scene, is refused or reported: line, figure, cause, way
out.
"""

from functools import cache

import numpy as np
import pytest
from attrs import evolve
from opir_readers.table_checks import SceneTimes, findings_of
from opir_readers.velocity_checks import velocity_slip
from read_files import EPOCH_US, read
from repository import DATA
from scipy.integrate import solve_ivp

from opir_core.geometry import local_axes
from opir_core.plugin import BadFileError, StateTable

TURN = np.array([0.0, 0.0, 7.292115e-5])
SCENE = SceneTimes(EPOCH_US, 600.0)

#: How a table of text would name the velocities.
NAMES = {"vx_ecef": "VX", "vy_ecef": "VY", "vz_ecef": "VZ"}


def doubts_about(table, times, start_s):
    """Return the warnings about a table; raise what it is refused for."""
    findings = findings_of(table, times, start_s)
    if findings.refused:
        raise BadFileError(*findings.refused)
    return list(findings.warnings)


@cache
def flight(latitude, azimuth, stages):
    """Return a burn that tilts over, integrated here, as a function of time: stages of (seconds,
    m/s² at their end).
    """
    lat, lon = np.radians([latitude, -120.6])
    up = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    along = np.cos(np.radians(azimuth)) * np.cross(up, east) + np.sin(np.radians(azimuth)) * east
    ends = np.cumsum([seconds for seconds, _ in stages])

    def push(time_s):
        stage = min(int(np.searchsorted(ends, time_s)), len(stages) - 1)
        return stages[stage][1] * (
            0.5 + 0.5 * (time_s - ends[stage] + stages[stage][0]) / stages[stage][0]
        )

    def rate(time_s, state):
        r = state[:3]
        v = state[3:]
        tilt = np.radians(min(60.0, 0.6 * time_s))
        gravity = -3.986004418e14 * r / np.linalg.norm(r) ** 3
        thrust = push(time_s) * (np.cos(tilt) * up + np.sin(tilt) * along) + 9.8 * up * (
            time_s < 60.0
        )
        return np.concatenate(
            [v, gravity + thrust - 2.0 * np.cross(TURN, v) - np.cross(TURN, np.cross(TURN, r))]
        )

    start = [*(6.379e6 * up), 0.0, 0.0, 0.0]
    return solve_ivp(
        rate, (0.0, ends[-1]), start, dense_output=True, rtol=1e-8, max_step=2.0
    ).sol, ends[-1]


def boost(step_s, *, latitude=34.7, azimuth=250.0, stages=((60.0, 20.0), (70.0, 30.0)), decimals=3):
    """Return the table of a burn, sampled and rounded."""
    state, end_s = flight(latitude, azimuth, stages)
    time_s = np.arange(0.0, end_s, step_s)
    position, velocity = np.round(state(time_s).T, decimals).reshape(-1, 2, 3).transpose(1, 0, 2)
    run = np.zeros(len(time_s), np.intp)
    burn = np.array([[0.0, time_s[-1]]])
    return StateTable(time_s, position, velocity, run, burn, lambda row: row + 2, (), NAMES)


def towards(table, *places, signs=(1.0, 1.0, 1.0)):
    """Return velocities towards local axes: 0 is east, 1 north, 2 up."""
    axes = local_axes(table.position_m)
    columns = [
        sign * (table.velocity_m_s * axes[:, place]).sum(axis=1)
        for place, sign in zip(places, signs, strict=True)
    ]
    return np.stack(columns, axis=1)


def inertial(table):
    return table.velocity_m_s + np.cross(TURN, table.position_m)


SLIPS = {
    "inertial": (inertial, "inertial", "vx_inertial_m_s: VX"),
    "km/s": (lambda t: t.velocity_m_s / 1e3, "in km/s", "vx_ecef_km_s: VX"),
    "ft/s": (lambda t: t.velocity_m_s / 0.3048, "in ft/s", "vx_ecef_ft_s: VX"),
    "knots": (lambda t: t.velocity_m_s / 0.514444, "in knots", "vx_ecef_kn: VX"),
    "inertial km/s": (
        lambda t: inertial(t) / 1e3,
        "inertial (with the Earth's rotation) and in km/s",
        "vx_inertial_km_s: VX",
    ),
    "rotation twice": (
        lambda t: 2.0 * t.velocity_m_s - inertial(t),
        "rotation twice over",
        "",
    ),
    "local": (
        lambda t: towards(t, 0, 1, 2),
        "towards east, north and up",
        "v_east_m_s: VX",
    ),
    "north, east, down": (
        lambda t: towards(t, 1, 0, 2, signs=(1.0, 1.0, -1.0)),
        "towards north, east and down",
        "",
    ),
    "sign": (lambda t: -t.velocity_m_s, "of the wrong sign", ""),
    "swapped": (lambda t: t.velocity_m_s[:, [1, 0, 2]], "axes in another order", ""),
    "one axis": (
        lambda t: t.velocity_m_s * [1.0, -1.0, 1.0],
        "axes in another order or sign (vx, -vy, vz",
        "",
    ),
    "a line late": (
        lambda t: np.vstack([t.velocity_m_s[:1], t.velocity_m_s[:-1]]),
        "of the line above",
        "",
    ),
    "a line early": (
        lambda t: np.vstack([t.velocity_m_s[1:], t.velocity_m_s[-1:]]),
        "of the line below",
        "",
    ),
}


@pytest.mark.parametrize("step_s", [0.1, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_of_velocities_is_reported_with_its_cause(slip, step_s):
    table = boost(step_s)
    wrong, cause, remedy = SLIPS[slip]
    report = velocity_slip(evolve(table, velocity_m_s=wrong(table)))
    assert report is not None
    assert cause in report.cause
    assert remedy in report.remedy
    assert report.is_systematic
    assert velocity_slip(table) is None


@pytest.mark.parametrize("slip", [name for name in SLIPS if "line" not in name])
def test_slips_at_steps_of_half_a_minute_are_reported(slip):
    table = boost(30.0, stages=((150.0, 20.0), (200.0, 25.0)))
    report = velocity_slip(evolve(table, velocity_m_s=SLIPS[slip][0](table)))
    assert report is not None
    assert SLIPS[slip][1] in report.cause
    assert velocity_slip(table) is None


@pytest.mark.parametrize("lag_s", [1.0, -2.0])
def test_velocities_of_another_time_are_reported_with_the_lag(lag_s):
    table = boost(0.5)
    columns = [np.interp(table.time_s - lag_s, table.time_s, axis) for axis in table.velocity_m_s.T]
    report = velocity_slip(evolve(table, velocity_m_s=np.stack(columns, axis=1)))
    assert f"of a time {abs(lag_s):g} s {'earlier' if lag_s > 0 else 'later'}" in report.cause


@pytest.mark.parametrize("step_s", [0.1, 0.3, 1.0, 3.0, 10.0, 30.0])
@pytest.mark.parametrize("decimals", [0, 3])
@pytest.mark.parametrize("seed", range(4))
def test_true_velocities_raise_no_alarm(step_s, decimals, seed):
    """Drawn boosts, at any step, positions to a metre and velocities with an error of a few m/s
    that drifts.
    """
    rng = np.random.default_rng(seed)
    stages = tuple(
        (float(rng.uniform(45.0, 120.0)), float(rng.uniform(15.0, 60.0)))
        for _ in range(rng.integers(1, 4))
    )
    place = {"latitude": float(rng.uniform(-80.0, 80.0)), "azimuth": float(rng.uniform(0.0, 360.0))}
    table = boost(step_s, stages=stages, decimals=decimals, **place)
    drift = 3.0 * np.sin(table.time_s[:, None] / 17.0 + rng.uniform(0.0, 6.0, 3))
    table = evolve(table, velocity_m_s=table.velocity_m_s + drift)
    assert velocity_slip(table) is None
    assert doubts_about(table, SCENE, 0.0) == []


FOREIGN = sorted((DATA / "flights").glob("*.csv"))


@pytest.mark.parametrize("file", FOREIGN, ids=lambda file: file.stem)
def test_flights_of_others_raise_no_alarm(file):
    table = read("csv", file.read_text(encoding="utf-8"))
    assert doubts_about(table, SceneTimes(EPOCH_US, 4000.0), 0.0) == []


def test_one_wrong_velocity_is_reported_with_its_line():
    table = boost(1.0)
    velocity = table.velocity_m_s.copy()
    velocity[40] += [0.0, 900.0, 0.0]
    doubt, *flown = doubts_about(evolve(table, velocity_m_s=velocity), SCENE, 0.0)
    assert doubt.startswith(
        "line 42: its velocity is 900 m/s off the change of the positions around it; is it a"
    )
    assert all("the path turns with" in words for words in flown)


def test_a_message_names_line_figure_cause_and_way_out():
    table = boost(1.0)
    with pytest.raises(BadFileError) as refused:
        doubts_about(evolve(table, velocity_m_s=SLIPS["inertial"][0](table)), SCENE, 0.0)
    text = str(refused.value)
    assert text == (
        "line 130: its velocity is 389 m/s off the change of the positions around it; all look"
        " inertial (with the Earth's rotation): so read, they agree to 0.04 m/s; set columns:"
        " {vx_inertial_m_s: VX, vy_inertial_m_s: VY, vz_inertial_m_s: VZ}, or leave the velocities"
        " out: positions are enough"
    )


def test_velocities_for_which_no_cause_is_known_are_refused():
    table = boost(1.0)
    noise = np.random.default_rng(1).normal(0.0, 3000.0, table.velocity_m_s.shape)
    with pytest.raises(BadFileError, match="for none of the usual causes"):
        doubts_about(evolve(table, velocity_m_s=noise), SCENE, 0.0)


FIRST = (
    "they look like Unix seconds: the first is 2026-04-01T12:00:00Z, 0 s after the scene's start;"
    " subtract"
)


@pytest.mark.parametrize(
    ("offset", "reported"),
    [
        (1_775_044_800.0, f"{FIRST} 1775044800 from them, or set start_s: -1775044800"),
        (1_775_044_860.0, "subtract 1775044860 from them, or set start_s: -1775044800"),
        (1_775_044_800_000.0, "they look like Unix milliseconds"),
        (1_459_080_018.0, "they look like GPS seconds: the first is 2026-04-01T12:00:00Z"),
        (2_461_132.0, "they look like days of a Julian date: the first is 2026-04-01T12:00:00Z"),
        (61_131.5, "they look like days of a modified Julian date"),
        (43_200.0, "they look like seconds of the day: the first is 2026-04-01T12:00:00Z"),
        (1_675_044_800.0, "(2023-01-30T02:13:20Z if they are Unix seconds): set start_s"),
        (9_000.0, "times count from start_s of the scene: set start_s, or a longer duration_s"),
        (-9_000.0, "times count from start_s of the scene"),
    ],
)
def test_times_of_another_scale_are_reported(offset, reported):
    table = boost(1.0)
    with pytest.raises(BadFileError) as refused:
        doubts_about(evolve(table, time_s=table.time_s + offset), SCENE, 0.0)
    assert reported in str(refused.value)


def test_all_reasons_are_reported_at_once():
    table = boost(1.0)
    wrong = evolve(table, time_s=table.time_s + 1_775_044_800.0, velocity_m_s=-table.velocity_m_s)
    times, velocities = findings_of(wrong, SCENE, 0.0).refused
    assert "Unix seconds" in times
    assert "all look of the wrong sign" in velocities


def test_an_ephemeris_of_another_day_is_reported():
    table = boost(1.0)
    with pytest.raises(BadFileError) as refused:
        doubts_about(evolve(table, time_s=table.time_s + 86400.0), SCENE, None)
    assert (
        "line 2: its states, 2026-04-02T12:00:00Z to 2026-04-02T12:02:09Z, and the scene,"
        " 2026-04-01T12:00:00Z to 2026-04-01T12:10:00Z, have no time in common"
        in str(refused.value)
    )


@pytest.mark.parametrize(
    ("change", "reported"),
    [
        (
            lambda t: evolve(t, time_s=t.time_s * 1e-1, velocity_m_s=None),
            "m/s, faster than what leaves the Earth",
        ),
        (
            lambda t: evolve(t, time_s=t.time_s * 1e-3, velocity_m_s=None),
            "are times or lengths in other units?",
        ),
        (
            lambda t: evolve(
                t, position_m=t.position_m[:1] + 0.0 * t.position_m, velocity_m_s=None
            ),
            "nothing moves faster than 0 m/s",
        ),
        (
            lambda t: evolve(t, position_m=np.round(t.position_m, -3), velocity_m_s=None),
            "the path turns with",
        ),
        (
            lambda t: evolve(t, position_m=np.round(t.position_m, -2), velocity_m_s=None),
            "the path turns with",
        ),
        (
            lambda t: evolve(t, position_m=t.position_m - [0.0, 0.0, 2e4], velocity_m_s=None),
            "below the WGS 84 ellipsoid",
        ),
    ],
)
def test_motion_that_no_launch_has_is_reported(change, reported):
    assert any(reported in doubt for doubt in doubts_about(change(boost(1.0)), SCENE, 0.0))


def test_a_state_out_of_line_is_reported_where_it_is():
    table = boost(1.0)
    place = table.position_m.copy()
    place[50] += [0.0, 0.0, 2000.0]
    (doubt,) = doubts_about(evolve(table, position_m=place, velocity_m_s=None), SCENE, 0.0)
    assert doubt.startswith("line 52: the path turns with 4163 m/s² there, 425 g; a wrong state")
