"""Brightness temperatures that opir gives for a look of `tests/data/goes_sightings.json`."""

from functools import cache

import numpy as np
from opir_photons.imagers.plugin import BANDS as EDGES, LONG_BANDS, PIXEL_URAD
from opir_photons.radiometry import band_radiance, band_transmittance, pixel_temperature_k
from opir_photons.radiometry.configs import PlumeConfig
from opir_photons.radiometry.earth import sky_tables
from opir_photons.radiometry.plume import plume_signatures
from opir_photons.radiometry.propellants import jet_power_w

from opir_core.plugin import Band, SignatureContext
from opir_core.scene import core_plumes

BANDS = tuple(Band(name, *edges) for name, edges in {**EDGES, **LONG_BANDS}.items())


def intensities_w_sr(look):
    """Return the in-band intensities towards the imager, by band."""
    usual_w = jet_power_w(core_plumes()["SLV"].peak_w_sr)
    scale = look["jet_power_w"] / usual_w
    config = PlumeConfig(propellant=look["propellant"], scale=scale, stages=1, rise_time_s=0.0)
    context = SignatureContext(
        bands=BANDS,
        ids=("T",),
        paths=("t",),
        types=("SLV",),
        profiles=("SLV",),
        burn_time_s=np.array([500.0]),
    )
    signatures = plume_signatures([config], context)
    target = np.zeros(1, dtype=np.int32)
    place = (
        np.array([100.0]),
        np.array([look["altitude_km"] * 1e3]),
        np.radians([look["aspect_deg"]]),
    )
    return {
        band.name: float(signatures.intensity_w_sr(row, target, *place)[0])
        for row, band in enumerate(BANDS)
    }


def pixel_k(
    look,
    name,
    share,
    factor=1.0,
    ground_k=None,
):
    """Return the temperatures, in one band, of a pixel beside the plume, and of the brightest one,
    K.

    `share` of the light is in that pixel; the plume is `factor` times as bright as opir's;
    `ground_k` is the brightness temperature of the neighbours, by default that of opir's
    background.
    """
    band = next(imager_band for imager_band in BANDS if imager_band.name == name)
    edges = (band.lower_um, band.upper_um)
    passed, behind = _air(look["climate"], edges, look["altitude_km"], look["zenith_deg"])
    behind = behind if ground_k is None else float(band_radiance(ground_k, *edges))
    arriving = (
        share * factor * intensities_w_sr(look)[name] * passed / (look["range_km"] * 1e3) ** 2
    )
    beside, brightest = pixel_temperature_k(
        np.array([0.0, arriving]), behind, PIXEL_URAD * 1e-6, band
    ).tolist()
    return beside, brightest


@cache
def _air(climate, edges, altitude_km, zenith_deg):
    """Return the transmittance to the imager, and the radiance behind, W m⁻² sr⁻¹."""
    elevation = np.radians(90.0 - zenith_deg)
    passed = float(band_transmittance(*edges, altitude_km * 1e3, elevation, climate=climate))
    curve = next(
        sky_table
        for sky_table in sky_tables(climate, "clear")
        if (sky_table.band.lower_um, sky_table.band.upper_um) == edges
    )
    return passed, float(np.interp(np.sin(elevation), curve.night_at, curve.night))
