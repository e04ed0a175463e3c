"""The target model `air-launch`: ignition in level flight, a pull-up, boost at a constant flight
path angle, then free flight to wherever that leads.

Speed relative to the Earth is v₀ + Δv · expm1(k t/T) / expm1(k), with Δv, T and k the burnout
speed, burn time and shape of a class profile. The flight path angle is γ · sin(½π t/t_p) until t_p,
so that the pull-up begins with v₀ dγ/dt, and then γ.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define, evolve, frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    ClassFlights,
    class_flights,
    classes_of,
    forces_of_targets,
    geodetic_columns,
    ignitions_s,
    plain_place,
    plain_places,
    plain_states,
    refuse,
)
from opir_core.builtin.target_models import AirLaunchConfig
from opir_core.errors import Problem
from opir_core.flight.boost import LaunchPlane, launch_site, speed_ratio, vertical_climb_s
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.propagation import impact
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef
from opir_core.geometry.vectors import FloatPair
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Ballistic, BoostProfile

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


@define(eq=False, kw_only=True, repr=False)
class AirLaunchTargets(ClassFlights):
    """Targets launched in the air, from ignition to burnout, or to impact."""

    flight: AirLaunch
    configs: tuple[AirLaunchConfig, ...]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: settings, burnout and impact.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times
        are scene times.
        """
        burnout = plain_states(*self.flight.burnout_ecef)
        places = plain_places(self.flight.impact_ecef_m)
        return [
            {
                "id": self.ids[row],
                "type": config.type,
                "profile": self.profiles[row].name,
                "launch": plain_place(config.launch),
                "heading_deg": config.heading_deg,
                "speed_m_s": config.speed_m_s,
                "ignition_s": float(self.ignition_s[row]),
                "burnout_s": float(self.burnout_s[row]),
                "burnout": burnout[row],
                "impact": {**places[row], "time_s": float(self.final_s[row])},
            }
            for row, config in enumerate(self.configs)
        ]


def air_launch_targets(configs: Sequence[AirLaunchConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class is not ballistic, or that does
    not come down within a day.
    """
    classes = classes_of(configs, context, Ballistic.model, "air-launch")
    profiles = tuple(
        _profile(config, kind.profiles[0]) for config, kind in zip(configs, classes, strict=True)
    )
    path = _path(configs, profiles)
    rows = np.arange(len(configs))
    burnout = path.state(rows, path.burnout_s)
    states = ecef_to_eci_state(*burnout, path.burnout_s)
    forces = forces_of_targets(configs, context)
    fall_s, point_m = impact(*states, 0.0, forces)
    refuse(
        [
            Problem(place, "does not come down within a day; lower speed_gain_m_s")
            for place, is_lost in zip(context.paths, np.isnan(fall_s).tolist(), strict=True)
            if is_lost
        ]
    )
    impact_s = path.burnout_s + fall_s
    flight = AirLaunch(path, burnout, impact_s, eci_to_ecef(point_m, impact_s))
    return class_flights(
        AirLaunchTargets,
        flight,
        configs,
        context,
        lambda: free_flight_ephemeris(
            path.burnout_s, impact_s, *states, forces=forces, tolerance_m=EPHEMERIS_TOLERANCE_M
        ),
        classes=classes,
        profiles=profiles,
        final_s=impact_s,
    )


def _profile(config: AirLaunchConfig, profile: BoostProfile) -> BoostProfile:
    """Return the profile of a class with what the target sets of it."""
    gain = config.speed_gain_m_s
    burn_s = config.burn_time_s
    flown = profile if burn_s is None else profile.with_burn_time(burn_s)
    return flown if gain is None else evolve(flown, burnout_speed_m_s=gain)


def _path(configs: Sequence[AirLaunchConfig], profiles: Sequence[BoostProfile]) -> AirLaunchPath:
    site = launch_site(*geodetic_columns(config.launch for config in configs))
    return AirLaunchPath(
        plane=site.plane(np.radians([config.heading_deg for config in configs])),
        ignition_s=ignitions_s(configs),
        burn_time_s=np.array([profile.burn_time_s for profile in profiles]),
        speed_m_s=np.array([config.speed_m_s for config in configs]),
        gain_m_s=np.array([profile.burnout_speed_m_s for profile in profiles]),
        speed_shape=np.array([profile.speed_shape for profile in profiles]),
        climb_rad=np.radians([config.climb_deg for config in configs]),
        pull_m_s2=np.array([config.pull_m_s2 for config in configs]),
    )
