"""The whole chain at its edges: zero and swapped bands, coldest and hottest, ground, limb and 1000
km: all finite.
"""

import numpy as np
import pytest
from opir_photons.radiometry import irradiance_at_aperture, minimum_detectable_intensity
from opir_photons.radiometry.viewing import views

from opir_core import Host
from opir_core.geometry import elevation_rad, geodetic_to_ecef
from opir_core.plugin import (
    AtmosphereContext,
    BackgroundContext,
    Band,
    Paths,
    SignatureContext,
    SourceContext,
)

HOST = Host.discover()
ODD = (
    Band("zero", 4.0, 4.0),
    Band("swapped", 5.0, 4.0),
    Band("hair", 4.3, 4.3 + 1e-12),
    Band("all", 1e-3, 1e6),
)
EVEN = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0), Band("LWIR", 8.0, 12.0))
HEIGHTS_M = np.array([-500.0, 0.0, 1.0, 8e3, 30e3, 99_999.9, 100e3, 100_000.1, 400e3, 1000e3])
SENSOR_M = geodetic_to_ecef(0.0, 0.0, 35_786e3)


def place(longitude_deg):
    target = geodetic_to_ecef(0.1, np.radians(longitude_deg), HEIGHTS_M)
    return target, np.broadcast_to(SENSOR_M, target.shape)


@pytest.mark.parametrize("bands", [ODD, EVEN])
def test_plumes(bands):
    component = HOST.component("opir_signature_models", "plume")
    context = SignatureContext(
        bands=bands,
        ids=("T",),
        paths=("",),
        types=("ICBM",),
        profiles=("",),
        burn_time_s=np.array([1e-3]),
    )
    signatures = component.build([component.config()], context)
    for time_s in (-1e9, -1e-9, 0.0, 5e-4, 1e-3, 1e9):
        for aspect in (0.0, 1e-300, np.pi / 2, np.pi):
            columns = (np.full(len(HEIGHTS_M), time_s), HEIGHTS_M, np.full(len(HEIGHTS_M), aspect))
            for band in range(len(bands)):
                result = signatures.intensity_w_sr(
                    band, np.zeros(len(HEIGHTS_M), np.int32), *columns
                )
                assert np.isfinite(result).all()
                assert (result >= 0.0).all()
                if bands is ODD and band < 2:
                    assert (result == 0.0).all()


@pytest.mark.parametrize("name", ["fires", "flares", "glints", "bolides"])
@pytest.mark.parametrize("temperature_k", [1.0, 20_000.0])
def test_sources(name, temperature_k):
    component = HOST.component("opir_source_models", name)
    places = tuple(
        {"lat_deg": lat, "lon_deg": lon}
        for lat in (-90.0, 0.0, 90.0)
        for lon in (-180.0, 0.0, 180.0)
    )
    context = SourceContext(
        bands=ODD, id="s", path="sources[0]", epoch_us=0, duration_s=60.0, seed=0
    )
    built = component.build(
        component.config(at=places, temperature_k=temperature_k, area_m2=1e12), context
    )
    rows = np.arange(len(built.ids), dtype=np.int32)
    for to_sensor in np.vstack([np.eye(3), -np.eye(3)]):
        time_s = np.zeros(len(rows))
        aspect = built.signatures.aspect_rad(
            rows, time_s, np.broadcast_to(to_sensor, (len(rows), 3))
        )
        for band in range(len(ODD)):
            result = built.signatures.intensity_w_sr(
                band, rows, time_s, np.zeros(len(rows)), aspect
            )
            assert np.isfinite(result).all()
            assert (result >= 0.0).all()


@pytest.mark.parametrize("longitude_deg", [0.0, 60.0, 80.0, 81.3, 82.0, 90.0, 120.0, 180.0])
def test_path_background_and_aperture(longitude_deg):
    target, sensor = place(longitude_deg)
    atmosphere = HOST.component("opir_atmosphere_models", "lowtran")
    earth = HOST.component("opir_background_models", "earth")
    sky = atmosphere.build(
        atmosphere.config(), AtmosphereContext(bands=EVEN, path="atmosphere", seed=0)
    )
    behind = earth.build(
        earth.config(),
        BackgroundContext(bands=EVEN, path="background", epoch_us=0, make_atmosphere=lambda: sky),
    )
    time_s = np.zeros(len(HEIGHTS_M))
    path = Paths(HEIGHTS_M, np.sin(elevation_rad(target, sensor)), target, sensor, time_s)
    view = views(sensor, target - sensor, time_s, 0)
    for band in range(len(EVEN)):
        passed = sky.transmittance(band, path)
        assert ((passed >= 0.0) & (passed <= 1.0)).all()
        level = Paths(
            HEIGHTS_M, np.full(len(HEIGHTS_M), path.elevation_sine[0]), target, sensor, time_s
        )
        assert (np.diff(sky.transmittance(band, level)) >= 0.0).all()
        assert (passed[-4:][path.elevation_sine[-4:] >= 0.0] == 1.0).all()
        shining = behind.radiance_w_m2_sr(band, view)
        assert np.isfinite(shining).all()
        assert (shining >= 0.0).all()
        range_m = np.linalg.norm(target - sensor, axis=1)
        assert np.isfinite(irradiance_at_aperture(1e300, range_m, passed)).all()
        assert (minimum_detectable_intensity(1e-30, range_m, passed) > 0.0).all()
