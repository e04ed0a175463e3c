"""How much of exact posteriors the ellipses and ellipsoids of boost-profile contain, by importance sampling.

    python benchmarks/exact_posteriors.py [--runs 60] [--samples 5000] [--sensors 1] [--only SRBM] [--pool 1]
                                          [--parts FOLDER] [--write FOLDER]
    python benchmarks/exact_posteriors.py --from-csv docs/benchmarks/exact_posteriors.csv

Flights, looks and times are those of `boost_profile.py`. The page states the method (`exact_posteriors_page.py`).
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from attrs import evolve
from boost_profile_flights import AFTER_S, MARKS, SENSORS, marks_at
from class_flights import PRIORS, flights, hidden, lines_of_sight, watch_of
from exact_boost_posteriors import Looks, effective, impacts_of, sampled, states_of
from exact_posteriors_page import EFFECTIVE, NOMINAL, TIMES, share, write_page
from opir_trackers.profile import fit
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.flight import on_ground
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.strain import OffModelFilters
from result_files import write_csv

from opir_core.interfaces.records import TRACK_CONTAINMENTS, Tracks
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees, on_normal_scale


def held(square: np.ndarray, sigmas: np.ndarray, weight: np.ndarray, degrees: int) -> list[float]:
    """Return which shares of boosts, of squares (m,) in told covariances, told radii (3,) hold, and the mean square."""
    from scipy.stats import chi2

    scaled = on_normal_scale(square, np.repeat(sigmas[None], len(square), axis=0), degrees)
    inside = scaled[:, None] <= chi2.ppf(TRACK_CONTAINMENTS, degrees)
    return [*(weight @ inside).tolist(), float(weight @ square) / degrees]


def of_flight(told: Tracks, row: int, bank: OffModelFilters, seeing: dict[str, Any], samples: int) -> list[float]:
    """Return how many boosts count for a track at `row` of what is told, and what of them is held: impact and state."""
    number, tick_s = told.track[row], float(told.tick_s[row])
    mine, rows = (each.take(each.track == number) for each in (bank.hypotheses, bank.rows))
    mine = evolve(mine, kind=np.full(len(mine), seeing["kind"]))
    looks = Looks.of(bank.seen.of(np.array([number])), tick_s, seeing["period_s"], seeing["chance"])
    boosts, weight = sampled(mine, rows, looks, samples, int(number))
    landed = impacts_of(boosts)
    known = np.isfinite(landed).all(axis=1)
    away = on_ground(landed[known], np.repeat(told.impact[row : row + 1], np.count_nonzero(known), axis=0))[:, :2]
    apart = states_of(boosts, tick_s) - told.state[row]
    covariances = told.impact_covariance[row, :2, :2], told.state_covariance[row]
    both = zip((away, apart), covariances, strict=True)
    impact, state = (nees(x, np.repeat(spread[None], len(x), axis=0)) for x, spread in both)
    share = weight[known] / weight[known].sum()
    return [
        effective(weight),
        *held(impact, told.impact_sigmas[row], share, 2),
        *held(state, told.state_sigmas[row], weight, 6),
    ]


def measured(kind: str, model: str, chosen: argparse.Namespace) -> dict[str, list[list[float]]]:
    """Return what of the posteriors of flights of a class, that like sensors see, is held at each mark."""
    period_s, sigma_rad, chances = SENSORS[model]
    number, sensors = TARGET_TYPES.index(kind), chosen.sensors
    truth, chance = flights(kind, chosen.runs, chosen.seed), chances[number]
    seeing: dict[str, Any] = {"period_s": period_s, "chance": chance}
    away_s = hidden(truth, chosen.seed)
    track, rays = lines_of_sight(truth, sigma_rad, chosen.seed, sensors=sensors, hidden_s=away_s, **seeing)
    fitting = Fitting(PRIORS.take([number]), watch_of(sensors, period_s, chance), True)
    bank, cut, found = OffModelFilters.empty(sensors), 0, {}
    for tick in range(1, int(fit.family_of(truth, PRIORS).burnout_s.max() + AFTER_S) + 2):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        cut = end
        marks = marks_at(truth, bank.seen, float(tick))
        for mark in np.unique(marks[marks >= 0]).tolist():
            mine = bank.without(np.setdiff1d(bank.seen.track, truth.track[marks == mark]))
            told = told_of(fitting, mine, float(tick))
            every = [of_flight(told, row, mine, seeing | {"kind": number}, chosen.samples) for row in range(len(told))]
            found[MARKS[mark]] = found.get(MARKS[mark], []) + every
    return found


def told_of(fitting: Fitting, bank: OffModelFilters, tick_s: float) -> Tracks:
    """Return what is told of a bank."""
    finer = fitting.parts(bank, tick_s)
    parts = None if finer is None else (finer, probability(finer))
    basis = Basis(fitting.priors, "kepler", fitting.memory(bank))
    return report(bank.hypotheses, probability(bank.hypotheses), tick_s, basis, parts)


def cells(
    kind: str, model: str, chosen: argparse.Namespace, found: dict[str, list[list[float]]]
) -> Iterator[dict[str, str]]:
    """Yield the rows of the CSV file of a class and model, a mark each."""
    for mark, when in zip(MARKS, TIMES, strict=True):
        every = np.array(found.get(mark, []))
        if not len(every):
            continue
        known = every[every[:, 0] > EFFECTIVE, 1:]
        if len(known) < 2:
            continue
        mean, error = 100.0 * known.mean(axis=0), 100.0 * known.std(axis=0, ddof=1) / np.sqrt(len(known))
        row = {"class": kind, "sensors": str(chosen.sensors), "sensor_model": model, "time": when}
        row |= {"flights_drawn": str(chosen.runs), "samples_per_posterior": str(chosen.samples)}
        row |= {"flights": str(len(every)), "flights_counted": str(len(known))}
        for what, first in (("impact", 0), ("state", 4)):
            for place, nominal in enumerate(NOMINAL, first):
                name = share(nominal, what)
                row |= {name: f"{mean[place]:.1f}", f"{name}_standard_error": f"{error[place]:.1f}"}
        yield {**row, "median_nees_over_6": f"{np.median(known[:, 7]):.2f}"}


def part_of(case: tuple[str, str, argparse.Namespace]) -> dict[str, list[list[float]]]:
    """Return what came of a class and model, measured or read."""
    kind, model, chosen = case
    path = chosen.parts / f"{kind}-{model}-{chosen.sensors}-{chosen.runs}.json" if chosen.parts else None
    if path and path.exists():
        told: dict[str, list[list[float]]] = json.loads(path.read_text(encoding="utf-8"))
        return told
    found = measured(kind, model, chosen)
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(found), encoding="utf-8")
    return found


def main() -> None:
    """Measure what is asked for and write the results, or redraw page and plot from a CSV file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60, help="flights of a class and model")
    parser.add_argument("--samples", type=int, default=5000, help="boosts drawn of each posterior")
    parser.add_argument("--sensors", type=int, choices=(1, 2), default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--pool", type=int, default=1, help="processes")
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--write", type=Path, help="folder for the CSV file, the page and the plot")
    parser.add_argument("--from-csv", type=Path, help="redraw page and plot beside this file, and measure nothing")
    chosen = parser.parse_args()
    if chosen.from_csv:
        write_page(chosen.from_csv)
        return
    cases = [(k, m, chosen) for m, k in product(SENSORS, TARGET_TYPES[::-1]) if chosen.only in (None, k)]
    rows: list[dict[str, str]] = []
    with ProcessPoolExecutor(chosen.pool) as pool:
        for (kind, model, _), found in zip(cases, pool.map(part_of, cases), strict=True):
            fresh = list(cells(kind, model, chosen, found))
            print("\n".join(",".join(row.values()) for row in fresh), flush=True)
            rows += fresh
    if chosen.write and rows:
        write_csv(chosen.write / "exact_posteriors.csv", rows)
        write_page(chosen.write / "exact_posteriors.csv")


if __name__ == "__main__":
    main()
