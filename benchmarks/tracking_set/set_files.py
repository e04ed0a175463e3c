"""Files of the tracking set: CSV tables, the same as Parquet, and `set.json`, which describes them.

CSV and JSON are the same bytes on every machine but for ties of rounding; their SHA-256 digests are
in `set.json`, and those of the published set in `digests.json` beside this file. Parquet has the
same rows; its bytes depend on the version of the library that writes it.
"""

import csv
import hashlib
import io
import json
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from opir_scoring.benchmark_tables import STATE
from set_bounds import bounds_of
from set_cases import CASES, SEEDS, scene_of
from set_flights import burns
from set_sights import TICK_S, clutter_half_angle_rad, middle_m, observed

VERSION = "1.0"
EPOCH = datetime(2026, 1, 1)
LICENCE = "CC0-1.0"
#: The cut-off distance of GOSPA over the median bound of position at the scored ticks of a scene.
CUTOFF_OF_BOUND = 10.0

COLUMNS = {
    "lines_of_sight": (
        *("scene", "detection", "time_utc", "time_s", "sensor"),
        *("sensor_x_m", "sensor_y_m", "sensor_z_m"),
        *("direction_x", "direction_y", "direction_z", "sigma_urad"),
    ),
    "truth": ("scene", "launch", "time_s", *STATE, "is_burning", "is_scored"),
    "origins": ("scene", "detection", "launch"),
    "launches": (
        *("scene", "launch", "stages", "ignition_s", "burnout_s"),
        *("lat_deg", "lon_deg", "azimuth_deg"),
    ),
    "bounds": (
        *("scene", "launch", "time_s", "position_m", "velocity_m_s", "log_det", "energy_m"),
        *("free_position_m", "free_velocity_m_s"),
    ),
}

README = """# Boost-phase tracking by line of sight, version {version}

{scenes} scenes in {cases} cases. Licence: CC0 1.0 (public domain,
https://creativecommons.org/publicdomain/zero/1.0/). All figures are notional.

- `lines_of_sight.csv` is what a tracker gets: the direction (unit vector) from a sensor to
  something hot. ECEF (WGS 84), metres, seconds since the epoch {epoch}Z; `sigma_urad` is the
  stated standard deviation per axis across the line. Light takes no time. A detection is a launch
  or clutter.
- `set.json` is what a tracker may know: of each sensor its orbit, its looks (every `period_s` from
  `phase_s`, at the whole Earth below it), its P_d for burning targets (dark ones are not
  detected), the stated standard deviation of its bias (two constant angles about east and north at
  the sensor) and its clutter (mean number a look, uniform in a cone).
- `truth.csv`, `launches.csv`, `origins.csv` (which detection is whose) and `bounds.csv` are not
  for trackers.
- Every table is there as Parquet too.
"""


class SceneTables(NamedTuple):
    """A scene's rows of each table, its bounds, and its description in `set.json`."""

    rows: dict[str, list[list[str]]]
    description: dict[str, Any]


def tables_of(name, seed):
    """Return the tables and the description of a scene."""
    scene = scene_of(name, seed)
    truth, sights = observed(scene)
    rows = observed_rows(scene, truth, sights)
    bounds = [bounds_of(scene, truth, sights, number) for number in range(len(scene.launches))]
    rows["origins"] = [
        [scene.name, str(row), _launch_name(owner) if owner >= 0 else ""]
        for row, owner in enumerate(sights.launch.tolist())
    ]
    rows["launches"] = [
        list(_launch_row(scene.name, *launch)) for launch in enumerate(scene.launches)
    ]
    rows["bounds"] = [
        row for number, own in enumerate(bounds) for row in _bound_rows(scene, number, own)
    ]
    return SceneTables(rows, _description(scene, name, seed, truth, bounds))


def observed_rows(scene, truth, sights):
    """Return the rows of lines of sight and of truth."""
    return {
        "lines_of_sight": list(_sight_rows(scene, sights)),
        "truth": list(_truth_rows(scene, truth)),
    }


def _launch_name(number):
    return f"L{number + 1}"


def _sight_rows(scene, sights):
    for row, time_s in enumerate(sights.time_s.tolist()):
        sensor = int(sights.sensor[row])
        place = sights.sensor_m[row].tolist()
        direction = sights.direction[row].tolist()
        yield [
            *(scene.name, str(row), utc(time_s), f"{time_s:.6f}", f"S{sensor + 1}"),
            *(f"{value:.2f}" for value in place),
            *(f"{value:.10f}" for value in direction),
            f"{1e6 * scene.sensors[sensor].sigma_rad:g}",
        ]


def utc(time_s):
    """Return a time since the epoch as text in UTC, to the microsecond."""
    return (EPOCH + timedelta(microseconds=round(1e6 * time_s))).isoformat(
        timespec="microseconds"
    ) + "Z"


def _truth_rows(scene, truth):
    for number, path in enumerate(truth.paths):
        burns_s = truth.burns_s[number]
        flying = np.flatnonzero(truth.tick_s >= burns_s[0, 0])
        states = path.states(truth.tick_s[flying])[0]
        for at, state in zip(flying.tolist(), states.tolist(), strict=True):
            time_s = truth.tick_s[at]
            is_burning = np.any((time_s >= burns_s[:, 0]) & (time_s < burns_s[:, 1]))
            yield [
                *(scene.name, _launch_name(number), f"{time_s:g}"),
                *(f"{value:.2f}" for value in state[:3]),
                *(f"{value:.4f}" for value in state[3:]),
                *(str(int(is_burning)), str(int(truth.is_scored[number, at]))),
            ]


def _launch_row(scene, number, launch):
    both = burns(launch.row, launch.stages)
    yield from (
        scene,
        _launch_name(number),
        str(launch.stages),
        f"{both[0, 0]:.6f}",
        f"{both[-1, 1]:.6f}",
    )
    yield from (f"{np.degrees(angle):.7f}" for angle in launch.row[:3])


def _bound_rows(scene, number, bounds):
    for time_s, *values in zip(*(column.tolist() for column in bounds), strict=True):
        # To four digits: linear algebra differs by machine in the last ones of sixteen.
        yield [
            scene.name,
            _launch_name(number),
            f"{time_s:g}",
            *(f"{value:.4g}" for value in values),
        ]


def _description(scene, name, seed, truth, bounds):
    bound_m = float(np.median(np.concatenate([own.position_m for own in bounds])))
    middle = middle_m(scene)
    return {
        "scene": scene.name,
        "case": name,
        "seed": seed,
        "launches": len(scene.launches),
        "end_s": float(truth.tick_s[-1]),
        "cutoff_m": float(f"{CUTOFF_OF_BOUND * bound_m:.2g}"),
        "clutter_towards_ecef_m": [round(value) for value in middle.tolist()],
        "sensors": [
            {
                "sensor": f"S{number + 1}",
                "altitude_m": round(sensor.altitude_m, 3),
                "inclination_deg": sensor.inclination_deg,
                "node_longitude_deg": sensor.node_deg,
                "argument_of_latitude_deg": sensor.argument_deg,
                "period_s": sensor.period_s,
                "phase_s": sensor.phase_s,
                "sigma_urad": round(1e6 * sensor.sigma_rad, 3),
                "bias_sigma_urad": round(1e6 * sensor.bias_sigma_rad, 3),
                "detection_probability": sensor.detection_probability,
                "clutter_per_look": sensor.clutter_per_look,
                "clutter_half_angle_rad": round(clutter_half_angle_rad(scene, sensor), 6),
            }
            for number, sensor in enumerate(scene.sensors)
        ],
    }


def write_set(folder, cases=tuple(CASES), seeds=SEEDS):
    """Write the set into a folder; return the digests of its tables, and of those of each scene."""
    folder.mkdir(parents=True, exist_ok=True)
    scenes = [tables_of(name, seed) for name in cases for seed in seeds]
    digests = {}
    for table, columns in COLUMNS.items():
        text = table_text(columns, (row for scene in scenes for row in scene.rows[table]))
        (folder / f"{table}.csv").write_bytes(text)
        digests[f"{table}.csv"] = digest(text)
        _write_parquet(folder / f"{table}.csv")
    description = {
        "set": "boost-phase tracking by line of sight",
        "version": VERSION,
        "licence": LICENCE,
        "epoch": EPOCH.isoformat() + "Z",
        "tick_s": TICK_S,
        "cases": {name: CASES[name].question for name in cases},
        "scenes": [scene.description for scene in scenes],
        "digests": digests,
    }
    (folder / "set.json").write_text(
        json.dumps(description, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )
    readme = README.format(
        version=VERSION, scenes=len(scenes), cases=len(cases), epoch=EPOCH.isoformat()
    )
    (folder / "README.md").write_text(readme, encoding="utf-8")
    return {
        "tables": digests,
        "scenes": {scene.description["scene"]: scene_digest(scene.rows) for scene in scenes},
    }


def digest(text):
    """Return the SHA-256 digest of a text."""
    return hashlib.sha256(text).hexdigest()


def scene_digest(rows):
    """Return the digest of a scene's lines of sight and truth."""
    return digest(b"".join(table_text((), rows[name]) for name in ("lines_of_sight", "truth")))


def table_text(columns, rows):
    """Return a CSV table as UTF-8."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue().encode()


def _write_parquet(path):
    """Write the Parquet table of a CSV table; where no library does, there is none."""
    try:
        from pyarrow import csv as arrow_csv, parquet
    except ModuleNotFoundError:
        return
    parquet.write_table(arrow_csv.read_csv(path), path.with_suffix(".parquet"), compression="zstd")
