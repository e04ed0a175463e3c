"""Ascents that share no code with opir: launchers with throttle, dark gaps and burns against the
motion, and missiles.

Notional point masses over a sphere that rotates, integrated by RK4, all flights at once. First
stages rise, pitch over and follow their velocity, with a throttle bucket, a limit of acceleration
and a tail-off; second stages of 6 to 12 m/s² burn for minutes, steered to a height; a stage that
flies back burns against its horizontal motion.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from drawn_flights import ROWS, Flown

from opir_core.geometry import geodetic_to_ecef, local_axes

MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, 7.292115e-5])
STEP_S = 0.1


class Plan(NamedTuple):
    """Burns of flights (n, k): begin, end, s, first acceleration, m/s², growth; steering ("rise",
    "orbit" or "back").

    `bucket` (n, 3): begin, end, s, and depth of the throttle bucket; `limit` (n,) of acceleration,
    m/s²; `tail_s` (n,) in which thrust falls before the first cut-off; `kick` (n,), rad, of the
    pitch-over; `height_m` (n,) steered to.
    """

    begin_s: np.ndarray
    end_s: np.ndarray
    first: np.ndarray
    growth: np.ndarray
    steering: tuple[str, ...]
    bucket: np.ndarray
    limit: np.ndarray
    tail_s: np.ndarray
    kick: np.ndarray
    height_m: np.ndarray


class _Stages(NamedTuple):
    """Burn times and gaps, s, accelerations at ignition, m/s², their growth, and steering."""

    burn_s: np.ndarray
    gap_s: np.ndarray
    first: np.ndarray
    growth: np.ndarray
    steering: tuple[str, ...]


def _launcher_stages(kind, drawn):
    back = kind == "boostback"
    burn_s = [drawn(125.0, 175.0), drawn(30.0, 60.0) if back else drawn(300.0, 480.0)]
    gap_s = drawn(14.0, 28.0) if back else drawn(5.0, 15.0)
    first = [drawn(12.5, 16.0), drawn(15.0, 35.0) if back else drawn(6.5, 11.0)]
    growth = [drawn(2.4, 3.4), drawn(1.1, 1.5) if back else drawn(3.5, 6.0)]
    columns = (np.stack(column, axis=1) for column in (burn_s, [gap_s], first, growth))
    return _Stages(*columns, ("rise", "back" if back else "orbit"))


def _missile_stages(kind, drawn):
    stages = 3 if kind == "three" else 2
    burn_s = drawn(45.0, 75.0, stages)
    first = drawn(14.0, 26.0, stages)
    growth = drawn(1.8, 4.0, stages)
    gap_s = drawn(*((2.0, 12.0) if kind == "three" else (22.0, 40.0)), stages - 1)
    return _Stages(burn_s, gap_s, first, growth, ("rise",) + ("along",) * (stages - 1))


def plans(kind, count, rng):
    """Return plans of "orbit", "boostback", "long gap" (22 to 40 s) or "three" stages with gaps of
    2 to 40 s.
    """

    def drawn(low, high, *shape):
        return rng.uniform(low, high, (count, *shape))

    launcher = kind in ("orbit", "boostback")
    stages = (_launcher_stages if launcher else _missile_stages)(kind, drawn)
    burn = np.round(stages.burn_s, 1)
    dark = burn[:, :-1] + np.round(stages.gap_s, 1)
    begin = np.concatenate([np.zeros((count, 1)), np.cumsum(dark, axis=1)], axis=1)
    start = drawn(45.0, 55.0)
    depth = start + drawn(10.0, 30.0), np.where(launcher, drawn(0.0, 0.35), 0.0)
    return Plan(
        begin,
        begin + burn,
        stages.first,
        stages.growth,
        stages.steering,
        np.stack([start, *depth], axis=1),
        np.where(launcher & (rng.random(count) < 0.5), drawn(28.0, 38.0), 1e3),
        np.where(rng.random(count) < 0.5, drawn(0.2, 3.0), 0.0) if launcher else np.zeros(count),
        np.radians(np.exp(drawn(*np.log([0.3, 6.0]))) if launcher else drawn(6.0, 20.0)),
        drawn(180e3, 500e3),
    )


#: Plans per flight, of which those that fly as meant are taken; and where: heights at the first
#: cut-off, m.
_PLANS = 12
_FIRST_CUT_M = {"orbit": (45e3, 110e3), "boostback": (45e3, 90e3), "long gap": (15e3, 120e3)}


def ascents(kind, count, seed):
    """Return drawn ascents, far from each other, and the times of their burns since the scene's
    start, (n, k, 2), s.
    """
    rng = np.random.default_rng([11, seed])
    launch, axes, azimuth = (np.repeat(column, _PLANS, axis=0) for column in _launches(count, rng))
    plan = plans(kind, len(launch), rng)
    start_s = rng.uniform(3.0, 6.0, len(launch))
    end_s = plan.end_s[:, -1]
    forward = np.sin(azimuth) * axes[:, 0] + np.cos(azimuth) * axes[:, 1]
    position, velocity = _flown(plan, launch, axes[:, 2], forward, end_s)
    height = np.linalg.norm(position, axis=2) - np.linalg.norm(launch, axis=1)[:, None]
    last_m_s = np.linalg.norm(velocity[:, -1], axis=1)
    is_sound = _is_sound(kind, height, plan.end_s[:, 0] / end_s) & (last_m_s < 8300.0)
    rows = np.flatnonzero(is_sound.reshape(count, -1).any(axis=1)) * _PLANS
    rows += is_sound.reshape(count, -1).argmax(axis=1)[rows // _PLANS]
    dark = np.ones((len(launch), 2, 2))
    edges = np.stack([plan.end_s[:, :-1], plan.begin_s[:, 1:]], axis=2) / end_s[:, None, None]
    dark[:, : edges.shape[1]] = edges
    burns = np.stack([plan.begin_s, plan.end_s], axis=2) + start_s[:, None, None]
    return Flown(start_s, end_s, position, velocity, dark).take(rows), burns[rows]


def _is_sound(kind, height, share):
    """Whether ascents (n,), cut off first after a share of their time, fly as meant."""
    cut = height[np.arange(len(height)), (share * (ROWS - 1)).astype(np.int64)]
    low, high = _FIRST_CUT_M.get(kind, (10e3, 80e3))
    is_meant = (cut > low) & (cut < high) & (height[:, -1] > cut)
    return is_meant & (height.min(axis=1) > -1.0)


def _launches(count, rng):
    columns = int(np.ceil(np.sqrt(0.6 * count)))
    cell = np.arange(count)
    rows = int(np.ceil(count / columns))
    jitter = rng.uniform(-0.2, 0.2, (2, count))
    latitude = -0.75 + 1.5 * ((cell // columns + 0.5 + jitter[0]) / rows)
    longitude = -0.2 + 0.6 * ((cell % columns + 0.5 + jitter[1]) / columns)
    launch = geodetic_to_ecef(latitude, longitude, 0.0)
    return launch, local_axes(launch), rng.uniform(0.0, 2.0 * np.pi, count)[:, None]


def _flown(plan, launch, up, forward, last_s):
    """Return ECEF positions and velocities (n, ROWS, 3), evenly over the time to the last
    cut-off.
    """
    count = len(launch)
    steps = int(np.ceil(last_s.max() / STEP_S)) + 1
    state = np.concatenate([launch, 1e-3 * up], axis=1)
    states = np.empty((steps + 1, count, 6))
    for step in range(steps + 1):
        states[step] = state
        # The force of the step is that of its middle: burns end at whole steps.
        rates = partial(_rates, plan, launch, up, forward, (step + 0.5) * STEP_S)
        k1 = rates(state, state)
        two = rates(state + 0.5 * STEP_S * k1, state)
        three = rates(state + 0.5 * STEP_S * two, state)
        four = rates(state + STEP_S * three, state)
        state = state + STEP_S / 6.0 * (k1 + 2.0 * two + 2.0 * three + four)
    time_s = last_s[:, None] * np.linspace(0.0, 1.0, ROWS)
    low = np.minimum((time_s / STEP_S).astype(np.int64), steps - 1)
    s = (time_s / STEP_S - low)[..., None]
    row = np.arange(count)[:, None]
    p, q, v, w = (
        states[low + k, row][..., axes] for axes in (slice(3), slice(3, 6)) for k in (0, 1)
    )
    place = (1 + 2 * s) * (1 - s) ** 2 * p + s**2 * (3 - 2 * s) * q
    place += STEP_S * (s * (1 - s) ** 2 * v - s**2 * (1 - s) * w)
    return place, (1 - s) * v + s * w


def _rates(plan, launch, up, forward, time_s, state, previous):
    size, stage = _thrust(plan, time_s)
    unit = _direction(plan, launch, up, forward, time_s, size, stage, previous)
    place = state[:, :3]
    velocity = state[:, 3:]
    radius = np.linalg.norm(place, axis=1, keepdims=True)
    air = 2e-6 * np.exp(-np.linalg.norm(place - launch, axis=1, keepdims=True) / 7200.0)
    drag = -air * np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
    turning = -2.0 * np.cross(SPIN, velocity) - np.cross(SPIN, np.cross(SPIN, place))
    hold = (time_s < 5.0) & (size[:, None] == 0.0)
    push = -MU / radius**3 * place + turning + drag + size[:, None] * unit
    return np.concatenate([velocity, np.where(hold, 0.0, push)], axis=1)


def _thrust(plan, time_s):
    """Return accelerations (n,) and the number of the stage that burns."""
    size = np.zeros(len(plan.limit))
    stage = np.zeros(len(plan.limit), dtype=np.int64)
    for k in range(plan.begin_s.shape[1]):
        share = (time_s - plan.begin_s[:, k]) / (plan.end_s[:, k] - plan.begin_s[:, k])
        burns = (share >= 0.0) & (share < 1.0)
        rows = plan.first[:, k] / (1.0 - (1.0 - 1.0 / plan.growth[:, k]) * np.clip(share, 0.0, 1.0))
        if k == 0:
            low, high, depth = plan.bucket.T
            rows = np.minimum(
                rows * np.where((time_s > low) & (time_s < high), 1.0 - depth, 1.0), plan.limit
            )
            remaining_s = plan.end_s[:, 0] - time_s
            rows = rows * np.where(
                remaining_s < plan.tail_s,
                0.4 + 0.6 * remaining_s / np.maximum(plan.tail_s, 1e-9),
                1.0,
            )
        size = np.where(burns, rows, size)
        stage = np.where(burns, k, stage)
    return size, stage


def _direction(plan, launch, up, forward, time_s, size, stage, state):
    speed = np.linalg.norm(state[:, 3:], axis=1, keepdims=True)
    unit = np.where(time_s < 8.0, up, state[:, 3:] / speed)
    if 8.0 <= time_s < 18.0:
        lead = (plan.kick * np.sin(np.pi * (time_s - 8.0) / 10.0) ** 2)[:, None]
        unit = np.cos(lead) * unit + np.sin(lead) * forward
    position = state[:, :3] / np.linalg.norm(state[:, :3], axis=1, keepdims=True)
    climb = np.sum(position * state[:, 3:], axis=1)
    flat = state[:, 3:] - climb[:, None] * position
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    for k, steering in enumerate(plan.steering):
        if steering in ("orbit", "back"):
            lift = (
                _lift(plan, launch, state, climb, time_s, size, k)
                if steering == "orbit"
                else -0.05 * np.ones(1)
            )
            side = np.sqrt(1.0 - lift**2)[:, None] * (1.0 if steering == "orbit" else -1.0)
            unit = np.where(
                (stage == k)[:, None] & (time_s > 30.0),
                lift[:, None] * position + side * flat,
                unit,
            )
    return unit / np.linalg.norm(unit, axis=1, keepdims=True)


def _lift(plan, launch, state, climb, time_s, size, stage):
    """Return the sine of the pitch that leads to the height and level flight at the end of a
    stage.
    """
    remaining_s = np.maximum(plan.end_s[:, stage] - time_s, 30.0)
    radius = np.linalg.norm(state[:, :3], axis=1)
    inertial = state[:, 3:] + np.cross(SPIN, state[:, :3])
    round_ = np.sum(inertial**2, axis=1) - climb**2
    height = radius - np.linalg.norm(launch, axis=1)
    expected = (
        6.0 * (plan.height_m - height) / remaining_s**2
        - 4.0 * climb / remaining_s
        + MU / radius**2
        - round_ / radius
    )
    return np.clip(expected / np.maximum(size, 1.0), -0.6, 0.6)
