"""Boosts of the tracking set: guided ascents with drag, integrated here in steps of Runge and
Kutta.

Point masses of notional parameters: constant thrust and mass flow, so thrust over mass grows
through a stage; a vertical rise, a pitch-over, then thrust along the velocity relative to the
rotating Earth, in upper stages off it by a constant angle of steering; an exponential atmosphere,
central gravity, WGS 84. Nothing of opir is used.
"""

from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import yaml
from foreign_flights import FLATTENING, MU, PITCH_OVER_S, RADIUS_M, SPIN

STEP_S = 0.5
SEA_LEVEL_KG_M3 = 1.225
SCALE_HEIGHT_M = 7500.0

#: Laws of the parameters and limits of the flights, with their units.
LAWS = yaml.safe_load(Path(__file__).with_name("flight_laws.yaml").read_text(encoding="utf-8"))

#: Columns of a flight's parameters before those of its stages.
PLACE = 7


class Paths(NamedTuple):
    """Flights (f,): times (f, k) of steps, s, and ECEF states (f, k, 6), m and m/s relative to the
    Earth.
    """

    time_s: np.ndarray
    state: np.ndarray

    def states(self, time_s):
        """Return the states (f, n, 6) at times (n,): cubic Hermite interpolation of position and
        its slope.
        """
        return np.array(
            [_interpolated(*row, time_s) for row in zip(self.time_s, self.state, strict=True)]
        )


def _interpolated(times, states, time_s):
    at = np.clip(np.searchsorted(times, time_s, side="right") - 1, 0, len(times) - 2)
    step = np.maximum(times[at + 1] - times[at], 1e-9)[:, None]
    share = (time_s[:, None] - times[at, None]) / step
    one = states[at]
    two = states[at + 1]
    gap = two[:, :3] - one[:, :3]
    left = one[:, 3:] * step - gap
    right = gap - two[:, 3:] * step
    bend = (1.0 - share) * left + share * right
    place = one[:, :3] + share * gap + share * (1.0 - share) * bend
    rate = gap + (1.0 - 2.0 * share) * bend + share * (1.0 - share) * (right - left)
    return np.concatenate([place, rate / step], axis=1)


class Leg(NamedTuple):
    """Part of flights (f,) between two times; in the dark `first` is 0. `steer` and the pitch-over
    are angles, rad.
    """

    start_s: np.ndarray
    end_s: np.ndarray
    ignition_s: np.ndarray
    burn_s: np.ndarray
    first: np.ndarray
    growth: np.ndarray
    steer: np.ndarray
    is_rising: bool
    is_turning: bool


def width(stages, has_gaps):
    """Return the number of parameters of a flight."""
    return PLACE + 3 * stages + (stages - 1) * (1 + has_gaps)


def drawn_vehicle(stages, has_gaps, rng):
    """Return drawn parameters (p,) of a flight from latitude, longitude, azimuth and ignition 0."""
    later = stages - 1
    parts = [
        np.zeros(4),
        rng.uniform(*LAWS["rise_s"], 1),
        rng.uniform(*LAWS["kick_rad"], 1),
        rng.uniform(*LAWS["drag_m2_kg"], 1),
        rng.uniform(*LAWS["burn_s"][stages], stages),
        rng.uniform(*LAWS["first_m_s2"], 1),
        rng.uniform(*LAWS["later_m_s2"], later),
        rng.uniform(*LAWS["growth"], stages),
        rng.uniform(*LAWS["steer_rad"], later),
        rng.uniform(*LAWS["gap_s"], later if has_gaps else 0),
    ]
    return np.concatenate(parts)


def prior_sigma(stages, has_gaps):
    """Return the standard deviations (p,) of the laws of parameters; launch and ignition are as
    good as unknown.
    """
    later = stages - 1
    names = ["rise_s", "kick_rad", "drag_m2_kg"]
    laws = [(-0.2, 0.2), (-0.2, 0.2), (-np.pi, np.pi), (-1e3, 1e3), *(LAWS[name] for name in names)]
    laws += [LAWS["burn_s"][stages]] * stages
    laws += [LAWS["first_m_s2"]] + [LAWS["later_m_s2"]] * later + [LAWS["growth"]] * stages
    laws += [LAWS["steer_rad"]] * later + [LAWS["gap_s"]] * (later if has_gaps else 0)
    return np.array([high - low for low, high in laws]) / np.sqrt(12.0)


def burns(row, stages):
    """Return the starts and ends (stages, 2) of a flight's burns, s."""
    burn = row[PLACE : PLACE + stages]
    gap = row[PLACE + 4 * stages - 1 :] if len(row) > width(stages, False) else np.zeros(stages - 1)
    end = row[3] + np.cumsum(burn + np.append(0.0, gap))
    return np.stack([end - burn, end], axis=1)


def ecef(latitude, longitude):
    """Return the ECEF positions (f, 3) of points (f,) on WGS 84."""
    squared = FLATTENING * (2.0 - FLATTENING)
    normal = RADIUS_M / np.sqrt(1.0 - squared * np.sin(latitude) ** 2)
    flat = normal * np.cos(latitude)
    high = normal * (1.0 - squared) * np.sin(latitude)
    return np.stack([flat * np.cos(longitude), flat * np.sin(longitude), high], axis=1)


def directions(latitude, longitude, azimuth):
    """Return up (f, 3), and the horizontal directions (f, 3) of azimuths, at points (f,)."""
    level = np.cos(latitude)
    up = np.stack([level * np.cos(longitude), level * np.sin(longitude), np.sin(latitude)], axis=1)
    east = np.stack([-np.sin(longitude), np.cos(longitude), np.zeros_like(longitude)], axis=1)
    north = np.cross(up, east)
    return up, np.sin(azimuth)[:, None] * east + np.cos(azimuth)[:, None] * north


def flown(rows, stages, until_s, step_s=STEP_S):
    """Return flights with parameters (f, p), up to a time after their last burnouts, in steps of at
    most `step_s`.
    """
    up, forward = directions(rows[:, 0], rows[:, 1], rows[:, 2])
    state = np.concatenate([ecef(rows[:, 0], rows[:, 1]), np.zeros((len(rows), 3))], axis=1)
    times = [rows[:, 3]]
    states = [state]
    for leg in _legs(rows, stages, until_s):
        count = max(1, int(np.ceil(np.max(leg.end_s - leg.start_s) / step_s)))
        step = (leg.end_s - leg.start_s) / count
        for number in range(count):
            now = leg.start_s + step * number
            states.append(_stepped(now, step, states[-1], leg, rows, up, forward))
            times.append(now + step)
    return Paths(np.array(times).T, np.array(states).transpose(1, 0, 2))


def _legs(rows, stages, until_s):
    """Yield the legs of flights: rise, pitch-over, the rest of the burns, the dark times and the
    free flight.
    """
    parts = np.split(rows[:, PLACE:], np.cumsum([stages, stages, stages, stages - 1]), axis=1)
    burn, first, growth, later_steer, gap = parts
    steer = np.concatenate([np.zeros((len(rows), 1)), later_steer], axis=1)
    none = np.zeros(len(rows))
    start = rows[:, 3]
    for stage in range(stages):
        end = start + burn[:, stage]
        thrust = (start, burn[:, stage], first[:, stage], growth[:, stage], steer[:, stage])
        rise = rows[:, 3] + rows[:, 4]
        edges = [start, end] if stage else [start, rise, rise + PITCH_OVER_S, end]
        for number, (one, two) in enumerate(pairwise(edges)):
            yield Leg(one, two, *thrust, not stage and number == 0, not stage and number == 1)
        start = end
        if stage < stages - 1 and gap.shape[1]:
            start = end + gap[:, stage]
            yield Leg(end, start, *thrust[:2], none, *thrust[3:], False, False)
    if np.any(start < until_s):
        yield Leg(start, np.full(len(rows), until_s), *thrust[:2], none, *thrust[3:], False, False)


def _stepped(
    now,
    step,
    state,
    leg,
    rows,
    up,
    forward,
):
    """Return states (f, 6) one step later, by the classical method of Runge and Kutta."""
    long = step[:, None]
    k1 = rates(now, state, leg, rows, up, forward)
    k2 = rates(now + 0.5 * step, state + 0.5 * long * k1, leg, rows, up, forward)
    k3 = rates(now + 0.5 * step, state + 0.5 * long * k2, leg, rows, up, forward)
    k4 = rates(now + step, state + long * k3, leg, rows, up, forward)
    return state + long / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def rates(
    now,
    state,
    leg,
    rows,
    up,
    forward,
):
    """Return the rates (f, 6) of states (f, 6) in the rotating frame."""
    place = state[:, :3]
    speed = state[:, 3:]
    x, y, z = place.T
    u, v, _ = speed.T
    radius = np.sqrt(np.sum(place * place, axis=1))
    turning = np.stack(
        [2.0 * SPIN * v + SPIN**2 * x, SPIN**2 * y - 2.0 * SPIN * u, np.zeros(len(state))], axis=1
    )
    height = radius - RADIUS_M * (1.0 - FLATTENING * (z / radius) ** 2)
    pace = np.sqrt(np.sum(speed * speed, axis=1))
    drag = (
        0.5
        * SEA_LEVEL_KG_M3
        * np.exp(-np.maximum(height, 0.0) / SCALE_HEIGHT_M)
        * rows[:, 6]
        * pace
    )
    size = leg.first / (
        1.0 - (1.0 - 1.0 / leg.growth) * np.clip((now - leg.ignition_s) / leg.burn_s, 0.0, 1.0)
    )
    pull = turning - MU * place / radius[:, None] ** 3 - drag[:, None] * speed
    pull += size[:, None] * _thrust_axis(
        now, place / radius[:, None], speed, pace, leg, rows, up, forward
    )
    return np.concatenate([speed, pull], axis=1)


def _thrust_axis(
    now,
    outward,
    speed,
    pace,
    leg,
    rows,
    up,
    forward,
):
    """Return the unit vectors (f, 3) of thrust."""
    if leg.is_rising:
        return up
    axis = speed / np.maximum(pace, 1e-9)[:, None]
    if leg.is_turning:
        over = np.clip((now - rows[:, 3] - rows[:, 4]) / PITCH_OVER_S, 0.0, 1.0)
        lead = (rows[:, 5] * np.sin(np.pi * over) ** 2)[:, None]
        turned = np.cos(lead) * axis + np.sin(lead) * forward
        return turned / np.sqrt(np.sum(turned * turned, axis=1, keepdims=True))
    # Across the velocity, in its vertical plane, upward.
    lift = outward - np.sum(outward * axis, axis=1, keepdims=True) * axis
    lift /= np.maximum(np.sqrt(np.sum(lift * lift, axis=1, keepdims=True)), 1e-9)
    return np.cos(leg.steer)[:, None] * axis + np.sin(leg.steer)[:, None] * lift


def is_fit(row, stages):
    """Return whether a flight stays above the ground while it burns, and what it is at its last
    burnout.
    """
    end_s = float(burns(row, stages)[-1, 1])
    if end_s - row[3] > LAWS["most_burn_s"]:
        return False
    state = flown(row[None], stages, end_s).state[0]
    radius = np.sqrt(np.sum(state[:, :3] ** 2, axis=1))
    height = radius - RADIUS_M * (1.0 - FLATTENING * (state[:, 2] / radius) ** 2)
    speed = np.sqrt(np.sum(state[-1, 3:] ** 2))
    climb = np.arcsin(np.sum(state[-1, :3] * state[-1, 3:]) / (radius[-1] * speed))
    return bool(
        height.min() > -30.0
        and height[-1] > LAWS["least_height_m"]
        and climb > LAWS["least_climb_rad"]
        and speed < LAWS["most_speed_m_s"]
    )
