"""The fates of particles: the ends of their burns, their impacts, glides within the reach of an
equilibrium glide, and the probability that they reach an orbit.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import air_velocity, dot, earth_rotated

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_MU_M3_S2
from opir_core.flight import Forces, propagate_kepler
from opir_core.geometry import ecef_to_geodetic, great_circle_m
from opir_core.interfaces import Columns
from opir_forecast.burning_on import LAW, STEPS, Steering, drawn_steering, flown_on
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import DRAWS, BurnState, Particles
from opir_forecast.vehicles import NONE, SPACE, STAGES, VehicleModel

#: Remaining share of a tilt after a step, which takes about 10 s, and of a present tilt (STAGES,
#: STEPS) in each step.
_KEEP = np.exp(-10.0 / LAW.tilt_s)
_DECAY = _KEEP ** (1.0 + np.arange(STAGES * STEPS).reshape(STAGES, STEPS))


@frozen(eq=False, repr=False)
class Fates(Columns):
    """Fates of particles (p,): inertial states at the ends of their burns, times and places of
    impact, ranges.

    `state` and `out_s` of dark particles are the present ones, `burnt` and `burnt_s` those at the
    end of the burn. `place` (p, 2) and `when_s`, since the scene's start, are nan without an
    impact; `range_m` is nan too without a launch. `origin` (p, 2) is the present place of the
    particle's track. `reach` (p,) is the relative probability of an orbit, `flies` says whether the
    burn stays above the ground.
    """

    state: FloatArray
    out_s: FloatArray
    place: FloatArray
    when_s: FloatArray
    range_m: FloatArray
    reach: FloatArray
    flies: BoolArray
    origin: FloatArray
    burnt: FloatArray
    burnt_s: FloatArray


def fates_of(
    outcomes: Outcomes,
    particles: Particles,
    launch: FloatArray,
    dark_s: FloatArray,
    time_s: float,
    forces: Forces,
) -> Fates:
    """Return the fates of particles at a time, given the launches (n, 3) of their tracks, nan where
    unknown.

    `dark_s` (n,) is the time since the burns of dark tracks ended.
    """
    is_space = particles.family == SPACE
    steering, tilt = _steering_and_tilts(outcomes.model, particles)
    # A space launcher that comes down has failed, at any time.
    shares = _uniform(4)[particles.draw]
    burns = particles.cut_off(np.where(is_space, shares, 1.0))
    out, later_s, least_m = flown_on(particles.state, burns, steering, tilt)
    out_s = time_s + later_s
    place, when_s = free_impacts(out, out_s, forces)
    burnt, burnt_s = _at_burnout(out, out_s, particles, dark_s)
    return Fates(
        out,
        out_s,
        place,
        when_s,
        _ranges_m(launch[particles.track], place),
        _orbit_reach(outcomes, particles, np.isfinite(when_s)),
        is_space | (least_m > local_radius_m(out) - LAW.crash_m),
        _origins(particles, time_s),
        burnt,
        burnt_s,
    )


def _ranges_m(launch: FloatArray, place: FloatArray) -> FloatArray:
    """Return the ranges (p,), m, from launches (p, 3), nan where unknown, to places (p, 2)."""
    is_known = np.isfinite(launch[:, 0])
    start = np.where(is_known[:, None], launch, 0.0)
    return np.where(is_known, great_circle_m(start, place), np.nan)


def _orbit_reach(outcomes: Outcomes, particles: Particles, falls: BoolArray) -> FloatArray:
    """Return the relative probabilities (p,) of an orbit, given which particles fall without
    another burn.
    """
    is_able = (particles.family == SPACE) | (particles.family == NONE)
    is_dark = particles.lit == BurnState.DARK
    burning = np.flatnonzero(is_able & ~is_dark)
    reach = np.zeros(len(particles))
    reach[burning] = outcomes.reaching(particles.state[burning], particles.take(burning))
    reach[is_able & is_dark & ~falls] = 1.0 / outcomes.model.data["marginal"]["orbit"]
    return reach


def _at_burnout(
    out: FloatArray, out_s: FloatArray, particles: Particles, dark_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states and times at the ends of burns: of dark particles, back along their free
    flight.
    """
    is_dark = particles.lit == BurnState.DARK
    since_s = np.where(is_dark, np.maximum(dark_s[particles.track], 0.0), 0.0)
    rows = np.flatnonzero(since_s > 0.0)
    state = out.copy()
    if len(rows):
        flown_back = propagate_kepler(out[rows, :3], out[rows, 3:6], -since_s[rows])
        state[rows, :6] = np.concatenate(flown_back, axis=1)
    return state, out_s - since_s


@cache
def _drawn_programs(model: VehicleModel) -> Steering:
    """Return the steering of all draws."""
    return drawn_steering(DRAWS, model.data, 3)


@cache
def _uniform(seed: int) -> FloatArray:
    """Return uniform numbers of all draws."""
    return np.random.default_rng(seed).random(DRAWS)


@cache
def _tilts() -> FloatArray:
    """Return angles (STAGES, STEPS, draws, 2), rad: Gauss-Markov processes from step to step that
    begin at 0.
    """
    rng = np.random.default_rng(2)
    low, high = np.radians(LAW.tilt_deg)
    sigma = (low * (high / low) ** rng.random(DRAWS))[:, None]
    noise = rng.normal(size=(STAGES * STEPS, DRAWS, 2))
    tilt = np.zeros_like(noise)
    for step in range(len(tilt)):
        # Before the first step it is the last one, which is still 0.
        tilt[step] = _KEEP * tilt[step - 1] + np.sqrt(1.0 - _KEEP * _KEEP) * noise[step]
    return (tilt * sigma * [1.0, LAW.sidewards]).reshape(STAGES, STEPS, DRAWS, 2)


def _thrust_angles(particles: Particles) -> FloatArray:
    """Return the angles (p, 2), rad, of the thrust from the velocity, downwards and sidewards; 0 in
    the dark or slow."""
    rows = np.flatnonzero(particles.lit == BurnState.LIT)
    angle = np.zeros((len(particles), 2))
    angle[rows] = _angles(particles.state[rows], particles.force[rows])
    return angle


def _angles(state: FloatArray, force: FloatArray) -> FloatArray:
    """Return the angles (n, 2), rad, of forces from the velocities of states; 0 in the slow."""
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity) + 1.0)
    along = np.maximum(dot(force, velocity) / speed, 1.0)[:, None]
    side = np.cross(velocity, state[:, :3])
    across = [_component(force, axis) for axis in (np.cross(velocity, side), side)]
    return np.arctan2(np.stack(across, axis=1), along) * (speed > LAW.fast_m_s)[:, None]


def _component(vector: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the components (n,) of vectors (n, 3) along long axes (n, 3)."""
    return dot(vector, axis) / np.sqrt(dot(axis, axis) + 1.0)


def _steering_and_tilts(model: VehicleModel, particles: Particles) -> tuple[Steering, FloatArray]:
    """Return the programs of particles (p,), and the tilts (STAGES, STEPS, p, 2) from them."""
    angle = _thrust_angles(particles)
    is_lit = particles.lit == BurnState.LIT
    steering = _steered(_drawn_programs(model), particles, angle, is_lit)
    lead = np.where(is_lit, steering.leads(particles.since_s), 0.0)
    largest = np.radians(LAW.largest_tilt_deg)
    present = np.clip(angle - lead[:, None] * [1.0, 0.0], -largest, largest)
    return steering, _tilts()[:, :, particles.draw] + _DECAY[:, :, None, None] * present


def _steered(
    programs: Steering, particles: Particles, angle: FloatArray, is_lit: BoolArray
) -> Steering:
    """Return the programs (p,) of particles: of some draws for each, one that fits the present
    angle of its thrust.
    """
    steps = LAW.stride * np.arange(LAW.choices)
    choice = (particles.draw[:, None] + steps) % len(programs)
    leads = _leads_of(programs, choice, particles.since_s)
    total = np.cumsum(_lead_weights(angle[:, :1], leads, is_lit[:, None]), axis=1)
    pick = total[:, -1:] * _uniform(6)[particles.draw, None]
    picked = np.sum(total < pick, axis=1).clip(0, LAW.choices - 1)
    return programs.take(choice[np.arange(len(choice)), picked])


def _leads_of(programs: Steering, choice: IntArray, since_s: FloatArray) -> FloatArray:
    """Return the leads (p, k) of programs (p, k) at times (p,) since the first ignition."""
    times_s = np.repeat(since_s, choice.shape[1])
    return programs.take(choice.ravel()).leads(times_s).reshape(choice.shape)


def _lead_weights(angle: FloatArray, leads: FloatArray, is_lit: BoolArray) -> FloatArray:
    """Return the weights (p, k) of leads by angles (p, 1) of the thrust; equal ones in the dark."""
    sigma = np.radians(LAW.lead_deg) + LAW.lead_share * np.abs(leads)
    score = (angle - leads) / sigma
    return np.where(is_lit, np.exp(-0.5 * score * score) / sigma + 1e-9, 1.0)


def features(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heights m, flight-path angles rad and speeds m/s through the air of inertial states
    (p, 6).
    """
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    climb = dot(state[:, :3], velocity) / np.maximum(radius * speed, 1.0)
    return radius - local_radius_m(state), np.arcsin(np.clip(climb, -1.0, 1.0)), speed


def _origins(particles: Particles, time_s: float) -> FloatArray:
    """Return the latitudes and longitudes (p, 2), rad, below the first particle of each one's
    track.
    """
    _, row, track = np.unique(particles.track, return_index=True, return_inverse=True)
    return _places(particles.state[row, :3], np.full(len(row), time_s))[track]


def _places(position: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the latitudes and longitudes (p, 2), rad, of inertial positions (p, 3) at times (p,)."""
    point = ecef_to_geodetic(earth_rotated(position, -time_s))
    return np.stack([point.latitude_rad, point.longitude_rad], axis=1)


def local_radius_m(state: FloatArray) -> FloatArray:
    """Return the radius (p,), m, of the ellipsoid below states (p, 6), to 50 m: a(1 - f sin² φ)."""
    sine = state[:, 2] / np.sqrt(dot(state[:, :3], state[:, :3]))
    return EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING * sine * sine)


def free_impacts(
    state: FloatArray, time_s: FloatArray, forces: Forces, tolerance_m: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (p, 2), rad, and times (p,) of the impacts of free flights;
    nan without one.

    Without a tolerance, under the gravity of a point mass.
    """
    from opir_core.flight import impact

    if tolerance_m is None:
        point_mass = Forces(zonal=(), gravity=forces.gravity)
        flight_s, end = impact(state[:, :3], state[:, 3:], forces=point_mass)
    else:
        flight_s, end = impact(state[:, :3], state[:, 3:], forces=forces, tolerance_m=tolerance_m)
    when_s = time_s + flight_s
    return _places(end, when_s), when_s


#: Steps of an even sequence in three dimensions: powers of the inverse root of x⁴ = x + 1
#: (Kronecker's sequence).
_STEPS = 1.2207440846057596 ** -np.arange(1.0, 4.0)


class GlideEnds(NamedTuple):
    """Places (p, 2), latitude and longitude, rad, times (p,) and weights of gliders' ends."""

    place: FloatArray
    time_s: FloatArray
    weight: FloatArray


def glide_ends(
    outcomes: Outcomes, state: FloatArray, out_s: FloatArray, weight: FloatArray, falls: FloatArray
) -> GlideEnds | None:
    """Return the ends of gliders whose burns end with inertial states (p, 6) at times.

    `weight` (p,) are the particles' weights as gliders, `falls` (p,) those of ballistic impacts.
    None if gliders have less than the share of one particle, which regions do not resolve.
    """
    glides = weight.sum()
    if not len(weight) * glides > glides + falls.sum():
        return None
    even = (np.arange(len(state))[:, None] * _STEPS + 0.5) % 1.0
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    range_m = _glide_ranges_m(outcomes, radius, speed, even)
    up = state[:, :3] / radius[:, None]
    course = _courses(up, velocity, even[:, 2])
    angle = (range_m / EARTH_EQUATORIAL_RADIUS_M)[:, None]
    end = EARTH_EQUATORIAL_RADIUS_M * (np.cos(angle) * up + np.sin(angle) * course)
    # Courses are over the ground, which turns with it.
    time_s = out_s + range_m / np.maximum(0.6 * speed, 100.0)
    return GlideEnds(_places(end, out_s), time_s, weight)


def _courses(up: FloatArray, velocity: FloatArray, even: FloatArray) -> FloatArray:
    """Return the mean directions (p, 3) of glides over the ground, by even draws (p,) of turns."""
    forwards = velocity - up * dot(up, velocity)[:, None]
    forwards /= np.maximum(np.sqrt(dot(forwards, forwards)), 1.0)[:, None]
    turn = np.radians(LAW.glide_turn_deg) * np.sqrt(12.0) * (even - 0.5)
    return np.cos(turn)[:, None] * forwards + np.sin(turn)[:, None] * np.cross(up, forwards)


def _glide_ranges_m(
    outcomes: Outcomes, radius: FloatArray, speed: FloatArray, even: FloatArray
) -> FloatArray:
    """Return the ranges (p,), m, of glides from radii and speeds (p,), by even draws (p, 3).

    The range of an equilibrium glide from speed v to w is R/2 · L/D · ln((1 - w²/c²) / (1 -
    v²/c²)), c the speed of an orbit (Eggers, Allen and Neice, NACA TR 1381, 1958).
    """
    lift_to_drag, final_m_s = _glide_classes(outcomes, len(radius))
    low, high = LAW.glide_ratio
    ratio = lift_to_drag * low * (high / low) ** even[:, 0]
    square = EARTH_MU_M3_S2 / radius
    start = np.clip(1.0 - speed * speed / square, 0.02, 1.0)
    log = np.log(np.maximum((1.0 - final_m_s * final_m_s / square) / start, 1.02))
    reach = 0.5 * EARTH_EQUATORIAL_RADIUS_M * ratio * log
    low, high = LAW.glide_share
    share = low + (high - low) * even[:, 1]
    return np.minimum(reach * share, LAW.farthest_glide_m)


def _glide_classes(outcomes: Outcomes, count: int) -> FloatArray:
    """Return lift over drag, and final speeds, m/s, (2, count) of the classes in turn."""
    classes = [outcomes.hypotheses[number].target_class for number in outcomes.columns("glide")]
    glides: list[Any] = [glider.after_burnout for glider in classes if glider]
    figures = [(glide.lift_to_drag, glide.final_speed_m_s) for glide in glides]
    return np.array(figures)[np.arange(count) % len(figures)].T
