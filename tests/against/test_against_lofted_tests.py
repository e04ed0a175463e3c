"""Three public lofted tests of 2017, and how far the same stages would fly on a usual course
(D. Wright, Union of Concerned Scientists, 2017).

The stages of the class, their ideal speeds scaled until the steepest flight to the reported range
has the reported apogee, are aimed as far as they go. The published flat ranges leave the Earth's
rotation out, which adds nothing northwards to first order.
"""

import re

import pytest
from pyproj import Geod

import opir_core as opir
from opir_core.flight.staged.staging import stagings

GEOD = Geod(ellps="WGS84")

#: As reported: range, km; apogee, km; minutes of flight, least and most; as published: flat range,
#: km, least and most. Last the scale of the ideal speeds that gives the apogee.
TESTS = {
    "4 July": (930.0, 2800.0, (37.0, 37.0), (6700.0, 6700.0), 0.85317),
    "28 July": (1000.0, 3700.0, (45.0, 47.0), (9000.0, 10_000.0), 0.91567),
    "28 November": (960.0, 4500.0, (54.0, 54.0), (13_000.0, 20_000.0), 0.95964),
}


def plan_of(bearing_deg, range_km, scale, **settings):
    """Return the plan of one flight with scaled stages, over a range in a direction."""
    lon, lat, _ = GEOD.fwd(127.0, 40.0, bearing_deg, range_km * 1e3)
    preset = stagings()["ICBM_liquid"].stages
    target = {
        "id": "T",
        "model": "gravity-turn",
        "type": "ICBM",
        "stages": [
            {
                "burn_time_s": stage.burn_time_s,
                "ideal_speed_m_s": stage.ideal_speed_m_s * scale,
                "growth": stage.growth,
                "gap_s": stage.gap_s,
            }
            for stage in preset
        ],
        "launch": {"lat_deg": 40.0, "lon_deg": 127.0, "time_s": 1.0},
        "aim": {"lat_deg": lat, "lon_deg": lon},
        **settings,
    }
    scene = {
        "scene": "lofted",
        "epoch": "2017-07-04T00:40:00Z",
        "duration_s": 60,
        "seed": 1,
        "sensors": [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": 105.0}],
        "targets": [target],
        "outputs": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene))


def refusal_km(pattern, *arguments, **settings):
    """Return the last number of the words with which a flight is refused."""
    with pytest.raises(opir.SceneError) as refused:
        plan_of(*arguments, **settings)
    return float(re.findall(pattern, str(refused.value))[-1])


@pytest.mark.slow
@pytest.mark.parametrize("name", TESTS)
def test_a_lofted_test_lasts_as_long_and_would_fly_as_far_as_published(name):
    range_km, apogee_km, minutes, flat_km, scale = TESTS[name]
    steepest_km = refusal_km(r"to (\d+) km", 90.0, range_km, scale, apogee_km=50_000.0)
    assert steepest_km == pytest.approx(apogee_km, rel=0.002)
    flown = plan_of(90.0, range_km, scale, apogee_km=0.999 * apogee_km).targets.truth()[0]
    lasted_min = (flown["impact"]["time_s"] - flown["ignition_s"]) / 60.0
    assert 0.98 * minutes[0] <= lasted_min <= 1.02 * minutes[1]
    farthest_km = refusal_km(r"at most about (\d+) km", 0.0, 19_500.0, scale)
    assert 0.92 * flat_km[0] <= farthest_km <= 1.08 * flat_km[1]
