"""`opir prior fit FILES -o prior.json`: the law of vehicles of the tracker imm, from a user's own
recorded flights.

Files are tables of the target model `table` with `is_burning`. Each burn gives its time, first
acceleration and ratio of masses (the rocket equation: the inverse of the force along the velocity
falls linearly), and the gap after it. Flights that end in an orbit are space launches, others
missiles. Medians are those of the flights; standard deviations are widened by `WIDEN`, and are at
least `LEAST`: a few flights do not show how others differ. What no flight shows stays as it is in
the tracker's own law.
"""

import argparse
import copy
import csv
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.errors import Problem, SceneError
from opir_core.output import OutputFiles

#: Factor of standard deviations, and their least values: burn time, acceleration, ratio, gap.
WIDEN = 1.5
LEAST = (0.3, 0.2, 0.25, 0.7)

#: Flights drawn for the marginal law of ranges; least rows of a burn.
DRAWS = 20000
LEAST_ROWS = 4

#: Perigee above which a flight ends in an orbit, m from the centre.
_ORBIT_M = 6371e3 + 80e3

#: Longest burn of a stage, s.
_LONGEST_S = 3600.0
#: No number of a flight is as large, m or s.
_BEYOND = 1e12

_COLUMNS = (
    "time_s",
    "x_ecef_m",
    "y_ecef_m",
    "z_ecef_m",
    "vx_ecef_m_s",
    "vy_ecef_m_s",
    "vz_ecef_m_s",
    "is_burning",
)


class RecordedFlight(NamedTuple):
    """The stages (n, 4) of a recorded flight: burn time, first acceleration, ratio, gap; whether it
    ends in an orbit."""

    stages: FloatArray
    orbits: bool


def prior_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `opir prior`."""
    actions = parser.add_subparsers(metavar="ACTION", required=True)
    fit_ = actions.add_parser("fit", help="fit a law of vehicles to recorded flights")
    fit_.add_argument(
        "files", nargs="+", type=Path, metavar="FILE", help="table of a flight, with is_burning"
    )
    fit_.add_argument(
        "-o", "--out", type=Path, required=True, help="JSON for the setting boost_prior of imm"
    )


def fit(arguments: argparse.Namespace) -> int:
    """Write the law of the flights in files, and print what each is taken for."""
    flights = [recorded_flight(path) for path in arguments.files]
    data = fitted(flights)
    with OutputFiles() as files:
        files.write(arguments.out, (json.dumps(data, indent=2) + "\n").encode(), "law of vehicles")
    sys.stdout.write(
        "\n".join([f"{arguments.out}:", *map(_shown, arguments.files, flights)]) + "\n"
    )
    return 0


def _shown(path: Path, flight: RecordedFlight) -> str:
    """Return what a file is taken for, and its stages with units."""
    stages = [
        f"{burn:.0f} s from {acceleration:.1f} m/s2 to {1.0 / ratio:.2f} of the mass"
        f"{f', {gap:.0f} s dark' if gap > 0.0 else ''}"
        for burn, acceleration, ratio, gap in flight.stages.tolist()
    ]
    return f"{path}: {'space launch' if flight.orbits else 'missile'}; burns of {'; '.join(stages)}"


def recorded_flight(path: Path) -> RecordedFlight:
    """Return the stages of a flight in a table. Raises `SceneError` if a column or a burn is
    missing.
    """
    table = _table(path)
    spans = _burns(table) if len(table) else []
    spans = [span for span in spans if span.stop - span.start >= LEAST_ROWS]
    if not spans:
        words = f"no burn of {LEAST_ROWS} rows or more; is_burning must be 1 in a burn"
        raise _refused(path, words)
    time_s = table[:, 0]
    starts = [float(time_s[span.start]) for span in spans]
    ends = [float(time_s[min(span.stop, len(table) - 1)]) for span in spans]
    if any(end - start > _LONGEST_S for start, end in zip(starts, ends, strict=True)):
        raise _refused(path, f"a burn of more than {_LONGEST_S:g} s; are its times in seconds?")
    gaps = [start - end for start, end in zip(starts[1:], ends, strict=False)]
    stages = np.array([_stage(table[span], end) for span, end in zip(spans, ends, strict=True)])
    columns = np.column_stack([stages, np.array([*gaps, np.nan])])
    # A burn against the motion is a return or a landing, not a stage on the way up; nor is what
    # follows.
    is_ascent = np.logical_and.accumulate(np.isfinite(stages[:, 0]))
    if not is_ascent[0]:
        raise _refused(path, "the first burn is against the motion")
    columns[np.count_nonzero(is_ascent) - 1, 3] = np.nan
    return RecordedFlight(columns[is_ascent], _perigee_m(table[-1]) > _ORBIT_M)


def _table(path: Path) -> FloatArray:
    """Return the columns of a file, as of `_COLUMNS`."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        cells = [[float(row[name]) for name in _COLUMNS] for row in rows]
        table = np.array(cells).reshape(-1, len(_COLUMNS))
    except KeyError as missing:
        words = f"no column {missing.args[0]}; needed are {', '.join(_COLUMNS)}"
        raise _refused(path, words) from None
    except OSError as error:
        raise _refused(path, str(error.strerror)) from error
    except (ValueError, TypeError, csv.Error) as error:
        raise _refused(path, str(error)) from error
    is_sound = (np.abs(table) < _BEYOND).all(axis=1)
    if not is_sound.all():
        raise _refused(path, f"row {np.argmin(is_sound) + 1} has no finite numbers of a flight")
    if not (np.diff(table[:, :1], axis=0) >= 0.0).all():
        raise _refused(path, "its times fall; sort the rows by time_s")
    return table


def _refused(path: Path, words: str) -> SceneError:
    return SceneError([Problem("", words)], source=str(path))


def _burns(table: FloatArray) -> list[slice]:
    """Return the rows of each burn."""
    on = np.concatenate([[0], table[:, -1] > 0.5, [0]]).astype(np.int64)
    edges = np.flatnonzero(np.diff(on)).reshape(-1, 2).tolist()
    return [slice(start, stop) for start, stop in edges]


def _stage(rows: FloatArray, end_s: float) -> tuple[float, float, float]:
    """Return burn time, first acceleration and ratio of masses of the rows of a burn that ends at a
    time.

    They are nan for a burn against the motion.
    """
    distinct = np.concatenate([[True], np.diff(rows[:, 0]) > 1e-9])
    along = _forces_along(rows[distinct])
    if np.median(along) <= 0.0:
        return np.nan, np.nan, np.nan
    along = np.maximum(along, 0.5)
    start_s = float(rows[0, 0])
    # An error of the force f is one of its inverse that is larger by 1/f²: rows of little force say
    # little.
    slope, start = np.polyfit(rows[distinct, 0] - start_s, 1.0 / along, 1, w=along**2)
    burn = end_s - start_s
    ratio = float(np.clip(start / max(start + slope * burn, 1e-4), 1.02, 20.0))
    return burn, 1.0 / max(start, 1e-3), ratio


def _apparent_weights(rows: FloatArray) -> FloatArray:
    """Return what holds rows of a table up against gravity and the Earth's rotation (n, 3), m/s²."""
    place = rows[:, 1:4]
    spin = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
    turning = 2.0 * np.cross(spin, rows[:, 4:7]) + np.cross(spin, np.cross(spin, place))
    radius = np.linalg.norm(place, axis=1, keepdims=True)
    return EARTH_MU_M3_S2 / radius**3 * place + turning


def _forces_along(rows: FloatArray) -> FloatArray:
    """Return the specific force along the velocity (n,), m/s², of rows of a table; at rest, all of
    it.
    """
    velocity = rows[:, 4:7]
    force = np.gradient(velocity, rows[:, 0], axis=0) + _apparent_weights(rows)
    speed = np.linalg.norm(velocity, axis=1)
    along = np.sum(force * velocity, axis=1) / np.maximum(speed, 1.0)
    return np.where(speed > 1.0, along, np.linalg.norm(force, axis=1))


def _perigee_m(row: FloatArray) -> float:
    """Return the least distance, m, from the Earth's centre of the free flight of a row."""
    place = row[1:4]
    velocity = row[4:7] + np.cross([0.0, 0.0, EARTH_ROTATION_RAD_S], row[1:4])
    momentum = float(np.linalg.norm(np.cross(place, velocity)))
    energy = 0.5 * float(velocity @ velocity) - EARTH_MU_M3_S2 / float(np.linalg.norm(place))
    parameter = momentum**2 / EARTH_MU_M3_S2
    return parameter / (1.0 + np.sqrt(max(1.0 + 2.0 * energy * parameter / EARTH_MU_M3_S2, 0.0)))


def fitted(flights: list[RecordedFlight]) -> dict[str, Any]:
    """Return the data of a law of vehicles, as in `vehicles.json`, from flights."""
    from opir_forecast.marginals import marginal_of
    from opir_forecast.vehicles import STAGES, model_of, vehicle_model

    data: dict[str, Any] = copy.deepcopy(dict(vehicle_model().data))
    data["note"] = f"Law of vehicles fitted to {len(flights)} flights by opir prior fit."
    for name, orbits in (("missile", False), ("space", True)):
        stages = [flight.stages[:STAGES] for flight in flights if flight.orbits == orbits]
        if not stages:
            continue
        _fit_stages(data["families"][name], stages, STAGES)
    data["marginal"] = marginal_of(model_of(data), DRAWS, 1)
    return data


def _fit_stages(law: dict[str, Any], stages: list[FloatArray], most: int) -> None:
    """Fit the number of stages, of at most `most`, and first and upper stages to those of flights,
    (stages, 4) each.
    """
    count = np.bincount([len(rows) - 1 for rows in stages], minlength=most) + 0.5
    law["stages"] = (count / count.sum()).round(4).tolist()
    _fit_part(law["first"], np.concatenate([rows[:1] for rows in stages]))
    _fit_part(law["upper"], np.concatenate([rows[1:] for rows in stages]))


def _fit_part(law: dict[str, list[float]], rows: FloatArray) -> None:
    """Replace medians and standard deviations of a part by those of stages (n, 4), where there are
    any.
    """
    for row in range(4):
        values = rows[:, row][np.isfinite(rows[:, row]) & (rows[:, row] > 0.5)]
        if not len(values):
            continue
        law["median"][row] = round(float(np.exp(np.mean(np.log(values)))), 3)
        spread = (
            WIDEN * float(np.std(np.log(values), ddof=1)) if len(values) > 2 else law["sigma"][row]
        )
        law["sigma"][row] = round(max(spread, LEAST[row]), 3)
