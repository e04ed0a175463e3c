"""What the target models of classes share: their trajectories, choice of profiles, and plain values
for the truth.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import Factory, define, field

from opir_core.arrays import ByteArray, FloatArray, IndexArray
from opir_core.builtin.configs import BallisticConfig, PlaceConfig
from opir_core.errors import Problem, SceneError
from opir_core.flight.aiming import boost_ephemeris, surface_range_m
from opir_core.flight.ephemeris import Ephemeris
from opir_core.geometry import Geodetic, ecef_to_geodetic
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import BoostProfile, TargetClass

if TYPE_CHECKING:
    from opir_core.builtin.target_models import ClassConfig, GlideConfig, GravityTurnConfig
    from opir_core.flight.aiming import Aim
    from opir_core.flight.air_launch import AirLaunch
    from opir_core.flight.forces import ForceModel
    from opir_core.flight.glide import GlideFlight
    from opir_core.flight.orbit_insertion import Insertion

#: How far the interpolated positions may be from the profile's, m.
EPHEMERIS_TOLERANCE_M = 0.01


@define(eq=False, kw_only=True, repr=False)
class ClassFlights(Trajectories):
    """Targets of classes, from ignition to burnout or, where a sensor looks on, to the end of
    their flight.

    `coast` is the flight after burnout where a sensor looks at it, else None; `final_s` (n,) its
    end; `turns_s` (n, k) the times at which the direction of flight bends; `glow_end_s` (n,) those
    up to which every sensor looks.
    """

    classes: tuple[TargetClass, ...]
    profiles: tuple[BoostProfile, ...]
    ids: tuple[str, ...]
    ignition_s: FloatArray
    burnout_s: FloatArray
    final_s: FloatArray
    turns_s: FloatArray
    boost: Ephemeris
    coast: Ephemeris | None
    glow_end_s: FloatArray = field(
        default=Factory(lambda flights: flights.burnout_s, takes_self=True)
    )

    @property
    def type_code(self) -> ByteArray:
        """Codes (n,) of the missile types that the classes resemble."""
        return np.array([kind.type_code for kind in self.classes], dtype=np.uint8)

    @property
    def class_names(self) -> Sequence[str]:
        """Names of the target classes."""
        return [kind.name for kind in self.classes]

    @property
    def end_s(self) -> FloatArray:
        """Scene times to which positions are known, (n,) s."""
        return self.burnout_s if self.coast is None else self.final_s

    @property
    def course_breakpoints_s(self) -> FloatArray:
        """Scene times (n, k) at which the direction of flight bends: pitch-over, and after
        burnout.
        """
        return self.turns_s

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,), to 1 cm; nan outside
        ignition to `end_s`.
        """
        if self.coast is None:
            return self.boost.position_m(target, time_s)
        coasting = time_s > self.burnout_s[target]
        boost = self.boost.position_m(target, np.where(coasting, np.nan, time_s))
        return np.where(
            coasting[:, None],
            self.coast.position_m(target, np.where(coasting, time_s, np.nan)),
            boost,
        )


@define(eq=False, kw_only=True, repr=False)
class AimedFlights(ClassFlights):
    """Targets from ignition to burnout, or to impact, with their flight to the aim
    point.
    """

    flight: "Aim | GlideFlight"
    configs: "tuple[BallisticConfig | GlideConfig, ...]"

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: settings, burnout, the glide if there is one, and impact.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times
        are scene times.
        """
        flight = self.flight
        burnout = plain_states(flight.burnout_position_ecef_m, flight.burnout_velocity_ecef_m_s)
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
                **later,
                "impact": {**impact[row], "time_s": float(flight.impact_s[row])},
                "miss_m": float(flight.miss_m[row]),
            }
            for row, (config, later) in enumerate(zip(self.configs, self.on_the_way(), strict=True))
        ]

    def on_the_way(self) -> Sequence[Mapping[str, Any]]:
        """Return the rows of each target's truth between burnout and impact."""
        return [{}] * len(self.ids)


def classes_of(
    configs: "Sequence[ClassConfig]", context: TargetContext, model: str, name: str = ""
) -> tuple[TargetClass, ...]:
    """Return the classes of targets; raises `SceneError` for those that another model flies after
    burnout.

    `name` is the name of the target model where it is not that of its classes.
    """
    classes = tuple(context.target_class(config.type) for config in configs)
    problems = [
        Problem(
            f"{path}.type",
            f"{kind.name} has the model {kind.after_burnout.model}, not {name or model}; omit model",
        )
        for kind, path in zip(classes, context.paths, strict=True)
        if kind.after_burnout.model != model
    ]
    refuse(problems)
    return classes


def refuse(problems: Sequence[Problem]) -> None:
    """Raise `SceneError` with the problems, if there are any."""
    if problems:
        raise SceneError(problems)


def aims_of(
    configs: "Sequence[BallisticConfig | GlideConfig | GravityTurnConfig]",
) -> tuple[Geodetic, Geodetic, FloatArray]:
    """Return launch and aim points of targets, and their distances (n,), m."""
    launch, aim = (
        geodetic_columns(getattr(config, place) for config in configs)
        for place in ("launch", "aim")
    )
    return launch, aim, surface_range_m(*launch[:2], *aim[:2])


def class_flights(
    record: Callable[..., Trajectories],
    flight: "Aim | AirLaunch | GlideFlight | Insertion",
    configs: "Sequence[ClassConfig]",
    context: TargetContext,
    coast: Callable[[], Ephemeris],
    **columns: Any,
) -> Trajectories:
    """Return targets whose boosts follow class profiles, with their flight and other columns.

    `coast` makes the flight after burnout, where a sensor looks at it: `glow_end_s` of `columns`,
    by default burnout, is the time up to which every sensor does.
    """
    is_watched = np.any(columns.get("glow_end_s", flight.burnout_s) > flight.burnout_s)
    return record(
        ids=context.ids,
        ignition_s=flight.path.ignition_s,
        burnout_s=flight.burnout_s,
        boost=boost_ephemeris(flight.path, EPHEMERIS_TOLERANCE_M),
        coast=coast() if context.free_flight or is_watched else None,
        flight=flight,
        configs=tuple(configs),
        **{"turns_s": flight.path.breakpoints_s(), **columns},
    )


def ignitions_s(configs: "Sequence[ClassConfig]") -> FloatArray:
    """Return the scene times of ignition, (n,)."""
    return np.array([config.launch.time_s for config in configs], dtype=np.float64)


def forces_of_targets(configs: "Sequence[ClassConfig]", context: TargetContext) -> "ForceModel":
    """Return the scene's forces, with the ballistic coefficients that targets bring."""
    forces = context.forces
    if isinstance(forces, str) or forces.drag is None:
        return forces
    usual = float(forces.drag.ballistic_coefficient_kg_m2)
    coefficients = (config.ballistic_coefficient_kg_m2 for config in configs)
    return forces.with_ballistic_coefficients(
        [usual if value is None else value for value in coefficients]
    )


def other_ranges(kind: TargetClass, flown: BoostProfile) -> str:
    """Return which ranges the other profiles of a class have."""
    return "".join(
        f"; of type {kind.name} there is also {profile.name}, {profile.minimum_range_m / 1e3:g} to"
        f" {profile.maximum_range_m / 1e3:g} km"
        for profile in kind.profiles
        if profile.name != flown.name
    )


def geodetic_columns(places: Iterable[PlaceConfig]) -> Geodetic:
    """Return the columns of places in radians and metres."""
    rows = [
        (math.radians(place.lat_deg), math.radians(place.lon_deg), place.height_m)
        for place in places
    ]
    return Geodetic(*np.array(rows, dtype=np.float64).reshape(-1, 3).T)


def plain_place(config: PlaceConfig) -> dict[str, float]:
    """Return a place as plain values."""
    return {"lat_deg": config.lat_deg, "lon_deg": config.lon_deg, "height_m": config.height_m}


def plain_places(position_ecef_m: FloatArray) -> list[dict[str, float]]:
    """Return positions (n, 3) as plain geodetic places, with heights above the WGS 84 ellipsoid."""
    where = ecef_to_geodetic(position_ecef_m)
    columns = (np.degrees(where.latitude_rad), np.degrees(where.longitude_rad), where.height_m)
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [
        {"lat_deg": latitude, "lon_deg": longitude, "height_m": height}
        for latitude, longitude, height in rows
    ]


def plain_states(
    position_ecef_m: FloatArray, velocity_ecef_m_s: FloatArray
) -> list[Mapping[str, Any]]:
    """Return states (n, 3) as plain places with position and velocity, which is relative to the
    rotating Earth.
    """
    rows = zip(
        plain_places(position_ecef_m),
        position_ecef_m.tolist(),
        velocity_ecef_m_s.tolist(),
        strict=True,
    )
    return [
        {**place, "position_ecef_m": position, "velocity_ecef_m_s": velocity}
        for place, position, velocity in rows
    ]
