"""The null models of the sky: the atmosphere `clear` and the background `none`."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.plugin.components import NoConfig
from opir_core.radiometry.protocols import AtmosphereContext, Background, BackgroundContext, Paths, Transmittance, Views


@frozen
class ClearSky:
    """An atmosphere that lets everything through."""

    def transmittance(self, band: int, path: Paths) -> FloatArray:
        """Return 1 for all paths."""
        return np.ones(len(path))

    def cloud_top_m(self, point_ecef_m: FloatArray) -> FloatArray:
        """Return -inf for all points: there are no clouds."""
        return np.full(len(point_ecef_m), -np.inf)


@frozen
class NoBackground:
    """A world that is dark but for what is looked for."""

    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return 0 for all views."""
        return np.zeros(len(view))

    def clutter_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return 0 for all views."""
        return np.zeros(len(view))


def clear_atmosphere(_config: NoConfig, _context: AtmosphereContext) -> Transmittance:
    """Return the atmosphere `clear`."""
    return ClearSky()


def no_background(_config: NoConfig, _context: BackgroundContext) -> Background:
    """Return the background `none`."""
    return NoBackground()
