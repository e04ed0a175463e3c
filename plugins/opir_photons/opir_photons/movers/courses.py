"""Courses over the ground, leg by leg, and the sources that go straight on.

On a leg a vehicle goes straight, its speed grows evenly, or it turns on a circle of radius
v²/(g tan φ) with its bank φ; its rate of climb goes evenly over into that of the leg. Distances are
along geodesics of the WGS 84 ellipsoid, so that speeds are those over the ground.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, RowArray
from opir_core.errors import Problem, SceneError
from opir_core.flight import Ephemeris
from opir_core.geometry import geodesic_direct, geodesic_inverse, geodetic_to_ecef, local_axes
from opir_core.plugin import SourceContext, Sources
from opir_photons.movers.configs import (
    FireFrontConfig,
    LegConfig,
    MoverConfig,
    ShipConfig,
    TrainConfig,
)
from opir_photons.movers.trajectories import moving_sources, with_headings
from opir_photons.radiometry.emitters import Emitters, emitters_of
from opir_photons.radiometry.sources import GreySignatures, grey_w_sr, starts_m

#: Standard gravity, m/s².
STANDARD_GRAVITY_M_S2 = 9.80665

#: Half the step of the differences that velocities are, s.
_HALF_STEP_S = 0.01


@frozen(eq=False)
class CourseLeg:
    """One leg of vehicles (n,): where it begins, m and rad, how fast and how steep, and its
    `config`.
    """

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    height_m: FloatArray
    heading_rad: FloatArray
    speed_m_s: FloatArray
    climb_m_s: FloatArray
    start_s: FloatArray
    config: LegConfig
    pull_m_s2: float

    @property
    def end_speed_m_s(self) -> FloatArray:
        """Speeds (n,) at the end, m/s."""
        return self.speed_m_s + self.config.acceleration_m_s2 * self.config.for_s

    def pull_s(self) -> FloatArray:
        """Return how long (n,) the rate of climb takes to be that of the leg, s."""
        return np.abs(self.config.climb_m_s - self.climb_m_s) / self.pull_m_s2

    def state(self, row: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions, m, and velocities, m/s (m, 3), ECEF, of vehicles (m,) at scene
        times.
        """
        since_s = time_s - self.start_s[row]
        before, place, after = (
            self.position_m(row, since_s + step_s) for step_s in (-_HALF_STEP_S, 0.0, _HALF_STEP_S)
        )
        return place, (after - before) / (2.0 * _HALF_STEP_S)

    def position_m(self, row: RowArray, since_s: FloatArray) -> FloatArray:
        """Return positions (m, 3), ECEF, m, at times since the leg began."""
        ahead, right = self._level_m(row, since_s)
        bearing = self.heading_rad[row] + np.arctan2(right, ahead)
        origin = (self.latitude_rad[row], self.longitude_rad[row])
        place = geodesic_direct(*origin, bearing, np.hypot(ahead, right))
        return geodetic_to_ecef(*place, self.height_m[row] + self.rise_m(row, since_s)[0])

    def next_leg(self, config: LegConfig) -> "CourseLeg":
        """Return the leg that follows."""
        row = np.arange(len(self.start_s))
        length_s = np.full(len(row), self.config.for_s)
        ahead, right = self._level_m(row, length_s)
        bearing = self.heading_rad + np.arctan2(right, ahead)
        distance_m = np.hypot(ahead, right)
        origin = (self.latitude_rad, self.longitude_rad)
        end = geodesic_direct(*origin, bearing, distance_m)
        backwards = geodesic_inverse(*end, *origin).bearing_rad
        convergence = np.where(distance_m > 0.0, backwards + np.pi - bearing, 0.0)
        rise_m, climb_m_s = self.rise_m(row, length_s)
        return CourseLeg(
            latitude_rad=end.latitude_rad,
            longitude_rad=end.longitude_rad,
            height_m=self.height_m + rise_m,
            heading_rad=self.heading_rad + self._turn_per_s(row) * length_s + convergence,
            speed_m_s=self.end_speed_m_s,
            climb_m_s=climb_m_s,
            start_s=self.start_s + length_s,
            config=config,
            pull_m_s2=self.pull_m_s2,
        )

    def _turn_per_s(self, row: RowArray) -> FloatArray:
        """Return the turn rates (m,), rad/s, to the right."""
        if self.config.bank_deg == 0.0:
            return np.zeros(len(row))
        across = STANDARD_GRAVITY_M_S2 * np.tan(np.radians(self.config.bank_deg))
        return across / self.speed_m_s[row]

    def _level_m(self, row: RowArray, since_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the ways (m,) ahead and to the right, m, in the plane in which the leg begins."""
        speed = self.speed_m_s[row]
        if self.config.bank_deg == 0.0:
            ahead = (speed + 0.5 * self.config.acceleration_m_s2 * since_s) * since_s
            return ahead, np.zeros(len(row))
        rate = self._turn_per_s(row)
        radius_m = speed / rate
        half = np.sin(0.5 * rate * since_s)
        return radius_m * np.sin(rate * since_s), 2.0 * radius_m * half * half

    def rise_m(self, row: RowArray, since_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how much (m,) higher the vehicles are, m, and their rates of climb, m/s."""
        first = self.climb_m_s[row]
        gain = self.config.climb_m_s - first
        pull_s = self.pull_s()[row]
        pulled_s = np.minimum(since_s, pull_s)
        slope = np.copysign(self.pull_m_s2, gain)
        climb = first + slope * pulled_s
        steady_s = since_s - pulled_s
        return first * pulled_s + 0.5 * slope * pulled_s * pulled_s + climb * steady_s, climb


def legs_of(
    emitters: Emitters, configs: Sequence[LegConfig], pull_m_s2: float, end_s: FloatArray, path: str
) -> list[CourseLeg]:
    """Return the legs of vehicles and the straight and level one after them, to `end_s` (n,) or
    beyond.

    `SceneError`, with its place, for a leg that ends below the ground, in space or at rest.
    """
    flown_s = sum(config.for_s for config in configs)
    rest_s = max(float(np.max(end_s - emitters["start_s"], initial=0.0)) - flown_s, 1.0)
    plan = [*configs, LegConfig(for_s=rest_s)]
    legs = [_first_leg(emitters, plan[0], pull_m_s2)]
    for number, config in enumerate(plan[1:]):
        problem = _problem(legs[-1])
        if problem:
            raise SceneError([Problem(f"{path}.legs[{number}]", problem)])
        legs.append(legs[-1].next_leg(config))
    return legs


def _first_leg(emitters: Emitters, config: LegConfig, pull_m_s2: float) -> CourseLeg:
    return CourseLeg(
        latitude_rad=np.radians(emitters["lat_deg"]),
        longitude_rad=np.radians(emitters["lon_deg"]),
        height_m=emitters["height_m"],
        heading_rad=np.radians(emitters["heading_deg"]),
        speed_m_s=emitters["speed_m_s"],
        climb_m_s=np.full(len(emitters), config.climb_m_s),
        start_s=emitters["start_s"],
        config=config,
        pull_m_s2=pull_m_s2,
    )


def _problem(leg: CourseLeg) -> str:
    """Return what is wrong with a leg; "" for nothing."""
    if leg.config.bank_deg != 0.0 and not np.all(leg.speed_m_s > 0.0):
        return "a turn needs a speed_m_s above 0"
    slowest = float(leg.end_speed_m_s.min(initial=np.inf))
    if leg.config.acceleration_m_s2 != 0.0 and slowest <= 0.0:
        return f"ends at {slowest:g} m/s; shorten it or brake less"
    rise_m, _ = leg.rise_m(
        np.arange(len(leg.height_m)), np.full(len(leg.height_m), leg.config.for_s)
    )
    height_m = leg.height_m + rise_m
    lowest = float(height_m.min(initial=0.0))
    if lowest < -500.0:
        return f"ends at a height of {lowest:.0f} m; shorten it or descend less"
    highest = float(height_m.max(initial=0.0))
    if highest > 150e3:
        return f"ends at a height of {highest:.0f} m; shorten it or climb less"
    return ""


def flight_of(legs: Sequence[CourseLeg]) -> Ephemeris:
    """Return the ephemeris of vehicles along their legs."""
    parts = [
        Ephemeris.build(
            leg.state,
            leg.start_s,
            leg.start_s + leg.config.for_s,
            (leg.start_s + leg.pull_s())[:, None],
        )
        for leg in legs
    ]
    return Ephemeris.joined(parts)


def ship_sources(config: ShipConfig, context: SourceContext) -> Sources:
    """Return ships: funnels that shine alike to all sides."""
    return _straight_on("ship", "other", config, context)


def train_sources(config: TrainConfig, context: SourceContext) -> Sources:
    """Return trains: exhausts that shine alike to all sides."""
    return _straight_on("train", "other", config, context)


def fire_front_sources(config: FireFrontConfig, context: SourceContext) -> Sources:
    """Return fronts of fire: flat grey bodies."""
    return _straight_on("fire front", "fire", config, context, is_flat=True)


def _straight_on(
    kind: str,
    resembles: str,
    config: MoverConfig,
    context: SourceContext,
    *,
    is_flat: bool = False,
) -> Sources:
    emitters = with_headings(emitters_of(config, context), context)
    up = local_axes(starts_m(emitters))[:, 2] if is_flat else None
    signatures = GreySignatures(grey_w_sr(emitters, context), up_ecef=up)
    end_s = emitters["end_s"]
    flight = flight_of(legs_of(emitters, (), 1.0, end_s, context.path))
    return moving_sources(kind, resembles, emitters, context, flight, end_s, signatures)
