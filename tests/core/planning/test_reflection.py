"""Sunlight on bodies: its amount by the geometry of each look, none in the Earth's shadow, none
before burnout.
"""

from unittest import mock

import numpy as np
import opir_photons.reflection
import pytest
from attrs import evolve
from cold_nozzles import silence_nozzles
from opir_photons.radiometry import band_radiance, solar_irradiance
from opir_photons.reflection import shadow_times_s

import opir_core as opir
import opir_core.geometry.sun
from opir_core.geometry import ecef_to_geodetic, local_axes, sun_position_ecef_m, sunlit_fraction
from opir_core.planning import Looks
from opir_core.plugin import Exposures, Paths
from opir_core.simulation import ProbabilityInterpolant

LOW = {
    "circular": {
        "altitude_km": 1500.0,
        "inclination_deg": 30.0,
        "lon_asc_node_deg": -170.0,
        "arg_latitude_deg": 20.0,
    }
}
SENSOR = {
    "model": "LEO-MEDIUM",
    "id": "L",
    "orbit": LOW,
    "bands": {"SWIR": [2.5, 3.0], "MWIR": [4.2, 4.45]},
}
EAST = (34.73, -120.57)
WEST = (9.0, 167.7)
#: At 04:00 both bodies fly from one side of the terminator to the other, at 14:00 one of them
#: twice, at 12:00 neither.
TWILIGHT = "2026-04-01T04:00:00"


@pytest.fixture(autouse=True)
def cold_nozzles(monkeypatch):
    silence_nozzles(monkeypatch)


def planned(epoch=TWILIGHT, albedo=0.3, detection="snr", sensors=(SENSOR,), **settings):
    targets = [
        {
            "id": name,
            "type": "ICBM",
            "launch": {"lat_deg": start[0], "lon_deg": start[1], "time_s": 10.0},
            "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
            "signature": {
                "model": "plume",
                "body_albedo": albedo,
                "body_area_m2": 5.0,
                "body_emissivity": 0.8,
            },
        }
        for name, start, aim in (("T1", EAST, WEST), ("T2", WEST, (30.0, -130.0)))
    ]
    scene = {"scene": "lit", "epoch": f"{epoch}Z", "duration_s": 2400.0, "seed": 5, "outputs": []}
    mapping = {
        **scene,
        "sensors": list(sensors),
        "targets": targets,
        "detection": detection,
        **settings,
    }
    return opir.compile_plan(opir.scene_from_mapping(mapping))


def late_looks(plan, step=10):
    """Exposures of looks after burnout, and the intensities that the scene's environment gives
    them.
    """
    geometry = plan.look_geometry()
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposures = geometry.exposures(looks.pair[::step], looks.scan[::step])
    exposures = exposures.take(
        np.flatnonzero(exposures.emission_time_s > plan.targets.burnout_s[exposures.target] + 1e-6)
    )
    environment = plan.detection.environment
    height_m = environment.paths(exposures).height_m
    aspect = environment.aspect_rad(exposures)
    return exposures, environment.intensities_w_sr((0, 1), exposures, height_m, aspect)


def expected_w_sr(plan, records, albedo):
    """Thermal and reflected light of both bands, from the geometry of each look."""
    sun_m = sun_position_ecef_m(np.datetime64(plan.scene.epoch_us, "us"), records.emission_time_s)
    to_sun = sun_m - records.target_ecef_m
    to_sensor = records.sensor_ecef_m - records.target_ecef_m
    distance_m = np.linalg.norm(to_sun, axis=1)
    cosine = np.sum(to_sun * to_sensor, axis=1) / distance_m / np.linalg.norm(to_sensor, axis=1)
    phase = np.arccos(cosine)
    law = (np.sin(phase) + (np.pi - phase) * cosine) / np.pi
    lit = sunlit_fraction(records.target_ecef_m, sun_m) * (149597870700.0 / distance_m) ** 2
    edges = ((2.5, 3.0), (4.2, 4.45))
    light = np.array([float(solar_irradiance(*edge)) for edge in edges])[:, None]
    warm = np.array([0.8 * 5.0 * float(band_radiance(300.0, *edge)) for edge in edges])[:, None]
    return warm, 2.0 / (3.0 * np.pi) * albedo * 5.0 * light * lit * law


@pytest.mark.slow
@pytest.mark.parametrize("epoch", [TWILIGHT, "2026-04-01T14:00:00", "2026-04-01T00:00:00"])
def test_bodies_reflect_by_phase_and_shadow(epoch):
    plan = planned(epoch)
    exposures, intensity_w_sr = late_looks(plan)
    warm, reflected = expected_w_sr(plan, exposures, 0.3)
    assert len(exposures) > 800
    assert intensity_w_sr == pytest.approx(warm + reflected, rel=3e-6)
    assert np.max(reflected[0]) > 5.0 * warm[0, 0]


def test_bodies_in_the_earths_shadow_reflect_nothing():
    epoch = "2026-04-01T14:00:00"
    exposures, intensity_w_sr = late_looks(planned(epoch))
    sun_m = sun_position_ecef_m(np.datetime64(epoch), exposures.emission_time_s)
    dark = sunlit_fraction(exposures.target_ecef_m, sun_m) == 0.0
    warm, _ = expected_w_sr(planned(epoch), exposures, 0.0)
    assert 100 < np.count_nonzero(dark) < len(dark) - 100
    assert intensity_w_sr[:, dark] == pytest.approx(
        np.broadcast_to(warm, intensity_w_sr[:, dark].shape), rel=1e-12
    )
    assert np.all(intensity_w_sr[:, ~dark] > warm)


def test_low_bodies_have_the_sunlight_that_the_air_leaves():
    """The last three minutes of a flight by day, as a satellite 1000 km above sees them."""
    clear = planned("2026-04-01T00:00:00")
    hazy = planned("2026-04-01T00:00:00", atmosphere="lowtran")
    time_s = clear.targets.end_s[0] - np.linspace(180.0, 0.5, 200)
    target = np.zeros(len(time_s), dtype=np.int32)
    position_m = clear.targets.position_ecef_m(target, time_s)
    sun_m = sun_position_ecef_m(np.datetime64("2026-04-01T00:00:00"), time_s)
    up = local_axes(position_m)[:, 2]
    range_m = np.full(len(time_s), 1e6)
    unit_column = np.ones(len(time_s))
    exposures = Exposures(
        time_s,
        time_s,
        target,
        target,
        target,
        range_m,
        unit_column,
        position_m,
        position_m + 1e6 * up,
    )
    height_m = ecef_to_geodetic(position_m).height_m
    plain, dimmed = (
        plan.detection.environment.intensities_w_sr((0, 1), exposures, height_m, unit_column)
        for plan in (clear, hazy)
    )
    warm, reflected = expected_w_sr(clear, exposures, 0.3)
    to_sun = sun_m - position_m
    sine = np.sum(up * to_sun, axis=1) / np.linalg.norm(to_sun, axis=1)
    path = Paths(height_m, sine, position_m, sun_m, time_s)
    air = np.array(
        [hazy.detection.environment.atmosphere.transmittance(band, path) for band in (0, 1)]
    )
    # Low down the air heats the body, too: below 200 km, what its signature says.
    step_m = clear.targets.position_ecef_m(target, time_s + 0.02) - clear.targets.position_ecef_m(
        target, time_s - 0.02
    )
    speed_m_s = np.linalg.norm(step_m, axis=1) / 0.04
    (signatures,) = clear.detection.environment.signatures
    heated = signatures.air_heated_w_sr((0, 1), target, height_m, speed_m_s)
    heated[:, height_m > 200e3] = 0.0
    assert np.all(heated[:, height_m < 100e3] > 0.0)
    assert plain == pytest.approx(warm + reflected + heated, rel=3e-6)
    assert dimmed == pytest.approx(warm + heated + air * reflected, rel=3e-6)
    assert np.all(air[:, height_m < 30e3] < 1.0)
    assert np.all(air[:, height_m > 101e3] == 1.0)
    assert 0 < np.count_nonzero(height_m < 30e3) < np.count_nonzero(height_m < 101e3) < len(time_s)


@pytest.mark.parametrize("epoch", [TWILIGHT, "2026-04-01T14:00:00"])
def test_the_edges_of_the_shadow_are_breakpoints(epoch):
    plan = planned(epoch)
    times_s = shadow_times_s(plan.targets, plan.scene.epoch_us)
    target, _ = np.nonzero(np.isfinite(times_s))
    edges_s = times_s[np.isfinite(times_s)]
    assert len(edges_s) >= 4
    for edge_s, number in zip(edges_s.tolist(), target.tolist(), strict=True):
        around_s = edge_s + np.array([-0.01, 0.01])
        position = plan.targets.position_ecef_m(np.full(2, number, dtype=np.int32), around_s)
        shares = sunlit_fraction(position, sun_position_ecef_m(np.datetime64(epoch), around_s))
        assert (shares[0] in (0.0, 1.0)) != (shares[1] in (0.0, 1.0))
    breakpoints_s = plan.detection.breakpoints_s()
    assert all(
        np.any(np.isclose(breakpoints_s[row], edge, atol=1e-9))
        for row, edge in zip(target, edges_s, strict=True)
    )


def test_interpolated_probabilities_at_the_edges_of_the_shadow():
    """A threshold between the warm and the lit body: P_d jumps at the shadow within a few
    seconds.
    """
    plan = planned(sensors=({**SENSOR, "nei_w_m2": 6e-14, "spectral_discrimination": "none"},))
    geometry = plan.look_geometry()
    model = plan.detection
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    interpolant = ProbabilityInterpolant.of(geometry, model, model.probability_tolerance)
    probability = interpolant.over(looks).probability()
    exact = model.probability(geometry.exposures(looks.pair, looks.scan))
    assert np.mean((exact > 0.01) & (exact < 0.99)) > 0.05
    assert np.ptp(exact) > 0.9
    assert np.max(np.abs(probability - exact)) < 2.0 * model.probability_tolerance


def test_without_followed_bodies_nobody_asks_for_the_sun():
    plumes = {**SENSOR, "follows_bodies": False, "solar_exclusion_deg": 0.0}
    with (
        mock.patch.object(opir_photons.reflection, "sun_ecef_m") as sun,
        mock.patch.object(opir_core.geometry.sun, "sun_position_eci_m") as deeper,
    ):
        plan = planned(sensors=(plumes,))
        run = opir.simulate(plan.scene)
    assert len(run.detections) > 100
    assert plan.detection.environment.sunlight is None
    assert sun.call_count == deeper.call_count == 0


def test_black_bodies_need_no_sun_and_add_nothing():
    plan = planned(albedo=0.0)
    exposures, intensity_w_sr = late_looks(plan)
    warm, _ = expected_w_sr(plan, exposures, 0.0)
    assert plan.detection.environment.sunlight is None
    assert intensity_w_sr == pytest.approx(np.broadcast_to(warm, intensity_w_sr.shape), rel=1e-12)


def test_a_plume_reflects_nothing():
    plan = planned("2026-04-01T00:00:00")
    environment = plan.detection.environment
    geometry = plan.look_geometry()
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposures = geometry.exposures(looks.pair, looks.scan)
    exposures = exposures.take(
        np.flatnonzero(exposures.emission_time_s <= plan.targets.burnout_s[exposures.target])
    )
    columns = (
        (0, 1),
        exposures,
        environment.paths(exposures).height_m,
        environment.aspect_rad(exposures),
    )
    dark = evolve(environment, sunlight=None)
    assert len(exposures) > 100
    assert np.array_equal(environment.intensities_w_sr(*columns), dark.intensities_w_sr(*columns))
