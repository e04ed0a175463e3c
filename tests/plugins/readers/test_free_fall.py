"""Tables whose states fall freely only if read otherwise are refused, with the slip and the remedy."""

import io
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from astropy.coordinates import EarthLocation
from scipy.integrate import solve_ivp

import opir_core as opir
from opir_core.simulation import plan_warnings

MU_M3_S2 = 3.986004418e14
EARTH_RAD_S = 7.292115e-5
MEAN_RADIUS_M = 6_371_000.0
EPOCH = "2026-04-01T12:00:00Z"
GEOSYNCHRONOUS_M = 42_164_172.0

Columns = Mapping[str, np.ndarray]


@cache
def suborbital() -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,), s, and inertial positions (n, 3), m, of a burn of 90 s and 180 s of free fall.

    The Earth is a sphere of the radius of the pad.
    """
    up = geodetic_place(34.7, -120.6, 0.0) / 6.371e6
    west = np.cross(up, [0.0, 0.0, 1.0]) / -np.hypot(*up[:2])
    place = 6_371_200.0 * up
    ground = np.cross([0.0, 0.0, EARTH_RAD_S], place)

    def rate(time_s: float, state: np.ndarray) -> np.ndarray:
        tilt = np.radians(0.5 * time_s)
        push = (15.0 + 0.25 * time_s) * (time_s < 90.0)
        gravity = -MU_M3_S2 * state[:3] / np.linalg.norm(state[:3]) ** 3
        return np.concatenate(
            [state[3:], gravity + push * (np.cos(tilt) * up + np.sin(tilt) * west)]
        )

    time_s = np.arange(0.0, 270.5, 0.5)
    flown = solve_ivp(rate, (0.0, 270.0), [*place, *ground], t_eval=time_s, max_step=0.5, rtol=1e-9)
    return time_s, flown.y[:3].T


def satellite(
    radius_m: float = 7.6e6,
    inclination_deg: float = 60.0,
    step_s: float = 60.0,
    sigma_m: float = 0.0,
    states: int = 40,
) -> tuple[np.ndarray, np.ndarray]:
    """Return times (n,), s, and inertial positions (n, 3), m, of a circular orbit, with noise."""
    time_s = step_s * np.arange(states)
    phase = np.sqrt(MU_M3_S2 / radius_m**3) * time_s
    tilt = np.radians(inclination_deg)
    across = np.sin(phase)
    place = np.stack([np.cos(phase), np.cos(tilt) * across, np.sin(tilt) * across], axis=1)
    return time_s, radius_m * place + sigma_m * noise(place)


def noise(place: np.ndarray) -> np.ndarray:
    return np.random.Generator(np.random.Philox(19)).standard_normal(place.shape)


def on_ground(time_s: np.ndarray, place: np.ndarray) -> dict[str, np.ndarray]:
    return {"time_s": time_s, **xyz(fixed(time_s, place), "ecef")}


def turned(place: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Return positions (n, 3) in axes that have turned about the Earth's by angles (n,)."""
    x, y, z = place.T
    return np.stack(
        [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z], axis=1
    )


def xyz(place: np.ndarray, frame: str) -> dict[str, np.ndarray]:
    return {f"{axis}_{frame}_m": place[:, number] for number, axis in enumerate("xyz")}


def fixed(time_s: np.ndarray, place: np.ndarray) -> np.ndarray:
    return turned(place, EARTH_RAD_S * time_s)


def geodetic(place: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return latitude and longitude, deg, and height, m, on WGS 84."""
    where = EarthLocation.from_geocentric(*place.T, unit="m").to_geodetic("WGS84")
    return where.lat.deg, where.lon.deg, where.height.to_value("m")


def table(path: Path, columns: Columns, decimals: int = 6) -> Path:
    text = io.StringIO()
    np.savetxt(
        text,
        np.stack(list(columns.values()), axis=1),
        fmt=f"%.{decimals}f",
        delimiter=",",
        header=",".join(columns),
        comments="",
    )
    path.write_text(text.getvalue(), encoding="utf-8")
    return path


def planned(path: Path, **settings: Any) -> opir.Plan:
    target = {"id": "T1", "model": "table", "type": "SRBM", "file": str(path), **settings}
    if "timestamp" not in path.read_text(encoding="utf-8")[:200]:
        target["start_s"] = 0.0
    return opir.compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "falls",
                "epoch": EPOCH,
                "duration_s": 250.0,
                "sensors": [{"model": "generic-scanner", "id": "S1", "orbital_slot_deg": -120.0}],
                "targets": [target],
            }
        )
    )


def complaint(path: Path, **settings: Any) -> str:
    with pytest.raises(opir.SceneError) as refused:
        planned(path, **settings)
    return str(refused.value)


def dated(time_s: np.ndarray) -> list[str]:
    start = np.datetime64("2026-04-01T12:00:00", "us")
    return [f"{start + np.timedelta64(round(second * 1e6), 'us')}Z" for second in time_s.tolist()]


def with_dates(path: Path, columns: Columns) -> Path:
    """Write a table whose first column, the time in seconds, stands as dates."""
    time_s, *values = columns.values()
    lines = [f"timestamp,{','.join(list(columns)[1:])}"]
    for date, row in zip(dated(time_s), np.stack(values, axis=1).tolist(), strict=True):
        lines.append(f"{date},{','.join(f'{value:.4f}' for value in row)}")
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def flight_columns() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, inertial and Earth-fixed positions of the flight, 5 s apart."""
    time_s, place = suborbital()
    return time_s[::10], place[::10], fixed(time_s, place)[::10]


def heights(scale: float, shift: float = 0.0) -> dict[str, np.ndarray]:
    time_s, _, place = flight_columns()
    latitude, longitude, height = geodetic(place)
    return {
        "time_s": time_s,
        "lat_deg": latitude,
        "lon_deg": longitude,
        "height_m": (height + shift) / scale,
    }


SLIPS: dict[str, tuple[Callable[[], Columns], str, str]] = {
    "heights in km": (lambda: heights(1e3), "with heights in km", "{height_km: height_m}"),
    "heights in feet": (lambda: heights(0.3048), "with heights in ft", "{height_ft: height_m}"),
    "distances from the centre": (
        lambda: heights(1.0, MEAN_RADIUS_M),
        "with distances from the Earth's centre as heights",
        "subtract the Earth's radius",
    ),
    "times in milliseconds": (
        lambda: rescaled(1e3, 1.0),
        "with times in ms",
        "{time_ms: time_s}",
    ),
    "times in minutes": (
        lambda: rescaled(1.0 / 60.0, 1.0),
        "with times in min",
        "{time_min: time_s}",
    ),
    "positions in feet": (
        lambda: rescaled(1.0, 1.0 / 0.3048),
        "with positions in ft",
        "{x_ecef_ft: x_ecef_m, y_ecef_ft: y_ecef_m, z_ecef_ft: z_ecef_m}",
    ),
}


def rescaled(times: float, lengths: float) -> Columns:
    time_s, _, place = flight_columns()
    return {"time_s": times * time_s, **xyz(lengths * place, "ecef")}


@pytest.mark.parametrize("slip", SLIPS)
def test_slips_of_units_are_named_with_their_remedy(tmp_path, slip):
    columns, cause, remedy = SLIPS[slip]
    message = complaint(table(tmp_path / "flight.csv", columns()))
    assert cause in message
    assert "fall freely" in message
    assert remedy in message
    assert message.count("targets[0].file") == 1


def test_remedies_of_messages_mend_the_table(tmp_path):
    path = table(tmp_path / "flight.csv", heights(1e3))
    (target,) = planned(path, columns={"height_km": "height_m"}).targets.truth()
    assert target["file"] == str(path)


@pytest.mark.parametrize("frame", ["teme", "ecef"])
def test_axes_of_flights_are_told_apart(tmp_path, frame):
    time_s, inertial, on_ground = flight_columns()
    place = inertial if frame == "ecef" else on_ground
    path = with_dates(tmp_path / "flight.csv", {"time_s": time_s, **xyz(place, frame)})
    message = complaint(path)
    right = {"ecef": "teme", "teme": "ecef"}[frame]
    assert ("along inertial axes" in message) == (frame == "ecef")
    assert (
        f"{{x_{right}_m: x_{frame}_m, y_{right}_m: y_{frame}_m, z_{right}_m: z_{frame}_m}}"
        in message
    )
    mended = {f"{axis}_{right}_m": f"{axis}_{frame}_m" for axis in "xyz"}
    planned(path, columns=mended)


@pytest.mark.parametrize("frame", ["teme", "ecef"])
def test_a_flight_that_ends_burning_is_told_by_its_pad(tmp_path, frame):
    time_s, inertial, on_ground = (column[:18] for column in flight_columns())
    place = inertial if frame == "ecef" else on_ground
    message = complaint(
        with_dates(tmp_path / "flight.csv", {"time_s": time_s, **xyz(place, frame)})
    )
    toward = "east" if frame == "ecef" else "west"
    assert f"its first state moves {toward} with 38" in message


def oem(path: Path, frame: str, time_s: np.ndarray, place: np.ndarray) -> Path:
    start, stop = (date[:-1] for date in dated(time_s[[0, -1]] - 600.0))
    head = f"""CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2026-04-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = ONE
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = {frame}
TIME_SYSTEM = UTC
START_TIME = {start}
STOP_TIME = {stop}
META_STOP"""
    velocity = np.gradient(place, time_s, axis=0, edge_order=2)
    rows = np.concatenate([place, velocity], axis=1) / 1e3
    lines = [
        " ".join([date[:-1], *(f"{value:.6f}" for value in row)])
        for date, row in zip(dated(time_s - 600.0), rows.tolist(), strict=True)
    ]
    path.write_text("\n".join([head, *lines, ""]), encoding="utf-8")
    return path


def sensor_planned(path: Path, **settings: Any) -> opir.Plan:
    orbit_file = {"path": str(path), **settings}
    return opir.compile_plan(
        opir.scene_from_mapping(
            {
                "scene": "looks",
                "epoch": EPOCH,
                "duration_s": 60.0,
                "sensors": [
                    {"model": "generic-scanner", "id": "L1", "orbit": {"file": orbit_file}}
                ],
                "targets": [],
            }
        )
    )


@pytest.mark.parametrize(
    ("frame", "axes"),
    [("ITRF2000", "inertial"), ("EME2000", "Earth-fixed"), ("TEME", "Earth-fixed")],
)
def test_axes_of_ephemerides_are_told_apart(tmp_path, frame, axes):
    time_s, inertial = satellite()
    place = inertial if axes == "inertial" else fixed(time_s, inertial)
    path = oem(tmp_path / "orbit.oem", frame, time_s, place)
    with pytest.raises(opir.SceneError) as refused:
        sensor_planned(path)
    assert f"along {axes} axes" in str(refused.value)
    assert "sensors[0].orbit.file.path" in str(refused.value)
    warnings = plan_warnings(sensor_planned(path, as_given=True))
    assert any(axes in warning for warning in warnings)


def test_an_ephemeris_covers_the_scene(tmp_path):
    time_s, inertial = satellite()
    path = oem(tmp_path / "orbit.oem", "TEME", time_s[:11], inertial[:11])
    with pytest.raises(
        opir.SceneError, match=r"no state at 2026-04-01T12:01:00Z.*the scene lasts 60 s"
    ):
        sensor_planned(path)


def noisy(step: int, sigma_m: float) -> Columns:
    time_s, place = (column[::step] for column in suborbital())
    return on_ground(time_s, place + sigma_m * noise(place))


def hover() -> Columns:
    time_s = np.arange(0.0, 250.0, 2.0)
    place = np.repeat(geodetic_place(34.7, -120.6, 30_000.0)[None], len(time_s), axis=0)
    return {"time_s": time_s, **xyz(place + 12.0 * time_s[:, None] * [0.0, 0.0, 1.0], "ecef")}


def cruise(side: float) -> Columns:
    """Return a flight along 59° N near the ground, as fast as it, towards the east or the west."""
    time_s = np.arange(0.0, 250.0)
    place = np.repeat(geodetic_place(59.0, 0.0, -8600.0)[None], len(time_s), axis=0)
    return {"time_s": time_s, **xyz(turned(place, -side * EARTH_RAD_S * time_s), "ecef")}


def geodetic_place(latitude_deg: float, longitude_deg: float, height_m: float) -> np.ndarray:
    latitude, longitude = np.radians([latitude_deg, longitude_deg])
    up = np.array(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    return (6_371_000.0 + height_m) * up


HEALTHY: dict[str, Callable[[], Columns]] = {
    "states each 5 s": lambda: noisy(10, 0.0),
    "states each second, 20 m of noise": lambda: noisy(2, 20.0),
    "states each 0.5 s, 5 m of noise": lambda: noisy(1, 5.0),
    "a burn alone": lambda: {name: column[:18] for name, column in noisy(10, 0.0).items()},
    "a climb without free fall": hover,
    "a cruise as fast as the ground": lambda: cruise(1.0),
    "a cruise against the ground": lambda: cruise(-1.0),
    "100 m of noise each minute": lambda: on_ground(
        *satellite(GEOSYNCHRONOUS_M, 0.05, 60.0, 100.0)
    ),
    "5 km of noise": lambda: on_ground(*satellite(GEOSYNCHRONOUS_M, 5.0, 300.0, 5000.0)),
    "the Moon": lambda: on_ground(*satellite(3.844e8, 28.0, 900.0)),
}


@pytest.mark.parametrize("case", HEALTHY)
def test_right_tables_are_taken_without_a_word(tmp_path, case):
    plan = planned(table(tmp_path / "flight.csv", HEALTHY[case](), decimals=3))
    assert not [each for each in plan_warnings(plan) if "seem" in each]


def test_two_places_at_one_time_are_refused_by_line(tmp_path):
    time_s, _, place = flight_columns()
    whole = {"time_s": np.floor(time_s / 10.0) * 10.0, **xyz(place, "ecef")}
    message = complaint(table(tmp_path / "flight.csv", whole))
    assert "line 3: the same time as line 2, and a place" in message
    assert "give times with more decimals" in message


@pytest.mark.parametrize("radius_m", [26.56e6, 3.844e8])
def test_daily_states_are_too_far_apart(tmp_path, radius_m):
    columns = on_ground(*satellite(radius_m, 28.0, 86_400.0))
    message = complaint(table(tmp_path / "orbit.csv", columns))
    assert "a step of 86400 s, in which the Earth turns by 361°" in message
    assert "seem" not in message


def test_daily_states_of_a_geostationary_satellite_are_taken(tmp_path):
    columns = on_ground(*satellite(GEOSYNCHRONOUS_M, 0.05, 86_400.0))
    assert not plan_warnings(sensor_planned(with_dates(tmp_path / "orbit.csv", columns)))


def test_segments_that_meet_with_jumps_are_taken(tmp_path):
    time_s, place = satellite(states=121)
    path = tmp_path / "orbit.oem"
    segments = [
        oem(path, "TEME", time_s[row : row + 31], place[row : row + 31] + row).read_text("utf-8")
        for row in (0, 30, 60, 90)
    ]
    others = [text[text.index("META_START") :] for text in segments[1:]]
    path.write_text("".join([segments[0], *others]), encoding="utf-8")
    assert not plan_warnings(sensor_planned(path))
