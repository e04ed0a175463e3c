"""Angles that detections work out when asked: those of the geometry, row by row, whoever else is in
the record.
"""

import subprocess
import sys

import numpy as np
import pytest
from opir_testing import stub_window

from opir_core.geometry import azimuth_elevation_range, azimuth_elevation_range_in_axes, local_axes
from opir_core.interfaces import Viewpoints
from opir_core.plugin import Detections


def seen(count: int = 400, share_moving: float = 0.3) -> Detections:
    """Return detections of sensors 0, 2, 3 and 7; sensor 3 is never twice at a place, sensor 7 now
    and then away.
    """
    random = np.random.default_rng(11)
    sensor = random.choice([0, 2, 3, 7], count)
    direction = random.normal(size=(count, 3))
    is_away = (sensor == 3) | ((sensor == 7) & (random.random(count) < share_moving))
    place = 4.2e7 * random.normal(size=(8, 3))[sensor] + is_away[:, None] * random.uniform(
        -1e6, 1e6, (count, 3)
    )
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return stub_window(
        count, sensor=sensor, sensor_ecef_m=place, line_of_sight_ecef=direction
    ).detections


def test_angles_of_a_row_do_not_depend_on_others() -> None:
    looks = seen()
    alone = azimuth_elevation_range_in_axes(
        looks.line_of_sight_ecef, local_axes(looks.sensor_ecef_m)
    )
    assert looks.angles().azimuth_rad.tobytes() == alone.azimuth_rad.tobytes()
    assert looks.angles().elevation_rad.tobytes() == alone.elevation_rad.tobytes()
    assert looks.azimuth_rad.tobytes() == alone.azimuth_rad.tobytes()
    assert looks.elevation_rad.tobytes() == alone.elevation_rad.tobytes()
    assert np.ptp(looks.azimuth_rad) > 6.0


def test_angles_are_those_of_a_point_on_the_line_of_sight() -> None:
    looks = seen()
    point_angles = azimuth_elevation_range(
        looks.sensor_ecef_m, looks.sensor_ecef_m + 4e7 * looks.line_of_sight_ecef
    )
    turned = np.sin(looks.azimuth_rad - point_angles.azimuth_rad) * np.cos(
        point_angles.elevation_rad
    )
    assert np.max(np.abs(turned)) < 1e-14
    assert np.max(np.abs(looks.elevation_rad - point_angles.elevation_rad)) < 1e-12


@pytest.mark.parametrize(
    "rows", [slice(0, 1), slice(3, 200, 7), slice(None, None, -1), slice(0, 0)]
)
def test_angles_do_not_depend_on_the_other_rows(rows: slice) -> None:
    looks = seen()
    assert looks.take(rows).azimuth_rad.tobytes() == looks.azimuth_rad[rows].tobytes()
    assert looks.take(rows).elevation_rad.tobytes() == looks.elevation_rad[rows].tobytes()


def test_a_sensor_that_stays_has_one_viewpoint() -> None:
    place = np.tile([4.2e7, 0.0, 0.0], (5, 1))
    sensor = np.array([0, 1, 0, 1, 1], dtype=np.int32)
    viewpoints = Viewpoints.of(sensor, place + np.array([0.0, 1.0, 0.0]) * sensor[:, None])
    assert viewpoints.position_ecef_m.tolist() == [[4.2e7, 0.0, 0.0], [4.2e7, 1.0, 0.0]]
    assert viewpoints.of_row.tolist() == sensor.tolist()


def test_what_is_not_known_is_nan_and_does_not_spread() -> None:
    place = np.tile([4.2e7, 0.0, 0.0], (4, 1))
    place[1, 2] = np.nan
    direction = np.tile([0.0, 1.0, 0.0], (4, 1))
    direction[2] = [np.nan, 0.0, 1.0]
    direction[3] = 0.0
    angles = stub_window(4, sensor_ecef_m=place, line_of_sight_ecef=direction).detections.angles()
    assert np.isnan(angles.azimuth_rad).tolist() == [False, True, True, True]
    assert np.isnan(angles.elevation_rad).tolist() == [False, True, True, True]


def test_no_detections_have_no_angles_and_no_times() -> None:
    nothing = Detections.empty()
    assert (
        nothing.angles().azimuth_rad.shape
        == nothing.elevation_rad.shape
        == nothing.time_s.shape
        == (0,)
    )


def test_seconds_are_the_nanoseconds() -> None:
    detections = stub_window(3, time_ns=[0, 60_050_000_000, 2**60 + 1]).detections
    assert detections.time_s.tolist() == [0.0, 60_050_000_000 * 1e-9, float(2**60 + 1) * 1e-9]


def test_records_import_no_geometry() -> None:
    program = (
        "import sys; import opir_core.interfaces.records; assert 'opir_core.geometry' not in"
        " sys.modules"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
