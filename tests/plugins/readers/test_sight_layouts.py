"""Lines of sight as other programs write them: the same directions and times, in other angles,
units and frames.
"""

import math

import numpy as np
import pytest
from opir_readers.detections.columns_of_run import columns_of
from opir_readers.frames import to_ecef
from read_files import read, recognised, refusal

from opir_core import compile_plan, scene_from_mapping

SCENE = {
    "scene": "one",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60.0,
    "sensors": [{"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -120.0}],
}


def only_row(names, cells, columns=None):
    text = f"{names}\n{cells}\n"
    assert columns or recognised(text) == ["sights"]
    (row,) = read("sights", text, columns=columns or {})
    return row


@pytest.mark.parametrize(
    ("names", "cells"),
    [
        ("time_s,ra_h,dec_deg", "1,12.5,-4.5"),
        ("time_s,RA (hours),dec_deg", "1,12.5,-4.5"),
        ("time_s,right_ascension_h,declination_deg", "1,12:30:00,-04:30:00.0"),
        ("time_s,right_ascension_h,declination_deg", "1,12 30 00.0,-4 30 0"),
        (
            "time_s,Right_Ascension (rad),Declination [rad]",
            f"1,{math.radians(187.5)!r},{math.radians(-4.5)!r}",
        ),
    ],
)
def test_right_ascensions_are_in_hours_or_degrees(names, cells):
    columns = {"right_ascension_h": "RA (hours)"} if "hours" in names else None
    row = only_row(names, cells, columns)
    assert row["right_ascension_deg"] == pytest.approx(187.5, abs=1e-9)
    assert row["declination_deg"] == pytest.approx(-4.5, abs=1e-9)


@pytest.mark.parametrize(
    ("names", "cells"),
    [
        ("time_s,azimuth_deg,elevation_deg", "1,190,5"),
        ("time_s,Azimuth (deg),Elevation (deg)", "1,190,5"),
        ("T;AZ;EL", "1;190;5"),
        ("time_s,azimuth_from_south_deg,elevation_deg", "1,10,5"),
        ("time_s,azimuth_deg,zenith_angle_deg", "1,190,85"),
        (
            "time_s,azimuth_from_south_rad,zenith_angle_rad",
            f"1,{math.radians(10)!r},{math.radians(85)!r}",
        ),
    ],
)
def test_angles_count_from_north_or_south_horizon_or_zenith(names, cells):
    row = only_row(names, cells, {"time_s": "T"} if names[0] == "T" else None)
    assert (row["azimuth_deg"], row["elevation_deg"]) == pytest.approx((190.0, 5.0), abs=1e-9)
    assert row["time_s"] == 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("unix_time", "1775044810"),
        ("unix_time_ms", "1775044810000"),
        ("MJD", "61131.50011574074"),
        ("gps_time", "1459080028"),
    ],
)
def test_times_count_from_other_dates(name, value):
    row = only_row(f"{name},az_deg,el_deg", f"{value},1,2")
    assert row["timestamp"][:20] in ("2026-04-01T12:00:10.", "2026-04-01T12:00:09.")


def test_a_flight_with_angles_beside_its_places_is_a_flight():
    text = "time_s,lat_deg,lon_deg,height_m,azimuth_deg,elevation_deg\n0,1,2,3,4,5\n1,1,2,3,4,5\n"
    assert recognised(text) == ["csv"]


@pytest.mark.parametrize("frame", ["EME2000", "TEME", "TOD_EARTH", "MOD", "CIRS", "ICRF"])
def test_directions_are_turned_from_the_frame_that_they_name(frame):
    plan = compile_plan(scene_from_mapping(SCENE))
    row = {
        "sensor_id": "A",
        "time_s": 10.0,
        "right_ascension_deg": 30.0,
        "declination_deg": -20.0,
        "reference_frame": frame,
    }
    longitude, latitude = np.radians([30.0, -20.0])
    level = np.cos(latitude)
    vector = np.array([[level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)]])
    kind = {"TOD_EARTH": "TOD", "ICRF": "EME2000"}.get(frame, frame)
    expected, _ = to_ecef(kind, vector, np.zeros((1, 3)), plan.scene.epoch_us, np.array([10.0]))
    sight = columns_of([row], plan, {}).detections.line_of_sight_ecef
    np.testing.assert_allclose(sight, expected, rtol=0.0, atol=1e-12)


def test_lines_of_a_fast_mode_are_of_a_scan_each():
    modes = {"slow": {"scan_period_ms": 2000.0}, "fast": {"scan_period_ms": 100.0}}
    spot = {"model": "generic-pointed", "id": "A", "orbital_slot_deg": -120.0, "modes": modes}
    plan = compile_plan(scene_from_mapping({**SCENE, "sensors": [spot]}))
    sight = {"sensor_id": "A", "right_ascension_deg": 30.0, "declination_deg": -20.0}
    rows = [{**sight, "time_s": 10.05 + 0.1 * number} for number in range(20)]
    assert len(np.unique(columns_of(rows, plan, {}).detections.scan)) == 20


def test_an_angle_that_is_none_is_named():
    reason = refusal("sights", "time_s,ra_h,dec_deg\n1,12:3x:00,2\n")
    assert "line 2: ra_h is '12:3x:00', not a finite number" in reason
