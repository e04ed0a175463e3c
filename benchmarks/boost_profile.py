"""boost-profile on targets of its own family: error over the bound, consistency, and what impact ellipses hold.

    python benchmarks/boost_profile.py [--runs 150] [--batches 4] [--only SRBM] [--parts FOLDER] [--write FOLDER]

Flights are drawn from the tracker's own priors, that of how long clouds hide a boost at first among them. One or two
like sensors in geostationary orbit look; the fit is given each flight's detections (association is measured elsewhere)
and the class, and told of nothing else. Marks are times since the first look that saw: 20 s, and 50, 75 and 95 % of the
class's median burn time, of those flights that were seen in the last second; and 5 s after the burn, of those that were
seen for 20 s. Which flights count is so known from the looks. (A share of each flight's own burn, or a time since its
own start, would pick flights by what no tracker knows: no posterior is right on those.)

Information is that of the priors and of the lines of sight that detected, along the true flight; once the burn has
ended, the end as if measured with the standard deviation that the looks alone give it. The start's prior counts as
normal: that no start is after the first light is left out, so that errors may be smaller than either yardstick for as
long as looks tell little of the start. Two yardsticks come of it. "bound" is van Trees': information and slopes
averaged over flights, in axes turned to each flight's heading, and then inverted; it is below every estimator's mean
square error (but for the divergence of these axes, of the order of the heading's variance), and far below where flights
differ much in what can be known of them. "expected" is the mean over flights of the inverse at each truth. It is what
the inequality of Gill and Levit (Bernoulli 1, 1995, 59) comes to with each flight's own weights, without the term in
which these weights change across a posterior: the sharper yardstick where posteriors are small, and no bound where they
are not, as with one sensor and while the end of the burn is open, for which the impact bends.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from boost_profile_flights import MARKS, PARTS, SENSORS, inverse, measured
from boost_profile_plot import Cell, plot

from opir_core.scene import TARGET_TYPES
from opir_core.scoring.consistency import consistency, containment

PAGE = """# The tracker boost-profile on its own family

Made by `python benchmarks/boost_profile.py --runs {runs} --batches {batches} --write docs/benchmarks`.

{docstring}

Up to {whole} runs a line (the column says how many count), so that a ratio is known to about {ratio:.0f} % (position,
velocity) and a share of 95 % lies in {low:.1f} to {high:.1f} % by chance. "/ bound" has its 95 % interval (bootstrap)
behind it. ANEES is of the state, over its six degrees of freedom; a star marks those outside their 99 % band, which is
{lower:.2f} to {upper:.2f} of all runs; p is that of Kolmogorov and Smirnov's test of the distribution. Containment is
that of the 50, 90 and 95 % ellipses of impact (no limit is set on their size here).

![Errors over the expected bound, ANEES, and shares of impacts in their 95 % ellipse](boost_profile.svg)

{table}
"""


def van_trees(sums: dict[str, Any]) -> dict[str, float]:
    """Return the bounds, squared, of position, velocity and impact, of the information and slopes averaged."""
    spread = inverse(np.array(sums["information"])[None])[0] * sums["count"]
    found = {}
    for name, part in PARTS.items():
        slopes = np.array(sums["slopes"])[part] / sums["landed" if name == "impact" else "count"]
        found[name] = float(np.trace(slopes @ spread @ slopes.T))
    return found


def ratio(rows: list[dict[str, float]], name: str, bound: float) -> tuple[str, float]:
    """Return RMSE over the bound (told squared) with its interval, and over the expected bound: the text, the last.

    The interval is of 1000 bootstrap samples of a fixed stream.
    """
    square = np.array([[row[name], row[f"{name} at the truth"]] for row in rows])
    square = square[np.isfinite(square).all(axis=1)]
    drawn = np.random.default_rng(1).integers(0, len(square), (1000, len(square)))
    low, high = np.quantile(np.sqrt(square[drawn, 0].mean(axis=1) / bound), (0.025, 0.975))
    whole = square.mean(axis=0)
    over = float(np.sqrt(whole[0] / whole[1]))
    return f"{np.sqrt(whole[0] / bound):.2f} ({low:.2f}, {high:.2f}) | {over:.2f}", over


def cells(kind: str, model: str, sensors: int, part: dict[str, Any]) -> Iterator[tuple[str, Cell]]:
    """Yield the lines of the table, a mark each, and what is drawn of each."""
    for mark, name in enumerate(MARKS):
        mine = [row for row in part["rows"] if row["mark"] == mark]
        if len(mine) < 2:
            continue
        state = consistency(np.array([row["nees"] for row in mine]), 6)
        impact = np.array([row["impact nees"] for row in mine])
        shares = [100.0 * containment(impact, 2, nominal)[0] for nominal in (0.5, 0.9, 0.95)]
        bound = van_trees(part["sums"][str(mark)])
        metres, speed, miss = (np.sqrt(np.nanmean([row[each] for row in mine])) for each in PARTS)
        told, over = zip(*(ratio(mine, each, bound[each]) for each in PARTS), strict=True)
        inside = "" if state.lower <= state.mean <= state.upper else " *"
        line = (
            f"| {kind} | {sensors} {model} | {name} | {len(mine)} | {metres:.0f} | {told[0]} | {speed:.1f} | {told[1]} "
            f"| {miss / 1e3:.1f} | {told[2]} | {state.mean / 6:.2f}{inside} | {state.p_value:.2f} "
            f"| {' / '.join(f'{share:.0f}' for share in shares)} |"
        )
        yield line, Cell(kind, model, sensors, mark, *over, state.mean / 6, shares[2])


_COLUMNS = (
    "class",
    "sensors",
    "when",
    "runs",
    "position, m",
    "/ bound",
    "/ expected",
    "velocity, m/s",
    "/ bound",
    "/ expected",
    "impact, km",
    "/ bound",
    "/ expected",
    "ANEES / 6",
    "p",
    "impact held, % of runs",
)
HEAD = [f"| {' | '.join(_COLUMNS)} |", "|" + "---|" * len(_COLUMNS)]


def main() -> None:
    """Measure what is asked for, or read what was measured, and print or write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=150, help="flights of a batch, flown together")
    parser.add_argument("--batches", type=int, default=1, help="so many batches, with seeds from the first on")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    found: list[tuple[str, Cell]] = []
    print("\n".join(HEAD))
    for sensors, model, kind in product((2, 1), SENSORS, TARGET_TYPES[::-1]):
        if chosen.only in (None, kind):
            seeds = range(chosen.seed, chosen.seed + chosen.batches)
            fresh = list(
                cells(kind, model, sensors, joined([part_of(kind, model, sensors, seed, chosen) for seed in seeds]))
            )
            print("\n".join(line for line, _ in fresh), flush=True)
            found += fresh
    if chosen.write:
        write(chosen.write, chosen.runs, chosen.batches, [*HEAD, *(line for line, _ in found)])
        plot([cell for _, cell in found], MARKS, chosen.write / "boost_profile.svg")


def part_of(kind: str, model: str, sensors: int, seed: int, chosen: argparse.Namespace) -> Any:
    """Return what came of a batch of one class and sensors, measured or read."""
    path = chosen.parts / f"{kind}-{model}-{sensors}-{chosen.runs}-{seed}.json" if chosen.parts else None
    if path and path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    if chosen.finished:
        return {"rows": [], "sums": {}}
    part = measured(kind, model, sensors, chosen.runs, seed).told()
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(part), encoding="utf-8")
    return part


def joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Return what came of several batches as one."""
    whole: dict[str, Any] = {"rows": [row for part in parts for row in part["rows"]], "sums": {}}
    for part in parts:
        for mark, fresh in part["sums"].items():
            kept = whole["sums"].get(mark, dict.fromkeys(fresh, 0.0))
            whole["sums"][mark] = {name: np.asarray(kept[name]) + np.asarray(fresh[name]) for name in fresh}
    return whole


def write(folder: Path, runs: int, batches: int, table: list[str]) -> None:
    """Write the page."""
    whole = runs * batches
    band = consistency(np.ones(whole), 6)
    page = PAGE.format(
        docstring="\n\n".join((__doc__ or "").strip().split("\n\n")[2:]),
        runs=runs,
        batches=batches,
        whole=whole,
        ratio=100.0 / np.sqrt(2 * 2.5 * whole),
        low=100.0 * (0.95 - 2.0 * np.sqrt(0.95 * 0.05 / whole)),
        high=100.0 * (0.95 + 2.0 * np.sqrt(0.95 * 0.05 / whole)),
        lower=band.lower / 6,
        upper=band.upper / 6,
        table="\n".join(table),
    )
    (folder / "boost_profile.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
