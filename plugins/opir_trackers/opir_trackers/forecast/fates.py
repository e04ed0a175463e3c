"""What becomes of particles: the ends of their burns, their impacts, and whether they reach an
orbit.
"""

from functools import cache
from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from opir_core.estimation import dot
from opir_core.flight import Forces, propagate_kepler
from opir_core.geometry import ecef_to_geodetic, great_circle_m
from opir_trackers.filter.thrust import air_velocity
from opir_trackers.forecast.burning_on import STEPS, TILT_S, Steering, drawn_steering, flown_on
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.particles import AGAIN, BURNING, OVER, Particles
from opir_trackers.forecast.vehicles import NONE, SPACE, STAGES, VehicleModel
from opir_trackers.lines_of_sight import earth_rotated

#: Standard deviation of the tilt of the thrust from a program, least and largest, rad: log-uniform
#: over particles. And its share sidewards: boosts keep to their plane. Notional.
TILT_RAD = np.radians([0.3, 4.0])
SIDEWARDS = 0.5

#: A tilt of the filter counts up to this angle, rad, above this speed, m/s.
_TILT_MOST = np.radians(15.0)
_FAST_M_S = 150.0

#: Programs that each particle chooses from; how well the filter knows the angle of the thrust, rad,
#: and the share of it by which it is wrong, as it expects none.
CHOICES = 8
_STRIDE = 61
_LEAD_RAD = np.radians(1.5)
_LEAD_SHARE = 0.25

#: A burn that leads this far below the ground, m, is none.
_BELOW_M = 300.0

#: Shares of the remaining burn after which failed launches go dark, by draw.
_SHARES = np.random.default_rng(4).random(BURNING + OVER + AGAIN)

#: Numbers by which programs are chosen, by draw.
_PICKS = np.random.default_rng(6).random(BURNING + OVER + AGAIN)

_KEEP = np.exp(-10.0 / TILT_S)

#: What is left of a present tilt (STAGES, STEPS) in each step.
_DECAY = _KEEP ** (1.0 + np.arange(STAGES * STEPS).reshape(STAGES, STEPS))


class Fates(NamedTuple):
    """What becomes of particles (p,): inertial states at the ends of their burns, times and places
    of impact, ranges.

    `state` and `out_s` of what is dark are those of now, `burnt` and `burnt_s` those at the end of
    its burn. `place` (p, 2) and `when_s`, since the scene's start, are nan where nothing falls;
    `range_m` is nan too without a launch. `origin` (p, 2) is the place of the particle's track now.
    `reach` (p,) is the relative probability of an orbit, `flies` says whether the burn stays above
    the ground.
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
    space = particles.family == SPACE
    able = (particles.family == SPACE) | (particles.family == NONE)
    reach = np.zeros(len(particles))
    mine = np.flatnonzero(able & (particles.lit > 0))
    reach[mine] = outcomes.reaching(particles.state[mine], particles.take(mine))
    angle = _thrust_angles(particles)
    steering = _steered(_steering(outcomes.model), particles, angle)
    own = angle - np.where(particles.lit == 1, steering.leads(particles.since_s), 0.0)[:, None] * [
        1.0,
        0.0,
    ]
    tilt = _tilts()[:, :, particles.draw] + _DECAY[:, :, None, None] * np.clip(
        own, -_TILT_MOST, _TILT_MOST
    )
    # What falls of a space launcher has failed, at any time.
    flown = particles.cut_off(np.where(space, _SHARES[particles.draw], 1.0))
    out, later_s, least_m = flown_on(particles.state, flown, steering, tilt)
    place, when_s = free_impacts(out, time_s + later_s, forces)
    known = np.isfinite(launch[:, 0])
    start = np.where(known[:, None], launch, 0.0)[particles.track]
    range_m = np.where(known[particles.track], great_circle_m(start, place), np.nan)
    dark = able & (particles.lit == 0)
    reach[dark] = np.where(
        np.isfinite(when_s[dark]), 0.0, 1.0 / outcomes.model.data["marginal"]["orbit"]
    )
    flies = space | (least_m > local_radius_m(out) - _BELOW_M)
    out_s = time_s + later_s
    burnt = _at_burnout(out, out_s, particles, dark_s)
    return Fates(
        out, out_s, place, when_s, range_m, reach, flies, _below(particles, time_s), *burnt
    )


def _at_burnout(
    out: FloatArray, out_s: FloatArray, particles: Particles, dark_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return states and times at the ends of burns: of what is dark, back along its free flight."""
    ago = np.where(particles.lit == 0, np.maximum(dark_s[particles.track], 0.0), 0.0)
    rows = np.flatnonzero(ago > 0.0)
    state = out.copy()
    if len(rows):
        before = propagate_kepler(out[rows, :3], out[rows, 3:6], -ago[rows])
        state[rows, :6] = np.concatenate(before, axis=1)
    return state, out_s - ago


@cache
def _steering(model: VehicleModel) -> Steering:
    """Return the steering of all draws."""
    return drawn_steering(BURNING + OVER + AGAIN, model.data, 3)


@cache
def _tilts() -> FloatArray:
    """Return angles (STAGES, STEPS, draws, 2), rad: Gauss-Markov processes from step to step that
    begin at 0.
    """
    rng = np.random.default_rng(2)
    size = BURNING + OVER + AGAIN
    sigma = (TILT_RAD[0] * (TILT_RAD[1] / TILT_RAD[0]) ** rng.random(size))[:, None]
    noise = rng.normal(size=(STAGES * STEPS, size, 2))
    tilt = np.zeros_like(noise)
    for step in range(len(tilt)):
        tilt[step] = (
            _KEEP * (tilt[step - 1] if step else 0.0) + np.sqrt(1.0 - _KEEP * _KEEP) * noise[step]
        )
    angles: FloatArray = (tilt * sigma * [1.0, SIDEWARDS]).reshape(STAGES, STEPS, size, 2)
    return angles


def _thrust_angles(particles: Particles) -> FloatArray:
    """Return the angles (p, 2), rad, of the thrust from the velocity, downwards and sidewards; 0 in
    the dark or slow."""
    rows = np.flatnonzero(particles.lit == 1)
    angle = np.zeros((len(particles), 2))
    state = particles.state[rows]
    force = particles.force[rows]
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity) + 1.0)
    side = np.cross(velocity, state[:, :3])
    down = np.cross(velocity, side)
    ahead = np.maximum(dot(force, velocity) / speed, 1.0)
    parts = [dot(force, axis) / np.sqrt(dot(axis, axis) + 1.0) for axis in (down, side)]
    angle[rows] = np.arctan2(np.stack(parts, axis=1), ahead[:, None]) * (speed > _FAST_M_S)[:, None]
    return angle


def _steered(every: Steering, particles: Particles, angle: FloatArray) -> Steering:
    """Return the programs (p,) of particles: of some draws for each, one that fits the present
    angle of its thrust.
    """
    choice = (particles.draw[:, None] + _STRIDE * np.arange(CHOICES)) % len(every)
    leads = (
        every.take(choice.ravel())
        .leads(np.repeat(particles.since_s, CHOICES))
        .reshape(choice.shape)
    )
    sigma = _LEAD_RAD + _LEAD_SHARE * np.abs(leads)
    away = (angle[:, :1] - leads) / sigma
    weight = np.where((particles.lit == 1)[:, None], np.exp(-0.5 * away * away) / sigma + 1e-9, 1.0)
    total = np.cumsum(weight, axis=1)
    picked = np.sum(total < total[:, -1:] * _PICKS[particles.draw, None], axis=1).clip(
        0, CHOICES - 1
    )
    return every.take(choice[np.arange(len(choice)), picked])


def features(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heights m, flight-path angles rad and speeds m/s through the air of inertial states
    (p, 6).
    """
    radius = np.sqrt(dot(state[:, :3], state[:, :3]))
    velocity = air_velocity(state)
    speed = np.sqrt(dot(velocity, velocity))
    climb = dot(state[:, :3], velocity) / np.maximum(radius * speed, 1.0)
    return radius - local_radius_m(state), np.arcsin(np.clip(climb, -1.0, 1.0)), speed


def _below(particles: Particles, time_s: float) -> FloatArray:
    """Return the latitudes and longitudes (p, 2), rad, below the first particles of each one's
    track now.
    """
    first = np.searchsorted(particles.track, np.unique(particles.track))
    now = ecef_to_geodetic(earth_rotated(particles.state[first, :3], np.full(len(first), -time_s)))
    place = np.stack([now.latitude_rad, now.longitude_rad], axis=1)
    return place[np.cumsum(np.diff(particles.track, prepend=particles.track[:1]) > 0)]


def local_radius_m(state: FloatArray) -> FloatArray:
    """Return the radius (p,), m, of the ellipsoid below states (p, 6), to 50 m: a(1 - f sin² φ)."""
    sine = state[:, 2] / np.sqrt(dot(state[:, :3], state[:, :3]))
    radius: FloatArray = EARTH_EQUATORIAL_RADIUS_M * (1.0 - EARTH_FLATTENING * sine * sine)
    return radius


def free_impacts(
    state: FloatArray, time_s: FloatArray, forces: Forces, tolerance_m: float | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return latitudes and longitudes (p, 2), rad, and times (p,) of the impacts of free flights;
    nan without one.

    Without a tolerance, under the gravity of a point mass.
    """
    from opir_core.flight import impact

    if tolerance_m is None:
        flight, fell = impact(
            state[:, :3], state[:, 3:], forces=Forces(zonal=(), gravity=forces.gravity)
        )
    else:
        flight, fell = impact(state[:, :3], state[:, 3:], forces=forces, tolerance_m=tolerance_m)
    when = time_s + flight
    down = ecef_to_geodetic(earth_rotated(fell, -when))
    return np.stack([down.latitude_rad, down.longitude_rad], axis=1), when
