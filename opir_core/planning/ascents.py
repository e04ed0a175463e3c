"""When burning targets pass altitudes: once each, on the way up."""

from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.flight.gravity_and_drag import height_m
from opir_core.geometry.vectors import length
from opir_core.interfaces.columns import Columns
from opir_core.planning.targets import Targets

#: Moments of a burn at which heights are sampled, and steps that sharpen a crossing between two of them.
_SAMPLES, _STEPS = 48, 3


@frozen(eq=False)
class Ascents(Columns):
    """Heights (n, m), m, of targets (n,) at scene times (n, m), s, from ignition to burnout."""

    target: IndexArray
    time_s: FloatArray
    height_m: FloatArray
    targets: Targets

    def take(self, rows: Any) -> "Ascents":
        """Return those of some of the targets."""
        return Ascents(self.target[rows], self.time_s[rows], self.height_m[rows], self.targets)

    def times_s(self, levels_m: FloatArray) -> FloatArray:
        """Return the scene times (n, k) at which targets first rise through levels (n, k); nan where they do not."""
        below = self.height_m[:, :-1, None] < levels_m[:, None, :]
        crossed = below & (self.height_m[:, 1:, None] >= levels_m[:, None, :])
        row, level = np.nonzero(crossed.any(axis=1))
        step = crossed.argmax(axis=1)[row, level]
        low_s, high_s = self.time_s[row, step], self.time_s[row, step + 1]
        low_m, high_m = self.height_m[row, step], self.height_m[row, step + 1]
        wanted_m = levels_m[row, level]
        for _ in range(_STEPS):
            middle_s = low_s + (high_s - low_s) * (wanted_m - low_m) / (high_m - low_m)
            middle_m = _heights_m(self.targets, self.target[row], middle_s)
            # The root of the parabola through three points is nearer by far; a bracket keeps it safe.
            is_low = middle_m < wanted_m
            low_s, low_m = np.where(is_low, middle_s, low_s), np.where(is_low, middle_m, low_m)
            high_s, high_m = np.where(is_low, high_s, middle_s), np.where(is_low, high_m, middle_m)
        times_s = np.full(levels_m.shape, np.nan)
        times_s[row, level] = low_s + (high_s - low_s) * (wanted_m - low_m) / np.maximum(high_m - low_m, 1e-300)
        return times_s


def ascents(targets: Targets) -> Ascents:
    """Return the heights of all targets while they burn."""
    everyone = np.arange(len(targets.ids), dtype=np.int32)
    share = np.arange(_SAMPLES + 1) / _SAMPLES
    time_s = targets.ignition_s[:, None] + (targets.burnout_s - targets.ignition_s)[:, None] * share
    # Rounding leads no moment out of the burn.
    time_s = np.minimum(time_s, targets.burnout_s[:, None])
    height_m = _heights_m(targets, np.repeat(everyone, _SAMPLES + 1), time_s.ravel())
    return Ascents(everyone, time_s, height_m.reshape(time_s.shape), targets)


def _heights_m(targets: Targets, target: IndexArray, time_s: FloatArray) -> FloatArray:
    return heights_m(targets.position_ecef_m(target, time_s))


def heights_m(position_ecef_m: FloatArray) -> FloatArray:
    """Return heights (n,) above the WGS 84 ellipsoid of positions (n, 3), to 2e-8 m: a fifth of what angles cost."""
    position = position_ecef_m.T
    return height_m(position, 1.0 / length(*position))
