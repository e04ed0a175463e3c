"""The target model `air-launch`: ignition in level flight, a pull-up, boost at a constant flight
path angle, then free flight to wherever that leads.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define, evolve

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
from opir_core.flight.air_launch import AirLaunch, AirLaunchPath
from opir_core.flight.boost import launch_site
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.propagation import impact
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Ballistic, BoostProfile


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
