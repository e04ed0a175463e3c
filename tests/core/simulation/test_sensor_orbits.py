"""A field of regard that suits another orbit is reported: a LEO sensor with a GEO's cone sees next
to nothing.
"""

import pytest

from opir_core import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.simulation import plan_warnings

LEO = {"circular": {"altitude_km": 500.0, "inclination_deg": 53.0, "lon_asc_node_deg": 0.0}}
MEO = {"circular": {"altitude_km": 8000.0, "inclination_deg": 53.0, "lon_asc_node_deg": 0.0}}
HEO = {"molniya": {"apogee_lon_deg": 10.0, "apogee_time_s": 21_600.0}}


def warnings_of(half_angle_deg=None, **sensor):
    if half_angle_deg is not None:
        sensor["field_of_regard_half_angle_deg"] = half_angle_deg
    scene = {
        "scene": "narrow",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "sensors": [{"id": "S", **sensor}],
        "tracker": "none",
    }
    return [
        line
        for line in plan_warnings(compile_plan(scene_from_mapping(scene)))
        if "field of regard" in line
    ]


@pytest.mark.parametrize(
    ("model", "half_angle_deg", "orbit"),
    [
        ("generic-scanner", None, {"slot": {"lon_deg": 10.0}}),
        ("generic-scanner", 2.0, {"slot": {"lon_deg": 10.0}}),
        ("generic-scanner", None, MEO),
        ("generic-scanner", 67.0, LEO),
        ("generic-scanner", 110.0, LEO),
        ("generic-scanner", 30.0, LEO),
        ("LEO-WIDE", None, LEO),
        ("HEO", None, HEO),
        ("SBIRS-GEO", None, HEO),
        ("SBIRS-GEO", None, LEO),
        ("DSP", None, LEO),
    ],
)
def test_fields_that_suit_their_orbits_raise_no_warning(model, half_angle_deg, orbit):
    assert warnings_of(half_angle_deg, model=model, orbit=orbit) == []


@pytest.mark.parametrize(
    ("model", "half_angle_deg", "orbit"),
    [
        ("SBIRS-GEO", 10.0, LEO),
        ("DSP", 10.0, LEO),
        ("generic-scanner", 10.0, LEO),
        ("generic-scanner", 0.5, {"slot": {"lon_deg": 10.0}}),
        ("generic-scanner", 0.5, MEO),
    ],
)
def test_fields_of_another_orbit_are_reported(model, half_angle_deg, orbit):
    (reported,) = warnings_of(half_angle_deg, model=model, orbit=orbit)
    assert reported.startswith("sensors[0]: its field of regard, ")


def test_the_share_is_that_of_spherical_caps():
    """At 500 km the horizon is 68 deg from nadir; 10 deg meet the ground 0.79 deg from the point
    below, 0.13 %.
    """
    (reported,) = warnings_of(10.0, model="generic-scanner", orbit=LEO)
    assert (
        "10 deg about nadir, holds 0.13% of the ground that it could see; the horizon is at 68 deg"
        in reported
    )
