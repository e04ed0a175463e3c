"""The atmosphere `clear` and the background `none`."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.host.components import NoConfig
from opir_core.interfaces.radiometric_models import (
    AtmosphereContext,
    Background,
    BackgroundContext,
    Paths,
    Transmittance,
    Views,
)


@frozen
class ClearSky(Transmittance):
    """An atmosphere with a transmittance of 1."""

    uses_seed: bool = False

    def transmittance(self, band: int, path: Paths) -> FloatArray:
        """Return 1 for all paths."""
        return np.ones(len(path))


@frozen
class NoBackground(Background):
    """A background without radiance."""

    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return 0 for all views."""
        return np.zeros(len(view))

    clutter_w_m2_sr = radiance_w_m2_sr


def clear_atmosphere(_config: NoConfig, _context: AtmosphereContext) -> Transmittance:
    """Return the atmosphere `clear`."""
    return ClearSky()


def no_background(_config: NoConfig, _context: BackgroundContext) -> Background:
    """Return the background `none`."""
    return NoBackground()
