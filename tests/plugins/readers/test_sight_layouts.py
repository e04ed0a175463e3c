"""Lines of sight as other programs write them: the same directions and times, in other angles,
units and frames.
"""

import math

import numpy as np
import pytest
from opir_readers.detections.columns_of_run import columns_of
from opir_readers.detections.sights import is_of_sights, sight_rows
from opir_readers.formats import READERS
from opir_readers.frames import to_ecef
from opir_readers.reading import reader_of

from opir_core.planning.plan import compile_plan
from opir_core.plugin import BadFileError
from opir_core.reading import scene_from_mapping

SCENE = {
    "scene": "one",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60.0,
    "sensors": [{"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -120.0}],
}


def only_row(names, cells, columns=None):
    text = f"{names}\n{cells}\n"
    assert is_of_sights(text) or columns
    (row,) = sight_rows(text, 0.0, columns or {})
    return row


@pytest.mark.parametrize(
    ("names", "cells", "expected"),
    [
        ("time_s,ra_h,dec_deg", "1,12.5,-4.5", (187.5, -4.5)),
        ("time_s,RA (hours),dec_deg", "1,12.5,-4.5", None),
        ("time_s,right_ascension_h,declination_deg", "1,12:30:00,-04:30:00.0", (187.5, -4.5)),
        ("time_s,right_ascension_h,declination_deg", "1,12 30 00.0,-4 30 0", (187.5, -4.5)),
        (
            "time_s,Right_Ascension (rad),Declination [rad]",
            f"1,{math.radians(187.5)!r},{math.radians(-4.5)!r}",
            (187.5, -4.5),
        ),
    ],
)
def test_right_ascensions_are_in_hours_or_degrees(names, cells, expected):
    if expected is None:
        row = only_row(names, cells, {"right_ascension_h": "RA (hours)"})
        expected = (187.5, -4.5)
    else:
        row = only_row(names, cells)
    assert (row["right_ascension_deg"], row["declination_deg"]) == pytest.approx(expected, abs=1e-9)


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
def test_azimuths_count_from_north_or_south_and_heights_from_the_horizon_or_the_zenith(
    names, cells
):
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
    assert reader_of(text, READERS).name == "csv"


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
    level = np.cos(np.radians(-20.0))
    vector = np.array(
        [
            [
                level * np.cos(np.radians(30.0)),
                level * np.sin(np.radians(30.0)),
                np.sin(np.radians(-20.0)),
            ]
        ]
    )
    kind = {"TOD_EARTH": "TOD", "ICRF": "EME2000"}.get(frame, frame)
    expected, _ = to_ecef(kind, vector, np.zeros((1, 3)), plan.scene.epoch_us, np.array([10.0]))
    found = columns_of([row], plan, {}).detections.line_of_sight_ecef
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_an_angle_that_is_none_is_named():
    with pytest.raises(BadFileError, match="line 2: ra_h is '12:3x:00', not a finite number"):
        sight_rows("time_s,ra_h,dec_deg\n1,12:3x:00,2\n", 0.0, {})
