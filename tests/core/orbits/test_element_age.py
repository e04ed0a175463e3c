"""Elements of another time than the scene's give a warning, with what their age does to a
position.
"""

import numpy as np
import pytest
from space_station import LINE_1, LINE_2, OMM

from opir_core import compile_plan, scene_from_mapping
from opir_core.orbits import OrbitConfig, orbit_of
from opir_core.simulation import plan_warnings

DAY_US = 86_400_000_000
LINES = (LINE_1, LINE_2)
#: Of all that is above the horizon, so that its field of regard gives no warning.
WIDE = {"field_of_regard_half_angle_deg": 75.0}
EPOCH_US = int(np.datetime64("2008-09-20T12:25:40", "us").astype(np.int64))


@pytest.mark.parametrize(
    "config", [OrbitConfig(tle=LINES), OrbitConfig(omm=OMM)], ids=["tle", "omm"]
)
@pytest.mark.parametrize(
    ("days", "reported"),
    [
        (0.0, None),
        (13.0, None),
        (-13.0, None),
        (
            20.0,
            (
                "20 days older than the scene; SGP4 errs by 1 to 3 km a day, so the satellite may be 20"
                " to 60 km away"
            ),
        ),
        (-30.0, "30 days younger than the scene"),
        (
            400.0,
            (
                "400 days older than the scene; SGP4 errs by 1 to 3 km a day, so the satellite may be"
                " 400 to"
            ),
        ),
        (
            20 * 365.25,
            (
                "20.0 years older than the scene; SGP4 errs by 1 to 3 km a day, so the satellite may be"
                " any"
            ),
        ),
    ],
)
def test_the_age_of_elements_is_reported_beyond_two_weeks(config, days, reported):
    warnings = orbit_of(config, EPOCH_US + round(days * DAY_US)).warnings
    assert len(warnings) == (reported is not None)
    assert reported is None or reported in warnings[0]


@pytest.mark.parametrize("is_meant", [False, True])
def test_a_scene_tells_it_with_the_sensor_unless_it_is_meant(is_meant):
    scene = {
        "scene": "old",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "sensors": [{"model": "generic-scanner", "id": "S", "orbit": {"tle": list(LINES)}, **WIDE}],
        "allow_implausible": is_meant,
    }
    reported = plan_warnings(compile_plan(scene_from_mapping(scene)))
    assert [
        line for line in reported if "elements of object 25544 are 17.5 years older" in line
    ] == reported
    assert [line.partition(":")[0] for line in reported] == (
        [] if is_meant else ["sensors[0].orbit"]
    )
