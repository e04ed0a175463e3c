"""Boosts of the tracker's prior: staged gravity turns over a round Earth, drawn once, in columns.

The prior is data of the tracker (`boost_priors.json`), wider than the target models' presets, and shares nothing with
them. A boost is up to four burns with dark gaps; thrust and mass flow of a stage are constant, so its acceleration is
A / (1 - c s) after s seconds (the rocket equation). The thrust is vertical first, then leads the velocity by a sine
squared (pitch-over), then lies along it but for a slow sine (steering). The last burn may be cut off early. Each boost
is flown in a plane without rotation or drag; what the rotation of the Earth does to it is far less than the prior
leaves open.
"""

import json
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2 as MU_M3_S2
from opir_core.interfaces import Columns
from opir_core.plugin import TARGET_TYPES

#: Largest number of burns.
STAGES = 4

#: Time between the instants at which a boost is compared with tracks, s.
STEP_S = 2.0


#: Parts of the ideal speeds of which the prior has as many boosts each.
_PARTS = 20


@frozen(eq=False, repr=False)
class BoostPrograms(Columns):
    """What the thrust of boosts (n,) does.

    Burn times, first accelerations, growths c and dark gaps after each stage are (n, STAGES), 0 where there is no
    stage; c is 1/s. The thrust is vertical for `rise_s`, leads the velocity by up to `lead_rad` over the next `over_s`,
    and by `steer_rad` sin(`steer_rate` t + `steer_phase`) throughout.
    """

    burn_s: FloatArray
    acceleration_m_s2: FloatArray
    growth_per_s: FloatArray
    gap_s: FloatArray
    rise_s: FloatArray
    over_s: FloatArray
    lead_rad: FloatArray
    steer_rad: FloatArray
    steer_rate: FloatArray
    steer_phase: FloatArray

    @property
    def starts_s(self) -> FloatArray:
        """Return the ignition times (n, STAGES) of the stages since the first."""
        length = self.burn_s + self.gap_s
        starts: FloatArray = np.cumsum(length, axis=1) - length
        return starts

    def leads(self, time_s: FloatArray) -> FloatArray:
        """Return the angles (...), rad, by which the thrust leads the velocity downwards, at times since ignition."""
        part = np.clip((time_s - self.rise_s) / self.over_s, 0.0, 1.0)
        steer = self.steer_rad * np.sin(self.steer_rate * time_s + self.steer_phase)
        lead: FloatArray = self.lead_rad * np.sin(np.pi * part) ** 2 + np.where(part > 0.0, steer, 0.0)
        return lead


@frozen(eq=False)
class PriorBoosts:
    """Boosts (n,) of the prior, and what they look like at instants (m,), in order of time since ignition.

    `log_weight` (n,) makes all target classes equally probable. At an instant: the boost, the time since its ignition,
    the stage, and features (m, 4): height m, speed m/s, flight-path angle rad, specific force m/s². `ends` are the
    instants at which stages burn out. `range_m` (n,) is the range of a boost, `class_code` (n,) its class by range.
    """

    programs: BoostPrograms
    range_m: FloatArray
    class_code: IntArray
    log_weight: FloatArray
    boost: IntArray
    time_s: FloatArray
    stage: IntArray
    features: FloatArray
    ends: "Instants"


@frozen(eq=False)
class Instants:
    """Instants (m,) of boosts: the boost, the time since its ignition, the stage and the features, as `PriorBoosts`."""

    boost: IntArray
    time_s: FloatArray
    stage: IntArray
    features: FloatArray


@cache
def priors() -> dict[str, Any]:
    """Return the ranges from which boosts are drawn."""
    found: dict[str, Any] = json.loads(files("opir_trackers").joinpath("boost_priors.json").read_text("utf-8"))
    return found


def longest_gap_s() -> float:
    """Return the longest dark gap between two burns, s."""
    longest: float = priors()["gap_s"][1]
    return longest


@cache
def prior_boosts() -> PriorBoosts:
    """Return the boosts of the prior, drawn with a fixed seed."""
    ranges = priors()
    rng = np.random.default_rng(ranges["seed"])
    programs = _drawn(rng, ranges, ranges["draws"])
    (least, most), highest = ranges["acceleration_m_s2"], ranges["highest_m_s2"]
    final = programs.acceleration_m_s2 / (1.0 - programs.growth_per_s * programs.burn_s)
    able = (programs.burn_s == 0.0) | ((programs.acceleration_m_s2 < most) & (final < highest))
    able[:, 0] &= programs.acceleration_m_s2[:, 0] > least
    programs = _evenly(programs.take(able.all(axis=1)), ranges["ideal_speed_m_s"], ranges["boosts"])
    instants, ends, range_m, is_flight = _flown(programs, ranges)
    kept = np.flatnonzero(is_flight)
    place = np.full(len(is_flight), -1)
    place[kept] = np.arange(len(kept))
    code = class_codes(range_m[kept])
    # As many of each octave of range: no class, and no range within one, is more probable than others.
    edges = np.geomspace(5e4, 1.7e7, 17)
    octave = np.clip(np.searchsorted(edges, range_m[kept]), 1, len(edges) - 1)
    share = np.bincount(octave, minlength=len(edges))[octave]
    return PriorBoosts(
        programs.take(kept),
        range_m[kept],
        code,
        -np.log(share),
        *_renumbered(instants, place),
        Instants(*_renumbered(ends, place)),
    )


def _evenly(programs: BoostPrograms, limits: tuple[float, float], count: int) -> BoostPrograms:
    """Return about `count` programs, as many of each part of the ideal speeds: limits of acceleration rule out many."""
    growth = np.maximum(programs.growth_per_s, 1e-9)
    ideal_m_s = np.sum(programs.acceleration_m_s2 * -np.log1p(-growth * programs.burn_s) / growth, axis=1)
    edges = np.linspace(*limits, _PARTS + 1)
    part = np.searchsorted(edges, ideal_m_s)
    order = np.argsort(part, kind="stable")
    rank = np.arange(len(part)) - np.searchsorted(part[order], part[order])
    return programs.take(order[rank < count // _PARTS])


def class_codes(range_m: FloatArray) -> IntArray:
    """Return codes (n,) into `TARGET_TYPES` of ranges (n,)."""
    least = priors()["least_ranges_km"]
    order = np.array([TARGET_TYPES.index(name) for name in least])
    codes: IntArray = order[np.searchsorted(1e3 * np.array(list(least.values())[1:]), range_m, side="right")]
    return codes


def _renumbered(instants: "Instants", place: IntArray) -> tuple[IntArray, FloatArray, IntArray, FloatArray]:
    number = place[instants.boost]
    rows = np.flatnonzero(number >= 0)
    rows = rows[np.argsort(instants.time_s[rows], kind="stable")]
    return number[rows], instants.time_s[rows], instants.stage[rows], instants.features[rows]


def _drawn(rng: np.random.Generator, ranges: dict[str, Any], count: int) -> BoostPrograms:
    """Return random programs."""

    def uniform(name: str, *shape: int) -> FloatArray:
        low, high = ranges[name]
        return rng.uniform(low, high, (count, *shape))

    def log_uniform(name: str, *shape: int) -> FloatArray:
        low, high = np.log(ranges[name])
        return np.exp(rng.uniform(low, high, (count, *shape)))

    stages = rng.choice(STAGES, count, p=ranges["stages"]) + 1
    used = np.arange(STAGES) < stages[:, None]
    burn = np.where(used, log_uniform("burn_s", STAGES) / np.sqrt(stages)[:, None], 0.0)
    ratio = log_uniform("growth", STAGES)
    growth = np.where(used, (1.0 - 1.0 / ratio) / np.maximum(burn, 1.0), 0.0)
    share = np.where(used, rng.uniform(0.5, 1.5, (count, STAGES)), 0.0)
    gained = uniform("ideal_speed_m_s")[:, None] * share / share.sum(axis=1, keepdims=True)
    # The integral of A / (1 - c s) over a burn is A ln(ratio) / c.
    first = np.where(used, gained * growth / np.log(ratio), 0.0)
    last = np.arange(STAGES) == stages[:, None] - 1
    cut = rng.random(count) < ranges["cut_off_probability"]
    burn = burn * np.where(last & cut[:, None], uniform("cut_off_share", 1), 1.0)
    hot = rng.random((count, STAGES)) < ranges["no_gap_probability"]
    gap = np.where(used & ~last & ~hot, uniform("gap_s", STAGES), 0.0)
    steer = np.radians(rng.normal(size=count) * log_uniform("steer_sigma_deg"))
    return BoostPrograms(
        burn_s=burn,
        acceleration_m_s2=first,
        growth_per_s=growth,
        gap_s=gap,
        rise_s=uniform("vertical_rise_s"),
        over_s=log_uniform("pitch_over_s"),
        lead_rad=np.radians(uniform("pitch_over_deg")),
        steer_rad=steer,
        steer_rate=2.0 * np.pi / log_uniform("steer_period_s"),
        steer_phase=rng.uniform(0.0, 2.0 * np.pi, count),
    )


def _flown(programs: BoostPrograms, ranges: dict[str, Any]) -> tuple[Instants, Instants, FloatArray, BoolArray]:
    """Return instants, ends of stages, ranges (n,) m and which boosts come down within the limits.

    Midpoint rule, with what the thrust gains in each step: half of the ranges are within 2 %. The kernel has 30 %.
    """
    starts, burn = programs.starts_s, programs.burn_s
    ends_s = starts + burn
    over_s = np.max(np.where(burn > 0.0, ends_s, 0.0), axis=1)
    steps = int(np.ceil(over_s.max() / STEP_S)) + 1
    count = len(over_s)
    state = np.zeros((4, count))
    state[1] = EARTH_EQUATORIAL_RADIUS_M
    grid = np.empty((steps + 1, 4, count))
    times: FloatArray = np.arange(steps + 1, dtype=np.float64) * STEP_S
    gains = np.array([gained(programs, np.full(count, time)) for time in times])
    grid[0] = state
    for step, now in enumerate(times[:-1].tolist()):
        middle = gained(programs, np.full(count, now + 0.5 * STEP_S))
        sizes = (middle - gains[step]) / (0.5 * STEP_S), (gains[step + 1] - gains[step]) / STEP_S
        half = state + 0.5 * STEP_S * _rates(programs, state, np.full(count, now), sizes[0])
        state = state + STEP_S * _rates(programs, half, np.full(count, now + 0.5 * STEP_S), sizes[1])
        grid[step + 1] = state
    # In free flight, some time after the burn.
    last = grid[np.minimum(np.ceil(over_s / STEP_S).astype(np.int64), steps), :, np.arange(count)].T
    range_m, apex_m = _ranges(last)
    low_m = np.min(np.where(times[:, None] <= over_s, np.hypot(grid[:, 0], grid[:, 1]), np.inf), axis=0)
    (least_m, most_m), highest_m = 1e3 * np.array(ranges["ranges_km"]), 1e3 * ranges["highest_km"]
    good = (range_m > least_m) & (range_m < most_m) & (apex_m < highest_m)
    good &= low_m >= EARTH_EQUATORIAL_RADIUS_M - 1.0
    size, stage = acceleration(programs.take(good), np.repeat(times[:, None], np.count_nonzero(good), axis=1))
    at, mine = np.nonzero(size > 0.0)
    boost = np.flatnonzero(good)[mine]
    along = size[at, mine] * np.cos(programs.take(boost).leads(times[at]))
    instants = Instants(boost, times[at], stage[at, mine], _features(grid[at, :, boost].T, along))
    one, which = np.nonzero((burn > 0.0) & good[:, None])
    when = ends_s[one, which]
    there = _between(programs.take(one), grid[:, :, one], gains[:, one], when)
    final = programs.acceleration_m_s2[one, which] / (1.0 - programs.growth_per_s[one, which] * burn[one, which])
    return instants, Instants(one, when, which, _features(there, final)), range_m, good


def _between(programs: BoostPrograms, grid: FloatArray, gains: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return states (4, m) of boosts at times (m,) between steps of the grid; velocities by what the thrust gained."""
    each = np.arange(len(time_s))
    row = np.minimum((time_s / STEP_S).astype(np.int64), len(grid) - 2)
    share = time_s / STEP_S - row
    before, after = gains[row, each], gains[row + 1, each]
    burnt = (gained(programs, time_s) - before) / np.maximum(after - before, 1e-9)
    shares = np.stack([share, share, burnt, burnt])
    states: FloatArray = (1.0 - shares) * grid[row, :, each].T + shares * grid[row + 1, :, each].T
    return states


def gained(programs: BoostPrograms, time_s: FloatArray) -> FloatArray:
    """Return the speed (n,), m/s, that the thrust has gained by times (n,) since ignition: A ln(1/(1 - c t)) / c."""
    burnt = np.clip(time_s[:, None] - programs.starts_s, 0.0, programs.burn_s)
    growth = np.maximum(programs.growth_per_s, 1e-9)
    total: FloatArray = np.sum(programs.acceleration_m_s2 * -np.log1p(-growth * burnt) / growth, axis=1)
    return total


def acceleration(programs: BoostPrograms, time_s: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the thrust acceleration (..., n), m/s², and the stage at times (..., n) since ignition; 0 in the dark."""
    starts = programs.starts_s
    size, stage = np.zeros(time_s.shape), np.zeros(time_s.shape, dtype=np.int64)
    for number in range(STAGES):
        since = time_s - starts[:, number]
        burns = (since >= 0.0) & (since < programs.burn_s[:, number])
        now = programs.acceleration_m_s2[:, number] / (
            1.0 - programs.growth_per_s[:, number] * np.where(burns, since, 0.0)
        )
        size, stage = np.where(burns, now, size), np.where(since >= 0.0, number, stage)
    return size, stage


def _rates(programs: BoostPrograms, state: FloatArray, time_s: FloatArray, size: FloatArray) -> FloatArray:
    """Return the rates (4, n) of states: horizontal and vertical position from the centre, and velocity.

    `size` (n,) is the acceleration by the thrust.
    """
    x, y, u, v = state
    square = x * x + y * y
    pull = -MU_M3_S2 / (square * np.sqrt(square))
    speed = np.hypot(u, v)
    rising = (time_s < programs.rise_s) | (speed < 1.0)
    ahead, up = np.where(rising, 0.0, u / np.maximum(speed, 1.0)), np.where(rising, 1.0, v / np.maximum(speed, 1.0))
    lead = programs.leads(time_s)
    cosine, sine = np.cos(lead), np.sin(lead)
    return np.array(
        [u, v, pull * x + size * (ahead * cosine + up * sine), pull * y + size * (up * cosine - ahead * sine)]
    )


def _features(state: FloatArray, size: FloatArray) -> FloatArray:
    """Return features (m, 4) of states (4, m) with forces along the velocity (m,)."""
    x, y, u, v = state
    radius = np.hypot(x, y)
    speed = np.hypot(u, v)
    climb = np.where(speed > 1.0, (x * u + y * v) / np.maximum(radius * speed, 1.0), 1.0)
    angle = np.arcsin(np.clip(climb, -1.0, 1.0))
    return np.stack([radius - EARTH_EQUATORIAL_RADIUS_M, speed, angle, size], axis=1)


def _ranges(state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ranges over a round Earth and greatest heights (n,), m, of free flights (4, n); nan without an impact."""
    x, y, u, v = state
    radius, square = np.hypot(x, y), u * u + v * v
    momentum = x * v - y * u
    energy = 0.5 * square - MU_M3_S2 / radius
    parameter = momentum * momentum / MU_M3_S2
    excentricity = np.sqrt(np.maximum(1.0 + 2.0 * energy * momentum * momentum / MU_M3_S2**2, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        apex = parameter / (1.0 - excentricity)
        now = np.arccos(np.clip((parameter / radius - 1.0) / excentricity, -1.0, 1.0))
        climbs = x * u + y * v >= 0.0
        now = np.where(climbs, now, 2.0 * np.pi - now)
        cosine = (parameter / EARTH_EQUATORIAL_RADIUS_M - 1.0) / excentricity
        down = 2.0 * np.pi - np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
        swept = np.where((energy < 0.0) & (radius >= EARTH_EQUATORIAL_RADIUS_M), down - now, np.nan)
    # A steep boost may have been turned back.
    forward = np.arctan2(x, y) - np.copysign(swept, momentum)
    return EARTH_EQUATORIAL_RADIUS_M * forward, apex - EARTH_EQUATORIAL_RADIUS_M
