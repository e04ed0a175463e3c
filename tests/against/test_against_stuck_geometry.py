"""What a stuck scan sees, against a small geometry of its own: angles in the frame of the satellite,
and the times of looks of the same run without the fault.
"""

from typing import Any

import numpy as np
import pytest

import opir_core as opir

AT_S, UNTIL_S = 40.0, 90.0
PERIOD_S = 2.0
HALF_DEG = 10.0
SLOT_DEG = 100.0


def scene(pattern: str, *faults: Any, **sensor: Any) -> opir.Scene:
    places = [(lat, lon) for lat in range(-45, 50, 15) for lon in range(50, 155, 15)]
    targets = [
        {
            "id": f"T{number}",
            "type": "ICBM",
            "launch": {"lat_deg": lat, "lon_deg": lon, "time_s": 0.1 * number},
            "aim": {"lat_deg": lat - (60 if lat > 0 else -60), "lon_deg": lon},
        }
        for number, (lat, lon) in enumerate(places)
    ]
    return opir.scene_from_mapping(
        {
            "scene": "stuck",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 120.0,
            "seed": 17,
            "detection": "constant",
            "sensors": [
                {
                    "model": "generic-scanner",
                    "id": "S",
                    "orbital_slot_deg": SLOT_DEG,
                    "scan_pattern": pattern,
                    "scan_period_ms": 1e3 * PERIOD_S,
                    "field_of_regard_half_angle_deg": HALF_DEG,
                    "detection_probability": {"ICBM": 1.0},
                    "solar_exclusion_deg": 0.0,
                    **sensor,
                }
            ],
            "targets": targets,
            **({"faults": list(faults)} if faults else {}),
        }
    )


def angles(run: opir.Run) -> tuple[Any, Any, Any]:
    """Return the components of true lines of sight towards east, north and down."""
    detections = run.detections
    rows = len(detections)
    target = run.truth.target
    target_m = run.plan.targets.position_ecef_m(target.astype(np.int32), run.truth.emission_time_s)
    up = detections.sensor_ecef_m / np.linalg.norm(detections.sensor_ecef_m, axis=1)[:, None]
    east = np.cross(np.tile([0.0, 0.0, 1.0], (rows, 1)), up)
    east /= np.linalg.norm(east, axis=1)[:, None]
    north = np.cross(up, east)
    line = target_m - detections.sensor_ecef_m
    return tuple(np.sum(line * axis, axis=1) for axis in (east, north, -up))


def keys(run: opir.Run, rows: Any) -> set[tuple[int, int]]:
    times_ns = run.detections.time_ns[rows].tolist()
    return set(zip(times_ns, run.truth.target[rows].tolist(), strict=True))


def during(run: opir.Run) -> Any:
    return (run.detections.time_s >= AT_S) & (run.detections.time_s < UNTIL_S)


def compared(pattern: str, at_s: float, sees: Any, **sensor: Any) -> int:
    """Check which looks of the whole run are left; return their number."""
    fault = {"sensor": "S", "fault": "stuck-scan", "at_s": at_s, "until_s": UNTIL_S}
    intact = opir.simulate(scene(pattern, **sensor))
    stuck = opir.simulate(scene(pattern, fault, **sensor))
    in_fault = (intact.detections.time_s >= at_s) & (intact.detections.time_s < UNTIL_S)
    expected = keys(intact, np.flatnonzero(in_fault & sees(intact)))
    is_late = (stuck.detections.time_s >= at_s) & (stuck.detections.time_s < UNTIL_S)
    assert keys(stuck, np.flatnonzero(is_late)) == expected
    assert keys(stuck, np.flatnonzero(~is_late)) == keys(intact, np.flatnonzero(~in_fault))
    return len(expected)


@pytest.mark.parametrize("rows", [3, 4])
def test_a_step_stare_sees_the_stare_in_which_it_was(rows: int) -> None:
    columns = 4
    raster = {"raster_rows": rows, "raster_columns": columns}
    intact = opir.simulate(scene("step-stare", **raster))
    place, line = _stares(intact, rows, columns)
    # Where the scan begins follows from any look: its stare and line are read in their turn.
    turn = intact.detections.time_s / PERIOD_S - (place + line) / (rows * columns)
    start = np.angle(np.mean(np.exp(2j * np.pi * turn))) / (2.0 * np.pi)
    # A stare that holds some target is caught in its middle.
    stare = np.bincount(place[during(intact)].astype(int)).argmax()
    at_s = PERIOD_S * (20.0 + (start + (stare + 0.5) / (rows * columns)) % 1.0)

    def sees(run: opir.Run) -> Any:
        return _stares(run, rows, columns)[0] == stare

    assert compared("step-stare", at_s, sees, **raster) > 100


def _stares(run: opir.Run, rows: int, columns: int) -> tuple[Any, Any]:
    """Return the stares of looks in the order of a serpentine, and where in them the line is."""
    east, north, down = angles(run)
    across = (np.degrees(np.arctan2(east, down)) + HALF_DEG) / (2 * HALF_DEG) * columns
    along = (HALF_DEG - np.degrees(np.arctan2(north, down))) / (2 * HALF_DEG) * rows
    row, column = np.floor(along), np.floor(across)
    order = np.where(row % 2 == 0, column, columns - 1 - column)
    return row * columns + order, along - row


def test_a_spin_sees_the_strip_on_which_it_was() -> None:
    width_rad = 0.02
    intact = opir.simulate(scene("spin"))
    east, north, _ = angles(intact)
    azimuth = np.arctan2(east, north)
    turn = intact.detections.time_s / PERIOD_S - azimuth / (2.0 * np.pi)
    start = np.angle(np.mean(np.exp(2j * np.pi * turn))) / (2.0 * np.pi)
    wanted_rad = azimuth[np.flatnonzero(during(intact))[0]]
    at_s = PERIOD_S * (20.0 + (start + wanted_rad / (2.0 * np.pi)) % 1.0)

    def sees(run: opir.Run) -> Any:
        east, north, down = angles(run)
        # The angle from the plane through nadir at that azimuth, on its side of nadir.
        across = east * np.cos(wanted_rad) - north * np.sin(wanted_rad)
        off_rad = np.arcsin(across / np.sqrt(east**2 + north**2 + down**2))
        in_front = east * np.sin(wanted_rad) + north * np.cos(wanted_rad) >= 0.0
        return in_front & (np.abs(off_rad) <= 0.5 * width_rad)

    assert compared("spin", at_s, sees, ifov_urad=1e6 * width_rad) > 20
