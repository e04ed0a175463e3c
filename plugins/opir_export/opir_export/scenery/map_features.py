"""The contents of a map of a run, for every format: flights, sensors, predicted impacts."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.cli import probability_text
from opir_core.geometry import ecef_to_geodetic
from opir_core.output import timestamp_text
from opir_core.planning import whole_flights
from opir_core.plugin import ImpactRegion, Sensor, Tracks
from opir_export.scenery.footprints import sensor_footprint

#: Longest flight after burnout that is written, s: an orbit has no end.
LONGEST_FLIGHT_S = 7200.0


@frozen(eq=False)
class Flight:
    """The true flight of a target from ignition to its end.

    Scene times (n,), s, and ECEF positions (n, 3), m.
    """

    target_id: str
    target_type: str
    time_s: FloatArray
    position_ecef_m: FloatArray
    burnout_s: float
    #: Whether the last position is the impact.
    has_impact: bool

    def geodetic_deg(self) -> FloatArray:
        """Return longitude and latitude, degrees, and height, m, (n, 3)."""
        return longitude_latitude_height(self.position_ecef_m)

    @property
    def ends(self) -> Mapping[str, int]:
        """Return the row of the launch and, if it is known, that of the impact."""
        return {"launch": 0, "impact": -1} if self.has_impact else {"launch": 0}


@frozen(eq=False)
class SensorPath:
    """The path of a sensor: scene times (n,), s, and ECEF positions (n, 3), m.

    A sensor at rest in ECEF has one. `footprint` (k, 2) is the boundary of the ground that it can
    see at the scene's start, latitude_rad and longitude_rad.
    """

    sensor: Sensor
    time_s: FloatArray
    position_ecef_m: FloatArray
    footprint: FloatArray

    @property
    def is_stationary(self) -> bool:
        """Whether the sensor stands still in ECEF."""
        return len(self.time_s) == 1

    def geodetic_deg(self) -> FloatArray:
        """Return longitude and latitude, degrees, and height, m, (n, 3)."""
        return longitude_latitude_height(self.position_ecef_m)


@frozen(eq=False)
class Prediction:
    """Estimated launch and impact of a track, valid from `start_s` until `end_s`.

    `end_s` is None for the track's last estimate. `launch` and `impact` (3,) are latitude_rad,
    longitude_rad and time_s, nan where unknown.
    """

    track: int
    start_s: float
    end_s: float | None
    launch: FloatArray
    impact: FloatArray
    regions: tuple[ImpactRegion, ...]


def flights(run: Any, step_s: float) -> Iterator[Flight]:
    """Yield the true flights of launches, points every `step_s` and at ignition, burnout, end."""
    targets = whole_flights(run.plan)
    truths = run.plan.targets.truth()
    for row, name in enumerate(targets.ids):
        start_s = float(targets.ignition_s[row])
        burnout_s = float(targets.burnout_s[row])
        flight_end_s = float(targets.end_s[row])
        end_s = min(flight_end_s, burnout_s + LONGEST_FLIGHT_S)
        time_s = np.append(_steps(start_s, burnout_s, step_s), _steps(burnout_s, end_s, step_s)[1:])
        position_m = targets.position_ecef_m(np.full(len(time_s), row, dtype=np.int32), time_s)
        is_known = np.isfinite(position_m).all(axis=1)
        yield Flight(
            target_id=name,
            target_type=targets.class_names[row],
            time_s=time_s[is_known],
            position_ecef_m=position_m[is_known],
            burnout_s=burnout_s,
            has_impact=bool(truths[row].get("impact")) and end_s == flight_end_s > burnout_s,
        )


def sensor_paths(run: Any, step_s: float) -> Iterator[SensorPath]:
    """Yield the sensors of a run, moving ones with points every `step_s` of the scene."""
    for sensor in run.sensors:
        still = sensor.orbit.is_stationary
        time_s = np.zeros(1) if still else _steps(0.0, run.plan.scene.duration_s, step_s)
        position_m = sensor.orbit.position_ecef_m(time_s)
        yield SensorPath(sensor, time_s, position_m, sensor_footprint(sensor, position_m[0]))


def predictions(run: Any, selection: str) -> Iterator[Prediction]:
    """Yield estimates of each track: the last, all (equal successors once), or none.

    `selection` is `last`, `all` or `none`.
    """
    rows: Tracks = run.tracks
    for track in np.unique(rows.track).tolist() if selection != "none" else ():
        track_rows = np.flatnonzero(rows.track == track)
        estimated = track_rows[
            np.isfinite(rows.impact[track_rows, 0]) | np.isfinite(rows.launch[track_rows, 0])
        ]
        selected = estimated[-1:] if selection == "last" else _changes(rows, estimated)
        ends = [*rows.tick_s[selected[1:]].tolist(), None]
        for row, end_s in zip(selected.tolist(), ends, strict=False):
            regions = rows.impact_regions[row]
            yield Prediction(
                track, float(rows.tick_s[row]), end_s, rows.launch[row], rows.impact[row], regions
            )


def _changes(rows: Tracks, estimated: Any) -> Any:
    """Return the rows of a track whose impact or regions differ from those of the row before."""
    regions = rows.impact_regions[estimated]
    impact = rows.impact[estimated]
    changed = np.ones(len(estimated), dtype=np.bool_)
    for place in range(1, len(estimated)):
        same_point = np.array_equal(impact[place], impact[place - 1], equal_nan=True)
        changed[place] = not (same_point and regions[place] == regions[place - 1])
    return estimated[changed]


_CONDITION_WORDS = {"burn over": " if the burn is over", "relights": " if it relights"}


def condition_words(region: ImpactRegion) -> str:
    """Return the condition of a region as words, ` if it relights (0.12)`; "" without one."""
    words = _CONDITION_WORDS.get(region.condition, "")
    return words and f"{words} ({probability_text(region.probability)})"


def longitude_latitude_height(position_ecef_m: FloatArray) -> FloatArray:
    """Return longitude, latitude, degrees, and ellipsoidal height, m, (n, 3) of ECEF positions."""
    place = ecef_to_geodetic(position_ecef_m)
    columns = (np.degrees(place.longitude_rad), np.degrees(place.latitude_rad), place.height_m)
    return np.stack(columns, axis=1)


def timestamps(run: Any, time_s: Sequence[float] | FloatArray) -> list[str]:
    """Return scene times, s, as text of UTC, `2026-04-01T12:00:10.162707Z`."""
    unix_us = run.plan.scene.epoch_us + np.rint(np.asarray(time_s, dtype=np.float64) * 1e6).astype(
        np.int64
    )
    return timestamp_text(unix_us)


def _steps(start_s: float, end_s: float, step_s: float) -> FloatArray:
    """Return times from start to end in equal steps of at most `step_s`."""
    count = max(int(np.ceil((end_s - start_s) / step_s - 1e-9)), 1) if end_s > start_s else 0
    return np.linspace(start_s, end_s, count + 1)
