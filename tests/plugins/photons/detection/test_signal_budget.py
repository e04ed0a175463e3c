"""Signal and noise of a look, worked out anew from the parts of the chain: source, air, range,
background, sensor.
"""

import numpy as np
import pytest
from scipy.constants import c, h

import opir_core as opir
from opir_core.planning import Looks
from opir_core.reading import scene_mapping

#: Noise is given: that of focal planes has tests of its own.
GIVEN = [
    {
        "model": "DSP",
        "preset": "paper",
        "scan_phase": "random",
        "id": "D",
        "orbital_slot_deg": -135.0,
        "nei_w_m2": 5e-13,
    },
    {
        "model": "SBIRS-GEO",
        "id": "S",
        "orbital_slot_deg": -120.0,
        "nei_w_m2": 1e-12,
        "band_nei_w_m2": {"MWIR": 3e-12},
    },
    {
        "model": "NEXTGEN-GEO",
        "id": "N",
        "orbital_slot_deg": -105.0,
        "collection_m2_s": 1e-6,
        "nei_w_cm2": 2e-17,
    },
]
SENSORS = [{**one, "focal_plane": None} for one in GIVEN]
SKIES = {
    "space": {},
    "air": {"atmosphere": {"model": "lowtran", "climate": "tropical"}},
    "earth": {"background": {"model": "earth", "clutter_residual": 3e-5}},
    "all": {"atmosphere": "lowtran", "background": "earth"},
}


@pytest.mark.slow
@pytest.mark.parametrize("sky", SKIES)
def test_snr_is_irradiance_over_the_noises_together(sky: str) -> None:
    """SNR = I τ / R² / σ with σ² = NEI² + L ω hc/λ / (A η t) + (c ω)²:
    docs/explanation/detection.md.
    """
    scene = opir.load_scene(
        "examples/photons.yaml",
        overrides=[
            "atmosphere=clear",
            "background=none",
            "classification=paper",
            "duration_s=60",
            "outputs=[]",
        ],
    )
    mapping = {**scene_mapping(scene), "sensors": SENSORS, **SKIES[sky]}
    plan = opir.compile_plan(opir.scene_from_mapping(mapping))
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair[::7], looks.scan[::7])
    result = plan.detection.response(exposed)
    chain = plan.detection.environment
    compared = 0
    noisy = 0
    for number, sensor in enumerate(plan.sensors):
        rows = np.flatnonzero(exposed.sensor == number)
        own = exposed.take(rows)
        light = sensor.radiometer
        path = chain.paths(own)
        aspect = chain.aspect_rad(own)
        view = chain.views(own)
        for place, band in enumerate(sensor.bands):
            name = chain.bands.index(band)
            intensity = chain.intensities_w_sr([name], own, path.height_m, aspect)[0]
            irradiance = intensity * chain.atmosphere.transmittance(name, path) / own.range_m**2
            cell_sr = light.ifov_rad**2
            behind = chain.background.radiance_w_m2_sr(name, view) * cell_sr
            clutter = chain.background.clutter_w_m2_sr(name, view) * cell_sr
            photon_j = h * c / (0.5e-6 * (band.lower_um + band.upper_um))
            counts = behind * photon_j / light.collection_m2_s
            sigma = np.sqrt(light.nei_w_m2[place] ** 2 + counts + clutter**2)
            np.testing.assert_allclose(result.noise_w_m2[rows, place], sigma, rtol=1e-12)
            np.testing.assert_allclose(
                result.snr[rows, place], irradiance / sigma, rtol=1e-11, atol=1e-300
            )
            compared += int((irradiance > 0.0).sum())
            noisy += int((counts > 0.1 * sigma**2).any()) + int((clutter > 0.1 * sigma).any())
    assert compared > 500
    # Photons and clutter are each more than a tenth of some band's noise, where there is a
    # background.
    assert (noisy >= 2) == ("background" in SKIES[sky])


@pytest.mark.slow
def test_noise_of_a_sensor_is_that_of_its_settings() -> None:
    """W/cm² are 1e4 W/m², and a band's own noise takes the place of the sensor's."""
    scene = opir.load_scene("examples/photons.yaml", overrides=["duration_s=60", "outputs=[]"])
    mapping = {**scene_mapping(scene), "sensors": SENSORS}
    plan = opir.compile_plan(opir.scene_from_mapping(mapping))
    reported = [sensor.radiometer.nei_w_m2 for sensor in plan.sensors]
    assert reported[0] == pytest.approx((5e-13,), rel=1e-15)
    assert reported[1] == pytest.approx((1e-12, 3e-12), rel=1e-15)
    assert reported[2] == pytest.approx((2e-13, 2e-13, 2e-13), rel=1e-15)
