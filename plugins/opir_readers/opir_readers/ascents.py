"""The target model `ascent`: a space launch of two burns with a dark gap, or the booster of one
that lands.

Kinematics, not a vehicle: under thrust speed and flight path angle follow programs on a great
circle through the launch point; without it the target falls freely (two bodies). Along the velocity
a burn accelerates by A/(1 - q t/T) with q = 1 - 1/growth, as constant thrust and mass flow do, less
the component of gravity: with a thrust of 1.3 times its weight a launcher lifts off slowly. The
second burn levels off into a circular orbit; its acceleration and the exponent of its program are
found so that it ends there.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define, frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.errors import Problem, SceneError
from opir_core.flight import Ephemeris, plain_gaps_s
from opir_core.geometry import geodetic_to_ecef, local_axes
from opir_core.plugin import StateTable, TargetContext, Trajectories
from opir_readers.ascent_legs import (
    AscentLeg,
    coast,
    falling,
    height_of,
    powered,
    resting,
    stopping,
    thrusting,
)
from opir_readers.celestial_frames import earth_rotation_m_s
from opir_readers.configs import AscentConfig
from opir_readers.table_targets import TableTargets, flights_of


@frozen
class AscentLaw:
    """The programs of a launcher and its booster. Notional where no source is named."""

    #: Thrust over weight at lift-off, of which 1.2 to 1.4 is usual (G. P. Sutton and O. Biblarz,
    #: Rocket Propulsion Elements, 8th edition, chapter 4).
    lift_off: float = 1.3
    #: Growth of the acceleration of the first burn with throttling, and of the second.
    first_growth: float = 3.0
    second_growth: float = 4.0
    #: Vertical flight, s.
    vertical_s: float = 12.0
    #: Flight path angle at the end of the first burn, rad, and the exponent of its program.
    first_angle_rad: float = float(np.radians(32.0))
    first_exponent: float = 0.75
    #: The booster's burns, s: back to the launch site, against re-entry, and to land.
    back_s: float = 45.0
    entry_s: float = 20.0
    landing_s: float = 25.0
    #: Height at which re-entry is braked, m, and the share of the speed that it takes.
    entry_m: float = 60e3
    entry_share: float = 0.4
    #: How long a booster is followed on the ground, s.
    rests_s: float = 60.0
    #: The largest thrust acceleration, m/s²: with gravity it stays below the 100 m/s² for which
    #: visibility is exact.
    most_m_s2: float = 90.0


LAW = AscentLaw()


@define(eq=False)
class AscentTargets(TableTargets):
    """Targets on kinematic ascents, which are tables of states without a file; `coast` follows the
    burns.
    """

    coast: Ephemeris | None = None

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,); nan outside ignition to
        `end_s`.
        """
        position_m = self.flight.position_m(target, time_s)
        coasting = np.flatnonzero(time_s > self.burnout_s[target])
        if self.coast is not None and len(coasting):
            position_m[coasting] = self.coast.position_m(target[coasting], time_s[coasting])
        return position_m

    @property
    def files(self) -> Sequence[Mapping[str, str]]:
        """Return no files."""
        return ()


def ascent_targets(configs: Sequence[AscentConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model; raises `SceneError` where no orbit is
    reached.
    """
    tables = []
    problems = []
    for config, path in zip(configs, context.paths, strict=True):
        try:
            tables.append(_table(config, legs_of(config)))
        except ValueError as error:
            problems.append(Problem(path, str(error)))
    if problems:
        raise SceneError(problems)
    flights = flights_of(tables, context)
    orbit = flights.ephemeris(flights.burnout_s, flights.end_s) if context.free_flight else None
    return AscentTargets(
        **flights.columns(configs, context),
        flight=flights.ephemeris(flights.ignition_s, flights.burnout_s),
        coast=orbit,
        records=tuple(map(_record, context.ids, configs, tables)),
    )


def legs_of(config: AscentConfig) -> list[AscentLeg]:
    """Return the legs of a flight, to the ground, or in orbit for `followed_s`.

    `ValueError` where the second burn reaches no orbit of the set height.
    """
    place = np.radians([config.lat_deg]), np.radians([config.lon_deg]), np.array([config.height_m])
    start = geodetic_to_ecef(*place)[0]
    ascent = _first_burn(start, float(np.radians(config.azimuth_deg)), config.first_burn_s)
    gap = coast(ascent, config.gap_s)
    if config.flight == "booster":
        return [ascent, gap, *_booster(gap, start, flies_back=config.flies_back)]
    insertion = _second_burn(gap, config.second_burn_s, config.orbit_altitude_km * 1e3)
    return [ascent, gap, insertion, coast(insertion, config.followed_s)]


def _first_burn(start_m: FloatArray, azimuth_rad: float, burn_s: float) -> AscentLeg:
    growth = 1.0 - 1.0 / LAW.first_growth
    upright_rad = 0.5 * np.pi

    def program(time_s: float) -> tuple[float, float]:
        share = max(time_s - LAW.vertical_s, 0.0) / (burn_s - LAW.vertical_s)
        turn = np.sin(upright_rad * share**LAW.first_exponent)
        angle = upright_rad + (LAW.first_angle_rad - upright_rad) * turn
        return LAW.lift_off * 9.81 / (1.0 - growth * time_s / burn_s), float(angle)

    east, north, _ = local_axes(start_m[None])[0]
    heading = np.sin(azimuth_rad) * east + np.cos(azimuth_rad) * north
    return powered(0.0, start_m, heading, 0.0, burn_s, program)


def _second_burn(gap: AscentLeg, burn_s: float, altitude_m: float) -> AscentLeg:
    """Return the burn from the end of a coast into a circular orbit at an altitude above the
    equatorial radius.
    """
    start_s, position, velocity = gap.end
    speed = float(np.linalg.norm(velocity))
    angle = float(np.arcsin(velocity @ position / (speed * np.linalg.norm(position))))
    growth = 1.0 - 1.0 / LAW.second_growth

    def burn(settings: FloatArray) -> AscentLeg:
        thrust_m_s2, exponent = settings.tolist()

        def program(time_s: float) -> tuple[float, float]:
            share = min(time_s / burn_s, 1.0)
            return thrust_m_s2 / (1.0 - growth * share), angle * (1.0 - share) ** exponent

        return powered(start_s, position, velocity, speed, burn_s, program)

    def miss(settings: FloatArray) -> FloatArray:
        _, end_m, end_m_s = burn(settings).end
        distance_m = float(np.linalg.norm(end_m))
        inertial_m_s = float(np.linalg.norm(end_m_s + earth_rotation_m_s(end_m)))
        radius_m = EARTH_EQUATORIAL_RADIUS_M + altitude_m
        circular_m_s = np.sqrt(EARTH_MU_M3_S2 / distance_m)
        return np.array([inertial_m_s - circular_m_s, (distance_m - radius_m) / 100.0])

    settings = _solved(
        miss, np.array([8.0, 1.5]), f"no orbit at {altitude_m / 1e3:g} km from there"
    )
    if LAW.second_growth * settings[0] > LAW.most_m_s2:
        raise ValueError(
            f"the second burn needs more than {LAW.most_m_s2:g} m/s²; let it burn longer"
        )
    return burn(settings)


def _booster(gap: AscentLeg, start_m: FloatArray, *, flies_back: bool) -> list[AscentLeg]:
    """Return the way of a booster from the end of its dark gap to the ground: to the launch site,
    or down the range.
    """
    if not flies_back:
        return _descent(gap)
    _, position, velocity = gap.end
    up = position / np.linalg.norm(position)
    onward = velocity - (velocity @ up) * up
    onward /= np.linalg.norm(onward)

    def flight(brake_m_s2: FloatArray) -> list[AscentLeg]:
        boostback = thrusting(gap, LAW.back_s, lambda *_: -float(brake_m_s2[0]) * onward)
        return [boostback, *_descent(boostback)]

    def beyond_km(brake_m_s2: FloatArray) -> FloatArray:
        return np.array([(flight(brake_m_s2)[-1].position_m[-1] - start_m) @ onward / 1e3])

    return flight(_solved(beyond_km, np.array([40.0]), "no way back to the launch site"))


def _descent(leg: AscentLeg) -> list[AscentLeg]:
    """Return the fall of a booster, its burn against re-entry, its landing and its rest."""

    def is_at_entry(place: FloatArray, way: FloatArray) -> bool:
        return height_of(place) < LAW.entry_m and _sinking_m_s(place, way) > 0.0

    def is_at_landing(place: FloatArray, way: FloatArray) -> bool:
        # A constant deceleration stops within half of the speed times the time.
        return height_of(place) < 0.5 * LAW.landing_s * _sinking_m_s(place, way)

    fall = falling(leg, is_at_entry)
    brake = LAW.entry_share * float(np.linalg.norm(fall.velocity_m_s[-1])) / LAW.entry_s
    entry = thrusting(fall, LAW.entry_s, lambda _, way: -brake * way / np.linalg.norm(way))
    approach = falling(entry, is_at_landing)
    _, place, way = approach.end
    landing = stopping(approach, 2.0 * height_of(place) / _sinking_m_s(place, way))
    return [fall, entry, approach, landing, resting(landing, LAW.rests_s)]


def _sinking_m_s(position_m: FloatArray, velocity_m_s: FloatArray) -> float:
    """Return the speed towards the Earth's centre, m/s."""
    return -float(velocity_m_s @ position_m) / float(np.linalg.norm(position_m))


def _solved(miss: Callable[[FloatArray], FloatArray], guess: FloatArray, words: str) -> FloatArray:
    """Return the settings (k,) at which a miss (k,) is zero, by Newton's method; `ValueError` with
    words without convergence.
    """
    for _ in range(40):
        residual = miss(guess)
        if float(np.abs(residual).max()) < 1e-6:
            return guess
        steps = np.diag(1e-5 * np.maximum(np.abs(guess), 1.0))
        slope = np.array([(miss(guess + step) - residual) / step.sum() for step in steps]).T
        change = np.linalg.solve(slope, residual)
        guess = guess - change * min(1.0, 0.5 / float(np.abs(change / guess).max()))
    if float(np.abs(miss(guess)).max()) < 1.0:
        return guess
    raise ValueError(words)


def _table(config: AscentConfig, legs: Sequence[AscentLeg]) -> StateTable:
    """Return the states of legs in scene time; each leg is a run of smooth motion."""
    burns = [(leg.time_s[0], leg.time_s[-1]) for leg in legs if leg.burns]
    return StateTable(
        time_s=config.time_s + np.concatenate([leg.time_s for leg in legs]),
        position_m=np.concatenate([leg.position_m for leg in legs]),
        velocity_m_s=np.concatenate([leg.velocity_m_s for leg in legs]),
        run=np.repeat(np.arange(len(legs)), [len(leg.time_s) for leg in legs]),
        burns_s=config.time_s + np.array(burns),
    )


def _record(target_id: str, config: AscentConfig, table: StateTable) -> Mapping[str, Any]:
    """Return the truth of a target as plain values."""
    launch = {"lat_deg": config.lat_deg, "lon_deg": config.lon_deg, "height_m": config.height_m}
    burns = table.burns_s.tolist()
    return {
        "id": target_id,
        "type": config.type,
        "flight": config.flight,
        "launch": launch,
        "azimuth_deg": config.azimuth_deg,
        "ignition_s": burns[0][0],
        "burnout_s": burns[-1][1],
        "stages": [{"ignition_s": start, "burnout_s": end} for start, end in burns],
        "gaps_s": plain_gaps_s(table.burns_s),
    }
