"""The target model `ballistic`: boost on a generic class profile, then free flight to the aim
point.
"""

from collections.abc import Mapping, Sequence

from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    AimedFlights,
    classes_of,
    forces_of_targets,
    geodetic_columns,
    ignitions_s,
    other_ranges,
)
from opir_core.builtin.configs import BallisticConfig
from opir_core.errors import Problem, SceneError
from opir_core.flight.aiming import aim, boost_ephemeris, coast_ephemeris, surface_range_m
from opir_core.flight.boost import boost_profile
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Ballistic, BoostProfile, TargetClass


def ballistic_targets(configs: Sequence[BallisticConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose class is not ballistic, whose profile
    is unknown or whose aim point is out of reach.
    """
    launch, aim_point = (
        geodetic_columns(getattr(config, place) for config in configs)
        for place in ("launch", "aim")
    )
    classes = classes_of(configs, context, Ballistic.model)
    unknown = _unknown_profiles(configs, classes)
    ranges_m = surface_range_m(*launch[:2], *aim_point[:2]).tolist()
    profiles = tuple(
        _profile(config, kind, range_m, row in unknown)
        for row, (config, kind, range_m) in enumerate(zip(configs, classes, ranges_m, strict=True))
    )
    forces = forces_of_targets(configs, context)
    flight = aim(launch, aim_point, ignitions_s(configs), profiles, forces=forces)
    problems = _problems(unknown, flight.complaints, classes, profiles, context.paths)
    if problems:
        raise SceneError(problems)
    return AimedFlights(
        classes=classes,
        profiles=profiles,
        ids=context.ids,
        ignition_s=flight.path.ignition_s,
        burnout_s=flight.burnout_s,
        final_s=flight.impact_s,
        turns_s=flight.path.breakpoints_s(),
        boost=boost_ephemeris(flight.path, EPHEMERIS_TOLERANCE_M),
        coast=coast_ephemeris(flight, EPHEMERIS_TOLERANCE_M, forces)
        if context.free_flight
        else None,
        flight=flight,
        configs=tuple(configs),
    )


def _unknown_profiles(
    configs: Sequence[BallisticConfig], classes: Sequence[TargetClass]
) -> dict[int, str]:
    """Return, by row, what is wrong with the profiles that are named and do not exist."""
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
    own = {profile.name: profile for profile in kind.profiles}
    return own[name] if name in own else boost_profile(name)


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
