"""boost-profile on targets of its own family: error over the bound, consistency, and what impact ellipses hold.

    python benchmarks/boost_profile.py [--runs 150] [--batches 4] [--again 2] [--only SRBM] [--parts FOLDER]
                                       [--write FOLDER]

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
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import numpy as np
from boost_profile_flights import MARKS, PARTS, SENSORS, inverse, measured
from boost_profile_plot import Cell, plot

from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import consistency, containment

PAGE = """# The tracker boost-profile on its own family

Made by `python benchmarks/boost_profile.py --runs {runs} --batches {batches} --again {fresh} --write docs/benchmarks`.

{docstring}

Up to {whole} runs a line (the column says how many count), so that a ratio is known to about {ratio:.0f} % (position,
velocity) and a share of 95 % lies in {low:.1f} to {high:.1f} % by chance. "/ bound" and "/ expected" have their 95 %
intervals behind them (bootstrap over flights). ANEES is of the state, over its six degrees of freedom, with its own
99 % interval (bootstrap); a dagger marks those whose interval leaves out 1.
Containment is that of the 50, 90 and 95 % ellipses of impact (no limit is set on their size here), the last with its
95 % interval (Wilson).

Of what one sensor sees the posterior is no normal distribution. Where mean and covariance told are exactly its own,
NEES still has a mean of 6, but no χ² distribution: most flights lie lower and a few far higher. So the tracker tells
how far the ellipsoids reach that hold 50, 90 and 95 % of its states (`state_sigmas`), and "as told" is ANEES on their
scale, on which what is told right has χ²'s distribution. A star marks what is outside its 99 % band, {lower:.2f} to
{upper:.2f} of all runs; p is that of Kolmogorov and Smirnov's test of the distribution on this scale. It is below
{least_p} in {few} of {cells} cells, where chance alone has it so in {by_chance:.1f}. How much of exact posteriors lies
in the same ellipses, and in the ellipsoids of states, another [benchmark](exact_posteriors.md) tells to half a percent.

![Errors over the expected bound, ANEES, and shares of impacts in their 95 % ellipse](boost_profile.svg)

{table}
{again}"""

AGAIN = """
## Cells in doubt, of other flights

Cells with a star or a dagger above, or p below 0.01, those of half a burn or more with errors over 1.10 of what is
expected, and those whose 95 % ellipses hold fewer than 93 or more than 97 %, are told again of up to {whole} other
flights, none of those above among them: flights that have raised a doubt cannot settle it, for of so many cells the
farthest off are the unluckiest. p is below {least_p} in {few} of {cells}.

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


class Line(NamedTuple):
    """A line of the table, what is drawn of it, and whether any of it is outside what is asked of it."""

    text: str
    cell: Cell
    p_value: float
    is_doubted: bool


def drawn(count: int, samples: int) -> np.ndarray:
    """Return bootstrap samples (samples, count) of flights, of a fixed stream."""
    return np.random.default_rng(1).integers(0, count, (samples, count))


def ratio(rows: list[dict[str, float]], name: str, bound: float) -> tuple[str, float]:
    """Return RMSE over the bound (told squared) and the expected bound, with 95 % intervals: the text, the last."""
    square = np.array([[row[name], row[f"{name} at the truth"]] for row in rows])
    square = square[np.isfinite(square).all(axis=1)]
    sampled, whole = square[drawn(len(square), 1000)].mean(axis=1), square.mean(axis=0)
    texts = []
    for over in (lambda means: np.sqrt(means[..., 0] / bound), lambda means: np.sqrt(means[..., 0] / means[..., 1])):
        low, high = np.quantile(over(sampled), (0.025, 0.975))
        texts.append(f"{over(whole):.2f} ({low:.2f}, {high:.2f})")
    return " | ".join(texts), float(np.sqrt(whole[0] / whole[1]))


def anees(values: np.ndarray, as_told: np.ndarray) -> tuple[str, float, float, bool]:
    """Return ANEES of values (n,), over six, with its interval, as told, and p; that told, p, and if it is doubted."""
    told, over = consistency(as_told, 6), values / 6.0
    low, high = np.quantile(over[drawn(len(over), 4000)].mean(axis=1), (0.005, 0.995))
    wide, far = "" if low <= 1.0 <= high else " †", "" if told.is_inside else " *"
    text = f"{over.mean():.2f} ({low:.2f}, {high:.2f}){wide} | {told.mean / 6.0:.2f}{far} | {told.p_value:.2f}"
    return text, told.mean / 6.0, told.p_value, bool(wide + far) or told.p_value < _LEAST_P


def held_of(impact: np.ndarray) -> tuple[float, ...]:
    """Return which shares of impacts, by their NEES (n,), the 50, 90 and 95 % ellipses hold, the last with limits."""
    found = [containment(impact, 2, nominal) for nominal in (0.5, 0.9, 0.95)]
    return *(each[0] for each in found), *found[-1][1:]


def cells(kind: str, model: str, sensors: int, part: dict[str, Any]) -> Iterator[Line]:
    """Yield the lines of the table, a mark each."""
    for mark, name in enumerate(MARKS):
        mine = [row for row in part["rows"] if row["mark"] == mark]
        if len(mine) < 2:
            continue
        state, over_six, p_value, is_doubted = anees(
            *(np.array([row[each] for row in mine]) for each in ("nees", "told nees"))
        )
        impact = np.array([row["impact nees"] for row in mine])
        *shares, low, high = (100.0 * each for each in held_of(impact))
        bound = van_trees(part["sums"][str(mark)])
        metres, speed, miss = (np.sqrt(np.nanmean([row[each] for row in mine])) for each in PARTS)
        told, over = zip(*(ratio(mine, each, bound[each]) for each in PARTS), strict=True)
        text = (
            f"| {kind} | {sensors} {model} | {name} | {len(mine)} | {metres:.0f} | {told[0]} | {speed:.1f} | {told[1]} "
            f"| {miss / 1e3:.1f} | {told[2]} | {state} "
            f"| {' / '.join(f'{share:.0f}' for share in shares)} ({low:.0f}, {high:.0f}) |"
        )
        is_doubted |= (mark > 0 and max(over) > _EFFICIENT) or not _HELD[0] <= shares[2] <= _HELD[1]
        yield Line(text, Cell(kind, model, sensors, mark, *over, over_six, shares[2]), p_value, is_doubted)


#: What errors over the expected bound are to stay below from half a burn on.
_EFFICIENT = 1.1

#: Below this p a distribution is in doubt.
_LEAST_P = 0.01

#: How many of impacts 95 % ellipses are to hold, %.
_HELD = (93.0, 97.0)

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
    "as told",
    "p",
    "impact held, % of runs",
)
HEAD = [f"| {' | '.join(_COLUMNS)} |", "|" + "---|" * len(_COLUMNS)]


def main() -> None:
    """Measure what is asked for, or read what was measured, and print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=150, help="flights of a batch, flown together")
    parser.add_argument("--batches", type=int, default=1, help="so many batches, with seeds from the first on")
    parser.add_argument(
        "--again", type=int, default=0, help="tell cells in doubt again, of so many batches of other flights"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=TARGET_TYPES)
    parser.add_argument("--parts", type=Path, help="folder in which finished parts are kept and looked for")
    parser.add_argument("--finished", action="store_true", help="show what is in that folder, and measure nothing")
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    found: list[Line] = []
    again: list[Line] = []
    print("\n".join(HEAD))
    for sensors, model, kind in product((2, 1), SENSORS, TARGET_TYPES[::-1]):
        if chosen.only in (None, kind):
            fresh = list(cells(kind, model, sensors, batches_of(kind, model, sensors, seeds_of(chosen), chosen)))
            print("\n".join(line.text for line in fresh), flush=True)
            found += fresh
    for sensors, model, kind in product((2, 1), SENSORS, TARGET_TYPES[::-1]):
        doubted = {line.cell.mark for line in found if line.is_doubted and line.cell[:3] == (kind, model, sensors)}
        if doubted and chosen.again:
            fresh = batches_of(kind, model, sensors, seeds_of(chosen, is_again=True), chosen)
            again += [line for line in cells(kind, model, sensors, fresh) if line.cell.mark in doubted]
    print("\n".join(line.text for line in again))
    if chosen.write:
        write(chosen.write, chosen, found, again)
        plot([line.cell for line in found], MARKS, chosen.write / "boost_profile.svg")


def seeds_of(chosen: argparse.Namespace, *, is_again: bool = False) -> range:
    """Return the seeds of the batches of all cells, or of those behind them, with which cells in doubt are told."""
    first = chosen.seed + chosen.batches * is_again
    return range(first, first + (chosen.again if is_again else chosen.batches))


def batches_of(kind: str, model: str, sensors: int, seeds: range, chosen: argparse.Namespace) -> dict[str, Any]:
    """Return what came of batches of one class and sensors."""
    return joined([part_of(kind, model, sensors, seed, chosen) for seed in seeds])


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


def write(folder: Path, chosen: argparse.Namespace, found: list[Line], again: list[Line]) -> None:
    """Write the page."""
    whole = chosen.runs * chosen.batches
    band = consistency(np.ones(whole), 6)
    more = AGAIN.format(
        whole=chosen.runs * chosen.again,
        least_p=_LEAST_P,
        few=sum(line.p_value < _LEAST_P for line in again),
        cells=len(again),
        table="\n".join([*HEAD, *(line.text for line in again)]),
    )
    page = PAGE.format(
        docstring="\n\n".join((__doc__ or "").strip().split("\n\n")[2:]),
        runs=chosen.runs,
        batches=chosen.batches,
        fresh=chosen.again,
        whole=whole,
        ratio=100.0 / np.sqrt(2 * 2.5 * whole),
        low=100.0 * (0.95 - 2.0 * np.sqrt(0.95 * 0.05 / whole)),
        high=100.0 * (0.95 + 2.0 * np.sqrt(0.95 * 0.05 / whole)),
        lower=band.lower / 6,
        upper=band.upper / 6,
        cells=len(found),
        few=sum(line.p_value < _LEAST_P for line in found),
        least_p=_LEAST_P,
        by_chance=_LEAST_P * len(found),
        table="\n".join([*HEAD, *(line.text for line in found)]),
        again=more if again else "",
    )
    (folder / "boost_profile.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
