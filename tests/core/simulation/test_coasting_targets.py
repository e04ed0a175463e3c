"""Sensors that follow bodies: looks go on after burnout, at where the free flight is, and disturb
nobody.
"""

import numpy as np
import pytest

from opir_core import compile_plan, simulate
from opir_core.flight import propagate, propagate_kepler
from opir_core.flight.forces import J2
from opir_core.geometry import eci_to_ecef
from opir_core.reading import scene_from_mapping

LOW = {
    "circular": {
        "altitude_km": 1500.0,
        "inclination_deg": 30.0,
        "lon_asc_node_deg": -150.0,
        "arg_latitude_deg": 20.0,
    }
}


def sensor(id_, **settings):
    return {
        "model": "NEXTGEN-GEO",
        "id": id_,
        "scan_period_ms": 500.0,
        "detection_probability": {"ICBM": 0.9, "IRBM": 0.9, "SRBM": 0.9},
        "field_of_regard_half_angle_deg": 70.0,
        **settings,
    }


def scene(sensors, **settings):
    return scene_from_mapping(
        {
            "scene": "free-flight",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 2400.0,
            "seed": 5,
            "sensors": sensors,
            "targets": [
                {
                    "id": "T1",
                    "type": "ICBM",
                    "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
                    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
                }
            ],
            **settings,
        }
    )


FOLLOWER = sensor("LOW", orbit=LOW, follows_bodies=True)
GEO = sensor("GEO", orbital_slot_deg=-150.0, field_of_regard_half_angle_deg=10.0)


def test_only_a_follower_sees_the_body_after_burnout():
    run = simulate(scene([FOLLOWER, GEO]))
    burnout_s = compile_plan(scene([GEO])).targets.burnout_s[0]
    follower = run.detections.sensor == 0
    assert run.truth.emission_time_s[follower].max() > burnout_s + 600.0
    assert run.truth.emission_time_s[~follower].max() <= burnout_s


@pytest.mark.parametrize("forces", ["kepler", ["j2"]])
def test_bodies_fly_as_the_scenes_forces_have_it(forces):
    plan = compile_plan(scene([FOLLOWER], forces=forces))
    (target,) = plan.targets.truth()
    trajectories = plan.targets.trajectories[0]
    flight = trajectories.flight
    elapsed_s = np.linspace(1.0, float(trajectories.end_s[0] - flight.burnout_s[0]) - 1.0, 50)
    states = flight.burnout_position_eci_m[0], flight.burnout_velocity_eci_m_s[0]
    expected = (
        propagate_kepler(*states, elapsed_s)[0]
        if forces == "kepler"
        else propagate(*states, elapsed_s, J2)[0]
    )
    time_s = flight.burnout_s[0] + elapsed_s
    position_m = plan.targets.position_ecef_m(np.zeros(50, dtype=np.int32), time_s)
    assert np.linalg.norm(position_m - eci_to_ecef(expected, time_s), axis=1).max() < 0.02
    assert plan.targets.end_s[0] == target["impact"]["time_s"]


def test_a_follower_changes_no_byte_of_the_others():
    alone = simulate(scene([GEO]))
    beside = simulate(scene([GEO, FOLLOWER]))
    rows = np.flatnonzero(beside.detections.sensor == 0)
    for name in ("time_ns", "detection_id", "line_of_sight_ecef", "confidence", "detection_count"):
        assert (
            getattr(alone.detections, name).tobytes()
            == getattr(beside.detections, name)[rows].tobytes()
        )


def test_windows_change_no_byte():
    long, short = (simulate(scene([FOLLOWER]), window_s=window_s) for window_s in (2400.0, 37.3))
    assert len(long.detections) > 1000
    assert (
        long.detections.line_of_sight_ecef.tobytes()
        == short.detections.line_of_sight_ecef.tobytes()
    )
    assert long.detections.detection_id.tobytes() == short.detections.detection_id.tobytes()


def test_the_free_flight_is_not_fitted_where_nobody_follows():
    assert compile_plan(scene([GEO])).targets.trajectories[0].coast is None


def test_no_light_is_seen_after_impact():
    plan = compile_plan(scene([FOLLOWER]))
    run = simulate(scene([FOLLOWER]))
    assert run.truth.emission_time_s.max() <= plan.targets.end_s[0]
    assert np.isfinite(run.detections.line_of_sight_ecef).all()
