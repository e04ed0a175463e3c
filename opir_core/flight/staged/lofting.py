"""Lofted and depressed gravity turns: kick and cut-off solved for together, for an aim point and an
apogee.

The flights of a boost that reach one point are a curve in three unknowns: the kick towards east and
north, and the cut-off of the last burn. At each cut-off later than the earliest one that reaches
the point there are two, a steep one and a flat one. The steep side ends at the latest cut-off, with
the steepest flight; the flat side there too, or where the burn ends without climb. Apogee increases
along the curve from its flat to its steep end, whereas range is monotonic in neither kick nor
cut-off: Newton's method for the three unknowns therefore aims at a point and an apogee.
"""

from enum import IntEnum

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.flight.gravity_and_drag import height_and_climb, height_m
from opir_core.flight.landing import polar_rad
from opir_core.flight.propagation import propagate
from opir_core.flight.rows import Rows, TrailingRows
from opir_core.flight.staged.gravity_turn import fineness_needed
from opir_core.flight.staged.shots import Reach, StagedShots
from opir_core.flight.universal_anomaly import cross, dot, length
from opir_core.geometry import ecef_to_eci_state
from opir_core.geometry.vectors import FloatPair

#: The tolerance of the miss and of the apogee, m.
TOLERANCE_M = 0.1


#: Steps of the finite differences of kick, rad, and cut-off, s.
_STEPS = np.array([1e-5, 1e-5, 1e-3])


#: The number of parts in which a goal is approached that is not reached at once.
_PARTS = 8


class Goal(IntEnum):
    """What a flight shall have besides its place of impact."""

    APOGEE = 0
    CUT_OFF = 1
    CLIMB = 2


@frozen(eq=False, repr=False)
class Goals(Rows):
    """The kind of goal of shots, and its values (n,): apogee, m; cut-off, s since ignition; climb
    at burnout, m/s.
    """

    kind: Goal
    value: FloatArray

    def residual(self, flights: "Flights") -> FloatArray:
        """Return the errors (3, n), m: east and north of the aim point, and of the goal."""
        values = flights.apogee_m, flights.unknown[2], flights.climb_m_s
        error_m = self._metres(values[self.kind]) - self._metres(self.value)
        return np.stack([flights.east_m, flights.north_m, error_m])

    def _metres(self, value: FloatArray) -> FloatArray:
        """Return values of goals (n,) as metres: what an error counts beside one of place is about
        as many metres as it moves the impact.
        """
        if self.kind == Goal.APOGEE:
            return bounded_m(value)
        return {Goal.CUT_OFF: 1e5, Goal.CLIMB: 100.0}[self.kind] * value


@frozen(eq=False, repr=False)
class Flights(TrailingRows):
    """Trial flights (n,): unknowns (3, n), misses towards east and north of the launch point,
    apogee and last climb.

    Unknowns are the kick towards east and north, rad, and the cut-off, s since ignition. The apogee
    is the height above the ellipsoid of that of the orbit half-way to impact; negative beyond
    escape. nan where flights do not come down.
    """

    unknown: FloatArray
    east_m: FloatArray
    north_m: FloatArray
    apogee_m: FloatArray
    climb_m_s: FloatArray

    def unless(self, is_bad: BoolArray) -> "Flights":
        """Return the flights without apogee and climb, nan, where they are bad."""
        apogee_m, climb_m_s = (
            np.where(is_bad, np.nan, column) for column in (self.apogee_m, self.climb_m_s)
        )
        return evolve(self, apogee_m=apogee_m, climb_m_s=climb_m_s)


def bounded_m(apogee_m: FloatArray) -> FloatArray:
    """Return R A/(R + A) of apogees, m: quadratic in the speed of a vertical launch, R at escape
    and smooth beyond.
    """
    radius_m = EARTH_EQUATORIAL_RADIUS_M
    with np.errstate(all="ignore"):
        return radius_m * (apogee_m / (radius_m + apogee_m))


def azimuth_and_kick(unknown: FloatArray) -> FloatPair:
    """Return azimuths and kicks (n,), rad, of unknowns (3, n)."""
    return np.arctan2(unknown[0], unknown[1]), np.hypot(unknown[0], unknown[1])


def unknowns(azimuth_rad: FloatArray, kick_rad: FloatArray, cut_off_s: FloatArray) -> FloatArray:
    """Return the unknowns (3, n) of flights."""
    return np.stack([kick_rad * np.sin(azimuth_rad), kick_rad * np.cos(azimuth_rad), cut_off_s])


def flights_with(shots: StagedShots, unknown: FloatArray) -> Flights:
    """Return the flights of shots with unknowns (3, n), under the shots' forces."""
    azimuth_rad, kick_rad = azimuth_and_kick(unknown)
    shots = evolve(shots, kick_rad=kick_rad)
    position, velocity = shots.burnout(azimuth_rad, unknown[2])
    with np.errstate(all="ignore"):
        landing = shots.landing_from(position, velocity)
        east_m, north_m = _offsets_m(shots, landing.impact_ecef_m)
        aim_east_m, aim_north_m = _offsets_m(shots, shots.aim_ecef_m)
        inverse_radius = 1.0 / length(position.T)
        _, climb = height_and_climb(position.T, velocity.T, inverse_radius)
        apogee_m = _apogee_m(shots, *ecef_to_eci_state(position, velocity, 0.0), landing.duration_s)
    return Flights(unknown, east_m - aim_east_m, north_m - aim_north_m, apogee_m, climb)


def _offsets_m(shots: StagedShots, point_ecef_m: FloatArray) -> FloatPair:
    """Return the offsets (n,) of points towards east and north of the launch points: azimuthal,
    equidistant.
    """
    angle, bearing = polar_rad(shots.boosts.site, point_ecef_m)
    distance_m = EARTH_EQUATORIAL_RADIUS_M * angle
    return distance_m * np.sin(bearing), distance_m * np.cos(bearing)


def _apogee_m(
    shots: StagedShots, position_m: FloatArray, velocity_m_s: FloatArray, duration_s: FloatArray
) -> FloatArray:
    """Return the heights (n,) of apogees of free flights from inertial states (n, 3) that last so
    long.
    """
    if shots.forces is not None:
        position_m, velocity_m_s = propagate(
            position_m, velocity_m_s, 0.5 * duration_s, shots.forces
        )
    position = position_m.T
    velocity = velocity_m_s.T
    radius = length(position)
    speed_squared = dot(velocity, velocity)
    towards_perigee = (speed_squared - EARTH_MU_M3_S2 / radius) * position - dot(
        position, velocity
    ) * velocity
    eccentricity = length(towards_perigee) / EARTH_MU_M3_S2
    semi_major_m = EARTH_MU_M3_S2 / (2.0 * EARTH_MU_M3_S2 / radius - speed_squared)
    apogee_radius_m = semi_major_m * (1.0 + eccentricity)
    point = towards_perigee * (-apogee_radius_m / length(towards_perigee))
    closed = height_m(point, 1.0 / np.abs(apogee_radius_m))
    return np.where(apogee_radius_m > 0.0, closed, apogee_radius_m - EARTH_EQUATORIAL_RADIUS_M)


def jointly_aimed(
    shots: StagedShots, goals: Goals, unknown: FloatArray
) -> tuple[Flights, FloatArray]:
    """Return the flights (n,) that reach aim points and goals by Newton's method, and what errors
    are left, m.

    The first guess is the flight of coarse steps and two-body motion; its slopes are then updated
    by Broyden's formula. A step that does not reduce the error is halved.
    """
    coarse = evolve(shots.in_two_body_motion(), fineness=np.ones_like(shots.fineness))
    guess, slopes = _with_slopes(coarse, goals, unknown)
    guess, _ = _improved(coarse, goals, guess, slopes, by_broyden=False)
    flights, error_m = _improved(
        shots, goals, flights_with(shots, guess.unknown), slopes, by_broyden=True
    )
    return flights, np.nan_to_num(error_m, nan=np.inf)


def _improved(
    shots: StagedShots, goals: Goals, flights: Flights, slopes: FloatArray, *, by_broyden: bool
) -> tuple[Flights, FloatArray]:
    """Return flights after Newton's steps and their errors, m; `slopes` become those of the last
    ones.
    """
    residual = goals.residual(flights)
    error_m = length(residual)
    share = np.ones(len(error_m))
    for _ in range(40):
        # Newton's method gives up where this share of its step does not reduce the error.
        rows = np.flatnonzero((error_m > TOLERANCE_M) & (share > 2.0**-7))
        if not rows.size:
            break
        group = shots.take(rows)
        aims = goals.take(rows)
        step = share[rows] * _newton_step(group, residual[:, rows], slopes[:, :, rows])
        unknown = flights.unknown[:, rows] + step
        if by_broyden:
            trial = flights_with(group, unknown)
            trial_slopes = _broyden(
                slopes[:, :, rows], aims.residual(trial) - residual[:, rows], step
            )
        else:
            trial, trial_slopes = _with_slopes(group, aims, unknown)
        trial_residual = aims.residual(trial)
        trial_m = length(trial_residual)
        nearer = trial_m < error_m[rows]
        share[rows] = np.where(nearer, np.minimum(2.0 * share[rows], 1.0), 0.5 * share[rows])
        better = rows[nearer]
        error_m[better] = trial_m[nearer]
        residual[:, better] = trial_residual[:, nearer]
        slopes[:, :, better] = trial_slopes[:, :, nearer]
        flights.overwrite(better, trial.take(np.flatnonzero(nearer)))
    return flights, error_m


def _with_slopes(
    shots: StagedShots, goals: Goals, unknown: FloatArray
) -> tuple[Flights, FloatArray]:
    """Return flights, and the slopes (3, 3, n) of their errors by each unknown (first axis: the
    error).
    """
    count = unknown.shape[1]
    rows = np.tile(np.arange(count), 4)
    moved = np.repeat(unknown[:, None, :], 4, axis=1)
    for number, step in enumerate(_STEPS.tolist()):
        moved[number, number + 1] += step
    flights = flights_with(shots.take(rows), moved.reshape(3, -1))
    residual = goals.take(rows).residual(flights).reshape(3, 4, count)
    return flights.take(np.arange(count)), (residual[:, 1:] - residual[:, :1]) / _STEPS[
        None, :, None
    ]


def _broyden(slopes: FloatArray, change: FloatArray, step: FloatArray) -> FloatArray:
    """Return slopes (3, 3, n) that explain the changes (3, n) of errors by steps of the
    unknowns.
    """
    scaled = step / _STEPS[:, None]
    explained = slopes[:, 0] * step[0] + slopes[:, 1] * step[1] + slopes[:, 2] * step[2]
    along = scaled / (_STEPS[:, None] * dot(scaled, scaled))
    return slopes + (change - explained)[:, None] * along[None]


def _newton_step(shots: StagedShots, residual: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the corrections (3, n) by Cramer's rule, of bounded size."""
    east = slopes[:, 0]
    north = slopes[:, 1]
    cut = slopes[:, 2]
    with np.errstate(all="ignore"):
        normal = cross(north, cut)
        determinant = dot(east, normal)
        step = -np.stack(
            [
                dot(residual, normal),
                dot(residual, cross(cut, east)),
                dot(residual, cross(east, north)),
            ]
        )
        step /= determinant
        # The largest corrections at once: of kick, rad, and cut-off, as a share of the last burn.
        kick = np.hypot(step[0], step[1]) / 0.2
        time = np.abs(step[2]) / (0.2 * shots.boosts.stages.burn_time_s[-1])
        return step / np.maximum(np.maximum(kick, time), 1.0)


@frozen(eq=False, repr=False)
class Side:
    """One side of the flights (n,) that reach aim points.

    Its inner end has the earliest cut-off, its outer one is the steepest or the flattest flight.
    Their apogees are nan where no flight was found.
    """

    shots: StagedShots
    inner: Flights
    outer: Flights

    def has(self, apogee_m: FloatArray) -> BoolArray:
        """Return whether apogees (n,), m, are between those of the ends."""
        lowest_m = np.minimum(self.inner.apogee_m, self.outer.apogee_m)
        highest_m = np.maximum(self.inner.apogee_m, self.outer.apogee_m)
        return (apogee_m >= lowest_m) & (apogee_m <= highest_m)

    def between_m(self, share: FloatArray) -> FloatArray:
        """Return apogees (n,), m, for shares of the way from the inner to the outer end."""
        return (1.0 - share) * self.inner.apogee_m + share * self.outer.apogee_m

    def start(self, apogee_m: FloatArray) -> FloatArray:
        """Return unknowns (3, n) between the ends, near those with these apogees."""
        share = (apogee_m - self.inner.apogee_m) / (self.outer.apogee_m - self.inner.apogee_m)
        share = np.clip(np.nan_to_num(share), 0.0, 1.0)
        # About the inner end the cut-off is a parabola over the apogee.
        weight = np.stack([share, share, share * share])
        return (1.0 - weight) * self.inner.unknown + weight * self.outer.unknown

    def with_apogee(self, apogee_m: FloatArray) -> tuple[Flights, BoolArray]:
        """Return the flights (n,) of this side with apogees, m, and whether there are such
        flights.
        """
        flights, error_m = jointly_aimed(
            self.shots, Goals(Goal.APOGEE, apogee_m), self.start(apogee_m)
        )
        is_solved = error_m <= TOLERANCE_M
        rows = np.flatnonzero(~is_solved & self.has(apogee_m))
        if rows.size:
            goals = Goals(Goal.APOGEE, apogee_m[rows])
            start = self.inner.take(rows)
            walked, is_solved[rows] = _walked(self.shots.take(rows), goals, start.apogee_m, start)
            flights.overwrite(rows, walked)
        return flights, is_solved & self.has(apogee_m)


def _walked(
    shots: StagedShots, goals: Goals, start_value: FloatArray, start: Flights
) -> tuple[Flights, BoolArray]:
    """Return flights (n,) nearest to goals, approached from `start` and its values `first`, whether
    they meet them.
    """
    flights = start.take(np.arange(len(start_value)))
    rows = np.flatnonzero(np.isfinite(start_value))
    for step in range(1, _PARTS + 1):
        share = step / _PARTS
        value = (1.0 - share) * start_value[rows] + share * goals.value[rows]
        aims = evolve(goals.take(rows), value=value)
        trial, error_m = jointly_aimed(shots.take(rows), aims, flights.unknown[:, rows])
        is_near = error_m <= TOLERANCE_M
        rows = rows[is_near]
        flights.overwrite(rows, trial.take(np.flatnonzero(is_near)))
        if not rows.size:
            break
    is_met = np.zeros(len(start_value), dtype=bool)
    is_met[rows] = True
    return flights, is_met


@frozen(eq=False, repr=False)
class Launches(Rows):
    """Launches (n,): azimuth and kick, rad, cut-off, s since ignition, `fineness`, and whether they
    reach their aims.

    `apogees_m` (n, 4) are those of the flattest flight, of the highest flat and of the lowest steep
    one, and of the steepest; nan without such a flight, and where no setting depends
    on them.
    """

    azimuth_rad: FloatArray
    kick_rad: FloatArray
    cut_off_s: FloatArray
    fineness: FloatArray
    is_solved: BoolArray
    apogees_m: FloatArray

    @classmethod
    def none(cls, azimuth_rad: FloatArray, cut_off_s: FloatArray) -> "Launches":
        """Return launches that do not reach their aim points, without kicks."""
        count = len(azimuth_rad)
        is_solved = np.zeros(count, dtype=bool)
        apogees_m = np.full((count, 4), np.nan)
        return cls(
            azimuth_rad.copy(),
            np.zeros(count),
            cut_off_s.copy(),
            np.ones(count),
            is_solved,
            apogees_m,
        )

    def unknown(self) -> FloatArray:
        """Return the unknowns (3, n)."""
        return unknowns(self.azimuth_rad, self.kick_rad, self.cut_off_s)


def lofted(
    shots: StagedShots, table: Reach, earliest: Launches, loft: FloatArray, apogee_m: FloatArray
) -> Launches:
    """Return the launches of lofts (n,) in [-1, 1], or of apogees, m, where these are not nan.

    `earliest` are the launches with the earliest cut-off, which a loft of 0 is. Where even the
    earliest possible one flies too far with the best kick, they are not solved, and a loft of 0 is
    its steep flight. `table` is how far the shots reach in about the direction of their aim points.
    """
    has_apogee = np.isfinite(apogee_m)
    launches = earliest.take(np.arange(len(loft)))
    np.logical_and(launches.is_solved, (loft == 0.0) & ~has_apogee, out=launches.is_solved)
    for find, ends, is_wanted in (
        (steep_side, [2, 3], loft >= 0.0),
        (flat_side, [1, 0], loft < 0.0),
    ):
        rows = np.flatnonzero(~launches.is_solved & (is_wanted | has_apogee))
        if not rows.size:
            continue
        side = find(
            shots.take(rows),
            table.take(rows),
            earliest.unknown()[:, rows],
            earliest.is_solved[rows],
        )
        apogees_m = launches.apogees_m[rows]
        apogees_m[:, ends] = np.stack([side.inner.apogee_m, side.outer.apogee_m], axis=1)
        launches.apogees_m[rows] = apogees_m
        goal_m = np.where(has_apogee[rows], apogee_m[rows], side.between_m(np.abs(loft[rows])))
        solved = _launches(side, goal_m, apogees_m)
        launches.overwrite(rows[solved.is_solved], solved.take(np.flatnonzero(solved.is_solved)))
    return launches


def _launches(side: Side, apogee_m: FloatArray, apogees_m: FloatArray) -> Launches:
    """Return the launches of the flights of a side with apogees (n,), m."""
    flights, is_solved = side.with_apogee(apogee_m)
    shots = side.shots
    cut_off_s = np.clip(flights.unknown[2], shots.earliest_s, shots.latest_s)
    azimuth_rad, kick_rad = azimuth_and_kick(flights.unknown)
    return Launches(azimuth_rad, kick_rad, cut_off_s, shots.fineness, is_solved, apogees_m)


def steep_side(shots: StagedShots, table: Reach, base: FloatArray, has_base: BoolArray) -> Side:
    """Return the steep flights that reach the aim points; `base` (3, n) are those of the earliest
    cut-off, if any.
    """
    zero = np.zeros_like(shots.earliest_s)
    shots = _finer(shots, unknowns(zero, zero, shots.latest_s))
    inner = _inner_end(shots, base, has_base, unknowns(zero, zero, shots.earliest_s))
    goals = Goals(Goal.CUT_OFF, shots.latest_s)
    outer, error_m = jointly_aimed(shots, goals, unknowns(zero, zero, shots.latest_s))
    rows = np.flatnonzero(error_m > TOLERANCE_M)
    if rows.size:
        group = shots.take(rows)
        start = inner.take(rows)
        # The steepest flight of stages that could escape has this apogee, m: it lasts 15 h; free
        # flight is followed for a day.
        highest = Goals(Goal.APOGEE, np.full(rows.size, 5e7))
        outer.overwrite(rows, _end(group, start, highest, start.apogee_m))
    return Side(shots, inner, outer)


def flat_side(shots: StagedShots, table: Reach, base: FloatArray, has_base: BoolArray) -> Side:
    """Return the flat flights that reach the aim points; `base` (3, n) are those of the earliest
    cut-off, if any.
    """
    range_rad, azimuth_rad = polar_rad(shots.boosts.site, shots.aim_ecef_m)
    earliest = unknowns(azimuth_rad, table.flat_kicks_rad(range_rad), shots.earliest_s)
    shots = _finer(shots, np.where(has_base, base, earliest))
    inner = _inner_end(shots, base, has_base, earliest)
    level = Goals(Goal.CLIMB, np.zeros_like(inner.climb_m_s))
    return Side(shots, inner, _end(shots, inner, level, inner.climb_m_s))


def _end(shots: StagedShots, inner: Flights, goals: Goals, value: FloatArray) -> Flights:
    """Return the flights (n,) with goals, from inner ends and their values `first`; or with the
    latest cut-off.

    Where neither can be aimed, as near orbital speed, they are the last on the way that can.
    """
    flights, error_m = jointly_aimed(shots, goals, inner.unknown)
    rows = np.flatnonzero(error_m > TOLERANCE_M)
    if rows.size:
        flights.overwrite(
            rows, _walked(shots.take(rows), goals.take(rows), value[rows], inner.take(rows))[0]
        )
    rows = np.flatnonzero(flights.unknown[2] > shots.latest_s)
    if rows.size:
        group = shots.take(rows)
        nearest = inner.unknown[:, rows]
        span = flights.unknown[:, rows] - nearest
        # About the inner end the cut-off is a parabola.
        share = np.sqrt((group.latest_s - nearest[2]) / span[2])
        flattened, error_m = jointly_aimed(
            group, Goals(Goal.CUT_OFF, group.latest_s), nearest + share * span
        )
        flights.overwrite(rows, flattened.unless(error_m > TOLERANCE_M))
    return flights


def _finer(shots: StagedShots, unknown: FloatArray) -> StagedShots:
    """Return shots with steps that are fine enough for launches with unknowns (3, n) too."""
    azimuth_rad, kick_rad = azimuth_and_kick(unknown)
    needed = fineness_needed(shots.boosts, azimuth_rad, kick_rad, unknown[2])
    return evolve(shots, fineness=np.maximum(shots.fineness, needed))


def _inner_end(
    shots: StagedShots, base: FloatArray, has_base: BoolArray, start: FloatArray
) -> Flights:
    """Return the flights (n,) with the earliest cut-off; their apogee is nan where there is
    none.
    """
    flights = flights_with(shots, np.where(has_base, base, start))
    rows = np.flatnonzero(~has_base)
    if rows.size:
        goals = Goals(Goal.CUT_OFF, shots.earliest_s[rows])
        aimed, error_m = jointly_aimed(shots.take(rows), goals, start[:, rows])
        flights.overwrite(rows, aimed.unless(error_m > TOLERANCE_M))
    return flights
