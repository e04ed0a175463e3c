"""Brightness temperatures of pixels, and where an imager puts what is above the ground."""

import numpy as np
import pytest
from opir_photons.imagers.plugin import (
    ABI_NEI_W_M2,
    AHI_NEI_W_M2,
    BANDS,
    FCI_BANDS,
    FCI_LONG_BANDS,
    FCI_LONG_NEI_W_M2,
    FCI_NEI_W_M2,
    PIXEL_URAD,
)
from opir_photons.radiometry import (
    band_radiance,
    band_radiance_slope,
    band_transmittance,
    brightness_temperature_k,
    parallax,
    pixel_temperature_k,
)
from opir_photons.radiometry.configs import CLIMATES
from opir_photons.radiometry.earth import sky_tables

import opir_core as opir
from opir_core import Host
from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import Band, SensorModel

ABI_7 = Band("B07", 3.8, 4.0)


@pytest.mark.parametrize("band", [Band(name, *edges) for name, edges in BANDS.items()], ids=str)
def test_a_black_body_has_its_own_brightness_temperature(band):
    temperature = np.geomspace(60.0, 19_000.0, 400)
    result = brightness_temperature_k(
        band_radiance(temperature, band.lower_um, band.upper_um), band
    )
    np.testing.assert_allclose(result, temperature, rtol=1e-9)


def test_what_no_black_body_radiates_has_none():
    assert np.isnan(brightness_temperature_k(np.array([0.0, -1.0, np.nan, 1e30]), ABI_7)).all()


def test_a_pixel_half_filled_by_fire_is_between_ground_and_fire():
    """A grey body that fills half of a pixel adds half of its radiance; the other half stays
    ground.
    """
    ground, fire = (float(band_radiance(kelvin, 3.8, 4.0)) for kelvin in (290.0, 900.0))
    pixel = 56e-6
    result = pixel_temperature_k(0.5 * (fire - ground) * pixel**2, ground, pixel, ABI_7)
    assert float(band_radiance(result, 3.8, 4.0)) == pytest.approx(0.5 * (fire + ground), rel=1e-9)
    assert 290.0 < float(result) < 900.0


def test_noise_is_the_published_nedt():
    """0.1 K at 300 K (0.16 K in band 7 of AHI), by a difference of Planck's integrals, over a pixel
    of 56 µrad.
    """
    for given, nedt in ((ABI_NEI_W_M2, {}), (AHI_NEI_W_M2, {"B07": 0.16})):
        for name, edges in BANDS.items():
            step = float(band_radiance(300.05, *edges) - band_radiance(299.95, *edges)) / 0.1
            assert given[name] == pytest.approx(
                nedt.get(name, 0.1) * step * (PIXEL_URAD * 1e-6) ** 2, rel=1e-3
            )
            assert step == pytest.approx(float(band_radiance_slope(300.0, *edges)), rel=1e-6)


#: NEDT of MTG-FCI, K, and the temperatures that they hold at, K.
FCI_NEDT = {
    "IR38": (0.1, 300.0),
    "WV63": (0.3, 250.0),
    "WV73": (0.3, 250.0),
    "IR87": (0.1, 300.0),
    "IR97": (0.3, 255.0),
    "IR105": (0.1, 300.0),
    "IR123": (0.2, 300.0),
    "IR133": (0.2, 270.0),
}


def test_noise_of_fci_is_its_nedt():
    noise = {**FCI_NEI_W_M2, **FCI_LONG_NEI_W_M2}
    for name, edges in {**FCI_BANDS, **FCI_LONG_BANDS}.items():
        nedt, at_k = FCI_NEDT[name]
        step = float(band_radiance(at_k + 0.05, *edges) - band_radiance(at_k - 0.05, *edges)) / 0.1
        assert noise[name] == pytest.approx(nedt * step * (PIXEL_URAD * 1e-6) ** 2, rel=1e-3)


@pytest.mark.parametrize("climate", CLIMATES)
def test_bands_of_imagers_have_air_and_background(climate):
    """In the same air a wide band lies between the narrow ones that it holds."""
    elevation = np.radians(50.0)
    for name, edges in {**FCI_BANDS, **FCI_LONG_BANDS}.items():
        passed = float(band_transmittance(*edges, 0.0, elevation, climate=climate))
        assert 0.0 <= passed < 0.95, name
        above = float(band_transmittance(*edges, 40e3, elevation, climate=climate))
        assert above > 0.5, name
        (curve,) = [
            table
            for table in sky_tables(climate, "clear")
            if (table.band.lower_um, table.band.upper_um) == edges
        ]
        seen_k = float(brightness_temperature_k(curve.night[-1], Band(name, *edges)))
        assert 200.0 < seen_k < 301.0, name


def test_a_plume_at_height_is_shifted_away_from_the_satellite():
    """On a flat Earth the shift is height times the tangent of the zenith angle; the curve adds a
    few per cent.
    """
    sensor = geodetic_to_ecef(np.zeros(2), np.zeros(2), np.full(2, 35_786e3))
    latitude = np.full(2, np.radians(30.0))
    target = geodetic_to_ecef(latitude, np.zeros(2), np.array([0.0, 50e3]))
    foot = geodetic_to_ecef(latitude, np.zeros(2), np.zeros(2))
    up = np.array([np.cos(latitude[0]), 0.0, np.sin(latitude[0])])
    away = sensor[1] - foot[1]
    zenith = np.arccos(np.dot(up, away) / np.linalg.norm(away))
    result = parallax(sensor, target)
    assert result.shift_m[0] == pytest.approx(0.0, abs=1e-3)
    assert result.shift_m[1] == pytest.approx(50e3 * np.tan(zenith), rel=0.03)
    assert result.latitude_rad[1] > latitude[1]
    assert np.isnan(
        parallax(
            sensor[:1], geodetic_to_ecef(np.radians([89.0]), np.zeros(1), np.full(1, 5e6))
        ).shift_m[0]
    )


@pytest.mark.parametrize(("name", "presets"), [("GOES-ABI", 5), ("AHI", 4), ("MTG-FCI", 3)])
def test_the_imagers_are_sensor_models_with_presets_by_scan(name, presets):
    model = Host.discover().component(SensorModel, name)
    assert len(model.presets) == presets
    scans = [preset for preset in model.presets.values() if "scan_period_ms" in preset]
    periods = [preset["scan_period_ms"] for preset in scans]
    assert max(periods) == 600_000.0
    assert min(periods) == (150_000.0 if name == "MTG-FCI" else 30_000.0)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "slot_deg"), [("GOES-ABI", -75.2), ("MTG-FCI", 0.0)])
def test_long_bands_of_imagers_see_a_launcher_before_the_earth(name, slot_deg):
    """Looks fall into the minute in which it is brightest, from behind; wells that the Earth fills
    see nothing.
    """
    scene = {
        "scene": "long waves",
        "epoch": "2026-01-15T12:00:00Z",
        "duration_s": 200,
        "seed": 3,
        "sensors": [
            {
                "model": name,
                "id": "S",
                "orbital_slot_deg": slot_deg,
                "preset": "long-waves",
                "scan_period_ms": 30_000.0,
            }
        ],
        "targets": [{"id": "T", "model": "ascent", "lat_deg": 5.2, "lon_deg": slot_deg + 40.0}],
        "detection": "snr",
        "atmosphere": {"model": "lowtran", "climate": "tropical"},
        "background": {"model": "earth", "climate": "tropical"},
        "outputs": [],
    }
    plan = opir.compile_plan(opir.scene_from_mapping(scene))
    window = opir.Engine(plan).advance(plan.end_ns)
    times_s = window.detections.time_s[window.truth.target == 0]
    assert np.any((times_s > 60.0) & (times_s < 150.0))
