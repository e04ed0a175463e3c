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
from attrs import define

from opir_core.arrays import FloatArray, IndexArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.errors import Problem, SceneError
from opir_core.flight import Ephemeris, joined_burns_s, plain_gaps_s
from opir_core.geometry import geodetic_to_ecef, local_axes
from opir_core.plugin import StateTable, TargetContext, Trajectories
from opir_readers.ascent_legs import (
    OMEGA,
    AscentLeg,
    coast,
    falling,
    height_of,
    powered,
    resting,
    stopping,
    thrusting,
)
from opir_readers.configs import AscentConfig
from opir_readers.interpolation import interpolant
from opir_readers.table_targets import EPHEMERIS_TOLERANCE_M, TableTargets

#: Thrust over weight at lift-off, of which 1.2 to 1.4 is usual (G. P. Sutton and O. Biblarz, Rocket
#: Propulsion Elements, 8th edition, chapter 4); growth of the acceleration of the first burn with
#: throttling, and of the second. Notional.
LIFT_OFF = 1.3
FIRST_GROWTH = 3.0
SECOND_GROWTH = 4.0

#: Vertical flight, s; flight path angle at the end of the first burn, rad, and the exponent of its
#: program. Notional.
_VERTICAL_S = 12.0
_FIRST_ANGLE_RAD = float(np.radians(32.0))
_FIRST_EXPONENT = 0.75

#: The booster's burns, s: back to the launch site, against re-entry, and to land; where re-entry is
#: braked, m, and how much of the speed that takes. Notional.
_BACK_S = 45.0
_ENTRY_S = 20.0
_LANDING_S = 25.0
_ENTRY_M = 60e3
_ENTRY_SHARE = 0.4

#: The largest thrust acceleration, m/s²: with gravity it stays below the 100 m/s² for which
#: visibility is exact.
MOST_M_S2 = 90.0

#: How long a booster is followed on the ground, s.
_RESTS_S = 60.0

_GRAVITY_M_S2 = 9.81
_ITERATIONS = 40
_MISS = 1e-6


@define(eq=False)
class AscentTargets(TableTargets):
    """Targets on kinematic ascents, which are tables of states without a file; `coast` is what
    follows the burns.
    """

    coast: Ephemeris | None = None

    def position_ecef_m(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of targets (m,) at scene times (m,); nan outside ignition to
        `end_s`.
        """
        position_m = self.flight.position_m(target, time_s)
        late = np.flatnonzero(time_s > self.burnout_s[target])
        if self.coast is not None and len(late):
            position_m[late] = self.coast.position_m(target[late], time_s[late])
        return position_m

    @property
    def files(self) -> Sequence[Mapping[str, str]]:
        """Return no files."""
        return ()


def ascent_targets(configs: Sequence[AscentConfig], context: TargetContext) -> Trajectories:
    """Return the trajectories of all targets of the model; raises `SceneError` where no orbit is
    reached.
    """
    tables = list[StateTable]()
    problems = list[Problem]()
    for config, path in zip(configs, context.paths, strict=True):
        try:
            tables.append(_table(config, legs_of(config)))
        except ValueError as error:
            problems.append(Problem(path, str(error)))
    if problems:
        raise SceneError(problems)
    ignition_s = np.array([table.burns_s[0, 0] for table in tables])
    burnout_s = np.array([table.burns_s[-1, 1] for table in tables])
    end_s = np.array([table.time_s[-1] for table in tables]) if context.free_flight else burnout_s
    longest = max(len(table.time_s) for table in tables)
    breaks_s = np.stack(
        [np.pad(table.time_s, (0, longest - len(table.time_s)), mode="edge") for table in tables]
    )
    state = interpolant(tables).state
    late = (
        Ephemeris.build(state, burnout_s, end_s, breaks_s, EPHEMERIS_TOLERANCE_M)
        if context.free_flight
        else None
    )
    return AscentTargets(
        type_code=np.array(
            [context.target_class(config.type).type_code for config in configs], dtype=np.uint8
        ),
        ignition_s=ignition_s,
        burnout_s=burnout_s,
        end_s=end_s,
        burns_s=joined_burns_s([table.burns_s[None] for table in tables]),
        flight=Ephemeris.build(state, ignition_s, burnout_s, breaks_s, EPHEMERIS_TOLERANCE_M),
        coast=late,
        records=tuple(_record(*row) for row in zip(context.ids, configs, tables, strict=True)),
    )


def legs_of(config: AscentConfig) -> list[AscentLeg]:
    """Return the legs of a flight, to the ground, or in orbit for `followed_s`.

    `ValueError` where the second burn reaches no orbit of the wanted height.
    """
    place = np.radians([config.lat_deg]), np.radians([config.lon_deg]), np.array([config.height_m])
    start = geodetic_to_ecef(*place)[0]
    first = _first_burn(start, float(np.radians(config.azimuth_deg)), config.first_burn_s)
    gap = coast(first, config.gap_s)
    if config.flight == "booster":
        return [first, gap, *_booster(gap, start, flies_back=config.flies_back)]
    second = _second_burn(gap, config.second_burn_s, config.orbit_altitude_km * 1e3)
    return [first, gap, second, coast(second, config.followed_s)]


def _first_burn(start_m: FloatArray, azimuth_rad: float, burn_s: float) -> AscentLeg:
    growth = 1.0 - 1.0 / FIRST_GROWTH

    def program(time_s: float) -> tuple[float, float]:
        share = max(time_s - _VERTICAL_S, 0.0) / (burn_s - _VERTICAL_S)
        bent = (_FIRST_ANGLE_RAD - 0.5 * np.pi) * np.sin(0.5 * np.pi * share**_FIRST_EXPONENT)
        return LIFT_OFF * _GRAVITY_M_S2 / (1.0 - growth * time_s / burn_s), float(
            0.5 * np.pi + bent
        )

    east, north, _ = local_axes(start_m[None])[0]
    return powered(
        0.0, start_m, np.sin(azimuth_rad) * east + np.cos(azimuth_rad) * north, 0.0, burn_s, program
    )


def _second_burn(before: AscentLeg, burn_s: float, altitude_m: float) -> AscentLeg:
    """Return the burn from the end of a coast into a circular orbit at an altitude above the
    equatorial radius.
    """
    position = before.position_m[-1]
    velocity = before.velocity_m_s[-1]
    speed = float(np.linalg.norm(velocity))
    angle = float(np.arcsin(velocity @ position / (speed * np.linalg.norm(position))))
    growth = 1.0 - 1.0 / SECOND_GROWTH
    wanted_m = EARTH_EQUATORIAL_RADIUS_M + altitude_m

    def flown(settings: FloatArray) -> AscentLeg:
        first_m_s2, exponent = settings.tolist()

        def program(time_s: float) -> tuple[float, float]:
            share = min(time_s / burn_s, 1.0)
            return first_m_s2 / (1.0 - growth * share), angle * (1.0 - share) ** exponent

        return powered(float(before.time_s[-1]), position, velocity, speed, burn_s, program)

    def miss(settings: FloatArray) -> FloatArray:
        leg = flown(settings)
        end_m = leg.position_m[-1]
        distance_m = float(np.linalg.norm(end_m))
        inertial_m_s = float(np.linalg.norm(leg.velocity_m_s[-1] + np.cross(OMEGA, end_m)))
        return np.array(
            [inertial_m_s - np.sqrt(EARTH_MU_M3_S2 / distance_m), (distance_m - wanted_m) / 100.0]
        )

    found = _solved(miss, np.array([8.0, 1.5]), f"no orbit at {altitude_m / 1e3:g} km from there")
    if SECOND_GROWTH * found[0] > MOST_M_S2:
        raise ValueError(f"the second burn needs more than {MOST_M_S2:g} m/s²; let it burn longer")
    return flown(found)


def _booster(before: AscentLeg, start_m: FloatArray, *, flies_back: bool) -> list[AscentLeg]:
    """Return the way of a booster from the end of its dark gap to the ground: to the launch site,
    or down the range.
    """
    velocity = before.velocity_m_s[-1]
    up = before.position_m[-1] / np.linalg.norm(before.position_m[-1])
    ahead = velocity - (velocity @ up) * up
    ahead /= np.linalg.norm(ahead)

    def flown(brake_m_s2: float) -> list[AscentLeg]:
        turned = [thrusting(before, _BACK_S, lambda *_: -brake_m_s2 * ahead)] if flies_back else []
        fallen = falling(
            (turned or [before])[-1],
            lambda place, way: height_of(place) < _ENTRY_M and _sinking_m_s(place, way) > 0.0,
        )
        brake = _ENTRY_SHARE * float(np.linalg.norm(fallen.velocity_m_s[-1])) / _ENTRY_S
        slowed = thrusting(fallen, _ENTRY_S, lambda _, way: -brake * way / np.linalg.norm(way))
        # A constant deceleration stops within half of the speed times the time.
        last = falling(
            slowed,
            lambda place, way: height_of(place) < 0.5 * _LANDING_S * _sinking_m_s(place, way),
        )
        place = last.position_m[-1]
        way = last.velocity_m_s[-1]
        landing = stopping(last, 2.0 * height_of(place) / _sinking_m_s(place, way))
        return [*turned, fallen, slowed, last, landing, resting(landing, _RESTS_S)]

    def beyond_km(brake_m_s2: FloatArray) -> FloatArray:
        return np.array([(flown(float(brake_m_s2[0]))[-1].position_m[-1] - start_m) @ ahead / 1e3])

    if not flies_back:
        return flown(0.0)
    return flown(float(_solved(beyond_km, np.array([40.0]), "no way back to the launch site")[0]))


def _sinking_m_s(position_m: FloatArray, velocity_m_s: FloatArray) -> float:
    """Return the speed towards the Earth's centre, m/s."""
    return -float(velocity_m_s @ position_m) / float(np.linalg.norm(position_m))


def _solved(miss: Callable[[FloatArray], FloatArray], guess: FloatArray, words: str) -> FloatArray:
    """Return the settings (k,) at which a miss (k,) is zero, by Newton's method; `ValueError` with
    words if none is.
    """
    for _ in range(_ITERATIONS):
        off = miss(guess)
        if float(np.abs(off).max()) < _MISS:
            return guess
        steps = 1e-5 * np.maximum(np.abs(guess), 1.0)
        slope = np.array([(miss(guess + step) - off) / step.sum() for step in np.diag(steps)]).T
        change = np.linalg.solve(slope, off)
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


def _record(own_id: str, config: AscentConfig, table: StateTable) -> Mapping[str, Any]:
    """Return the truth of a target as plain values."""
    launch = {"lat_deg": config.lat_deg, "lon_deg": config.lon_deg, "height_m": config.height_m}
    return {
        "id": own_id,
        "type": config.type,
        "flight": config.flight,
        "launch": launch,
        "azimuth_deg": config.azimuth_deg,
        "ignition_s": float(table.burns_s[0, 0]),
        "burnout_s": float(table.burns_s[-1, 1]),
        "stages": [
            {"ignition_s": start, "burnout_s": end} for start, end in table.burns_s.tolist()
        ],
        "gaps_s": plain_gaps_s(table.burns_s),
    }
