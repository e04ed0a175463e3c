"""Target classes: kinematic boosts, what follows burnout, and default plumes, as records without
behaviour.

The core's classes are in `opir_core/data`: `target_classes.json`, with profiles from
`class_profiles.json` and plumes from `plumes.json`. All are notional templates for warning
simulation, not any vehicle.
"""

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

from attrs import Factory, evolve, frozen

from opir_core.scene.scene import REPORTED_TYPES, SOURCE_TYPES, TARGET_TYPES

_DATA = Path(__file__).parents[1] / "data"

#: Half the circumference of the Earth, m: no place is farther.
FARTHEST_M = 2.004e7

#: The bands that a plume's peaks are given in.
PLUME_BANDS = ("SWIR", "MWIR", "LWIR")

#: The temperature of bodies after burnout, K.
BODY_TEMPERATURE_K = 300.0

Value = TypeVar("Value")


@frozen
class BoostProfile:
    """A class of boosted flight.

    Speed relative to the Earth is v(t) = v_bo · expm1(k t/T) / expm1(k), with burn time T and
    `speed_shape` k > 0; the flight path angle stays vertical until `pitch_start_s` tv and then is
    pi/2 + (gamma_bo - pi/2) · sin(pi/2 · u^n), u = (t - tv)/(T - tv), with `pitch_exponent` n > 0.
    The burnout speed and angle here reach the reference range on a spherical, non-rotating Earth;
    aiming adjusts them. Ranges are geodesic distances from launch to aim point; a flight into orbit
    has none.
    """

    name: str
    burn_time_s: float
    pitch_start_s: float
    speed_shape: float
    pitch_exponent: float
    burnout_speed_m_s: float
    burnout_flight_path_angle_rad: float
    reference_range_m: float = 0.0
    minimum_range_m: float = 0.0
    maximum_range_m: float = FARTHEST_M

    def with_burn_time(self, burn_time_s: float) -> "BoostProfile":
        """Return the profile with another burn time: the same course in t/T, to the same burnout
        speed.
        """
        if not 0.0 < burn_time_s < math.inf:
            raise ValueError(f"burn time must be a positive number of seconds, not {burn_time_s}")
        pitch_start_s = self.pitch_start_s * (burn_time_s / self.burn_time_s)
        return evolve(self, burn_time_s=burn_time_s, pitch_start_s=pitch_start_s)


@frozen
class Plume:
    """Defaults of a target's signature.

    `peak_w_sr` is the radiant intensity of the first stage by band (`PLUME_BANDS`), W/sr, seen
    broadside at the best altitude; `stages` the number of stages, of equal shares of the burn;
    `body_temperature_k` the temperature of the body after burnout.
    """

    peak_w_sr: Mapping[str, float]
    stages: int = 1
    body_temperature_k: float = BODY_TEMPERATURE_K


@frozen
class Ballistic:
    """After burnout: free flight to the aim point, under the scene's forces."""

    model: ClassVar[str] = "ballistic"


@frozen(kw_only=True)
class OrbitInsertion:
    """At burnout: a circular orbit, with its altitude above the equatorial radius."""

    model: ClassVar[str] = "orbit"
    altitude_m: float


@frozen(kw_only=True)
class EquilibriumGlide:
    """After burnout: equilibrium glide at a constant lift-to-drag ratio, then free fall to the aim
    point.

    The glide ends at `final_speed_m_s`; `scale_height_m` is that of the exponential atmosphere.
    """

    model: ClassVar[str] = "glide"
    lift_to_drag: float
    final_speed_m_s: float
    scale_height_m: float


AfterBurnout = Ballistic | OrbitInsertion | EquilibriumGlide

#: What may follow burnout, by its name, which is that of the core's target model for it.
AFTER_BURNOUT: Mapping[str, type[AfterBurnout]] = MappingProxyType(
    {kind.model: kind for kind in (Ballistic, OrbitInsertion, EquilibriumGlide)}
)


@frozen(kw_only=True)
class TargetClass:
    """A class of targets, which a scene chooses by `type: NAME`.

    `reported_type` is the right answer for it among `REPORTED_TYPES`, UNKNOWN for classes other
    than missiles. `resembles` is the missile type whose values stand in where a sensor or a model
    names no value for the class; by default the reported type. Of several `profiles`, the first
    with limits that contain the range is flown; `plumes` has the default signature of each, by the
    profile's name.
    """

    hook: ClassVar[str] = "opir_target_classes"
    kind: ClassVar[str] = "target class"

    name: str
    summary: str
    reported_type: str
    profiles: tuple[BoostProfile, ...]
    plumes: Mapping[str, Plume]
    after_burnout: AfterBurnout = Ballistic()
    resembles: str = Factory(lambda self: self.reported_type, takes_self=True)

    @property
    def type_code(self) -> int:
        """Return the code of the missile type that the class resembles, into `EMITTER_TYPES`."""
        return TARGET_TYPES.index(self.resembles)

    def profile(self, range_m: float) -> BoostProfile:
        """Return the profile for a range: the one that covers it, or else the one with the nearest
        limits.
        """
        return min(self.profiles, key=lambda profile: _range_outside_m(profile, range_m))

    def plume(self, profile: str) -> Plume:
        """Return the default plume of a flown profile; the profile of another class has that
        class's plume.
        """
        return (
            self.plumes.get(profile)
            or core_plumes().get(profile)
            or self.plumes[self.profiles[0].name]
        )

    def own(self, values: Mapping[str, Value]) -> Value | None:
        """Return the value of the class in a mapping by type, or that of the type that it
        resembles, or None.
        """
        return values.get(self.name, values.get(self.resembles))

    def fault(self) -> str:
        """Return the first error of the class (`with ...`, `without ...`), or ""."""
        names = [profile.name for profile in self.profiles]
        lacking = [name for name in names if name not in self.plumes]
        faults = (
            (self.name in RESERVED_NAMES, "which is the name of a type that is no target's"),
            (
                self.reported_type not in REPORTED_TYPES,
                f"with the reported type {self.reported_type!r}",
            ),
            (
                self.resembles not in TARGET_TYPES,
                f"that resembles {self.resembles!r}, not {' or '.join(TARGET_TYPES)}",
            ),
            (
                type(self.after_burnout) not in AFTER_BURNOUT.values(),
                f"with {self.after_burnout!r} after burnout",
            ),
            (not names, "without profiles"),
            (len(set(names)) < len(names), "with two profiles of one name"),
            (bool(lacking), f"without a plume for the profile {', '.join(lacking)}"),
        )
        profiles = map(_profile_fault, self.profiles)
        plumes = map(_plume_fault, self.plumes.values())
        class_faults = (words for is_fault, words in faults if is_fault)
        return next(filter(None, (*class_faults, *profiles, *plumes)), "")


#: Names of types that a target class cannot have.
RESERVED_NAMES = (*SOURCE_TYPES, "UNKNOWN")


def _profile_fault(profile: BoostProfile) -> str:
    is_valid = (
        0.0 <= profile.pitch_start_s < profile.burn_time_s < math.inf
        and profile.speed_shape > 0.0
        and profile.pitch_exponent > 0.0
        and profile.burnout_speed_m_s > 0.0
        and abs(profile.burnout_flight_path_angle_rad) < 0.5 * math.pi
        and 0.0 <= profile.minimum_range_m <= profile.maximum_range_m
    )
    return (
        ""
        if is_valid
        else f"with a profile {profile.name} whose times, shape, burnout or ranges are not possible"
    )


def _plume_fault(plume: Plume) -> str:
    is_valid = (
        set(plume.peak_w_sr) == set(PLUME_BANDS)
        and min(plume.peak_w_sr.values()) >= 0.0
        and plume.stages >= 1
    )
    return (
        ""
        if is_valid
        else f"with a plume that has not one peak for each of {', '.join(PLUME_BANDS)}, and stages"
    )


def _range_outside_m(profile: BoostProfile, range_m: float) -> float:
    """Return the distance of a range from the limits of a profile, 0 within them."""
    return max(profile.minimum_range_m - range_m, range_m - profile.maximum_range_m, 0.0)


def _read(name: str) -> Mapping[str, Any]:
    return json.loads((_DATA / name).read_text(encoding="utf-8"))


@cache
def core_profiles() -> Mapping[str, BoostProfile]:
    """Return the boost profiles of the core's classes, by name."""
    rows = _read("class_profiles.json")["profiles"]
    return MappingProxyType({name: _profile(name, row) for name, row in rows.items()})


@cache
def plume_table() -> Mapping[str, Any]:
    """Return the table of the core's plumes as it is in `plumes.json`, with its bands and its
    notes.
    """
    return MappingProxyType(_read("plumes.json"))


@cache
def core_plumes() -> Mapping[str, Plume]:
    """Return the plumes of the core's classes, by the name of the profile."""
    table = plume_table()
    body_k = table["body_temperature_k"]
    return MappingProxyType(
        {
            name: Plume(peaks, table["stages"][name], body_k.get(name, BODY_TEMPERATURE_K))
            for name, peaks in table["peak_w_sr"].items()
        }
    )


@cache
def core_target_classes() -> Mapping[str, TargetClass]:
    """Return the core's target classes, by name."""
    rows = _read("target_classes.json")["classes"]
    return MappingProxyType({name: _target_class(name, row) for name, row in rows.items()})


def core_target_class(name: str) -> TargetClass:
    """Return one of the core's target classes; raises `KeyError` for another name."""
    return core_target_classes()[name]


def _target_class(name: str, row: Mapping[str, Any]) -> TargetClass:
    values = dict(row)
    names = values.pop("profiles")
    phase = values.pop("after_burnout", {Ballistic.model: {}})
    ((kind, settings),) = phase.items()
    return TargetClass(
        name=name,
        profiles=tuple(core_profiles()[profile] for profile in names),
        plumes={profile: core_plumes()[profile] for profile in names},
        after_burnout=AFTER_BURNOUT[kind](**settings),
        **values,
    )


def _profile(name: str, row: Mapping[str, Any]) -> BoostProfile:
    minimum_km, maximum_km = row.get("range_limits_km", (0.0, FARTHEST_M / 1e3))
    return BoostProfile(
        name=name,
        burn_time_s=row["burn_time_s"],
        pitch_start_s=row["pitch_start_s"],
        speed_shape=row["speed_shape"],
        pitch_exponent=row["pitch_exponent"],
        burnout_speed_m_s=row["burnout_speed_m_s"],
        burnout_flight_path_angle_rad=math.radians(row["burnout_flight_path_angle_deg"]),
        reference_range_m=row.get("range_km", 0.0) * 1e3,
        minimum_range_m=minimum_km * 1e3,
        maximum_range_m=maximum_km * 1e3,
    )
