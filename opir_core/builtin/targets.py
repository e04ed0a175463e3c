"""The target model `ballistic`: boost on a generic class profile, then free flight to the aim
point.
"""

from collections.abc import Mapping, Sequence

from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    AimedFlights,
    aims_of,
    class_flights,
    classes_of,
    forces_of_targets,
    ignitions_s,
    other_ranges,
    refuse,
)
from opir_core.builtin.configs import BallisticConfig
from opir_core.errors import Problem
from opir_core.flight.aiming import aim, coast_ephemeris
from opir_core.flight.boost import boost_profile
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Ballistic, BoostProfile, TargetClass


def ballistic_targets(configs: Sequence[BallisticConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class is not ballistic, whose profile
    is unknown or whose aim point is out of reach.
    """
    launch, aim_point, range_m = aims_of(configs)
    classes = classes_of(configs, context, Ballistic.model)
    unknown = _unknown_profiles(configs, classes)
    profiles = tuple(
        _profile(config, kind, distance_m, row in unknown)
        for row, (config, kind, distance_m) in enumerate(
            zip(configs, classes, range_m.tolist(), strict=True)
        )
    )
    forces = forces_of_targets(configs, context)
    flight = aim(launch, aim_point, ignitions_s(configs), profiles, forces=forces)
    refuse(_problems(unknown, flight.complaints, classes, profiles, context.paths))
    return class_flights(
        AimedFlights,
        flight,
        configs,
        context,
        lambda: coast_ephemeris(flight, EPHEMERIS_TOLERANCE_M, forces),
        classes=classes,
        profiles=profiles,
        final_s=flight.impact_s,
    )


def _unknown_profiles(
    configs: Sequence[BallisticConfig], classes: Sequence[TargetClass]
) -> dict[int, str]:
    """Return, by row, the errors of profiles that are named and do not exist."""
    complaints = {}
    for row, (config, kind) in enumerate(zip(configs, classes, strict=True)):
        try:
            if config.profile is not None:
                _named_profile(config.profile, kind)
        except ValueError as error:
            complaints[row] = str(error)
    return complaints


def _named_profile(name: str, kind: TargetClass) -> BoostProfile:
    """Return the profile of a name: one of the class, or of the core; `ValueError` if there is
    none.
    """
    profiles = {profile.name: profile for profile in kind.profiles}
    return profiles[name] if name in profiles else boost_profile(name)


def _profile(
    config: BallisticConfig, kind: TargetClass, range_m: float, is_unknown: bool
) -> BoostProfile:
    """Return the profile that a target flies; in the place of an unknown one, that of its class."""
    named = None if is_unknown else config.profile
    profile = kind.profile(range_m) if named is None else _named_profile(named, kind)
    return profile if config.burn_time_s is None else profile.with_burn_time(config.burn_time_s)


def _problems(
    unknown: Mapping[int, str],
    complaints: Sequence[str],
    classes: Sequence[TargetClass],
    profiles: Sequence[BoostProfile],
    paths: Sequence[str],
) -> list[Problem]:
    """Return the problems of targets that cannot fly as configured."""
    problems = []
    for row, (complaint, kind, path) in enumerate(zip(complaints, classes, paths, strict=True)):
        if row in unknown:
            problems.append(Problem(f"{path}.profile", unknown[row]))
        elif complaint:
            problems.append(
                Problem(f"{path}.aim", f"{complaint}{other_ranges(kind, profiles[row])}")
            )
    return problems
