"""Launches from high land: where and when they began, by two sensors and by one."""

from functools import cache

import numpy as np
import pytest

import opir_core as opir

#: Launch and aim, degrees, of a class.
FLIGHTS = {
    "SRBM": (33.0, 55.0, 36.0, 52.0),
    "IRBM": (35.0, 103.0, 20.0, 120.0),
    "ICBM": (41.0, -105.0, 50.0, 60.0),
}
SEEDS = (41, 42, 43)


@cache
def off(sensors: int, height_m: float) -> np.ndarray:
    """Return rows of time, s, its standard deviation, and χ² of the place, of the last launch point
    of each flight.
    """
    rows = []
    for kind, (lat, lon, to_lat, to_lon) in FLIGHTS.items():
        for seed in SEEDS:
            slots = (lon - 25.0, lon + 20.0)[:sensors]
            scene = {
                "scene": "inland",
                "epoch": "2026-06-01T09:00:00Z",
                "duration_s": 60.0,
                "seed": seed,
                "sensors": [
                    {"model": "SBIRS-GEO", "id": f"S{slot}", "orbital_slot_deg": slot}
                    for slot in slots
                ],
                "targets": [
                    {
                        "id": "T",
                        "type": kind,
                        "launch": {
                            "lat_deg": lat,
                            "lon_deg": lon,
                            "height_m": height_m,
                            "time_s": 10.0,
                        },
                        "aim": {"lat_deg": to_lat, "lon_deg": to_lon},
                    }
                ],
                "tracker": "imm",
            }
            tracks = opir.simulate(opir.scene_from_mapping(scene)).tracks
            last = np.flatnonzero(np.isfinite(tracks.launch[:, 0]))[-1]
            place = tracks.launch[last]
            spread = tracks.launch_covariance[last]
            east = 6.37e6 * np.cos(np.radians(lat)) * (place[1] - np.radians(lon))
            apart = np.array([east, 6.37e6 * (place[0] - np.radians(lat))])
            rows.append(
                [
                    place[2] - 10.0,
                    np.sqrt(spread[2, 2]),
                    apart @ np.linalg.solve(spread[:2, :2], apart),
                ]
            )
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.parametrize("sensors", [1, 2])
@pytest.mark.parametrize("height_m", [0.0, 1200.0])
def test_when_and_where_launches_began_is_within_what_is_stated(
    sensors: int, height_m: float
) -> None:
    time_s, sigma_s, square = off(sensors, height_m).T
    assert np.mean(np.square(time_s / sigma_s)) < 2.0
    assert np.abs(time_s / sigma_s).max() < 3.0
    # χ² of two degrees, 99.9 %.
    assert square.max() < 13.8


@pytest.mark.slow
def test_two_sensors_place_a_launch_from_high_land_as_well_as_one_from_the_sea() -> None:
    # A start at 1.2 km taken for one at sea level is some 17 s early.
    assert np.abs(off(2, 1200.0)[:, 0]).max() < 12.0
    assert np.median(np.abs(off(2, 1200.0)[:, 0])) < 6.0
