"""The bench against short scripts: noise by term, curves, operating characteristics, false alarms, frames."""

import math

import numpy as np
import pytest
from opir_coverage.bench.budget import noise_budget, waterfall
from opir_coverage.bench.curves import curve, first_report_s, least_intensities_w_sr, operating_characteristic
from opir_coverage.bench.frames import frame
from opir_coverage.bench.stand import Bench, Poses
from scipy.special import ndtr

H_C = 6.62607015e-34 * 299792458.0


def test_detector_noise_is_that_of_electrons():
    """Dark current of i t electrons has the variance i t; m reads of r electrons m r². The rest is common to both."""
    plane = {"aperture_m": 0.5, "integration_time_ms": 20.0, "dark_current_e_s": 3e9, "read_noise_e": 80.0}
    bench = Bench.of_model("SBIRS-GEO").changed(sensor__focal_plane={**plane, "subframes": 9})
    found = noise_budget(bench, Poses.of())
    named = {each.name: each.sigma_w_m2 for each in found.terms}
    ratio = named["dark current and warm optics"] / named["read-out"]
    assert np.allclose(ratio, math.sqrt(3e9 * 0.020 / (9 * 80.0**2)), rtol=1e-6)
    whole = np.sqrt(sum(np.square(each.sigma_w_m2) for each in found.terms))
    assert np.allclose(whole, found.whole_w_m2, rtol=1e-3)


def test_photon_noise_is_poisson():
    """E hc/λ over A η t, E the radiance of the background in a pixel; in LWIR within that of 200 to 330 K."""
    bench = Bench.of_model("DSP")
    sensor = bench.sensor
    found = noise_budget(bench, Poses.of())
    sigma = next(each.sigma_w_m2[0] for each in found.terms if each.name == "photons of the background")
    low, high = sensor.bands[0].lower_um, sensor.bands[0].upper_um
    photon_j = H_C / (0.5e-6 * (low + high))
    radiance = sigma**2 * sensor.radiometer.collection_m2_s / photon_j / sensor.radiometer.ifov_rad**2

    def planck(kelvin):
        um = np.linspace(low, high, 2001) * 1e-6
        spectral = 2.0 * H_C * 299792458.0 / um**5 / np.expm1(H_C / (um * 1.380649e-23 * kelvin))
        return float(np.sum(0.5 * (spectral[1:] + spectral[:-1]) * np.diff(um)))

    assert planck(200.0) < radiance < planck(330.0)
    slope = (planck(300.01) - planck(299.99)) / 0.02
    assert found.nedt_k[0] == pytest.approx(found.whole_w_m2[0] / (slope * sensor.radiometer.ifov_rad**2), rel=1e-3)


def test_the_waterfall_ends_at_the_margin():
    found = noise_budget(Bench.of_model("SBIRS-GEO"), Poses.of())
    steps = waterfall(found, 1, 5.0)
    assert 10.0 ** (steps[-1].level_db / 10.0) == pytest.approx(found.signals.snr[0, 1] / 5.0, rel=1e-9)
    assert sum(each.gain_db for each in steps) == pytest.approx(steps[-1].level_db)


def bare(sensor="DSP"):
    """Return a sensor before a dark background without air."""
    return Bench.of_model(sensor).changed(atmosphere="clear", background="none")


def test_the_least_intensity_is_that_of_the_closed_form():
    """T NEI R² in vacuum, with R from the law of cosines on a sphere."""
    bench, height_m, elevation = bare(), 30e3, math.radians(35.0)
    found = bench.signals(Poses.of(height_m=height_m, elevation_rad=elevation))
    near, far = 6371008.8 + height_m, 42164170.0
    range_m = math.sqrt(far**2 - (near * math.cos(elevation)) ** 2) - near * math.sin(elevation)
    radiometer = bench.sensor.radiometer
    expected = radiometer.threshold * radiometer.nei_w_m2[0] * range_m**2
    assert least_intensities_w_sr(bench, found)[0, 0] == pytest.approx(expected, rel=3e-3)


def test_p_d_and_the_operating_characteristic_are_those_of_gaussian_noise():
    """Q(T - SNR); two of three looks of 4π sin²(θ/2)/ω cells pass at about the rate that the detection page gives."""
    bench = bare().changed(sensor__nei_w_m2=4e-12)
    poses = Poses.of("ICBM", height_m=40e3)
    snr = float(bench.signals(poses).snr[0, 0])
    found = operating_characteristic(bench, poses, (4.0, 5.0, 6.0))
    assert [row[2] for row in found.rows] == pytest.approx([float(ndtr(snr - t)) for t in (4.0, 5.0, 6.0)], abs=1e-9)
    cells = 4.0 * math.pi * math.sin(0.5 * math.radians(10.0)) ** 2 / 56e-6**2
    alone = bench.changed(sensor__confirmation_detections=1, sensor__confirmation_scans=1)
    rates = [row[1] for row in operating_characteristic(alone, poses, (5.0, 6.0)).rows]
    assert rates == pytest.approx([float(ndtr(-t)) * cells * 86400.0 / 0.2 for t in (5.0, 6.0)], rel=1e-6)


def test_lines_of_sight_are_as_sharp_as_the_signal():
    """√(pointing² + (IFOV/SNR)²) without a focal plane."""
    bench = bare().changed(sensor__nei_w_m2=4e-12)
    poses = Poses.of(height_m=np.array([20e3, 60e3]))
    model, looks = bench.model(poses)
    snr = bench.signals(poses).snr[:, 0]
    found = model.line_of_sight_sigma_rad(model.response(looks), looks.sensor)
    assert found == pytest.approx(np.hypot(bench.sensor.line_of_sight_sigma_rad, 56e-6 / snr), rel=1e-9)


def test_curves_are_of_the_conditions_that_they_name():
    found = curve([Bench.of_model("SBIRS-GEO")], "least-intensity", "height", ["ICBM"], {}, (0.0, 10.0, 100.0))
    low, middle, high = (row[1] for row in found.rows)
    assert low > middle > high
    clouds = curve([Bench.of_model("SBIRS-GEO")], "pd", "cloud", ["ICBM"], {"height_m": 5e3}, (2.0, 8.0))
    assert clouds.rows[0][1] > 0.9 > 1e-3 > clouds.rows[1][1]
    sides = curve([bare()], "snr", "aspect", ["ICBM"], {}, (0.0, 90.0)).rows
    assert sides[1][1] > sides[0][1]


def test_the_first_report_of_a_sure_sensor_follows_the_second_look():
    """P_d 1 from ignition on: the second of two looks a period apart is later than 1.9 periods with 0.1."""
    bench = bare().changed(sensor__nei_w_m2=1e-18, sensor__scan_period_ms=10000.0)
    time_s = first_report_s(bench, "ICBM", {"elevation_rad": math.radians(45.0)})
    assert time_s == pytest.approx(10.0 + 0.9 * 10.0, abs=0.2)


def test_a_frame_holds_the_electrons_of_its_target_and_the_noise_of_its_background():
    bench = Bench.of_model("SBIRS-GEO").changed(sensor__focal_plane="notional").whole()
    poses = Poses.of("ICBM")
    made = frame(bench, poses, 96, 3)
    plane = bench.focal_plane()
    seconds = plane["integration_time_ms"] * 1e-3
    area = math.pi / 4.0 * plane["aperture_m"] ** 2 * plane["optics_transmission"] * plane["quantum_efficiency"]
    photons = bench.signals(poses).irradiance_w_m2[0, 0] * area * seconds / (H_C / 2.75e-6)
    assert made.target.sum() == pytest.approx(photons, rel=1e-6)
    assert made.mask[48, 48]
    assert made.mask.sum() < 40
    mean = made.background + plane["dark_current_e_s"] * seconds
    away = ~made.mask
    noise = made.electrons[away] - (mean + made.target)[away]
    expected = math.sqrt(np.mean(mean) + plane["read_noise_e"] ** 2 * plane["subframes"])
    assert np.std(noise) == pytest.approx(expected, rel=0.03)
