"""The generic target classes: how speed and flight path angle run from ignition to burnout.

The numbers, with their source, are in `opir_core/data/class_profiles.json`. They are notional kinematic templates for
warning simulation, not any vehicle.
"""

import json
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from attrs import evolve, frozen

#: The profiles a target type may fly; of several, the first whose limits hold the range to the aim point.
PROFILES_BY_TYPE: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"ICBM": ("ICBM_liquid", "ICBM_solid"), "IRBM": ("MRBM", "IRBM"), "SRBM": ("SRBM",)}
)

_TABLE = Path(__file__).parents[1] / "data" / "class_profiles.json"


@frozen
class BoostProfile:
    """A class of boosted flight.

    Speed relative to the Earth is v(t) = v_bo · expm1(k t/T) / expm1(k), with burn time T and `speed_shape` k > 0; the
    flight path angle stays vertical until `pitch_start_s` tv and then is pi/2 + (gamma_bo - pi/2) · sin(pi/2 · u^n),
    u = (t - tv)/(T - tv), with `pitch_exponent` n > 0. The burnout speed and angle given here reach the reference range
    on a spherical, non-rotating Earth; aiming adjusts them. Ranges are geodesic distances from launch to aim point.
    """

    name: str
    burn_time_s: float
    pitch_start_s: float
    speed_shape: float
    pitch_exponent: float
    burnout_speed_m_s: float
    burnout_flight_path_angle_rad: float
    reference_range_m: float
    minimum_range_m: float
    maximum_range_m: float

    def with_burn_time(self, burn_time_s: float) -> "BoostProfile":
        """Return the profile stretched to another burn time: the same course in t/T, to the same burnout speed."""
        if not 0.0 < burn_time_s < math.inf:
            raise ValueError(f"burn time must be a positive number of seconds, not {burn_time_s}")
        pitch_start_s = self.pitch_start_s * (burn_time_s / self.burn_time_s)
        return evolve(self, burn_time_s=burn_time_s, pitch_start_s=pitch_start_s)


@cache
def boost_profiles() -> Mapping[str, BoostProfile]:
    """Return the profiles by name."""
    table = json.loads(_TABLE.read_text(encoding="utf-8"))
    return MappingProxyType({name: _profile(name, row) for name, row in table["profiles"].items()})


def boost_profile(name: str) -> BoostProfile:
    """Return the profile of that name; a `ValueError` lists the names there are."""
    try:
        return boost_profiles()[name]
    except KeyError:
        raise ValueError(f"no boost profile {name!r}; there are {', '.join(sorted(boost_profiles()))}") from None


def profile_for_type(target_type: str, range_m: float) -> BoostProfile:
    """Return the profile that a target of this type flies over this range.

    Where no profile of the type covers the range, the one whose limits are nearest; aiming then says what they are.
    """
    profiles = [boost_profile(name) for name in PROFILES_BY_TYPE[target_type]]
    return min(profiles, key=lambda profile: _range_outside_m(profile, range_m))


def _range_outside_m(profile: BoostProfile, range_m: float) -> float:
    """Return by how much a range misses the limits of a profile, 0 within them."""
    return max(profile.minimum_range_m - range_m, range_m - profile.maximum_range_m, 0.0)


def _profile(name: str, row: Mapping[str, Any]) -> BoostProfile:
    minimum_km, maximum_km = row["range_limits_km"]
    return BoostProfile(
        name=name,
        burn_time_s=row["burn_time_s"],
        pitch_start_s=row["pitch_start_s"],
        speed_shape=row["speed_shape"],
        pitch_exponent=row["pitch_exponent"],
        burnout_speed_m_s=row["burnout_speed_m_s"],
        burnout_flight_path_angle_rad=math.radians(row["burnout_flight_path_angle_deg"]),
        reference_range_m=row["range_km"] * 1e3,
        minimum_range_m=minimum_km * 1e3,
        maximum_range_m=maximum_km * 1e3,
    )
