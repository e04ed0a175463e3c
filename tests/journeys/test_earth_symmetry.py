"""Nothing but the Earth's turning tells one longitude, or one sidereal day, from another.

A scene turned as a whole about the Earth's axis (slots and nodes of sensors, launches and aims), or
shifted by whole sidereal days, has the same looks and detections, and its truth, ranges, angles and
probabilities stay to 1e-9.
"""

from typing import Any

import numpy as np
import pytest

from opir_core.geometry import gmst_rad
from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.reading.scene_schema import epoch_us_of_text, text_of_epoch_us
from opir_core.simulation.run import simulate

EPOCH = "2026-04-01T12:00:00Z"
BAR = 1e-9
CIRCULAR = {"altitude_km": 1400.0, "inclination_deg": 64.0, "arg_latitude_deg": 25.0}
FORCES: dict[str, Any] = {
    "kepler": "kepler",
    "drag": ["j2", "j3", {"drag": {"ballistic_coefficient_kg_m2": 900.0}}],
}
TURNS_DEG = (37.25, 180.0, -92.625)


def lon_deg(degrees):
    return (degrees + 180.0) % 360.0 - 180.0


def scene(forces, turn_deg=0.0, epoch=EPOCH, node="lon_asc_node_deg"):
    """Return a scene turned as a whole: two slots, a random scan, an orbit that moves, and a target
    of each class.
    """
    places = (
        ("ICBM", 34.73, -120.57, 9.0, 167.7),
        ("IRBM", 22.02, -159.78, 9.0, 167.7),
        ("SRBM", 64.0, 171.0, 66.0, 178.0),
    )
    node_deg = lon_deg(-170.0 + turn_deg) if node == "lon_asc_node_deg" else 31.0
    return {
        "scene": "symmetry",
        "epoch": epoch,
        "duration_s": 260.0,
        "seed": 3,
        "forces": forces,
        "sensors": [
            {"model": "DSP", "id": "A", "orbital_slot_deg": lon_deg(-125.0 + turn_deg)},
            {
                "model": "DSP",
                "id": "B",
                "orbital_slot_deg": lon_deg(-175.5 + turn_deg),
                "scan_phase": "random",
            },
            {"model": "SBIRS-GEO", "id": "C", "orbit": {"circular": {**CIRCULAR, node: node_deg}}},
        ],
        "targets": [
            {
                "id": f"T{number}",
                "type": kind,
                "launch": {
                    "lat_deg": lat,
                    "lon_deg": lon_deg(lon + turn_deg),
                    "time_s": 7.0 * number,
                },
                "aim": {"lat_deg": aim_lat, "lon_deg": lon_deg(aim_lon + turn_deg)},
            }
            for number, (kind, lat, lon, aim_lat, aim_lon) in enumerate(places)
        ],
    }


def whole(mapping):
    read = scene_from_mapping(mapping)
    return compile_plan(read), simulate(read)


def assert_same(one, turned_run, turn_deg):
    """Check looks exactly, and all else to the bar: of the Earth's radius, of the circle, of each
    number.
    """
    (plan, run), (plan_2, run_2) = one, turned_run
    assert plan.pairs.looks.tobytes() == plan_2.pairs.looks.tobytes()
    assert plan.pairs.blocked.tobytes() == plan_2.pairs.blocked.tobytes()
    assert len(run.detections) > 400
    for name in ("time_ns", "sensor", "scan", "reported_type", "bands", "detection_count"):
        assert (
            getattr(run.detections, name).tobytes() == getattr(run_2.detections, name).tobytes()
        ), name
    for name in ("confidence", "azimuth_rad", "elevation_rad"):
        close(getattr(run_2.detections, name), getattr(run.detections, name))
    for name in ("range_m", "emission_time_s", "probability", "target_elevation_sine"):
        close(getattr(run_2.truth, name), getattr(run.truth, name))
    turn = np.radians(turn_deg)
    for target, target_2 in zip(plan.targets.truth(), plan_2.targets.truth(), strict=True):
        for name in ("position_ecef_m", "velocity_ecef_m_s"):
            x, y, z = target["burnout"][name]
            turned = [np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y, z]
            close(target_2["burnout"][name], turned, scale=float(np.linalg.norm(turned)))
        close(target_2["burnout_s"], target["burnout_s"])
        close(target_2["impact"]["time_s"], target["impact"]["time_s"])
        close(target_2["impact"]["lat_deg"], target["impact"]["lat_deg"])


def close(result, expected, scale=0.0):
    np.testing.assert_allclose(result, expected, rtol=BAR, atol=BAR * max(scale, 1e-3))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("forces", "turn_deg"),
    [
        *(("kepler", turn_deg) for turn_deg in TURNS_DEG),
        ("drag", TURNS_DEG[0]),
        *(pytest.param("drag", turn_deg, marks=pytest.mark.slow) for turn_deg in TURNS_DEG[1:]),
    ],
)
def test_turning_a_scene_about_the_axis_changes_nothing(forces, turn_deg):
    assert_same(whole(scene(FORCES[forces])), whole(scene(FORCES[forces], turn_deg)), turn_deg)


def test_turning_the_sensors_alone_changes_much():
    """The comparison can fail."""
    turned = {**scene("kepler"), "sensors": scene("kepler", 5.0)["sensors"]}
    with pytest.raises(AssertionError):
        assert_same(whole(scene("kepler")), whole(turned), 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("days", [1, 366, 5000])
@pytest.mark.parametrize("node", ["lon_asc_node_deg", "raan_deg"])
def test_whole_sidereal_days_change_nothing(days, node):
    """A node in right ascension comes back over the same ground, as nearly as epochs are whole
    microseconds.
    """
    shifted = text_of_epoch_us(after_sidereal_days(days))
    assert_same(
        whole(scene("kepler", node=node)), whole(scene("kepler", epoch=shifted, node=node)), 0.0
    )


def after_sidereal_days(days):
    """Return the microsecond nearest to that many whole turns of sidereal time after the epoch."""
    start_us = epoch_us_of_text(EPOCH)
    shift_us = round(days * 86_164_090_531)
    for _ in range(3):
        excess = angle_between(start_us, start_us + shift_us)
        shift_us -= round(excess / 7.2921159e-11)
    assert abs(angle_between(start_us, start_us + shift_us)) < 1e-10
    return start_us + shift_us


def angle_between(first_us, second_us):
    angles = [float(gmst_rad(np.datetime64(time_us, "us"))) for time_us in (first_us, second_us)]
    return (angles[1] - angles[0] + np.pi) % (2.0 * np.pi) - np.pi
