"""Files as other programs write them, drawn at random: flights, orbits, telemetry, lines of sight
and elements. Motions are integrated by scipy and turned by the rotation angle of ERFA, apart from
opir.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import erfa
import numpy as np
from attrs import evolve, frozen
from pyproj import Transformer
from scipy.integrate import solve_ivp

MU_M3_S2 = 3.986004418e14
J2 = 1.08262668e-3
RADIUS_M = 6_378_137.0
EARTH_RAD_S = 7.292115e-5
START = np.datetime64("2026-04-01T12:00:00", "us")

_TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
_TO_GEODETIC = Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)

Rng = np.random.Generator
Vectors = np.ndarray


@frozen
class Path3:
    """A path: times (n,), s after `START`, inertial positions and velocities (n, 3), m and m/s."""

    time_s: np.ndarray
    place: Vectors
    rate: Vectors

    @property
    def angle(self) -> np.ndarray:
        """Return the Earth's angle from the inertial axes (n,), rad: 0 at time 0."""
        return EARTH_RAD_S * self.time_s

    @property
    def fixed(self) -> Vectors:
        """Return Earth-fixed positions (n, 3)."""
        return turned(self.place, self.angle)

    @property
    def ground_rate(self) -> Vectors:
        """Return velocities over the Earth (n, 3), Earth-fixed."""
        return turned(self.rate - np.cross([0.0, 0.0, EARTH_RAD_S], self.place), self.angle)

    def take(self, rows: slice | np.ndarray) -> "Path3":
        return Path3(self.time_s[rows], self.place[rows], self.rate[rows])


def turned(vectors: Vectors, angle: np.ndarray) -> Vectors:
    """Return vectors (n, 3) in axes that have turned about the third by angles (n,)."""
    x, y, z = vectors.T
    return np.stack(
        [np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x, z], axis=1
    )


def geodetic(place: Vectors) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return latitudes, longitudes, deg, and heights, m, on WGS 84."""
    lon, lat, height = _TO_GEODETIC.transform(*place.T)
    return lat, lon, height


def ecef(lat_deg: float, lon_deg: float, height_m: float) -> np.ndarray:
    return np.array(_TO_ECEF.transform(lon_deg, lat_deg, height_m))


def gravity(place: np.ndarray) -> np.ndarray:
    """Return gravity with the Earth's oblateness, m/s²."""
    x, y, z = place
    square = x * x + y * y + z * z
    radius = np.sqrt(square)
    share = 1.5 * J2 * RADIUS_M**2 / square
    tilt = 5.0 * z * z / square
    factors = np.array([1.0 + share * (1.0 - tilt)] * 2 + [1.0 + share * (3.0 - tilt)])
    return -MU_M3_S2 / radius**3 * place * factors


Push = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def flown(
    place: np.ndarray, rate: np.ndarray, time_s: np.ndarray, push: Push | None = None
) -> Path3:
    """Return the path from a state at the first time; `push` is an acceleration beside gravity."""

    def rates(moment: float, state: np.ndarray) -> np.ndarray:
        force = gravity(state[:3])
        if push is not None:
            force = force + push(moment, state[:3], state[3:])
        return np.concatenate([state[3:], force])

    start = np.concatenate([place, rate])
    span = (time_s[0], time_s[-1])
    step = {} if push is None else {"max_step": 1.0}
    flight = solve_ivp(rates, span, start, t_eval=time_s, rtol=1e-10, atol=1e-4, **step)
    return Path3(time_s, flight.y[:3].T, flight.y[3:].T)


def launch(rng: Rng, step_s: float | None = None, coast_s: float = 240.0) -> Path3:
    """Return a launch from a random pad with a random azimuth and one burn, that then coasts."""
    lat = rng.uniform(-60.0, 60.0)
    pad = ecef(lat, rng.uniform(-180.0, 180.0), rng.uniform(0.0, 800.0))
    up = pad / np.linalg.norm(pad)
    east = np.cross([0.0, 0.0, 1.0], up)
    east /= np.linalg.norm(east)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    level = np.sin(azimuth) * east + np.cos(azimuth) * np.cross(up, east)
    burn_s = rng.uniform(70.0, 170.0)
    thrust = rng.uniform(17.0, 22.0)
    growth = rng.uniform(0.08, 0.15)
    pitch = rng.uniform(0.3, 0.6)
    ground = np.cross([0.0, 0.0, EARTH_RAD_S], pad)

    def push(moment: float, _place: np.ndarray, _rate: np.ndarray) -> np.ndarray:
        tilt = np.radians(min(pitch * max(moment - 8.0, 0.0), 75.0))
        size = (thrust + growth * moment) * (moment < burn_s)
        return size * (np.cos(tilt) * up + np.sin(tilt) * level)

    step = step_s or rng.choice([1.0, 2.0, 5.0])
    path = flown(pad, ground, np.arange(0.0, burn_s + coast_s, step), push)
    _, _, height = geodetic(path.fixed)
    # Free fall shows above the air: lower flights are drawn anew.
    return path if height[-1] > 120_000.0 or coast_s < 100.0 else launch(rng, step_s, coast_s)


def orbit(rng: Rng, kind: str = "LEO", step_s: float = 60.0, count: int = 60) -> Path3:
    """Return a satellite: `LEO`, `MEO`, `HEO`, `GEO`."""
    perigee_m, eccentricity = {
        "LEO": (RADIUS_M + rng.uniform(3.5e5, 1.4e6), rng.uniform(0.0, 0.01)),
        "MEO": (RADIUS_M + rng.uniform(1.9e7, 2.3e7), rng.uniform(0.0, 0.02)),
        "HEO": (RADIUS_M + rng.uniform(8e5, 2e6), rng.uniform(0.6, 0.73)),
        "GEO": (42_164_172.0, 1e-4),
    }[kind]
    tilt = np.radians(rng.uniform(0.0, 0.2) if kind == "GEO" else rng.uniform(20.0, 110.0))
    node, turn = rng.uniform(0.0, 2.0 * np.pi, 2)
    speed = np.sqrt(MU_M3_S2 * (1.0 + eccentricity) / perigee_m)
    axis = np.array([np.cos(node), np.sin(node), 0.0])
    pole = np.array([np.sin(node) * np.sin(tilt), -np.cos(node) * np.sin(tilt), np.cos(tilt)])
    side = np.cross(pole, axis)
    out = np.cos(turn) * axis + np.sin(turn) * side
    ahead = np.cross(pole, out)
    return flown(perigee_m * out, speed * ahead, step_s * np.arange(count))


def dates(time_s: np.ndarray) -> list[str]:
    return [f"{START + np.timedelta64(round(moment * 1e6), 'us')}Z" for moment in time_s.tolist()]


def xyz(vectors: Vectors, pattern: str) -> dict[str, np.ndarray]:
    return {pattern.format(axis): vectors[:, row] for row, axis in enumerate("xyz")}


def csv_text(columns: Mapping[str, Sequence[object] | np.ndarray]) -> str:
    """Return a table; numbers have six decimals, angles eight."""
    rows = zip(*columns.values(), strict=True)
    lines = [
        ",".join(f"{cell:.8f}" if isinstance(cell, float) else str(cell) for cell in row)
        for row in rows
    ]
    return "\n".join([",".join(columns), *lines, ""])


def places_csv(path: Path3, **units: float) -> str:
    """Return a table of latitude, longitude and height; `height` is metres of a unit of height."""
    lat, lon, height = geodetic(path.fixed)
    return csv_text(
        {
            "time_s": path.time_s,
            "lat_deg": lat,
            "lon_deg": lon,
            "height_m": height / units.get("height", 1.0),
        }
    )


def states_csv(path: Path3, velocity: Vectors | None = None, unit_m: float = 1.0) -> str:
    """Return a table of ECEF positions and perhaps velocities."""
    columns = {"time_s": path.time_s, **xyz(path.fixed / unit_m, "{}_ecef_m")}
    if velocity is not None:
        columns |= xyz(velocity, "v{}_ecef_m_s")
    return csv_text(columns)


def dated_csv(path: Path3, vectors: Vectors, frame: str) -> str:
    """Return a table of positions in a frame at dates."""
    return csv_text({"timestamp": dates(path.time_s), **xyz(vectors, f"{{}}_{frame}_m")})


def oem_text(path: Path3, frame: str, place: Vectors, rate: Vectors) -> str:
    """Return an ephemeris message in km and km/s."""
    stamps = [date[:-1] for date in dates(path.time_s)]
    head = (
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-04-01T00:00:00\nORIGINATOR = TEST\nMETA_START\n"
        "OBJECT_NAME = ONE\nOBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\n"
        f"REF_FRAME = {frame}\nTIME_SYSTEM = UTC\nSTART_TIME = {stamps[0]}\n"
        f"STOP_TIME = {stamps[-1]}\nMETA_STOP\n"
    )
    rows = np.concatenate([place, rate], axis=1) / 1e3
    lines = [
        " ".join([stamp, *(f"{value:.9f}" for value in row)])
        for stamp, row in zip(stamps, rows.tolist(), strict=True)
    ]
    return "\n".join([head + lines[0], *lines[1:], ""])


def webcast_json(path: Path3, speed: float = 1.0, height: float = 1e3, time: float = 1.0) -> str:
    """Return telemetry once a second, speeds and heights rounded; the units in m/s, m and s."""
    rates = np.linalg.norm(path.ground_rate, axis=1)
    _, _, up = geodetic(path.fixed)
    up = up - up[0]
    return json.dumps(
        [
            {"time": t / time, "velocity": round(v / speed), "altitude": round(h / height, 1)}
            for t, v, h in zip(path.time_s.tolist(), rates.tolist(), up.tolist(), strict=True)
        ]
    )


@frozen
class Lines:
    """Lines of sight: times (n,), s, ids, azimuths and elevations (n,), deg, and places (n, 3)."""

    time_s: np.ndarray
    ids: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    origin: Vectors
    direction: Vectors
    sigma_urad: float = 20.0

    def with_angles(self, azimuth: np.ndarray, elevation: np.ndarray) -> "Lines":
        return evolve(self, azimuth=azimuth, elevation=elevation)


SENSORS = (
    "sensors:\n"
    "  - {model: SBIRS-GEO, id: WEST, orbital_slot_deg: -135.0, scan_period_ms: 1000}\n"
    "  - {model: SBIRS-GEO, id: EAST, orbital_slot_deg: -75.0, scan_period_ms: 1000}\n"
)
_SLOTS = {"WEST": -135.0, "EAST": -75.0}


def lines_of(rng: Rng) -> Lines:
    """Return what two geostationary sensors see of a launch between them, each second."""
    pad = ecef(rng.uniform(-50.0, 50.0), rng.uniform(-130.0, -80.0), 0.0)
    up = pad / np.linalg.norm(pad)
    east = np.cross([0.0, 0.0, 1.0], up)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    level = np.sin(azimuth) * east + np.cos(azimuth) * np.cross(up, east)
    rows = []
    for late, (name, slot) in enumerate(_SLOTS.items()):
        moments = 10.0 + 0.31 * late + np.arange(90.0)
        place = pad + np.outer(8.0 * moments**1.9, up) + np.outer(3.0 * moments**2.1, level)
        slot_rad = np.radians(slot)
        out = np.array([np.cos(slot_rad), np.sin(slot_rad), 0.0])
        sideways = np.array([-np.sin(slot_rad), np.cos(slot_rad), 0.0])
        origin = 42_164_172.0 * out
        line = place - origin
        line /= np.linalg.norm(line, axis=1)[:, None]
        line += 20e-6 * rng.standard_normal(line.shape)
        line /= np.linalg.norm(line, axis=1)[:, None]
        rows += [
            (moment, name, *ray, *origin, ray @ sideways, ray[2], ray @ out)
            for moment, ray in zip(moments.tolist(), line, strict=True)
        ]
    rows.sort(key=lambda row: row[0])
    numbers = np.array([row[2:] for row in rows])
    return Lines(
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.degrees(np.arctan2(numbers[:, 6], numbers[:, 7])) % 360.0,
        np.degrees(np.arcsin(numbers[:, 8])),
        numbers[:, 3:6],
        numbers[:, :3],
    )


def lines_csv(lines: Lines, **columns: Sequence[object] | np.ndarray) -> str:
    """Return a table of lines of sight; `columns` replace its own, or stand beside them."""
    table = {
        "timestamp": dates(lines.time_s),
        "sensor_id": lines.ids,
        "azimuth_deg": lines.azimuth,
        "elevation_deg": lines.elevation,
        "line_of_sight_sigma_urad": np.full(len(lines.time_s), lines.sigma_urad),
    }
    return csv_text({name: values for name, values in {**table, **columns}.items() if len(values)})


def celestial_deg(lines: Lines, *, of_date: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return right ascensions and declinations (n,), deg: of the date, or of J2000 (IAU 2006)."""
    day = 2_461_132.0 + lines.time_s / 86_400.0
    sidereal = np.array(
        [
            erfa.gst06a(2_400_000.5, each - 2_400_000.5, 2_400_000.5, each - 2_400_000.5)
            for each in day.tolist()
        ]
    )
    vectors = turned(lines.direction, -sidereal)
    if not of_date:
        matrix = erfa.pnm06a(2_400_000.5, float(day[0]) - 2_400_000.5)
        vectors = (matrix.T @ vectors.T).T
    right = np.degrees(np.arctan2(vectors[:, 1], vectors[:, 0])) % 360.0
    return right, np.degrees(np.arcsin(vectors[:, 2]))


def elements(rng: Rng) -> dict[str, object]:
    """Return mean elements of a satellite in a low orbit, as an OMM has them."""
    return {
        "OBJECT_NAME": f"SAT {rng.integers(100)}",
        "OBJECT_ID": "2020-001A",
        "EPOCH": "2026-04-01T12:00:00.000000",
        "MEAN_MOTION": round(float(rng.uniform(12.0, 15.8)), 8),
        "ECCENTRICITY": round(float(rng.uniform(0.0001, 0.01)), 7),
        "INCLINATION": round(float(rng.uniform(28.0, 98.0)), 4),
        "RA_OF_ASC_NODE": round(float(rng.uniform(7.0, 359.0)), 4),
        "ARG_OF_PERICENTER": round(float(rng.uniform(7.0, 359.0)), 4),
        "MEAN_ANOMALY": round(float(rng.uniform(7.0, 359.0)), 4),
        "EPHEMERIS_TYPE": 0,
        "NORAD_CAT_ID": int(rng.integers(100, 60_000)),
        "ELEMENT_SET_NO": 999,
        "REV_AT_EPOCH": 100,
        "BSTAR": 3e-5,
        "MEAN_MOTION_DOT": 1e-5,
        "MEAN_MOTION_DDOT": 0,
    }


def tle_text(rng: Rng) -> str:
    """Return two lines of elements with right checksums."""
    row = elements(rng)
    number = int(row["NORAD_CAT_ID"])  # type: ignore[call-overload]
    eccentricity = round(float(row["ECCENTRICITY"]) * 1e7)  # type: ignore[arg-type]
    first = f"1 {number:05d}U 20001A   26091.50000000  .00001000  00000+0  30000-4 0  999"
    second = (
        f"2 {number:05d} {row['INCLINATION']:8.4f} {row['RA_OF_ASC_NODE']:8.4f} {eccentricity:07d}"
        f" {row['ARG_OF_PERICENTER']:8.4f} {row['MEAN_ANOMALY']:8.4f} {row['MEAN_MOTION']:11.8f}  100"
    )
    return "".join(f"{line}{_checksum(line)}\n" for line in (first, second))


def _checksum(line: str) -> int:
    return sum(int(mark) if mark.isdigit() else mark == "-" for mark in line) % 10


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path
