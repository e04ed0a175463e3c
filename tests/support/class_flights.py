"""Flights drawn from the family that `boost-profile` fits, and what geostationary sensors see of them."""

import numpy as np
from attrs import evolve
from opir_trackers.configs import BoostProfileConfig
from opir_trackers.profile import fit
from opir_trackers.profile import flight as profile_flight
from opir_trackers.profile.family import BURN, LIFT, PITCH, SHAPE, SIZE, SPEED, TURN_EAST, TURN_NORTH, fitted, priors_of
from opir_trackers.profile.rows import axes_about
from opir_trackers.profile.strain import OffModelFilters
from opir_trackers.sensors import SensorSchedule

from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.scene.scene import TARGET_TYPES

GEO_M = 4.2164e7
SLOTS_RAD = (-0.4, 0.6)

PRIORS = priors_of(BoostProfileConfig().priors)


def watch_of(sensors, period_s=0.25, chance=0.7, bias_sigma_rad=0.0):
    """Return like sensors."""
    return SensorSchedule(
        np.full(sensors, period_s),
        np.full((sensors, len(TARGET_TYPES)), chance),
        np.full(sensors, bias_sigma_rad),
        np.zeros(sensors, dtype=np.bool_),
    )


def flights(kind, count, seed):
    """Return flights of a type as hypotheses that are true: draws from the type's prior that come down again."""
    drawn = _drawn(np.random.default_rng(seed), TARGET_TYPES.index(kind), 2 * count)
    nothing = np.zeros((len(drawn), SIZE, SIZE))
    ends, slope = profile_flight.burnouts(fit.family_of(drawn, PRIORS), nothing)
    landed = profile_flight.impacts(ends, slope, nothing, "kepler").mean
    kept = np.flatnonzero(np.isfinite(landed).all(axis=1))[:count]
    return evolve(drawn.take(kept), track=np.arange(len(kept)))


def _drawn(rng, number, count):
    prior, truth = PRIORS.take(np.full(count, number)), fit.blank(count, 2)
    x = truth.parameters
    turn, azimuth = prior.turn_rad + prior.turn_sigma_rad * rng.normal(size=count), rng.uniform(0.0, 6.28, count)
    x[:, TURN_EAST], x[:, TURN_NORTH] = turn * np.sin(azimuth), turn * np.cos(azimuth)
    for column, sigma in (
        (SPEED, prior.speed_sigma),
        (BURN, prior.burn_sigma),
        (SHAPE, prior.shape_sigma),
        (PITCH, prior.pitch_sigma),
        (LIFT, prior.lift_sigma),
    ):
        x[:, column] = sigma * rng.normal(size=count)
    return evolve(
        truth,
        parameters=fitted(x, prior),
        kind=np.full(count, number),
        anchor_latitude_rad=rng.uniform(0.5, 0.8, count),
        anchor_longitude_rad=rng.uniform(-0.1, 0.1, count),
        anchor_s=np.full(count, 5.0),
        is_bent=np.ones(count, dtype=np.int64),
    )


def hidden(truth, seed):
    """Return how long (n,) flights are hidden at first, s: draws from their types' prior."""
    return PRIORS.hidden_s[truth.kind] * np.abs(np.random.default_rng(2000 + seed).normal(size=len(truth)))


def lines_of_sight(truth, sigma_rad, seed, *, sensors=2, period_s=0.25, chance=0.7, biases_rad=0.0, hidden_s=0.0):
    """Return tracks and rays, by time, of like sensors whose biases are drawn for each flight.

    Nothing is seen of a flight for the first `hidden_s` (n,), or for all alike: clouds.
    """
    rng = np.random.default_rng(1000 + seed)
    family = fit.family_of(truth, PRIORS)
    count, parts, tracks = len(truth), [], []
    clear_s = family.start_s + hidden_s
    looks = period_s * np.arange(1, int(family.burnout_s.max() / period_s) + 4)
    for sensor, slot in enumerate(SLOTS_RAD[:sensors]):
        origin = GEO_M * np.array([np.cos(slot), np.sin(slot), 0.0])
        bias = biases_rad * rng.normal(size=(count, 2))
        track, time_s = np.repeat(np.arange(count), len(looks)), np.tile(looks, count)
        seen = rng.random(len(track)) < chance
        track, time_s = track[seen], time_s[seen]
        left_s = time_s - 0.125
        for _ in range(3):
            held = np.clip(left_s, family.start_s[track], family.burnout_s[track])
            line = _position(family, track, held) - origin
            left_s = time_s - np.linalg.norm(line, axis=1) / SPEED_OF_LIGHT_M_S
        seen = (left_s > clear_s[track]) & (left_s < family.burnout_s[track])
        track, time_s, line = track[seen], time_s[seen], line[seen]
        rays = LinesOfSight(
            time_s,
            np.full(len(track), sensor, dtype=np.int32),
            np.round(time_s / period_s).astype(np.int64),
            np.tile(origin, (len(track), 1)),
            line / np.linalg.norm(line, axis=1)[:, None],
            np.full(len(track), sigma_rad),
        )
        parts.append(_turned(rays, bias[track] + sigma_rad * rng.normal(size=(len(track), 2))))
        tracks.append(track)
    every, whose = LinesOfSight.concatenate(parts), np.concatenate(tracks)
    order = np.lexsort((whose, every.sensor, every.time_s))
    return whose[order], every.take(order)


def _position(family, track, time_s):
    """Return positions (n, 3), in pieces that stay in memory's reach."""
    cuts = range(0, len(track), 20_000)
    parts = [family.places(track[cut : cut + 20_000], time_s[cut : cut + 20_000]).position_m for cut in cuts]
    return np.concatenate(parts)


def _turned(rays, stray):
    axes = axes_about(rays)
    turned = rays.direction_ecef + stray[:, :1] * axes[:, 0] + stray[:, 1:] * axes[:, 1]
    return evolve(rays, direction_ecef=turned / np.linalg.norm(turned, axis=1)[:, None])


def bank_after(fitting, track, rays, ticks):
    """Return the bank of a fit after so many ticks, a second each, of rays (m,) by time, given to tracks (m,)."""
    bank, cut = OffModelFilters.empty(len(fitting.watch.period_s)), 0
    for tick in range(1, ticks + 1):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        cut = end
    return bank
