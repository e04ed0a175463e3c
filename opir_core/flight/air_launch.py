"""Boosts that begin in level flight: ignition, a pull-up, then a constant flight path angle.

Speed relative to the Earth is v₀ + Δv · expm1(k t/T) / expm1(k), with Δv, T and k the burnout
speed, burn time and shape of a class profile. The flight path angle is γ · sin(½π t/t_p) until t_p,
so that the pull-up begins with v₀ dγ/dt, and then γ.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.boost import LaunchPlane, speed_ratio, vertical_climb_s
from opir_core.geometry.vectors import FloatPair

#: Nodes and weights of Gauss and Legendre on [0, 1].
_NODES, _WEIGHTS = (0.5 * column for column in np.polynomial.legendre.leggauss(12))
_NODES = _NODES + 0.5


@frozen(eq=False)
class AirLaunchPath:
    """The boosts of n targets, ignition to burnout; columns (n,), in SI units and rad."""

    plane: LaunchPlane
    ignition_s: FloatArray
    burn_time_s: FloatArray
    speed_m_s: FloatArray
    gain_m_s: FloatArray
    speed_shape: FloatArray
    climb_rad: FloatArray
    pull_m_s2: FloatArray

    @property
    def burnout_s(self) -> FloatArray:
        """Scene times of burnout, (n,) s."""
        return self.ignition_s + self.burn_time_s

    @property
    def pull_s(self) -> FloatArray:
        """How long the pull-up takes, (n,) s, at most the burn."""
        pull_s = 0.5 * np.pi * self.climb_rad * self.speed_m_s / self.pull_m_s2
        return np.minimum(pull_s, self.burn_time_s)

    def breakpoints_s(self) -> FloatArray:
        """Return the times (n, 1) at which the pull-up ends."""
        return (self.ignition_s + self.pull_s)[:, None]

    def state(self, target: RowArray, time_s: FloatArray) -> FloatPair:
        """Return ECEF positions and velocities relative to the Earth (m, 3) of targets (m,) at
        times (m,) of their burns.
        """
        elapsed_s = np.minimum(time_s - self.ignition_s[target], self.burn_time_s[target])
        pull_s = self.pull_s[target]
        pulled_s = np.minimum(elapsed_s, pull_s)
        risen_m = self._pulled_m(target, pulled_s)
        swept = self._swept_rad(target, pulled_s)
        angle = self.climb_rad[target]
        way_m = self._way_m(target, elapsed_s) - self._way_m(target, pulled_s)
        height_m = risen_m + np.sin(angle) * way_m
        radius_m = self.plane.radius_m[target]
        swept += np.log((radius_m + height_m) / (radius_m + risen_m)) / np.tan(angle)
        lean = 0.5 * np.pi - self._angle_rad(target, pulled_s)
        plane = self.plane.take(target)
        return plane.state(height_m, swept, self._speeds_m_s(target, elapsed_s), lean)

    def _angle_rad(self, target: RowArray, elapsed_s: FloatArray) -> FloatArray:
        share = np.minimum(elapsed_s / self.pull_s[target], 1.0)
        return self.climb_rad[target] * np.sin(0.5 * np.pi * share)

    def _speeds_m_s(self, target: RowArray, elapsed_s: FloatArray) -> FloatArray:
        shape = self.speed_shape[target]
        ratio = speed_ratio(elapsed_s, self.burn_time_s[target], shape)
        return self.speed_m_s[target] + self.gain_m_s[target] * ratio

    def _way_m(self, target: RowArray, elapsed_s: FloatArray) -> FloatArray:
        """Return the lengths of the ways (m,) since ignition."""
        columns = (elapsed_s, self.burn_time_s[target], self.speed_shape[target])
        return self.speed_m_s[target] * elapsed_s + self.gain_m_s[target] * vertical_climb_s(
            *columns
        )

    def _pulled_m(self, target: RowArray, elapsed_s: FloatArray) -> FloatArray:
        """Return how far (m,) targets have risen in their pull-up."""
        total = np.zeros(len(target))
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            time_s = node * elapsed_s
            climb = np.sin(self._angle_rad(target, time_s))
            total += weight * self._speeds_m_s(target, time_s) * climb
        return total * elapsed_s

    def _swept_rad(self, target: RowArray, elapsed_s: FloatArray) -> FloatArray:
        """Return the angles (m,) about the Earth's centre that targets have swept in it."""
        total = np.zeros(len(target))
        for node, weight in zip(_NODES, _WEIGHTS, strict=True):
            time_s = node * elapsed_s
            level = self._speeds_m_s(target, time_s) * np.cos(self._angle_rad(target, time_s))
            radius_m = self.plane.radius_m[target] + self._pulled_m(target, time_s)
            total += weight * level / radius_m
        return total * elapsed_s


@frozen(eq=False)
class AirLaunch:
    """The flights of n targets: their boosts, states at burnout, and times, s, and points of
    impact, ECEF, m.
    """

    path: AirLaunchPath
    burnout_ecef: FloatPair
    impact_s: FloatArray
    impact_ecef_m: FloatArray

    @property
    def burnout_s(self) -> FloatArray:
        """Scene times of burnout, (n,) s."""
        return self.path.burnout_s
