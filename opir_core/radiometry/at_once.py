"""Several bands asked of a model at once: by its own way where it has one, else one after the other."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray, IndexArray
from opir_core.radiometry.protocols import (
    Background,
    ManyBandBackground,
    ManyBandSignatures,
    ManyBandTransmittance,
    Signatures,
    Transmittance,
)
from opir_core.radiometry.records import Paths, Views


def intensities_w_sr(
    signatures: Signatures,
    bands: Sequence[int],
    target: IndexArray,
    time_since_ignition_s: FloatArray,
    altitude_m: FloatArray,
    aspect_rad: FloatArray,
) -> FloatArray:
    """Return radiant intensities (bands, n) at the source, W/sr."""
    columns = (target, time_since_ignition_s, altitude_m, aspect_rad)
    if isinstance(signatures, ManyBandSignatures):
        return signatures.intensities_w_sr(bands, *columns)
    return np.array([signatures.intensity_w_sr(band, *columns) for band in bands])


def transmittances(atmosphere: Transmittance, bands: Sequence[int], path: Paths) -> FloatArray:
    """Return in-band transmittances (bands, n)."""
    if isinstance(atmosphere, ManyBandTransmittance):
        return atmosphere.transmittances(bands, path)
    return np.array([atmosphere.transmittance(band, path) for band in bands])


def radiances_and_clutter_w_m2_sr(
    background: Background, bands: Sequence[int], view: Views
) -> tuple[FloatArray, FloatArray]:
    """Return in-band radiances and clutter (bands, n), W m⁻² sr⁻¹."""
    if isinstance(background, ManyBandBackground):
        return background.radiances_and_clutter_w_m2_sr(bands, view)
    both = [(background.radiance_w_m2_sr(band, view), background.clutter_w_m2_sr(band, view)) for band in bands]
    radiance, clutter = zip(*both, strict=True)
    return np.array(radiance), np.array(clutter)
