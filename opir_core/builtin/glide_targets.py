"""The target model `glide`: boost on a class profile, equilibrium glide, then free fall to the aim point."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define

from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    ClassFlights,
    classes_of,
    forces_of_targets,
    geodetic_columns,
    ignitions_s,
    other_ranges,
    plain_place,
    plain_places,
    plain_states,
)
from opir_core.builtin.configs import GlideConfig
from opir_core.errors import Problem, SceneError
from opir_core.flight.aiming import boost_ephemeris, surface_range_m
from opir_core.flight.glide import GlideFlight, GlideShape, glide_ephemeris, glide_flight
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.protocols import Trajectories
from opir_core.scene.target_classes import EquilibriumGlide, TargetClass


@define(eq=False, kw_only=True)
class GlideTargets(ClassFlights):
    """Targets from ignition to burnout, or to impact, and what is known of their flight to the aim point."""

    flight: GlideFlight
    configs: tuple[GlideConfig, ...]

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: what was asked for, burnout, the end of the glide, and impact.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times are scene times.
        """
        flight = self.flight
        burnout = plain_states(flight.burnout_position_ecef_m, flight.burnout_velocity_ecef_m_s)
        release = plain_states(flight.release_position_ecef_m, flight.release_velocity_ecef_m_s)
        impact = plain_places(flight.impact_ecef_m)
        return [
            {
                "id": self.ids[row],
                "type": config.type,
                "profile": self.profiles[row].name,
                "launch": plain_place(config.launch),
                "aim": plain_place(config.aim),
                "ignition_s": float(self.ignition_s[row]),
                "burnout_s": float(self.burnout_s[row]),
                "burnout": burnout[row],
                "glide_end": {**release[row], "time_s": float(flight.release_s[row])},
                "impact": {**impact[row], "time_s": float(flight.impact_s[row])},
                "miss_m": float(flight.miss_m[row]),
            }
            for row, config in enumerate(self.configs)
        ]


def glide_targets(configs: Sequence[GlideConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class does not glide, or whose aim point is out of reach.
    """
    launch, aim_point = (geodetic_columns(getattr(config, place) for config in configs) for place in ("launch", "aim"))
    classes = classes_of(configs, context, EquilibriumGlide.model)
    ranges_m = surface_range_m(*launch[:2], *aim_point[:2]).tolist()
    profiles = tuple(kind.profile(range_m) for kind, range_m in zip(classes, ranges_m, strict=True))
    forces = forces_of_targets(configs, context)
    flight = glide_flight(launch, aim_point, ignitions_s(configs), profiles, _shape(classes), forces=forces)
    problems = [
        Problem(f"{path}.aim", complaint + other_ranges(kind, profile))
        for path, complaint, kind, profile in zip(context.paths, flight.complaints, classes, profiles, strict=True)
        if complaint
    ]
    if problems:
        raise SceneError(problems)
    turns_s = np.concatenate([flight.path.breakpoints_s(), flight.release_s[:, None]], axis=1)
    return GlideTargets(
        classes=classes,
        profiles=profiles,
        ids=context.ids,
        ignition_s=flight.path.ignition_s,
        burnout_s=flight.burnout_s,
        final_s=flight.impact_s,
        turns_s=turns_s,
        boost=boost_ephemeris(flight.path, EPHEMERIS_TOLERANCE_M),
        coast=glide_ephemeris(flight, EPHEMERIS_TOLERANCE_M, forces) if context.free_flight else None,
        flight=flight,
        configs=tuple(configs),
    )


def _shape(classes: Sequence[TargetClass]) -> GlideShape:
    """Return the constants of the classes' glides."""
    glides = [kind.after_burnout for kind in classes if isinstance(kind.after_burnout, EquilibriumGlide)]
    columns = [(glide.lift_to_drag, glide.final_speed_m_s, glide.scale_height_m) for glide in glides]
    return GlideShape(*np.array(columns, dtype=np.float64).reshape(-1, 3).T)
