"""Flights of boost-profile's own family, fitted tick by tick: squared errors, information and slopes at each mark.

`tests/support` is on the path of whoever imports this.
"""

from typing import Any

import numpy as np
from attrs import evolve
from class_flights import PRIORS, flights, hidden, lines_of_sight, watch_of
from opir_trackers.profile import fit
from opir_trackers.profile import flight as profile_flight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.end import ends_of
from opir_trackers.profile.family import BURN, EAST, SIZE, START, TURN_EAST
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.flight import Moments, on_ground
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.rows import means, single
from opir_trackers.profile.seen import TrackHistory
from opir_trackers.profile.strain import OffModelFilters
from opir_trackers.sensors import SensorSchedule

from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees, on_normal_scale

#: Scan period, s, line of sight error, rad, and chance of detection of ICBM, IRBM and SRBM: each model's defaults.
SENSORS: dict[str, tuple[float, float, tuple[float, ...]]] = {
    "DSP": (0.2, 50e-6, (0.60, 0.50, 0.35)),
    "SBIRS-GEO": (0.1, 20e-6, (0.80, 0.72, 0.60)),
    "NEXTGEN-GEO": (0.05, 10e-6, (0.95, 0.92, 0.85)),
}

#: The end of a burn is known this well, s, before any look tells of it: too little to matter.
_OPEN_S = 2.0

#: Marks: after the first look, seconds and shares of the class's burn; seconds after the burn.
EARLY_S, SHARES, AFTER_S = 20.0, (0.5, 0.75, 0.95), 5.0
MARKS = ("20 s", "50 %", "75 %", "95 %", "5 s after")


class Marked:
    """What came of flights at each mark: rows of figures, and the sums of information and slopes."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []
        self.sums: dict[int, dict[str, Any]] = {}

    def put(self, mark: int, columns: dict[str, np.ndarray], information: np.ndarray, slopes: np.ndarray) -> None:
        """Take figures (n,) of n flights at a mark, their information (n, 10, 10) and slopes (n, 8, 10)."""
        for values in zip(*columns.values(), strict=True):
            self.rows.append({"mark": mark, **dict(zip(columns, map(float, values), strict=True))})
        landed = np.isfinite(slopes).all(axis=(1, 2))
        fresh = {
            "count": len(slopes),
            "landed": int(np.count_nonzero(landed)),
            "information": information.sum(axis=0),
            "slopes": np.where(landed[:, None, None], slopes, np.nan_to_num(slopes)).sum(axis=0),
        }
        kept = self.sums.get(mark)
        self.sums[mark] = fresh if kept is None else {name: kept[name] + fresh[name] for name in fresh}

    def told(self) -> dict[str, Any]:
        """Return all as plain values."""
        sums = {
            str(mark): {name: np.asarray(value).tolist() for name, value in each.items()}
            for mark, each in self.sums.items()
        }
        return {"rows": self.rows, "sums": sums}


def marks_at(truth: Hypotheses, seen: TrackHistory, tick_s: float) -> np.ndarray:
    """Return which mark (n,) each flight passes at a tick, -1 for none.

    Marks in the burn are times since the first look, the same for all flights of a class, of those flights of which
    light came in the last second: which flights count is then known from what was seen, as a posterior wants it. (A
    share of each flight's own burn would pick the flights whose burns are about to end, which no tracker can know.)
    After the burn those count of which the first light and the last are so far apart as the first mark is late.
    """
    found = np.full(len(truth), -1)
    place = np.flatnonzero(np.isin(truth.track, seen.track))
    if not len(place):
        return found
    truth, seen = truth.take(place), seen.of(truth.track[place])
    first_s, last_s = np.min(seen.first_s, axis=1), np.max(seen.last_s, axis=1)
    burn_s = PRIORS.burn_s[truth.kind]
    for mark, after_s in enumerate([np.full(len(truth), EARLY_S), *(share * burn_s for share in SHARES)]):
        found[place[(np.ceil(first_s + after_s) == tick_s) & (last_s > tick_s - 1.0)]] = mark
    burnout_s = fit.family_of(truth, PRIORS).burnout_s
    found[place[(np.ceil(burnout_s + AFTER_S) == tick_s) & (last_s > first_s + EARLY_S)]] = len(MARKS) - 1
    return found


def turned(truth: Hypotheses, tick_s: float) -> tuple[Moments, np.ndarray, np.ndarray]:
    """Return states (n, 6) and impacts (n, 3), slopes (n, 8, 10) and turns (n, 10, 10) of parameters, of flights.

    Slopes are of position and velocity up, along and right of the heading at the launch, of the impact along and right
    of the way to it, by parameters of which place and lean are turned to along and right of the heading too.
    """
    family, count = fit.family_of(truth, PRIORS), len(truth)
    ends, slope = profile_flight.burnouts(family, np.zeros((count, SIZE, SIZE)))
    states, by_state = profile_flight.sloped_states(family, tick_s, ends, slope)
    impacts, by_impact = profile_flight.sloped_impacts(ends, slope)
    turns = np.tile(np.eye(SIZE), (count, 1, 1))
    east, north = family.turn_east, family.turn_north
    for first in (EAST, TURN_EAST):
        turns[:, first, first], turns[:, first, first + 1] = east, north
        turns[:, first + 1, first], turns[:, first + 1, first + 1] = north, -east
    axes = np.stack([family.up, family.heading, family.right], axis=1)
    launch = np.column_stack([*truth.anchors.places(truth.parameters), family.start_s])
    way = -on_ground(launch, impacts)[:, :2]
    way /= np.hypot(way[:, 0], way[:, 1])[:, None]
    across = np.stack([way, np.column_stack([way[:, 1], -way[:, 0]])], axis=1)
    parts = [axes @ by_state[:, :3], axes @ by_state[:, 3:], across @ by_impact[:, :2]]
    slopes = np.concatenate(parts, axis=1) @ turns.transpose(0, 2, 1)
    return Moments(states, impacts), slopes, turns


def bounds(truth: Hypotheses, watch: SensorSchedule, seen: TrackHistory, tick_s: float) -> np.ndarray:
    """Return the bounds (n, 10, 10) of flights whose rows have been added up along the truth."""
    family = fit.family_of(truth, PRIORS)
    spread = fit.solved(truth, PRIORS, watch.bias_sigma_rad).spread
    slope = np.zeros((len(truth), SIZE))
    slope[:, START], slope[:, BURN] = 1.0, family.courses.burn_s
    silence = seen.of(truth.track).silence(truth.kind, tick_s, watch)
    burn_s = family.courses.burn_s
    wide = ends_of(family.start_s, np.log(burn_s), np.square(_OPEN_S / burn_s), silence)
    over = (family.burnout_s < tick_s) / (wide.variance * np.square(burn_s))
    gain = np.sum(spread * slope[:, None], axis=2)
    variance = np.sum(gain * slope, axis=1)
    less = over / (1.0 + over * variance)
    found: np.ndarray = spread - less[:, None, None] * gain[:, :, None] * gain[:, None, :]
    return found


def with_true_rows(truth: Hypotheses, track: np.ndarray, rays: LinesOfSight) -> Hypotheses:
    """Return the flights with rays added, linearised at the truth."""
    if not len(track):
        return truth
    family = fit.family_of(truth, PRIORS)
    rows = single(track, rays)
    rows = means(evolve(rows, time_s=np.clip(rows.time_s - 0.125, family.start_s[track], family.burnout_s[track])))
    rows = rows.take(np.argsort(rows.track, kind="stable"))
    return fit.with_rows(truth, family, rows, rows.track, np.ones(len(rows)))


def measured(kind: str, model: str, sensors: int, runs: int, seed: int) -> Marked:
    """Return the figures of runs of one class, seen by like sensors."""
    period_s, sigma_rad, chances = SENSORS[model]
    number = TARGET_TYPES.index(kind)
    truth = flights(kind, runs, seed)
    chance = chances[number]
    seeing: dict[str, Any] = {"sensors": sensors, "period_s": period_s, "chance": chance}
    track, rays = lines_of_sight(truth, sigma_rad, seed, **seeing, hidden_s=hidden(truth, seed))
    watch = watch_of(sensors, period_s, chance)
    prior = PRIORS.take([number])
    fitting, bank, marked, cut = Fitting(prior, watch, True), OffModelFilters.empty(sensors), Marked(), 0
    known = evolve(fit.blank(runs, sensors), **{name: getattr(truth, name) for name in _SHARED})
    last = int(fit.family_of(truth, PRIORS).burnout_s.max() + AFTER_S) + 2
    for tick in range(1, last):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        known = with_true_rows(known, track[cut:end], rays.take(slice(cut, end)))
        cut = end
        marks = marks_at(truth, bank.seen, float(tick))
        for mark in np.unique(marks[marks >= 0]).tolist():
            chosen = np.flatnonzero(marks == mark)
            marked.put(mark, *figures(known.take(chosen), bank, fitting, float(tick)))
    return marked


_SHARED = (
    "track",
    "kind",
    "anchor_latitude_rad",
    "anchor_longitude_rad",
    "anchor_s",
    "parameters",
    "is_bent",
)


def figures(
    truth: Hypotheses, bank: OffModelFilters, fitting: Fitting, tick_s: float
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """Return squared errors and NEES of flights at a tick, and their information (n, 10, 10) and slopes (n, 8, 10)."""
    mine = evolve(bank, hypotheses=bank.hypotheses.take(np.isin(bank.hypotheses.track, truth.track)))
    likely, finer = mine.hypotheses, fitting.parts(mine, tick_s)
    parts = None if finer is None else (finer, probability(finer))
    memory = fitting.memory(bank)
    told = report(likely, probability(likely), tick_s, Basis(fitting.priors, "kepler", memory), parts)
    truth = truth.take(np.isin(truth.track, told.track))
    limit = bounds(truth, fitting.watch, bank.seen, tick_s)
    exact, slopes, turns = turned(truth, tick_s)
    limit = turns @ limit @ turns.transpose(0, 2, 1)
    error = told.state - exact.mean
    away = on_ground(exact.covariance, told.impact)[:, :2]
    at_best = np.diagonal(slopes @ limit @ slopes.transpose(0, 2, 1), axis1=1, axis2=2)
    found = {
        "position": np.sum(error[:, :3] ** 2, axis=1),
        "velocity": np.sum(error[:, 3:] ** 2, axis=1),
        "impact": np.sum(away**2, axis=1),
        "nees": nees(error, told.state_covariance),
        "told nees": on_normal_scale(nees(error, told.state_covariance), told.state_sigmas, 6),
        "impact nees": on_normal_scale(nees(away, told.impact_covariance[:, :2, :2]), told.impact_sigmas),
    }
    found |= {f"{name} at the truth": at_best[:, part].sum(axis=1) for name, part in PARTS.items()}
    return found, inverse(limit), slopes


#: Rows of slopes that belong to each figure.
PARTS = {"position": slice(0, 3), "velocity": slice(3, 6), "impact": slice(6, 8)}


def inverse(matrices: np.ndarray) -> np.ndarray:
    """Return the inverses (n, 10, 10) of covariances, scaled to a unit diagonal before."""
    scale = 1.0 / np.sqrt(np.diagonal(matrices, axis1=1, axis2=2))
    outer = scale[:, :, None] * scale[:, None, :]
    found: np.ndarray = np.linalg.inv(matrices * outer) * outer
    return found
