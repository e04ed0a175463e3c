"""The target model `ballistic`: boost on a generic class profile, then free flight to the aim point."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import define
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray
from opir_core.builtin.configs import AimConfig, BallisticConfig, LaunchConfig
from opir_core.errors import Problem, SceneError
from opir_core.flight.aiming import Aim, aim, surface_range_m
from opir_core.flight.boost import boost_profile
from opir_core.flight.ephemeris import Ephemeris
from opir_core.geometry import Geodetic, ecef_to_geodetic
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.protocols import Trajectories
from opir_core.scene.target_classes import BoostProfile, TargetClass

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel

#: How far the interpolated positions may be from the profile's, m.
EPHEMERIS_TOLERANCE_M = 0.01


@define(eq=False)
class BallisticTargets:
    """Targets on their way from ignition to burnout, or to the end, and what is known of their flight to the aim point.

    `coast` is their free flight where a sensor follows it, else None.
    """

    type_code: NDArray[np.uint8]
    ignition_s: FloatArray
    burnout_s: FloatArray
    boost: Ephemeris
    coast: Ephemeris | None
    flight: Aim
    ids: tuple[str, ...]
    configs: tuple[BallisticConfig, ...]
    profiles: tuple[BoostProfile, ...]

    @property
    def class_names(self) -> Sequence[str]:
        """Names of the target classes."""
        return [config.type for config in self.configs]

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,), to 1 cm; nan outside ignition to `end_s`."""
        if self.coast is None:
            return self.boost.position_m(target, time_s)
        late = time_s > self.burnout_s[target]
        boost = self.boost.position_m(target, np.where(late, np.nan, time_s))
        return np.where(late[:, None], self.coast.position_m(target, np.where(late, time_s, np.nan)), boost)

    @property
    def end_s(self) -> FloatArray:
        """Scene times to which positions are known, (n,) s."""
        return self.burnout_s if self.coast is None else self.flight.impact_s

    @property
    def course_breakpoints_s(self) -> FloatArray:
        """Scene times (n, 1) of pitch-over, before which flight is vertical."""
        return self.flight.path.breakpoints_s()

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: what was asked for, burnout and impact.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times are scene times.
        """
        burnout, impact = (
            _places(ecef_to_geodetic(position))
            for position in (self.flight.burnout_position_ecef_m, self.flight.impact_ecef_m)
        )
        return [
            {
                "id": self.ids[row],
                "type": config.type,
                "profile": self.profiles[row].name,
                "launch": _place(config.launch),
                "aim": _place(config.aim),
                "ignition_s": float(self.ignition_s[row]),
                "burnout_s": float(self.burnout_s[row]),
                "burnout": {
                    **burnout[row],
                    "position_ecef_m": self.flight.burnout_position_ecef_m[row].tolist(),
                    "velocity_ecef_m_s": self.flight.burnout_velocity_ecef_m_s[row].tolist(),
                },
                "impact": {**impact[row], "time_s": float(self.flight.impact_s[row])},
                "miss_m": float(self.flight.miss_m[row]),
            }
            for row, config in enumerate(self.configs)
        ]


def ballistic_targets(configs: Sequence[BallisticConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose profile is unknown or whose aim point is out of reach.
    """
    launch, aim_point = (_columns(getattr(config, place) for config in configs) for place in ("launch", "aim"))
    classes = [context.target_class(config.type) for config in configs]
    unknown = _unknown_profiles(configs, classes)
    ranges_m = surface_range_m(
        launch.latitude_rad, launch.longitude_rad, aim_point.latitude_rad, aim_point.longitude_rad
    ).tolist()
    profiles = tuple(
        _profile(config, kind, range_m, row in unknown)
        for row, (config, kind, range_m) in enumerate(zip(configs, classes, ranges_m, strict=True))
    )
    ignition_s = np.array([config.launch.time_s for config in configs], dtype=np.float64)
    forces = _forces(configs, context)
    flight = aim(launch, aim_point, ignition_s, profiles, forces=forces)
    problems = _problems(unknown, flight.complaints, classes, profiles, context.paths)
    if problems:
        raise SceneError(problems)
    path = flight.path
    return BallisticTargets(
        type_code=np.array([kind.type_code for kind in classes], dtype=np.uint8),
        ignition_s=ignition_s,
        burnout_s=flight.burnout_s,
        boost=Ephemeris.build(path.state, ignition_s, flight.burnout_s, path.breakpoints_s(), EPHEMERIS_TOLERANCE_M),
        coast=_coast(flight, forces) if context.free_flight else None,
        flight=flight,
        ids=context.ids,
        configs=tuple(configs),
        profiles=profiles,
    )


def _coast(flight: Aim, forces: "ForceModel") -> Ephemeris:
    from opir_core.flight.aiming import coast_ephemeris

    return coast_ephemeris(flight, EPHEMERIS_TOLERANCE_M, forces)


def _forces(configs: Sequence[BallisticConfig], context: TargetContext) -> "ForceModel":
    """Return the scene's forces, with the ballistic coefficients that targets bring."""
    forces = context.forces
    if isinstance(forces, str) or forces.drag is None:
        return forces
    usual = float(forces.drag.ballistic_coefficient_kg_m2)
    own = (config.ballistic_coefficient_kg_m2 for config in configs)
    return forces.with_ballistic_coefficients([usual if value is None else value for value in own])


def _unknown_profiles(configs: Sequence[BallisticConfig], classes: Sequence[TargetClass]) -> dict[int, str]:
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
    """Return the profile of a name: one of the class, or of the core; `ValueError` if there is none."""
    own = {profile.name: profile for profile in kind.profiles}
    return own[name] if name in own else boost_profile(name)


def _profile(config: BallisticConfig, kind: TargetClass, range_m: float, is_unknown: bool) -> BoostProfile:
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
    """Return what is wrong with each target that cannot fly as asked."""
    problems = []
    for row, (complaint, kind, path) in enumerate(zip(complaints, classes, paths, strict=True)):
        if row in unknown:
            problems.append(Problem(f"{path}.profile", unknown[row]))
        elif complaint:
            problems.append(Problem(f"{path}.aim", f"{complaint}{_other_ranges(kind, profiles[row])}"))
    return problems


def _other_ranges(kind: TargetClass, chosen: BoostProfile) -> str:
    """Return which ranges the other profiles of a class have."""
    others = (profile for profile in kind.profiles if profile.name != chosen.name)
    return "".join(
        f"; of type {kind.name} there is also {other.name}, {other.minimum_range_m / 1e3:g} to"
        f" {other.maximum_range_m / 1e3:g} km"
        for other in others
    )


def _columns(places: Iterable[LaunchConfig | AimConfig]) -> Geodetic:
    """Return the columns of places in radians and metres."""
    rows = [(math.radians(place.lat_deg), math.radians(place.lon_deg), place.height_m) for place in places]
    return Geodetic(*np.array(rows, dtype=np.float64).reshape(-1, 3).T)


def _place(config: LaunchConfig | AimConfig) -> dict[str, float]:
    return {"lat_deg": config.lat_deg, "lon_deg": config.lon_deg, "height_m": config.height_m}


def _places(where: Geodetic) -> list[dict[str, float]]:
    columns = (np.degrees(where.latitude_rad), np.degrees(where.longitude_rad), where.height_m)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [{"lat_deg": latitude, "lon_deg": longitude, "height_m": height} for latitude, longitude, height in rows]
