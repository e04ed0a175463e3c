"""Null models: the atmosphere `clear`, the background `none` and the tracker `none`."""

from typing import TYPE_CHECKING

import numpy as np
from attrs import define, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.protocols import Tracker
from opir_core.interfaces.records import Detections, Tracks
from opir_core.plugin.components import NoConfig

if TYPE_CHECKING:
    from opir_core.interfaces.radiometric_models import (
        AtmosphereContext,
        Background,
        BackgroundContext,
        Paths,
        Transmittance,
        Views,
    )


@frozen
class ClearSky:
    """An atmosphere with a transmittance of 1."""

    def transmittance(self, band: int, path: "Paths") -> FloatArray:
        """Return 1 for all paths."""
        return np.ones(len(path))

    def cloud_top_m(self, point_ecef_m: FloatArray) -> FloatArray:
        """Return -inf for all points: there are no clouds."""
        return np.full(len(point_ecef_m), -np.inf)


@frozen
class NoBackground:
    """A background without radiance."""

    def radiance_w_m2_sr(self, band: int, view: "Views") -> FloatArray:
        """Return 0 for all views."""
        return np.zeros(len(view))

    def clutter_w_m2_sr(self, band: int, view: "Views") -> FloatArray:
        """Return 0 for all views."""
        return np.zeros(len(view))


def clear_atmosphere(_config: NoConfig, _context: "AtmosphereContext") -> "Transmittance":
    """Return the atmosphere `clear`."""
    return ClearSky()


def no_background(_config: NoConfig, _context: "BackgroundContext") -> "Background":
    """Return the background `none`."""
    return NoBackground()


@define
class NoTracker(Tracker):
    """A tracker without tracks: it never steps, and the track number of every detection is -1."""

    cadence_s: float | None = None

    def associate(self, detections: Detections) -> IntArray:
        """Return -1 for each detection."""
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return no estimates."""
        return Tracks.empty()


def no_tracker(_config: NoConfig, _context: TrackerContext) -> Tracker:
    """Return the tracker `none`."""
    return NoTracker()
