"""boost-profile on targets of its own family: error over the bound, consistency, and what impact ellipses hold.

    python benchmarks/boost_profile.py [--runs 40] [--only SRBM] [--parts FOLDER] [--write docs/benchmarks]

Flights are drawn from the tracker's own priors, and seen by one or two like sensors in geostationary orbit; the fit is
given each flight's detections (association is measured elsewhere) and the class, and told of nothing else. The bound is
the Bayesian Cramér and Rao's: the prior's information, and that of the lines of sight that detected along the true
flight; once the burn has ended, the end as if measured with the standard deviation that the looks alone give it. It is
mapped to position, velocity and impact at the truth, and averaged over the draws. A bound of a linearised impact is no
bound while the end of the burn is open, for which the impact bends too much: it is a yardstick there.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from attrs import evolve
from profile_flights import PRIORS, flights, lines_of_sight, watch_of

from opir_core.scene import TARGET_TYPES
from opir_core.scoring.consistency import consistency, containment, nees
from opir_core.tracking import profile_fit as fit
from opir_core.tracking import profile_flight
from opir_core.tracking.profile_bank import Fitting
from opir_core.tracking.profile_end import ends_of
from opir_core.tracking.profile_family import BURN, SIZE, START
from opir_core.tracking.profile_fit import Hypotheses
from opir_core.tracking.profile_flight import Moments, on_ground
from opir_core.tracking.profile_hypotheses import probability
from opir_core.tracking.profile_report import report
from opir_core.tracking.profile_rows import means, single
from opir_core.tracking.profile_seen import Seen, Watch
from opir_core.tracking.profile_strain import Bank
from opir_core.tracking.rays import Rays

#: Scan period, s, line of sight error, rad, and chance of detection of ICBM, IRBM and SRBM: each model's defaults.
SENSORS: dict[str, tuple[float, float, tuple[float, ...]]] = {
    "DSP": (0.2, 50e-6, (0.60, 0.50, 0.35)),
    "SBIRS-GEO": (0.1, 20e-6, (0.80, 0.72, 0.60)),
    "NEXTGEN-GEO": (0.05, 10e-6, (0.95, 0.92, 0.85)),
}

#: The end of a burn is known this well, s, before any look tells of it: too little to matter.
_OPEN_S = 2.0

#: Marks at which flights are looked at: seconds after the start, shares of the class's burn, seconds after the burn.
EARLY_S, SHARES, AFTER_S = 21.0, (0.5, 0.75, 0.95), 5.0
MARKS = ("20 s", "50 %", "75 %", "95 %", "5 s after")

PAGE = """# The tracker boost-profile on its own family

Made by `python benchmarks/boost_profile.py --write docs/benchmarks`. {docstring}

{runs} runs a line, so that a ratio is known to about {ratio:.0f} % (position, velocity) and a share of 95 % lies in
{low:.0f} to 100 % by chance. "RMSE / bound" has its 95 % interval (bootstrap) behind it. ANEES is of the state, over
its six degrees of freedom; its 99 % band is {lower:.2f} to {upper:.2f}; p that of Kolmogorov and Smirnov's test of the
distribution. Containment is that of the 50, 90 and 95 % ellipses of impact, of those runs in which an impact is told
(no limit is set on its size here).

{table}
"""


class Marked:
    """What came of one flight at each mark, as rows of figures."""

    def __init__(self) -> None:
        self.rows: list[dict[str, float]] = []

    def put(self, mark: int, columns: dict[str, np.ndarray]) -> None:
        """Take figures (n,) of n flights at a mark."""
        for values in zip(*columns.values(), strict=True):
            self.rows.append({"mark": mark, **dict(zip(columns, map(float, values), strict=True))})


def marks_at(truth: Hypotheses, seen: Seen, tick_s: float) -> np.ndarray:
    """Return which mark (n,) each flight passes at a tick, -1 for none.

    Marks in the burn are times, the same for all flights of a class, of those flights of which light came in the last
    second: which flights count is then known from what was seen, as a posterior wants it. (A share of each flight's own
    burn would pick the flights whose burns are about to end, which no tracker can know.)
    """
    family = fit.family_of(truth, PRIORS)
    found = np.full(len(truth), -1)
    last_s = np.max(seen.last_s, axis=1)[np.searchsorted(seen.track, truth.track)]
    burn_s = PRIORS.burn_s[truth.kind]
    for mark, after_s in enumerate([np.full(len(truth), EARLY_S), *(share * burn_s for share in SHARES)]):
        at = np.ceil(family.start_s + after_s)
        found[(at == tick_s) & (last_s > tick_s - 1.0)] = mark
    found[np.ceil(family.burnout_s + AFTER_S) == tick_s] = len(MARKS) - 1
    return found


def states_and_impacts(truth: Hypotheses, spread: np.ndarray, tick_s: float) -> tuple[Moments, Moments, np.ndarray]:
    """Return states, impacts, and the linear covariances of impacts, of flights with covariances (n, 10, 10)."""
    family = fit.family_of(truth, PRIORS)
    ends, slope = profile_flight.burnouts(family, spread)
    states = profile_flight.states(family, spread, tick_s, ends, slope)
    small = 1e-6 * spread
    exact = profile_flight.burnouts(family, small)
    impacts = profile_flight.impacts(*exact, small, "kepler")
    return states, impacts, 1e6 * impacts.covariance


def bounds(truth: Hypotheses, watch: Watch, seen: Seen, tick_s: float) -> np.ndarray:
    """Return the bounds (n, 10, 10) of flights whose rows have been added up along the truth."""
    family = fit.family_of(truth, PRIORS)
    spread = fit.solved(truth, PRIORS, watch.bias_sigma_rad).spread
    slope = np.zeros((len(truth), SIZE))
    slope[:, START], slope[:, BURN] = 1.0, family.courses.burn_s
    silence = seen.of(truth.track).silence(truth.kind, tick_s, watch)
    wide = ends_of(family.burnout_s, np.full(len(truth), _OPEN_S**2), silence)
    over = (family.burnout_s < tick_s) / wide.variance_s2
    gain = np.sum(spread * slope[:, None], axis=2)
    variance = np.sum(gain * slope, axis=1)
    less = over / (1.0 + over * variance)
    found: np.ndarray = spread - less[:, None, None] * gain[:, :, None] * gain[:, None, :]
    return found


def with_true_rows(truth: Hypotheses, track: np.ndarray, rays: Rays) -> Hypotheses:
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
    track, rays = lines_of_sight(truth, sigma_rad, seed, sensors=sensors, period_s=period_s, chance=chance)
    watch = watch_of(sensors, period_s, chance)
    prior = PRIORS.take([number])
    fitting, bank, marked, cut = Fitting(prior, watch, True), Bank.empty(sensors), Marked(), 0
    known = evolve(fit.blank(runs, sensors), **{name: getattr(truth, name) for name in _SHARED})
    last = int(fit.family_of(truth, PRIORS).burnout_s.max() + AFTER_S) + 2
    for tick in range(1, last):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        known = with_true_rows(known, track[cut:end], rays.take(slice(cut, end)))
        cut = end
        marks = marks_at(truth, bank.seen, float(tick)) if len(bank.seen.track) == runs else np.full(runs, -1)
        for mark in np.unique(marks[marks >= 0]).tolist():
            chosen = np.flatnonzero(marks == mark)
            marked.put(mark, figures(known.take(chosen), bank, fitting, float(tick)))
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


def figures(truth: Hypotheses, bank: Bank, fitting: Fitting, tick_s: float) -> dict[str, np.ndarray]:
    """Return squared errors and bounds, NEES of states and impacts, of flights at a tick."""
    mine = np.isin(bank.hypotheses.track, truth.track)
    likely = bank.hypotheses.take(mine)
    told = report(likely, probability(likely), tick_s, fitting.priors, "kepler", np.inf)
    truth = truth.take(np.isin(truth.track, told.track))
    limit = bounds(truth, fitting.watch, bank.seen, tick_s)
    states, impacts, impact_limit = states_and_impacts(truth, limit, tick_s)
    error = told.state - states.mean
    away = on_ground(impacts.mean, told.impact)[:, :2]
    at_best = np.diagonal(states.covariance, axis1=1, axis2=2)
    return {
        "position": np.sum(error[:, :3] ** 2, axis=1),
        "velocity": np.sum(error[:, 3:] ** 2, axis=1),
        "impact": np.sum(away**2, axis=1),
        "position bound": at_best[:, :3].sum(axis=1),
        "velocity bound": at_best[:, 3:].sum(axis=1),
        "impact bound": impact_limit[:, 0, 0] + impact_limit[:, 1, 1],
        "nees": nees(error, told.state_covariance),
        "impact nees": nees(away, told.impact_covariance[:, :2, :2]),
    }


def ratio(rows: list[dict[str, float]], name: str) -> str:
    """Return RMSE over bound with its interval: 1000 bootstrap samples of a fixed stream."""
    square = np.array([[row[name], row[f"{name} bound"]] for row in rows])
    square = square[np.isfinite(square).all(axis=1)]
    drawn = np.random.default_rng(1).integers(0, len(square), (1000, len(square)))
    sums = square[drawn].sum(axis=1)
    low, high = np.quantile(np.sqrt(sums[:, 0] / sums[:, 1]), (0.025, 0.975))
    whole = np.sqrt(square[:, 0].sum() / square[:, 1].sum())
    return f"{whole:.2f} ({low:.2f}, {high:.2f})"


def lines(kind: str, model: str, sensors: int, rows: list[dict[str, float]]) -> Iterator[str]:
    """Yield the lines of the table, a mark each."""
    for mark, name in enumerate(MARKS):
        mine = [row for row in rows if row["mark"] == mark]
        if len(mine) < 2:
            continue
        state = consistency(np.array([row["nees"] for row in mine]), 6)
        impact = np.array([row["impact nees"] for row in mine])
        held = " / ".join(f"{100.0 * containment(impact, 2, nominal)[0]:.0f}" for nominal in (0.5, 0.9, 0.95))
        metres, speed, miss = (
            np.sqrt(np.nanmean([row[each] for row in mine])) for each in ("position", "velocity", "impact")
        )
        yield (
            f"| {kind} | {sensors} {model} | {name} | {metres:.0f} | {ratio(mine, 'position')} | {speed:.1f} "
            f"| {ratio(mine, 'velocity')} | {miss / 1e3:.1f} | {ratio(mine, 'impact')} | {state.mean / 6:.2f} "
            f"| {state.p_value:.2f} | {held} |"
        )


_COLUMNS = (
    "class",
    "sensors",
    "share of burn",
    "position, m",
    "RMSE / bound",
    "velocity, m/s",
    "RMSE / bound",
    "impact, km",
    "RMSE / bound",
    "ANEES / 6",
    "p",
    "impact held, % of runs",
)
HEAD = [f"| {' | '.join(_COLUMNS)} |", "|" + "---|" * len(_COLUMNS)]


def main() -> None:
    """Measure what is asked for, or read what was measured, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    table = list(HEAD)
    for sensors in (2, 1):
        for model in ("SBIRS-GEO", "DSP", "NEXTGEN-GEO"):
            for kind in TARGET_TYPES[::-1]:
                if chosen.only in (None, kind):
                    part = list(lines(kind, model, sensors, part_of(kind, model, sensors, chosen)))
                    print("\n".join(part), flush=True)
                    table += part
    if chosen.write:
        write(chosen.write, chosen.runs, table)


def part_of(kind: str, model: str, sensors: int, chosen: argparse.Namespace) -> Any:
    """Return the rows of one class and sensors, measured or read."""
    path = chosen.parts / f"{kind}-{model}-{sensors}-{chosen.runs}.json" if chosen.parts else None
    if path and path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    if chosen.finished:
        return []
    rows = measured(kind, model, sensors, chosen.runs, chosen.seed).rows
    if path:
        path.write_text(json.dumps(rows), encoding="utf-8")
    return rows


def write(folder: Path, runs: int, table: list[str]) -> None:
    """Write the page."""
    band = consistency(np.ones(runs), 6)
    page = PAGE.format(
        docstring=(__doc__ or "").split("\n\n")[2].replace("\n", " "),
        runs=runs,
        ratio=100.0 / np.sqrt(2 * 2.5 * runs),
        low=100.0 * (0.95 - 2.0 * np.sqrt(0.95 * 0.05 / runs)),
        lower=band.lower / 6,
        upper=band.upper / 6,
        table="\n".join(table),
    )
    (folder / "boost_profile.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
