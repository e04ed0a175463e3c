"""The target model `glide`: boost on a class profile, equilibrium glide, then free fall to the aim
point. The air keeps gliders hot: where light is measured, every sensor looks at them to impact.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    AimedFlights,
    aims_of,
    class_flights,
    classes_of,
    forces_of_targets,
    ignitions_s,
    other_ranges,
    plain_states,
    refuse,
)
from opir_core.builtin.target_models import GlideConfig
from opir_core.errors import Problem
from opir_core.flight.glide import GlideFlight, GlideShape, glide_ephemeris, glide_flight
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import EquilibriumGlide


class GlideTargets(AimedFlights):
    """Targets that glide after burnout."""

    flight: GlideFlight

    def on_the_way(self) -> Sequence[Mapping[str, Any]]:
        """Return the end of each target's glide."""
        flight = self.flight
        release = plain_states(flight.release_position_ecef_m, flight.release_velocity_ecef_m_s)
        times = flight.release_s.tolist()
        return [
            {"glide_end": {**state, "time_s": time_s}}
            for state, time_s in zip(release, times, strict=True)
        ]


def glide_targets(configs: Sequence[GlideConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class does not glide, or whose aim
    point is out of reach.
    """
    launch, aim_point, range_m = aims_of(configs)
    classes = classes_of(configs, context, EquilibriumGlide.model)
    profiles = tuple(
        kind.profile(distance_m) for kind, distance_m in zip(classes, range_m.tolist(), strict=True)
    )
    forces = forces_of_targets(configs, context)
    flight = glide_flight(
        launch,
        aim_point,
        ignitions_s(configs),
        profiles,
        GlideShape.of(kind.after_burnout for kind in classes),
        forces=forces,
    )
    refuse(
        [
            Problem(f"{path}.aim", complaint + other_ranges(kind, profile))
            for path, complaint, kind, profile in zip(
                context.paths, flight.complaints, classes, profiles, strict=True
            )
            if complaint
        ]
    )
    return class_flights(
        GlideTargets,
        flight,
        configs,
        context,
        lambda: glide_ephemeris(flight, EPHEMERIS_TOLERANCE_M, forces),
        classes=classes,
        profiles=profiles,
        final_s=flight.impact_s,
        glow_end_s=flight.impact_s if context.measures_light else flight.burnout_s,
        turns_s=np.concatenate([flight.path.breakpoints_s(), flight.release_s[:, None]], axis=1),
    )
