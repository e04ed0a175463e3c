"""Narrow fields do not look beside the Sun or along the Earth's limb, where a scene says so."""

from typing import Any

import numpy as np
from directed_spot import LAUNCH_M, host_of, point_at, run, scene, spot_times_s, stay

import opir_core as opir
from opir_core.geometry import grazing_height_m, limb_angle_rad
from opir_core.geometry.sun import sun_ecef_m
from opir_core.simulation.undetected import undetected_text

#: An hour after midnight at the sensor the Sun is 14 deg beside the Earth's centre.
EPOCH = "2026-03-20T07:40:00Z"
WIDE: dict[str, Any] = {"field_of_regard_half_angle_deg": 40.0, "solar_exclusion_deg": 0.0}
EQUATORIAL_RADIUS_M = 6378137.0


def spot(keep_out: dict[str, Any], **settings: Any) -> dict[str, Any]:
    pointing = {"half_angle_deg": 0.5, "slew_deg_s": 1.0, "settle_s": 3.0, "delay_s": 2.0}
    return {**WIDE, "pointing": {**pointing, **keep_out}, **settings}


def sun_from_sensor(of: opir.Run, time_s: Any) -> Any:
    """Return unit vectors (n, 3) towards the Sun."""
    sensor_m = of.sensors[1].orbit.position_ecef_m(np.asarray(time_s))
    towards = sun_ecef_m(np.asarray(time_s), of.plan.scene.epoch_us) - sensor_m
    return towards / np.linalg.norm(towards, axis=1, keepdims=True)


def beside(towards: Any, angle_deg: float) -> Any:
    """Return a unit vector at an angle from another, away from the Earth's centre's side."""
    aside = np.cross(towards, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)
    angle_rad = np.radians(angle_deg)
    return np.cos(angle_rad) * towards + np.sin(angle_rad) * aside


def refusal(keep_out: dict[str, Any], direction: Any, **settings: Any) -> str:
    """Return what becomes of a command in a direction from SPOT."""
    plan = opir.compile_plan(scene(point_at(LAUNCH_M), epoch=EPOCH), host_of(point_at(LAUNCH_M)))
    (sensor_m,) = plan.sensors[1].orbit.position_ecef_m(np.zeros(1))
    place_m = sensor_m + 3e7 * direction
    of = run(point_at(place_m), epoch=EPOCH, duration_s=10.0, spot=spot(keep_out, **settings))
    (record,) = of.commands
    assert np.isnan(record.from_s) == bool(record.refusal)
    return record.refusal


def test_a_command_beside_the_sun_is_refused_with_its_angle() -> None:
    (sun,) = sun_from_sensor(run(point_at(LAUNCH_M), epoch=EPOCH, duration_s=1.0), [0.0])
    keep_out = {"sun_keep_out_deg": 5.0}
    words = "1.9 deg from the Sun; keep-out 5 deg"
    assert refusal(keep_out, beside(sun, 1.9)) == words
    assert refusal(keep_out, beside(sun, -1.9)) == words
    assert not refusal(keep_out, beside(sun, 5.01))
    assert refusal(keep_out, beside(sun, 4.99)) == "5.0 deg from the Sun; keep-out 5 deg"
    assert not refusal({}, beside(sun, 1.9))
    assert refusal({}, beside(sun, 1.9), solar_exclusion_deg=5.0) == words


def test_a_command_along_the_limb_is_refused_with_its_angle() -> None:
    """From the equator, in its plane, the limb is asin(a/r) from nadir."""
    (sensor_m,) = (
        run(point_at(LAUNCH_M), duration_s=1.0).sensors[1].orbit.position_ecef_m(np.zeros(1))
    )
    radius_m = np.linalg.norm(sensor_m)
    limb_deg = np.degrees(np.arcsin(EQUATORIAL_RADIUS_M / radius_m))
    keep_out = {"limb_keep_out_deg": 2.0}
    words = "1.2 deg from the Earth's limb; keep-out 2 deg"
    assert refusal(keep_out, beside(-sensor_m / radius_m, limb_deg + 1.2)) == words
    assert not refusal(keep_out, beside(-sensor_m / radius_m, limb_deg + 2.01))
    assert not refusal({}, beside(-sensor_m / radius_m, limb_deg + 1.2))


def test_the_limb_is_where_lines_of_sight_graze_the_ellipsoid() -> None:
    rng = np.random.default_rng(5)
    sensor_m = rng.normal(size=(50, 3))
    sensor_m *= rng.uniform(6.9e6, 4.2e7, (50, 1)) / np.linalg.norm(sensor_m, axis=1)[:, None]
    aside = np.cross(sensor_m, rng.normal(size=(50, 3)))
    aside *= (np.linalg.norm(sensor_m, axis=1) / np.linalg.norm(aside, axis=1))[:, None]
    low, high = np.zeros(50), np.full(50, np.pi / 2)
    for _ in range(60):
        middle = 0.5 * (low + high)
        place_m = (
            sensor_m * (1.0 - 3.0 * np.cos(middle))[:, None] + 3.0 * aside * np.sin(middle)[:, None]
        )
        is_clear = grazing_height_m(sensor_m, place_m) > 0.0
        low, high = np.where(is_clear, low, middle), np.where(is_clear, middle, high)
    np.testing.assert_allclose(limb_angle_rad(sensor_m, place_m), 0.0, atol=1e-7)


def test_looks_are_not_made_while_the_sun_is_within_the_keep_out() -> None:
    """The field stays at its own place; the Sun passes the edge of the keep-out in the middle."""
    at = {"at_deg": [34.0, -120.0]}
    free = run(lambda _: [], epoch=EPOCH, spot=spot(at))
    times_s = spot_times_s(free)
    assert len(times_s) > 800
    place_m = np.array(free.sensors[1].pointing.at_ecef_m)  # type: ignore[union-attr]
    sensor_m = free.sensors[1].orbit.position_ecef_m(times_s)
    axis = (place_m - sensor_m) / np.linalg.norm(place_m - sensor_m, axis=1, keepdims=True)
    angle_deg = np.degrees(np.arccos(np.sum(axis * sun_from_sensor(free, times_s), axis=1)))
    edge_deg = float(np.mean(np.sort(angle_deg)[len(times_s) // 2 :][:2]))
    kept = run(lambda _: [], epoch=EPOCH, spot=spot({**at, "sun_keep_out_deg": edge_deg}))
    assert spot_times_s(kept).tolist() == times_s[angle_deg > edge_deg].tolist()
    assert 0 < len(spot_times_s(kept)) < len(times_s)


def test_looks_are_not_made_along_the_limb() -> None:
    at = {"at_deg": [34.0, -120.0]}
    free = spot_times_s(run(lambda _: [], spot=spot(at))).tolist()
    # The place is 6 deg from nadir, and so 2.7 deg from the limb.
    near = run(lambda _: [], spot=spot({**at, "limb_keep_out_deg": 2.0}))
    beyond = run(lambda _: [], spot=spot({**at, "limb_keep_out_deg": 4.0}))
    assert spot_times_s(near).tolist() == free
    assert not len(spot_times_s(beyond))


def test_a_director_knows_what_is_kept_out() -> None:
    reach = []
    (sun,) = sun_from_sensor(run(point_at(LAUNCH_M), epoch=EPOCH, duration_s=1.0), [0.0])

    def decide(situation: Any) -> list[Any]:
        (sensor,) = situation.sensors
        (sensor_m,) = sensor.orbit.position_ecef_m(np.zeros(1))
        places_m = [sensor_m + 3e7 * beside(sun, angle_deg) for angle_deg in (4.0, 6.0)]
        reach.append(situation.in_reach("SPOT", np.array(places_m)).tolist())
        return []

    run(decide, epoch=EPOCH, duration_s=10.0, spot=spot({"sun_keep_out_deg": 5.0}))
    assert reach == [[False, True]]


def test_a_launch_outside_of_a_narrow_field_is_not_called_a_chance_miss() -> None:
    spot_alone = {"model": "SPOT", "id": "SPOT", "orbital_slot_deg": -100.0}
    of = run(stay, sensors=[spot_alone])
    assert undetected_text(of.plan, 0).startswith("outside of its narrow field, or by chance, in")
