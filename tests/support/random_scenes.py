"""Scenes at random, far from any that trackers were made on: sensors, targets and trackers."""

from typing import Any

from hypothesis import strategies as st


@st.composite
def sensors(draw):
    result = []
    for number in range(draw(st.integers(1, 3))):
        slot = draw(st.floats(-170.0, -60.0))
        low = {
            "altitude_km": draw(st.floats(500.0, 3000.0)),
            "inclination_deg": 80.0,
            "lon_asc_node_deg": slot,
        }
        is_low = draw(st.booleans()) and draw(st.booleans())
        chance = draw(st.sampled_from([0.3, 0.7, 1.0]))
        where = {"orbital_slot_deg": slot}
        if is_low:
            where = {"orbit": {"circular": low | {"arg_latitude_deg": draw(st.floats(0.0, 60.0))}}}
        result.append(
            {
                "model": "generic-scanner",
                "id": f"S{number}",
                **where,
                "field_of_regard_half_angle_deg": 90.0,
                "scan_period_ms": draw(st.sampled_from([100, 500, 2000, 5000])),
                "line_of_sight_sigma_urad": draw(st.sampled_from([0.01, 1.0, 20.0, 300.0])),
                "line_of_sight_bias_sigma_urad": draw(st.sampled_from([0.0, 0.0, 30.0])),
                "detection_probability": dict.fromkeys(("ICBM", "IRBM", "SRBM"), chance),
                "follows_bodies": draw(st.booleans()),
            }
        )
    return result


@st.composite
def targets(draw):
    aims = {"ICBM": (-30.0, 80.0), "IRBM": (-12.0, -25.0), "SRBM": (1.0, 4.0)}
    result = []
    for number in range(draw(st.integers(1, 3))):
        kind = draw(st.sampled_from(sorted(aims)))
        lat = draw(st.floats(20.0, 40.0))
        lon = draw(st.floats(-140.0, -100.0))
        aim = {"lat_deg": lat + aims[kind][0], "lon_deg": lon + aims[kind][1]}
        launch = {"lat_deg": lat, "lon_deg": lon, "time_s": draw(st.floats(0.0, 20.0))}
        result.append({"id": f"T{number}", "type": kind, "launch": launch, "aim": aim})
    return result


TRACKERS: list[Any] = [
    "kepler-arc",
    "imm",
    {"model": "imm", "cadence_s": 3.0},
    {"model": "imm", "needed_scans": 2, "late_s": 5.0},
]


def tracked_scene(sensors, targets, tracker, seed):
    """Return a scene of 70 s."""
    scene = {"scene": "any", "epoch": "2026-04-01T12:00:00Z", "duration_s": 70, "seed": seed}
    return {**scene, "sensors": sensors, "targets": targets, "tracker": tracker}
