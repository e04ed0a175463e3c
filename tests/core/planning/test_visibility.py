"""Lines of sight between grid points: what is interpolated stays within its stated bound, what is
certain is true.
"""

import numpy as np
import pytest
from attrs import evolve, frozen

import opir_core as opir
from opir_core import Engine, Plan, compile_plan
from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2, SPEED_OF_LIGHT_M_S
from opir_core.geometry import elevation_rad, grazing_height_m, is_occluded
from opir_core.planning import PairCompiler, look_times_s, visible_now
from opir_core.planning.sightlines import Visibility
from opir_core.plugin import Sensor


@frozen
class PolarOrbit:
    """A circular polar orbit over longitude 0 of an Earth that does not turn: a fast sensor close
    by.
    """

    height_m: float
    start_rad: float
    is_stationary: bool = False

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        radius_m = 6.378137e6 + self.height_m
        angle = self.start_rad + np.sqrt(EARTH_MU_M3_S2 / radius_m**3) * time_s
        return radius_m * np.stack([np.cos(angle), np.zeros_like(angle), np.sin(angle)], axis=1)


def plan(target_type: str, aim_lat_deg: float, launch_lat_deg: float = 5.0) -> Plan:
    scene = opir.scene_from_mapping(
        {
            "scene": "sight",
            "epoch": "2026-04-01T00:00:00Z",
            "duration_s": 400.0,
            "classification": "none",
            "sensors": [
                {"model": "DSP", "id": f"S{slot}", "orbital_slot_deg": slot, "scan_period_ms": 37.0}
                for slot in (-120.0, -80.0, 0.0, 40.0, 82.0)
            ],
            "targets": [
                {
                    "id": "T",
                    "type": target_type,
                    "launch": {"lat_deg": launch_lat_deg, "lon_deg": 0.0, "time_s": 1.3},
                    "aim": {"lat_deg": aim_lat_deg, "lon_deg": 3.0},
                }
            ],
        }
    )
    return compile_plan(scene)


def with_orbits(subject: Plan, height_m: float) -> Plan:
    """Return the plan with its sensors in low orbits, from all around the pass over the launch."""
    sensors = tuple(
        evolve(sensor, orbit=PolarOrbit(height_m, start), field_of_regard_half_angle_rad=1.5)
        for sensor, start in zip(
            subject.sensors, np.linspace(-0.4, 0.3, len(subject.sensors)), strict=True
        )
    )
    pairs, sightlines = PairCompiler(
        sensors, subject.targets, [0.0] * len(sensors), True, subject.end_ns
    ).compiled()
    return evolve(subject, sensors=sensors, pairs=pairs, sightlines=sightlines)


PLANS = {
    "ICBM": lambda: plan("ICBM", 75.0),
    "IRBM": lambda: plan("IRBM", 40.0),
    "SRBM": lambda: plan("SRBM", 10.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PLANS)
@pytest.mark.parametrize(("height_m", "sine_bound"), [(None, 3e-6), (500e3, 3e-5), (1000e3, 3e-5)])
def test_light_times_and_elevations_stay_within_their_bounds(
    name: str, height_m: float, sine_bound: float
) -> None:
    compiled = PLANS[name]()
    compiled = compiled if height_m is None else with_orbits(compiled, height_m)
    window = Engine(compiled).advance(compiled.end_ns)
    detections = window.detections
    truth = window.truth
    target_m = compiled.targets.position_ecef_m(truth.target, truth.emission_time_s)
    look_s = detections.time_ns * 1e-9
    travel_s = look_s - truth.emission_time_s
    exact_s = np.linalg.norm(target_m - detections.sensor_ecef_m, axis=1) / SPEED_OF_LIGHT_M_S
    inner = truth.emission_time_s < compiled.targets.burnout_s[0] - 1e-6
    assert inner.sum() > 100
    assert np.max(np.abs(travel_s - exact_s)[inner]) < 5e-8
    exact = np.sin(elevation_rad(target_m, detections.sensor_ecef_m))
    assert np.max(np.abs(truth.target_elevation_sine - exact)) < sine_bound


@pytest.mark.parametrize("height_m", [None, 500e3])
def test_what_is_certain_is_true(height_m: float | None) -> None:
    """Every scan of every pair, judged exactly, agrees with what the plan holds for certain: no
    look is no sight.
    """
    compiled = PLANS["ICBM"]()
    compiled = compiled if height_m is None else with_orbits(compiled, height_m)
    judged = dict.fromkeys(Visibility, 0)
    for pair in range(len(compiled.pairs)):
        scans = np.arange(1, 6800)
        time_s = look_times_s(compiled.pairs, np.full(len(scans), pair), scans)
        sensor = compiled.sensors[compiled.pairs.sensor[pair]]
        exact, inside = seen_exactly(compiled, sensor, time_s)
        is_look = (
            (compiled.pairs.first_scan[pair] <= scans) & (scans <= compiled.pairs.last_scan[pair])
        )[inside]
        sight = np.full(len(is_look), Visibility.NEVER)
        point = compiled.sightlines.first_point[pair] + np.floor(time_s[inside][is_look]).astype(
            int
        )
        sight[is_look] = compiled.sightlines.sight[point]
        assert exact[sight == Visibility.ALWAYS].all()
        assert not exact[sight == Visibility.NEVER].any()
        for kind in Visibility:
            judged[kind] += int((sight == kind).sum())
    assert judged[Visibility.ALWAYS] > 1000
    assert judged[Visibility.NEVER] > 1000
    assert judged[Visibility.UNCERTAIN] < judged[Visibility.ALWAYS] / 5


def seen_exactly(
    subject: Plan, sensor: Sensor, time_s: FloatArray
) -> tuple[np.ndarray, np.ndarray]:
    """Return, for the looks that fall into the burn, whether they see the target; light time is
    solved for.
    """
    sensor_m = sensor.orbit.position_ecef_m(time_s)
    ignition_s = subject.targets.ignition_s[0]
    burnout_s = subject.targets.burnout_s[0]
    emission_s = time_s - 0.0
    for _ in range(4):
        held = np.clip(emission_s, ignition_s, burnout_s)
        target_m = subject.targets.position_ecef_m(np.zeros(len(time_s), dtype=np.int32), held)
        emission_s = time_s - np.linalg.norm(target_m - sensor_m, axis=1) / SPEED_OF_LIGHT_M_S
    inside = (emission_s > ignition_s) & (emission_s < burnout_s)
    return visible_now(sensor, sensor_m[inside], target_m[inside]), inside


def test_a_sensor_at_the_horizon_sees_what_grazes_the_ellipsoid() -> None:
    compiled = PLANS["ICBM"]()
    sensor = compiled.sensors[0]
    sensor_m = sensor.orbit.position_ecef_m(np.zeros(2000))
    heights = np.linspace(0.0, 4e5, 2000)
    from opir_core.geometry import geodetic_to_ecef

    target_m = geodetic_to_ecef(np.full(2000, 0.1), np.full(2000, np.radians(5.0)), heights)
    wide = evolve(sensor, field_of_regard_half_angle_rad=np.pi)
    assert np.array_equal(visible_now(wide, sensor_m, target_m), ~is_occluded(sensor_m, target_m))


def test_lines_of_sight_far_above_the_horizon_need_no_grazing_height(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Neither do those that another condition rules out; near the horizon the exact angles decide."""
    from opir_core.planning import visibility

    searched = []

    def grazing_m(*places_m: FloatArray, exact_above_m: float) -> FloatArray:
        searched.append(len(places_m[0]))
        return grazing_height_m(*places_m, exact_above_m=exact_above_m)

    sensor = PLANS["ICBM"]().sensors[0]
    monkeypatch.setattr(visibility, "grazing_height_m", grazing_m)
    (sensor_m,) = sensor.orbit.position_ecef_m(np.zeros(1))
    turn = np.linspace(0.0, np.pi, 721)
    across = np.cross(sensor_m, [0.0, 0.0, 1.0])
    unit = [vector / np.linalg.norm(vector) for vector in (sensor_m, across)]
    target_m = 6.5e6 * (np.cos(turn)[:, None] * unit[0] + np.sin(turn)[:, None] * unit[1])
    sensor_m = np.broadcast_to(sensor_m, target_m.shape)
    elevation = elevation_rad(target_m, sensor_m)
    for least_rad in (0.0, 0.1, -0.1):
        looking = evolve(
            sensor, field_of_regard_half_angle_rad=np.pi, minimum_elevation_rad=least_rad
        )
        clear = (elevation > 0.0) | (grazing_height_m(sensor_m, target_m) > 0.0)
        expected = (elevation > least_rad) & clear
        assert np.array_equal(visible_now(looking, sensor_m, target_m), expected)
    assert searched == [np.count_nonzero((elevation <= 0.0) & (elevation > -0.1))]


@pytest.mark.parametrize("start_s", [59.99, 60.0, 61.0, 500.0])
def test_targets_after_the_end_of_the_scene_are_not_seen(
    start_s: float,
) -> None:
    scene = {
        "scene": "late",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "sensors": [{"model": "DSP", "id": "S", "orbital_slot_deg": 0.0}],
        "detection": "snr",
        "sources": [
            {
                "id": "b",
                "model": "bolides",
                "at": [{"lat_deg": 1.0, "lon_deg": 2.0, "start_s": start_s}],
            }
        ],
        "outputs": [],
    }
    compiled = compile_plan(opir.scene_from_mapping(scene))
    assert all(
        np.isfinite(column).all()
        for column in (compiled.sightlines.travel_s, compiled.sightlines.elevation_sine)
    )
    truth = Engine(compiled).advance(compiled.end_ns).truth
    assert np.all(truth.target < 0)
