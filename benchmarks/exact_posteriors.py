"""What ellipses and ellipsoids of boost-profile hold of exact posteriors, found by importance sampling.

    python benchmarks/exact_posteriors.py [--runs 60] [--samples 5000] [--sensors 1] [--only SRBM] [--pool 1]
                                          [--parts FOLDER] [--write FOLDER]

Whether a truth lies in an ellipse is one yes or no a flight, and a share of 95 % takes thousands of them to be known to
a point. The posterior itself, given a flight's looks, tells it far more sharply: what share of it the ellipse holds.
Flights, looks and marks are those of `boost_profile.py`. Nothing in the posterior is linear: likelihoods are those of
the paths themselves, of the first light, and of looks that saw nothing since the last; priors are those of natural
parameters. Boosts are drawn from a mixture of Student's distributions about hypotheses that were fitted anew near
starts and ends, and weighed by the posterior over that mixture. A flight counts where more than 60 of them do (their
effective number); of the others, whose posteriors are the longest or the sharpest, no share is known well enough.
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
from exact_boosts import Looks, effective, impacts_of, sampled, states_of
from opir_trackers.profile import fit
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.flight import on_ground
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.strain import OffModelFilters
from profile_flights import PRIORS, flights, hidden, lines_of_sight, watch_of

from opir_core.interfaces.records import TOLD_CONTAINMENTS, Tracks
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees, on_normal_scale

PAGE = """# What boost-profile tells, against exact posteriors

Made by `python benchmarks/exact_posteriors.py --runs {runs} --samples {samples}{seen} --write docs/benchmarks`.

{docstring}

Shares are means over flights, with their standard errors: of exact posteriors in the 50, 90 and 95 % ellipses of
impact, and in the ellipsoids of the state. "NEES / 6" is the posterior's mean normalised square of what is told, median
over flights.

{table}
"""

_COLUMNS = ("class", "sensors", "when", "flights", "of", "impact held, %", "state held, %", "NEES / 6")
HEAD = [f"| {' | '.join(_COLUMNS)} |", "|" + "---|" * len(_COLUMNS)]

#: A posterior of which fewer boosts count is not known well enough.
_LEAST = 60.0


def held(square: np.ndarray, sigmas: np.ndarray, weight: np.ndarray, degrees: int) -> list[float]:
    """Return which shares of boosts, of squares (m,) in told covariances, told radii (3,) hold, and the mean square."""
    from scipy.stats import chi2

    scaled = on_normal_scale(square, np.repeat(sigmas[None], len(square), axis=0), degrees)
    inside = scaled[:, None] <= chi2.ppf(TOLD_CONTAINMENTS, degrees)
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


def lines(kind: str, model: str, sensors: int, found: dict[str, list[list[float]]]) -> Iterator[str]:
    """Yield the lines of the table, a mark each."""
    for mark in MARKS:
        every = np.array(found.get(mark, []))
        if not len(every):
            continue
        known = every[every[:, 0] > _LEAST, 1:]
        if len(known) < 2:
            continue
        mean, error = 100.0 * known.mean(axis=0), 100.0 * known.std(axis=0, ddof=1) / np.sqrt(len(known))
        shares = (" / ".join(f"{mean[i]:.1f} ± {error[i]:.1f}" for i in range(first, first + 3)) for first in (0, 4))
        told = f"{np.median(known[:, 7]):.2f}"
        yield f"| {kind} | {sensors} {model} | {mark} | {len(known)} | {len(every)} | {' | '.join(shares)} | {told} |"


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
    """Measure what is asked for, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=60, help="flights of a class and model")
    parser.add_argument("--samples", type=int, default=5000, help="boosts drawn of each posterior")
    parser.add_argument("--sensors", type=int, choices=(1, 2), default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--pool", type=int, default=1, help="processes")
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    cases = [(k, m, chosen) for m, k in product(SENSORS, TARGET_TYPES[::-1]) if chosen.only in (None, k)]
    table = list(HEAD)
    print("\n".join(HEAD))
    with ProcessPoolExecutor(chosen.pool) as pool:
        for (kind, model, _), found in zip(cases, pool.map(part_of, cases), strict=True):
            fresh = list(lines(kind, model, chosen.sensors, found))
            print("\n".join(fresh), flush=True)
            table += fresh
    if chosen.write:
        docstring = "\n\n".join((__doc__ or "").strip().split("\n\n")[2:])
        seen = "" if chosen.sensors == 1 else f" --sensors {chosen.sensors}"
        page = PAGE.format(docstring=docstring, table="\n".join(table), seen=seen, **vars(chosen))
        (chosen.write / "exact_posteriors.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
