"""Sensors with a focal plane: noise, clutter, saturation and lines of sight worked out anew from
the settings.
"""

import math
from typing import Any

import numpy as np
import pytest
from opir_photons.detection import cfar_loss
from opir_photons.radiometry import (
    FilteredSpot,
    FrameDifference,
    PointSpread,
    SpatialTransfer,
    centroid_sigma_rad,
    filter_weights,
    noise_gain,
)
from scipy.constants import c, h
from scipy.special import ndtr
from snr_scene import DSP, NEXTGEN, SBIRS, joined, looks_of, scene, windows_of

import opir_core as opir
from opir_core import Engine
from opir_core.planning import Looks
from opir_core.plugin import FocalPlaneConfig
from opir_core.reading import scene_mapping
from opir_core.scene.field_rows import named_values
from opir_core.simulation import ProbabilityInterpolant
from opir_core.simulation.explanation import explained

CLOUD = {"atmosphere": {"model": "lowtran", "cloud": {"top_km": 8.0}}, "background": "earth"}
BY_DAY = {"epoch": "2026-04-01T22:00:00Z"}
SKIES = {
    "cloud by day": {**CLOUD, **BY_DAY},
    "clear by night": {"atmosphere": "lowtran", "background": "earth"},
}


def with_plane(sensor: dict[str, Any], plane: Any = "notional", **changes: Any) -> dict[str, Any]:
    computed = {name: value for name, value in sensor.items() if name != "nei_w_m2"}
    # A block is one plane for all bands.
    return {
        **computed,
        "focal_plane": plane,
        **({} if plane == "notional" else {"band_focal_plane": {}}),
        **changes,
    }


def spot_rad(plane: Any, middle_um: float) -> float:
    airy = math.sqrt(2.0) / math.pi * middle_um * 1e-6 / plane.aperture_m
    smear = plane.drift_urad_s * plane.integration_time_ms * 1e-3
    return math.sqrt(
        airy**2 + 1e-12 * (plane.blur_urad**2 + plane.jitter_urad**2 + smear**2 / 24.0)
    )


def spread_of(plane: Any, middle_um: float, pixel_rad: float) -> PointSpread:
    smear = plane.drift_urad_s * plane.integration_time_ms * 1e-3
    blur = 1e-6 * math.sqrt(plane.blur_urad**2 + plane.jitter_urad**2 + smear**2 / 24.0)
    return PointSpread.of(middle_um, plane.aperture_m, blur, pixel_rad)


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
@pytest.mark.parametrize(
    "changes",
    [
        {"spatial_filter": "surround", "temporal_filter": "none"},
        pytest.param({}, marks=pytest.mark.slow),
        pytest.param({"spatial_filter": "sum", "core_pixels": 2}, marks=pytest.mark.slow),
    ],
)
def test_noise_of_electrons_photons_and_structure(sky: str, changes: dict[str, Any]) -> None:
    """σ² = (electrons without light + photons of the background) / gain² + structure left by the
    filters.
    """
    planes = {
        "D": {"aperture_m": 0.9, "blur_urad": 18.0},
        "B": {},
        "N": {"aperture_m": 1.0, "blur_urad": 4.0},
    }
    # Cold optics and a given dark current: detectors have tests of their own.
    cold = {
        "dark_current_e_s": 5e9,
        "optics_temperature_k": 0.0,
        "bits": 12,
        "subframes": 16,
        "read_noise_e": 100.0,
    }
    cold |= {
        "optics_transmission": 0.7,
        "quantum_efficiency": 0.7,
        "registration_urad": 0.5,
        "drift_urad_s": 0.02,
    }
    cold |= {"integration_time_ms": 10.0, "jitter_urad": 2.5}
    sensors = [
        with_plane(one, {**cold, **planes[one["id"]], **changes}) for one in (DSP, SBIRS, NEXTGEN)
    ]
    plan = opir.compile_plan(scene(sensors, "IS", **SKIES[sky]))
    exposed = looks_of(plan, 97)
    result = plan.detection.response(exposed)
    chain = plan.detection.environment
    for number, sensor in enumerate(plan.sensors):
        rows = np.flatnonzero(exposed.sensor == number)
        own = exposed.take(rows)
        light = sensor.radiometer
        plane = light.focal_planes[0]
        pixel = light.ifov_rad
        view = chain.views(own)
        bands = [chain.bands.index(band) for band in sensor.bands]
        radiance, rms, part = chain.background.structured_radiances_w_m2_sr(bands, view)
        range_m = np.linalg.norm(view.point_ecef_m - own.sensor_ecef_m, axis=1)
        for place, band in enumerate(sensor.bands):
            middle_um = 0.5 * (band.lower_um + band.upper_um)
            sigma = spot_rad(plane, middle_um)
            weights = filter_weights(plane.spatial_filter, plane.core_pixels, sigma, pixel)
            spread = spread_of(plane, middle_um, pixel)
            gain = float(FilteredSpot.of(weights, spread).response())
            frames = 1 + (plane.temporal_filter == "difference")
            area = math.pi / 4 * plane.aperture_m**2 * 0.49 * 0.9
            per_unit = area * plane.integration_time_ms * 1e-3 * middle_um * 1e-6 / (h * c)
            electrons = plane.dark_current_e_s * plane.integration_time_ms * 1e-3
            electrons = electrons + 16 * (
                100.0**2 + (plane.well_capacity_e / 2.0**plane.bits) ** 2 / 12.0
            )
            electrons = electrons + radiance[place] * pixel**2 * per_unit
            clutter = np.empty(len(rows))
            for row in range(len(rows)):
                structure = chain.background.structures[part[row]]
                lag = (
                    FrameDifference(plane.lag_s, 0.5e-6 / pixel, 0.02e-6 / pixel)
                    if frames == 2
                    else None
                )
                scale = structure.scale_m / range_m[row] / pixel
                remaining = SpatialTransfer.of(weights, spread).variance(
                    scale, structure.exponent, lag
                )
                clutter[row] = rms[place, row] * pixel**2 * math.sqrt(float(remaining)) / gain
            noise = np.sqrt(noise_gain(weights) * frames * electrons) / per_unit / gain
            expected = np.hypot(noise, clutter)
            np.testing.assert_allclose(result.noise_w_m2[rows, place], expected, rtol=3e-4)


def test_notional_clutter_exceeds_detector_noise() -> None:
    """Sunlit cloud leaves several times the noise of the detectors in every band."""
    sensors = [with_plane(one) for one in (DSP, SBIRS, NEXTGEN)]
    plan = opir.compile_plan(scene(sensors, "IRS", duration_s=100, **SKIES["cloud by day"]))
    exposed = looks_of(plan)
    noise = plan.detection.response(exposed).noise_w_m2
    for number, most in ((0, (300.0,)), (1, (60.0, 60.0)), (2, (60.0, 60.0, 120.0))):
        computed = np.array(plan.detection.receivers[number].radiometer.nei_w_m2)
        rows = exposed.sensor == number
        above = np.median(noise[rows][:, : len(most)], axis=0) / computed
        assert np.all(above > 2.0)
        assert np.all(above < most)


@pytest.mark.slow
def test_structure_costs_detections_by_day_only() -> None:
    seen = {}
    for sky, changes in SKIES.items():
        for name, plane in (
            ("still", {"registration_urad": 0.0, "drift_urad_s": 0.0}),
            ("notional", "notional"),
        ):
            # A threshold near the signals of faint plumes.
            sensor = with_plane(SBIRS, plane, threshold_sigma=60.0)
            plan = opir.compile_plan(scene([sensor], "IRS", duration_s=150, **changes))
            seen[sky, name] = float(plan.detection.probability(looks_of(plan)).mean())
    assert seen["cloud by day", "notional"] < 0.97 * seen["cloud by day", "still"]
    assert seen["clear by night", "notional"] == pytest.approx(
        seen["clear by night", "still"], rel=0.03
    )


@pytest.mark.slow
def test_a_well_limits_the_signal_and_a_full_one_leaves_none() -> None:
    def signals(well_e: float, **sky: Any) -> np.ndarray:
        plane = {
            "well_capacity_e": well_e,
            "dark_current_e_s": 0.0,
            "optics_temperature_k": 0.0,
            "fill_factor": 1.0,
        }
        plane["temporal_filter"] = "none"
        plan = opir.compile_plan(scene([with_plane(SBIRS, plane)], "I", **sky))
        response = plan.detection.response(looks_of(plan))
        return response.snr * response.noise_w_m2

    total = signals(1e9)
    limited = signals(2e3)
    # 16 subframes; the brightest pixel has the mean shares 0.4985 and 0.4730 of Airy patterns
    # blurred by 0.33 pixels: tests/against/test_against_displaced_spots.py holds such shares
    # against images.
    per_unit = math.pi / 4 * 0.36 * 0.49 * 0.01 * np.array([2.75e-6, 4.5e-6]) / (h * c)
    most = 16 * 2e3 / per_unit / [0.4985, 0.4730]
    np.testing.assert_allclose(limited, np.minimum(total, most), rtol=5e-3)
    assert np.all(total.max(axis=0) > most)
    assert np.all(signals(1e3, **SKIES["cloud by day"]) == 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("temporal", ["none", "difference"])
def test_lines_of_sight_have_the_bound_of_their_centroids(temporal: str) -> None:
    plane = {"temporal_filter": temporal, "dark_current_e_s": 5e9}
    sensor = with_plane(SBIRS, plane, line_of_sight_sigma_urad=0.0, spectral_discrimination="none")
    plan = opir.compile_plan(scene([{**sensor, "bands": {"SWIR": [2.5, 3.0]}}], "I"))
    result, truth = joined(windows_of(plan, [60.0]))
    rows = truth.target >= 0
    config = plan.sensors[0].radiometer.focal_planes[0]
    pixel = plan.sensors[0].radiometer.ifov_rad
    sigma = spot_rad(config, 2.75)
    weights = filter_weights("matched", 1, sigma, pixel)
    gain = float(FilteredSpot.of(weights, spread_of(config, 2.75, pixel)).response())
    pixel_snr = result.snr[rows] * math.sqrt(noise_gain(weights)) / gain
    per_unit = math.pi / 4 * 0.36 * 0.49 * 0.9 * 0.01 * 2.75e-6 / (h * c)
    signal_e = result.band_irradiance_w_m2[rows, 0] * per_unit
    selected = slice(None, None, max(1, int(rows.sum()) // 40))
    expected = centroid_sigma_rad(pixel_snr[selected], sigma, pixel, signal_e[selected])
    np.testing.assert_allclose(result.line_of_sight_sigma_rad[rows][selected], expected, rtol=0.05)
    assert expected.min() < 0.2 * pixel
    floored = opir.compile_plan(scene([{**sensor, "line_of_sight_sigma_urad": 30.0}], "I"))
    assert joined(windows_of(floored, [60.0]))[0].line_of_sight_sigma_rad.min() >= 30e-6


def test_reference_cells_divide_snr_by_the_loss() -> None:
    known, estimated = (
        opir.compile_plan(scene([with_plane(DSP, {"reference_cells": cells})], "I"))
        for cells in (None, 24)
    )
    snr = [plan.detection.response(looks_of(plan)).snr for plan in (known, estimated)]
    np.testing.assert_allclose(snr[0], snr[1] * float(cfar_loss(ndtr(-5.0), 24)), rtol=1e-9)
    assert snr[1].max() > 1.0
    assert known.detection.rate_per_scan.tolist() == estimated.detection.rate_per_scan.tolist()


@pytest.mark.slow
def test_clutter_that_stays_is_confirmed_over_scans() -> None:
    """Registration errors are new in every frame; what drift leaves is there again in the next
    scan.
    """
    confirmed = {}
    for name, plane in {
        "none": None,
        "registration": {"registration_urad": 1.0, "drift_urad_s": 0.0},
        "drift": {"registration_urad": 0.0, "drift_urad_s": 1.0},
    }.items():
        sensor = {
            **SBIRS,
            "focal_plane": plane,
            "confirmation_detections": 2,
            "confirmation_scans": 3,
        }
        plan = opir.compile_plan(scene([sensor], "I", **SKIES["cloud by day"]))
        confirmed[name] = float(plan.detection.rate_per_scan[0] / plan.detection.noise_chance[0])
    assert confirmed["registration"] == pytest.approx(confirmed["none"], rel=0.05)
    assert confirmed["drift"] > 1e4 * confirmed["none"]


def test_worst_phase_and_given_noise() -> None:
    mean, worst = (
        opir.compile_plan(scene([with_plane(SBIRS, plane)], "I")).detection.receivers[0]
        for plane in ({}, {"phase": "worst"})
    )
    given = opir.compile_plan(scene([with_plane(SBIRS, nei_w_m2=1e-12)], "I")).detection.receivers[
        0
    ]
    share = {"mean": 0.4985, "worst": 0.2394}
    assert mean.plane.peak_share[0] == pytest.approx(share["mean"], abs=2e-3)
    assert worst.plane.peak_share[0] == pytest.approx(share["worst"], abs=2e-3)
    assert worst.radiometer.nei_w_m2[0] > 1.5 * mean.radiometer.nei_w_m2[0]
    assert given.radiometer.nei_w_m2 == (1e-12, 1e-12)


@pytest.mark.slow
def test_between_knots_no_look_is_off_by_more_than_the_tolerance() -> None:
    sensors = [with_plane(one) for one in (DSP, SBIRS, NEXTGEN)]
    plan = opir.compile_plan(scene(sensors, duration_s=150, **SKIES["cloud by day"]))
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exact = plan.detection.response(plan.look_geometry().exposures(looks.pair, looks.scan))
    interpolant = ProbabilityInterpolant.of(plan.look_geometry(), plan.detection, 1e-4)
    assert np.abs(interpolant.over(looks).probability() - ndtr(exact.probit)).max() <= 1e-4
    assert len(interpolant.at[0]) < 0.5 * len(looks.pair)


def test_windows_do_not_change_results() -> None:
    plan = opir.compile_plan(
        scene([with_plane(SBIRS), with_plane(NEXTGEN)], **SKIES["cloud by day"])
    )
    total, parts = (joined(windows_of(plan, edges)) for edges in ([60.0], [7.3, 7.4, 31.0, 60.0]))
    for one, other in zip(total, parts, strict=True):
        for name in (
            "time_ns",
            "detection_id",
            "line_of_sight_ecef",
            "line_of_sight_sigma_rad",
            "probability",
        ):
            if hasattr(one, name):
                assert np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True)
    assert len(total[0]) > 100


def test_a_scene_that_names_none_has_the_same_noise_as_ever() -> None:
    """A background of any structure is clutter by its residual to sensors without a focal plane."""
    rough = {"model": "earth", "structure": {"cloud": {"thermal_rms": 5.0, "solar_rms": 5.0}}}
    plain, structured = (
        opir.compile_plan(scene(**{**SKIES["cloud by day"], "background": one}))
        for one in ("earth", rough)
    )
    noise = [plan.detection.response(looks_of(plan)).noise_w_m2 for plan in (plain, structured)]
    assert np.array_equal(*noise)
    assert all(receiver.plane is None for receiver in plain.detection.receivers)


def test_notional_stands_for_the_values_of_the_sensor_model() -> None:
    result = scene([with_plane(DSP), with_plane(SBIRS), with_plane(NEXTGEN)])
    planes = [sensor.model.config.focal_plane for sensor in result.sensors]
    assert [plane.aperture_m for plane in planes] == [0.9, 0.6, 1.0]
    repeated = opir.scene_from_mapping(scene_mapping(result))
    assert repeated.sensors == result.sensors
    from opir_dsp.plugin import DspConfig

    assert DspConfig(orbital_slot_deg=0.0, focal_plane="notional").focal_plane == planes[0]
    assert DspConfig(orbital_slot_deg=0.0).focal_plane == planes[0]
    assert (
        DspConfig(orbital_slot_deg=0.0, focal_plane=FocalPlaneConfig()).focal_plane.aperture_m
        == 0.6
    )


@pytest.mark.parametrize(
    ("plane", "message"),
    [
        ("real", "'real' is not notional; or give a block of settings"),
        (["notional"], "this is a list; a block"),
        (
            {"aperture_m": 0.0},
            r"sensors\[0\].focal_plane.aperture_m: 0.0 is outside \[0.001, 100\] m",
        ),
        ({"spatial_filter": "median"}, "'median' is not one of sum, surround, matched"),
        ({"apertur_m": 1.0}, "unknown key; did you mean aperture_m?"),
        ({"reference_cells": 4}, r"4 is outside \[8, 1000000\]"),
    ],
)
def test_a_focal_plane_that_is_wrong_is_refused_with_its_place(plane: Any, message: str) -> None:
    with pytest.raises(opir.SceneError, match=message):
        scene([with_plane(SBIRS, plane)])


def test_a_loss_that_is_not_worked_out_is_refused() -> None:
    for changes in (
        {"threshold_sigma": 12.0},
        {"false_alarm_probability": 1e-30},
        {"threshold_sigma": 0.5},
    ):
        refused = scene([with_plane(SBIRS, {"reference_cells": 16}, **changes)])
        with pytest.raises(
            opir.ModelError, match="reference_cells: the loss of a threshold above 10 or below 1"
        ):
            opir.compile_plan(refused)
    opir.compile_plan(
        scene([with_plane(SBIRS, {"reference_cells": 16}, false_alarm_probability=1e-7)])
    )


def test_times_fit_the_scan_period_and_bands_may_differ() -> None:
    plane = {"integration_time_ms": 200.0, "lag_s": 0.05}
    sensor = with_plane(SBIRS, plane, band_focal_plane={"MWIR": {"well_capacity_e": 5.0}})
    short, middle = opir.compile_plan(scene([sensor])).sensors[0].radiometer.focal_planes
    assert (short.integration_time_ms, short.lag_s) == (100.0, 0.1)
    assert (short.well_capacity_e, middle.well_capacity_e) == (2e7, 5.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"band_focal_plane": {"LWIR": {"bits": 8}}},
            "band_focal_plane: LWIR is not one of the sensor's bands",
        ),
        (
            {"band_focal_plane": {"MWIR": {"lag_s": 8.0}}},
            "lag_s is no setting of focal_plane; known: aperture_m, ",
        ),
        ({"focal_plane": None}, "focal_plane: without one set the noise, nei_w_m2"),
    ],
)
def test_settings_of_bands_that_are_wrong_are_refused(settings: Any, message: str) -> None:
    with pytest.raises(opir.SceneError, match=message):
        scene([{**with_plane(SBIRS), **settings}])


def test_a_fleet_works_its_focal_plane_out_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from opir_photons.detection import focal_planes

    built = []
    own = focal_planes.SpatialTransfer.of
    monkeypatch.setattr(
        focal_planes.SpatialTransfer, "of", lambda *arguments: built.append(1) or own(*arguments)
    )
    slots = [
        with_plane({**SBIRS, "id": f"S{slot}", "orbital_slot_deg": slot})
        for slot in (-150.0, -140.0, -120.0)
    ]
    plane = [{**sensor, "focal_plane": {"aperture_m": 0.61}} for sensor in slots]
    Engine(opir.compile_plan(scene(plane, "I", **SKIES["cloud by day"])))
    assert len(built) == 2


def test_explain_shows_what_focal_planes_come_to() -> None:
    sky = SKIES["cloud by day"]
    plan = opir.compile_plan(scene([with_plane(SBIRS), NEXTGEN], "I", **sky))
    rows = explained(plan)["focal_planes"]
    assert [(row["sensor_id"], row["band"]) for row in rows] == [("B", "SWIR"), ("B", "MWIR")]
    response = plan.detection.response(looks_of(plan, 1))
    for place, row in enumerate(rows):
        nei = plan.detection.receivers[0].radiometer.nei_w_m2[place]
        noise = response.noise_w_m2[looks_of(plan, 1).sensor == 0, place] / nei
        assert row["nei_w_m2"] == nei
        assert row["least_noise_over_nei"] == pytest.approx(noise.min(), rel=0.01)
        assert row["largest_noise_over_nei"] == pytest.approx(noise.max(), rel=0.01)
        assert row["share_in_pixel"] == pytest.approx(0.485, abs=0.02)
    assert explained(opir.compile_plan(scene([SBIRS], "I", **sky)))["focal_planes"] == []
    assert (
        explained(opir.compile_plan(scene([SBIRS], "I", detection="constant")))["focal_planes"]
        == []
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plane", "sees"),
    [
        (
            {"aperture_m": 100.0, "blur_urad": 0.0, "jitter_urad": 0.0, "well_capacity_e": 1e12},
            True,
        ),
        ({"read_noise_e": 0.0, "dark_current_e_s": 0.0}, True),
        ({"registration_urad": 0.0, "drift_urad_s": 0.0}, True),
        ({"core_pixels": 9}, True),
        ({"blur_urad": 9e4}, False),
        ({"registration_urad": 1e5, "drift_urad_s": 1e6, "lag_s": 1e5}, False),
    ],
)
def test_extreme_focal_planes_stay_in_bounds(plane: dict[str, Any], sees: bool) -> None:
    plan = opir.compile_plan(
        scene([with_plane(SBIRS, plane)], "I", atmosphere="lowtran", background="earth")
    )
    result, truth = joined(windows_of(plan, [60.0]))
    assert np.any(truth.target >= 0) == sees
    assert np.all(np.isfinite(result.snr))
    assert np.all(
        (result.line_of_sight_sigma_rad >= 20e-6) & (result.line_of_sight_sigma_rad < 1e-3)
    )
    assert np.all(truth.probability[truth.target >= 0] > 0.0)


def test_a_model_s_notional_values_are_described() -> None:
    from opir_dsp.plugin import DspConfig

    described = named_values(DspConfig)["focal_plane: notional"]
    assert (
        FocalPlaneConfig(**described)
        == DspConfig(orbital_slot_deg=0.0, focal_plane="notional").focal_plane
    )
