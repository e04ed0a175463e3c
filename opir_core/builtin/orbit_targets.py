"""The target model `orbit`: boost on a class profile into a circular orbit, without impact."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define

from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    ClassFlights,
    class_flights,
    classes_of,
    forces_of_targets,
    geodetic_columns,
    ignitions_s,
    plain_place,
    plain_states,
    refuse,
)
from opir_core.builtin.target_models import InsertionConfig
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.errors import Problem
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.orbit_insertion import Insertion, insertion
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import OrbitInsertion, TargetClass


@define(eq=False, kw_only=True, repr=False)
class OrbitTargets(ClassFlights):
    """Targets from ignition to insertion into orbit, and in orbit for the time in which sensors
    follow them.
    """

    flight: Insertion
    configs: tuple[InsertionConfig, ...]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: settings, burnout, and the orbit at burnout.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times
        are scene times.
        """
        flight = self.flight
        burnout = plain_states(flight.burnout_position_ecef_m, flight.burnout_velocity_ecef_m_s)
        orbit = _orbits(flight)
        return [
            {
                "id": self.ids[row],
                "type": config.type,
                "profile": self.profiles[row].name,
                "launch": plain_place(config.launch),
                "azimuth_deg": config.azimuth_deg,
                "ignition_s": float(self.ignition_s[row]),
                "burnout_s": float(self.burnout_s[row]),
                "burnout": burnout[row],
                "orbit": orbit[row],
            }
            for row, config in enumerate(self.configs)
        ]


def orbit_targets(configs: Sequence[InsertionConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class is not inserted into orbit, or
    whose orbit is out of reach of its profile.
    """
    classes = classes_of(configs, context, OrbitInsertion.model)
    profiles = tuple(kind.profiles[0] for kind in classes)
    azimuth_rad = np.radians([config.azimuth_deg for config in configs])
    altitude_m = np.array(
        [_altitude_m(config, kind) for config, kind in zip(configs, classes, strict=True)]
    )
    launch = geodetic_columns(config.launch for config in configs)
    flight = insertion(launch, ignitions_s(configs), azimuth_rad, altitude_m, profiles)
    refuse(
        [
            Problem(
                path,
                f"no ascent of {profile.name} was found that ends in a circular orbit at"
                f" {height / 1e3:g} km",
            )
            for path, profile, height, reached in zip(
                context.paths, profiles, altitude_m.tolist(), flight.converged.tolist(), strict=True
            )
            if not reached
        ]
    )
    final_s = flight.burnout_s + np.array([config.followed_s for config in configs])
    return class_flights(
        OrbitTargets,
        flight,
        configs,
        context,
        lambda: free_flight_ephemeris(
            flight.burnout_s,
            final_s,
            flight.burnout_position_eci_m,
            flight.burnout_velocity_eci_m_s,
            forces=forces_of_targets(configs, context),
            tolerance_m=EPHEMERIS_TOLERANCE_M,
        ),
        classes=classes,
        profiles=profiles,
        final_s=final_s,
    )


def _altitude_m(config: InsertionConfig, kind: TargetClass) -> float:
    assert isinstance(kind.after_burnout, OrbitInsertion)
    return kind.after_burnout.altitude_m if config.altitude_km is None else config.altitude_km * 1e3


def _orbits(flight: Insertion) -> list[dict[str, float]]:
    """Return the orbits at burnout as plain values: semi-major axis by vis-viva, eccentricity and
    inclination.
    """
    position = flight.burnout_position_eci_m
    velocity = flight.burnout_velocity_eci_m_s
    radius_m = np.sqrt(np.sum(position**2, axis=1))
    momentum = np.cross(position, velocity)
    axis_m = 1.0 / (2.0 / radius_m - np.sum(velocity**2, axis=1) / EARTH_MU_M3_S2)
    to_perigee = np.cross(velocity, momentum) / EARTH_MU_M3_S2 - position / radius_m[:, None]
    eccentricity = np.sqrt(np.sum(to_perigee**2, axis=1))
    inclination_rad = np.arctan2(np.hypot(momentum[:, 0], momentum[:, 1]), momentum[:, 2])
    period_s = 2.0 * np.pi * np.sqrt(axis_m**3 / EARTH_MU_M3_S2)
    names = ("altitude_m", "semi_major_axis_m", "eccentricity", "inclination_deg", "period_s")
    columns = (
        radius_m - EARTH_EQUATORIAL_RADIUS_M,
        axis_m,
        eccentricity,
        np.degrees(inclination_rad),
        period_s,
    )
    return [
        dict(zip(names, row, strict=True))
        for row in zip(*(column.tolist() for column in columns), strict=True)
    ]
