"""The bench against short scripts: noise by term, curves, operating characteristics, false alarms,
frames.
"""

import math

import numpy as np
import pytest
from opir_bench.bands import BandLimits, best_bands
from opir_bench.budget import noise_budget, waterfall
from opir_bench.curves import (
    curve,
    least_intensities_w_sr,
    operating_characteristic,
)
from opir_bench.frames import frame
from opir_bench.movies import Filming, clip
from opir_bench.stand import Bench, Poses
from scipy.special import j0, j1, ndtr

H_C = 6.62607015e-34 * 299792458.0


def photons_per_s(kelvin, low_um, high_um):
    """Return the photons per s, m² and sr of a black body in a band."""
    um = np.linspace(low_um, high_um, 4001) * 1e-6
    spectral = 2.0 * 299792458.0 / um**4 / np.expm1(H_C / (um * 1.380649e-23 * kelvin))
    return float(np.sum(0.5 * (spectral[1:] + spectral[:-1]) * np.diff(um)))


def test_detector_noise_is_that_of_electrons():
    """Dark current, warm optics of i t electrons have the variance i t; m reads of r electrons m
    r²; steps m s²/12.
    """
    plane = {
        "aperture_m": 0.5,
        "integration_time_ms": 20.0,
        "dark_current_e_s": 3e9,
        "read_noise_e": 80.0,
    }
    bench = Bench.of_model("SBIRS-GEO").changed(
        sensor__focal_plane={**plane, "subframes": 9, "optics_temperature_k": 260}
    )
    result = noise_budget(bench, Poses.of())
    named = {term.name: term.sigma_w_m2 for term in result.terms}
    cone = math.pi / (4.0 * 2.0**2 + 1.0)
    pitch_m = 28e-6 * 2.0 * 0.5
    warm = [
        0.3 * photons_per_s(260.0, *edges) * cone * pitch_m**2 * 0.7 * 0.9
        for edges in ((2.5, 3.0), (4.0, 5.0))
    ]
    read = named["read-out"]
    assert np.allclose(
        named["dark current"] / read, math.sqrt(3e9 * 0.020 / (9 * 80.0**2)), rtol=1e-6
    )
    assert np.allclose(
        named["warm optics"] / read, np.sqrt(np.array(warm) * 0.020 / (9 * 80.0**2)), rtol=1e-4
    )
    assert np.allclose(named["conversion"] / read, 2e7 / 2**16 / math.sqrt(12.0) / 80.0, rtol=1e-6)
    total = np.sqrt(sum(np.square(term.sigma_w_m2) for term in result.terms))
    assert np.allclose(total, result.whole_w_m2, rtol=1e-9)


def test_terms_add_up_where_drift_alone_decorrelates_frames():
    bench = Bench.of_model("SBIRS-GEO").with_planes(drift_urad_s=50.0, registration_urad=30.0)
    result = noise_budget(bench, Poses.of())
    total = np.sqrt(sum(np.square(term.sigma_w_m2) for term in result.terms))
    assert np.allclose(total, result.whole_w_m2, rtol=1e-9)
    assert {term.name for term in result.terms} >= {
        "clutter by frame registration",
        "clutter by drift",
    }


def test_a_stated_noise_is_that_of_the_detector():
    bench = Bench.of_model("SBIRS-GEO").changed(sensor__nei_w_m2=3e-13)
    result = noise_budget(bench, Poses.of())
    assert result.terms[0].name == "detector (stated or calibrated NEI)"
    assert result.terms[0].sigma_w_m2 == pytest.approx(np.full(2, 3e-13))


def airy_share(radius_rad, wavelength_um, aperture_m):
    """Return the share of an Airy pattern's light within a radius: 1 - J0² - J1²."""
    at = math.pi * radius_rad * aperture_m / (wavelength_um * 1e-6)
    return 1.0 - float(j0(at)) ** 2 - float(j1(at)) ** 2


def planck(kelvin, low_um, high_um):
    um = np.linspace(low_um, high_um, 2001) * 1e-6
    spectral = 2.0 * H_C * 299792458.0 / um**5 / np.expm1(H_C / (um * 1.380649e-23 * kelvin))
    return float(np.sum(0.5 * (spectral[1:] + spectral[:-1]) * np.diff(um)))


def long_wave(**changes):
    """Return the bench of a DSP with the paper's band, 8 to 12 um, and scan."""
    return Bench.of_model("DSP").changed(sensor__preset="paper", **changes)


def photon_noise(bench):
    """Return the photon noise of a bench's first band, W/m²."""
    result = noise_budget(bench, Poses.of())
    return next(
        term.sigma_w_m2[0] for term in result.terms if term.name == "photons of the background"
    )


def test_photon_noise_is_poisson():
    """E hc/λ over A η t, E the radiance of the background in a pixel; in LWIR within that of 200 to
    330 K.
    """
    bench = long_wave(sensor__focal_plane=None, sensor__nei_w_m2=4e-12)
    sensor = bench.sensor
    result = noise_budget(bench, Poses.of())
    sigma = photon_noise(bench)
    low = sensor.bands[0].lower_um
    high = sensor.bands[0].upper_um
    photon_j = H_C / (0.5e-6 * (low + high))
    radiance = (
        sigma**2 * sensor.radiometer.collection_m2_s / photon_j / sensor.radiometer.ifov_rad**2
    )
    assert planck(200.0, low, high) < radiance < planck(330.0, low, high)
    slope = (planck(300.01, low, high) - planck(299.99, low, high)) / 0.02
    assert result.nedt_k[0] == pytest.approx(
        result.whole_w_m2[0] / (slope * sensor.radiometer.ifov_rad**2), rel=1e-3
    )


def test_photon_noise_of_a_focal_plane_is_that_of_its_pixels_and_frames():
    """Two frames of 81 pixels have 162 times the variance of one, over the squared share of the
    light in them.

    At least that in a circle of 3 pixels, 1.5 less than the square's and 1 for the blur and the
    place on a pixel.
    """
    alone = long_wave(sensor__focal_plane=None, sensor__nei_w_m2=4e-12)
    plane = {
        "spatial_filter": "sum",
        "core_pixels": 9,
        "aperture_m": 0.9,
        "integration_time_ms": 1.0,
    }
    efficiency = {"optics_transmission": 0.6, "quantum_efficiency": 0.6, "fill_factor": 0.8}
    both = long_wave(sensor__focal_plane={**plane, **efficiency})
    collection = math.pi / 4.0 * 0.9**2 * 0.6 * 0.6 * 0.8 * 1e-3
    ratio = (
        (photon_noise(both) / photon_noise(alone)) ** 2
        * collection
        / alone.sensor.radiometer.collection_m2_s
    )
    assert 1.0 < ratio / 162.0 < 1.0 / airy_share(3.0 * 56e-6, 10.0, 0.9) ** 2


def test_the_waterfall_ends_at_the_margin():
    result = noise_budget(Bench.of_model("SBIRS-GEO"), Poses.of())
    steps = waterfall(result, 1, 5.0)
    assert 10.0 ** (steps[-1].level_db / 10.0) == pytest.approx(
        result.signals.snr[0, 1] / 5.0, rel=1e-9
    )
    assert sum(step.gain_db for step in steps) == pytest.approx(steps[-1].level_db)


def test_a_frame_difference_leaves_nothing_of_a_target_that_stands_still():
    """The source is the class's, whatever is left; a target far from where it was keeps all its
    light.
    """
    bench = Bench.of_model("SBIRS-GEO").with_planes(registration_urad=0.0, drift_urad_s=0.0)
    single = bench.with_planes(temporal_filter="none").signals(Poses.of()).irradiance_w_m2[0]
    for speed, share in ((0.0, 0.0), (5000.0, 1.0)):
        result = noise_budget(bench, Poses.of(speed_m_s=speed))
        assert result.light_w_m2 == pytest.approx(single, rel=1e-9)
        assert result.signals.irradiance_w_m2[0] == pytest.approx(
            share * single, rel=1e-9, abs=1e-3 * float(single.min())
        )


def bare(sensor="DSP"):
    """Return a sensor before a dark background without air."""
    bench = long_wave() if sensor == "DSP" else Bench.of_model(sensor)
    return bench.changed(atmosphere="clear", background="none")


def test_the_least_intensity_is_that_of_the_closed_form():
    """T NEI R² in vacuum, with R from the law of cosines on a sphere."""
    bench = bare().changed(sensor__nei_w_m2=4e-12)
    height_m = 30e3
    elevation = math.radians(35.0)
    result = bench.signals(Poses.of(height_m=height_m, elevation_rad=elevation))
    near = 6371008.8 + height_m
    far = 42164170.0
    range_m = math.sqrt(far**2 - (near * math.cos(elevation)) ** 2) - near * math.sin(elevation)
    expected = bench.sensor.radiometer.threshold * 4e-12 * range_m**2
    assert least_intensities_w_sr(bench, result)[0, 0] == pytest.approx(expected, rel=3e-3)


def test_the_least_intensity_in_a_band_is_what_that_band_alone_needs():
    """Of summed bands that of a sensor with this band alone; of compared ones that of coincidence
    in all but one.
    """
    bench = Bench.of_model("SBIRS-GEO")
    poses = Poses.of(height_m=30e3)
    result = least_intensities_w_sr(bench, bench.signals(poses))[0]
    for place, band in enumerate(bench.sensor.bands):
        edges = {band.name: [band.lower_um, band.upper_um]}
        alone = bench.changed(sensor__bands=edges, sensor__reference_band=band.name)
        assert least_intensities_w_sr(alone, alone.signals(poses))[0, 0] == pytest.approx(
            result[place], rel=1e-9
        )
    gates = bench.changed(sensor__spectral_discrimination="dual-band-ratio")
    needed = least_intensities_w_sr(gates, gates.signals(poses))[0]
    assert (needed / result) == pytest.approx([2.0 / 5.5, 1.0], rel=1e-9)


def test_p_d_and_the_operating_characteristic_are_those_of_gaussian_noise():
    """Q(T - SNR); two of three looks of 4π sin²(θ/2)/ω cells pass at about the rate that the
    detection page gives.
    """
    bench = bare().changed(sensor__nei_w_m2=4e-12)
    poses = Poses.of("ICBM", height_m=40e3)
    snr = float(bench.signals(poses).snr[0, 0])
    result = operating_characteristic(bench, poses, (4.0, 5.0, 6.0))
    assert [row[2] for row in result.rows] == pytest.approx(
        [float(ndtr(snr - t)) for t in (4.0, 5.0, 6.0)], abs=1e-9
    )
    cells = 4.0 * math.pi * math.sin(0.5 * math.radians(10.0)) ** 2 / 56e-6**2
    alone = bench.changed(sensor__confirmation_detections=1, sensor__confirmation_scans=1)
    rates = [row[1] for row in operating_characteristic(alone, poses, (5.0, 6.0)).rows]
    assert rates == pytest.approx(
        [float(ndtr(-t)) * cells * 86400.0 / 0.2 for t in (5.0, 6.0)], rel=1e-6
    )


def test_lines_of_sight_are_as_sharp_as_the_signal():
    """√(pointing² + (IFOV/SNR)²) without a focal plane."""
    bench = bare().changed(sensor__nei_w_m2=4e-12, sensor__focal_plane=None)
    poses = Poses.of(height_m=np.array([20e3, 60e3]))
    model, looks = bench.model(poses)
    snr = bench.signals(poses).snr[:, 0]
    result = model.line_of_sight_sigma_rad(model.response(looks), looks.sensor)
    assert result == pytest.approx(
        np.hypot(bench.sensor.line_of_sight_sigma_rad, 56e-6 / snr), rel=1e-9
    )


def test_curves_are_of_the_conditions_that_they_name():
    result = curve(
        [Bench.of_model("SBIRS-GEO")], "least-intensity", "height", ["ICBM"], {}, (0.0, 10.0, 100.0)
    )
    low, middle, high = (row[1] for row in result.rows)
    assert low > middle > high
    clouds = curve(
        [Bench.of_model("SBIRS-GEO")], "pd", "cloud", ["ICBM"], {"height_m": 5e3}, (2.0, 8.0)
    )
    assert clouds.rows[0][1] > 0.9 > 1e-3 > clouds.rows[1][1]
    sides = curve([bare()], "snr", "aspect", ["ICBM"], {}, (0.0, 90.0)).rows
    assert sides[1][1] > sides[0][1]


def test_the_first_report_of_a_sure_sensor_follows_the_second_look():
    """P_d 1 from ignition on: the second of two looks a period apart is later than 1.9 periods with
    0.1.
    """
    bench = bare().changed(sensor__nei_w_m2=1e-18, sensor__scan_period_ms=10000.0)
    rows = curve([bench], "first-report", "elevation", ["ICBM"], {}, (45.0,)).rows
    assert rows[0][1] == pytest.approx(10.0 + 0.9 * 10.0, abs=0.2)


def test_a_frame_holds_the_electrons_of_its_target_and_the_noise_of_its_background():
    """A frame is single: of a target that stands still it has all the light."""
    plane = {
        "aperture_m": 0.5,
        "optics_transmission": 0.8,
        "quantum_efficiency": 0.6,
        "fill_factor": 0.95,
    }
    times = {
        "integration_time_ms": 12.0,
        "subframes": 20,
        "dark_current_e_s": 4e7,
        "optics_temperature_k": 0.0,
    }
    noise = {"read_noise_e": 90.0, "well_capacity_e": 3e7, "bits": 16}
    bench = Bench.of_model("SBIRS-GEO").changed(sensor__focal_plane={**plane, **times, **noise})
    poses = Poses.of("ICBM", speed_m_s=0.0)
    image = frame(bench, poses, 96, 3)
    area = math.pi / 4.0 * 0.5**2 * 0.8 * 0.6 * 0.95
    single = bench.changed(
        sensor__focal_plane={**plane, **times, **noise, "temporal_filter": "none"}
    )
    photons = single.signals(poses).irradiance_w_m2[0, 0] * area * 0.012 / (H_C / 2.75e-6)
    assert image.target.sum() == pytest.approx(photons, rel=1e-6)
    assert image.mask[48, 48]
    assert image.mask.sum() < 40
    mean = image.background + 4e7 * 0.012
    offset = ~image.mask
    residual = image.electrons[offset] - (mean + image.target)[offset]
    reading = 20 * (90.0**2 + (3e7 / 2**16) ** 2 / 12.0)
    assert np.std(residual) == pytest.approx(
        math.sqrt(np.mean(mean + image.target) + reading), rel=0.03
    )


def test_the_spot_of_a_frame_is_the_airy_pattern():
    """Nearly without blur: shares of pixels within the circles inside and around squares of 1, 3, …
    pixels.
    """
    plane = {"aperture_m": 0.2, "blur_urad": 0.5, "jitter_urad": 0.0}
    image = frame(
        Bench.of_model("SBIRS-GEO").changed(sensor__focal_plane=plane), Poses.of("ICBM"), 64
    )
    spot = image.target / image.target.sum()
    for half in (0.5, 1.5, 3.5):
        side = slice(32 - int(half), 33 + int(half))
        inner, outer = (
            airy_share(radius * half * 28e-6, 2.75, 0.2) for radius in (1.0, math.sqrt(2.0))
        )
        assert inner - 2e-3 < spot[side, side].sum() < outer + 2e-3


def rule_07_electrons_per_s(cutoff_um, kelvin, pitch_m):
    """Return the dark electrons of a square pixel by Rule 07 (Tennant 2010), as quoted in open
    programs.
    """
    effective = cutoff_um
    if cutoff_um < 4.63513642316149:
        effective /= (
            1.0
            - (0.200847413564122 / cutoff_um - 0.200847413564122 / 4.63513642316149)
            ** 0.544071281108481
        )
    volts = 1.380649e-23 * kelvin / 1.602176634e-19
    density_a_cm2 = 8367.00001853855 * math.exp(-1.16239134096245 * 1.24 / (effective * volts))
    return density_a_cm2 * (100.0 * pitch_m) ** 2 / 1.602176634e-19


#: 81 pixels hold all light; dark current, warm optics and reads are counted.
WARM_PLANE = {
    "aperture_m": 0.6,
    "f_number": 2.0,
    "integration_time_ms": 10.0,
    "subframes": 1,
    "read_noise_e": 2000.0,
    "optics_transmission": 0.7,
    "optics_temperature_k": 290.0,
    "fill_factor": 1.0,
    "bits": 32,
    "quantum_efficiency": 0.8,
    "detector_temperature_k": 120.0,
    "well_capacity_e": 1e12,
    "blur_urad": 1.0,
    "spatial_filter": "sum",
    "core_pixels": 9,
    "temporal_filter": "none",
    "jitter_urad": 0.0,
}


def snr_of_band(light_w_m2, low_um, high_um, ifov_rad):
    """Return the SNR of 81 pixels of the warm plane."""
    per_s = math.pi / 4.0 * 0.6**2 * 0.7 * 0.8 * 0.5e-6 * (low_um + high_um) / H_C
    pitch_m = ifov_rad * 2.0 * 0.6
    cone_sr = math.pi / (4.0 * 2.0**2 + 1.0)
    warm = 0.3 * photons_per_s(290.0, low_um, high_um) * cone_sr * pitch_m**2 * 0.8
    dark = rule_07_electrons_per_s(high_um, 120.0, pitch_m)
    return light_w_m2 * per_s * 0.01 / math.sqrt(81.0 * ((warm + dark) * 0.01 + 2000.0**2))


def test_the_best_band_is_that_of_a_script_and_false_alarms_are_equal():
    """In vacuum before a dark sky."""
    bench = bare("SBIRS-GEO").changed(sensor__focal_plane=WARM_PLANE)
    bench = bench.changed(sensor__confirmation_detections=1, sensor__confirmation_scans=1)
    poses = Poses.of("SRBM", height_m=[10e3, 40e3])
    edges = (2.5, 3.1, 4.17, 4.4, 4.6, 5.0)
    result = best_bands(bench, [poses], BandLimits(edges, 0.2, 1.0), most=99)
    sensor = bench.sensor
    ifov = sensor.radiometer.ifov_rad
    scripted = {}
    for low, high in ((a, b) for a in edges for b in edges if 0.2 - 1e-9 <= b - a <= 1.0 + 1e-9):
        alone = bench.changed(sensor__bands={"MWIR": [low, high]}, sensor__reference_band="MWIR")
        light = float(alone.light_w_m2(poses)[:, 0].min())
        scripted[low, high] = snr_of_band(light, low, high, ifov)
    rows = {(row[1], row[2]): row for row in result.rows[:-1]}
    assert list(rows) == sorted(scripted, key=scripted.get, reverse=True)
    for band, snr in scripted.items():
        # Diffraction leaves some light outside of 81 pixels.
        assert 0.9 * snr < rows[band][4] < 1.02 * snr
    half_rad = sensor.field_of_regard_half_angle_rad
    sigma = sensor.radiometer.threshold
    cells = 4.0 * math.pi * math.sin(0.5 * half_rad) ** 2 / ifov**2
    a_day = float(ndtr(-sigma)) * cells * 86400.0 / (sensor.scan.period_ns * 1e-9)
    assert [row[6] for row in rows.values()] == pytest.approx([a_day] * len(rows), rel=1e-6)


def test_a_clip_holds_the_light_and_the_way_of_its_target():
    """Centroids and sums of frames, by a script; the speed across the sky is v sin a / R, the light
    E A τ η t λ/hc.
    """
    plane = {
        "aperture_m": 0.6,
        "integration_time_ms": 10.0,
        "subframes": 1,
        "registration_urad": 0.0,
        "bits": 64,
    }
    plane |= {
        "optics_transmission": 0.7,
        "quantum_efficiency": 0.8,
        "fill_factor": 0.9,
        "optics_temperature_k": 0.0,
    }
    plane |= {
        "dark_current_e_s": 0.0,
        "read_noise_e": 0.1,
        "well_capacity_e": 1e15,
        "drift_urad_s": 0.0,
    }
    bench = bare("SBIRS-GEO").changed(sensor__focal_plane=plane)
    aspect = math.radians(50.0)
    poses = Poses.of("SRBM", height_m=40e3, aspect_rad=math.radians(50.0))
    film = clip(bench, poses, Filming(frames=5, every_s=4.0, pixels=64), seed=4)
    at = np.arange(64.0)
    for frame_e, row, column, light in zip(
        film.electrons, film.row, film.column, film.light_w_m2, strict=True
    ):
        total = float(frame_e.sum())
        assert (
            frame_e.sum(axis=1) @ at / total,
            frame_e.sum(axis=0) @ at / total,
        ) == pytest.approx((row, column), abs=0.2)
        low = bench.sensor.bands[0].lower_um
        high = bench.sensor.bands[0].upper_um
        per_unit = math.pi / 4.0 * 0.6**2 * 0.7 * 0.8 * 0.9 * 0.01 * 0.5e-6 * (low + high) / H_C
        assert total == pytest.approx(light * per_unit, rel=0.02)
    range_m = float(bench.signals(poses).range_m[0])
    across = 1000.0 * math.sin(aspect) / range_m / bench.sensor.radiometer.ifov_rad
    assert np.hypot(np.diff(film.row), np.diff(film.column)) / 4.0 == pytest.approx(
        [across] * 4, rel=1e-3
    )


def test_a_scaled_target_has_the_signal_over_noise_that_was_asked_for():
    """In the middle frame, by its brightest pixel: light over the root of its own photons and the
    rest of the noise.
    """
    film = clip(
        bare("SBIRS-GEO"),
        Poses.of("SRBM"),
        Filming(frames=3, every_s=0.5, pixels=32, snr=(6.0, 6.0)),
        seed=2,
    )
    assert film.snr[1] == pytest.approx(6.0, rel=0.02)
    assert film.scale < 1.0
