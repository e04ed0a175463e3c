"""Every public function in float64 against 40 digits, with condition numbers, at inputs drawn.

    python -m benchmarks.stability [--draws 1000] [--seed 1] [--quick] [--only NAME] [--write
    docs/benchmarks]

Draws are usual inputs and those at the ends of what a double holds. Floating-point warnings are
errors. `--quick` draws 20 of each; `--write` puts the page, the plot and a CSV with the worst input
of every function into a folder.
"""

import argparse
import csv
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from exact_cases import every_bound, every_case, left_out
from exact_cases.measure import ROUNDOFF, Outcome, Searched, measured, row_text, searched

QUICK = 20

PAGE = """# Numerical stability

Does opir lose digits that its inputs do not?

{answer} {count} inputs were drawn for {functions} functions, each computed in float64 and in 40 digits or more.

![Relative error against condition number of all draws, and the condition number of two-body arcs](stability.svg)

The relative error of a good formula is about (1 + κ) u (the line on the left): u = 1.1·10⁻¹⁶ is the rounding of a
double, and the condition number κ is the factor by which an input's relative change grows on its way to the result.
So 10⁻⁹ may be right, and 10⁻¹⁴ a defect. On the right κ of `propagate_kepler` by number of turns and speed: after a
thousand turns three digits are gone, whatever computes them. The largest errors over (1 + κ) u: {worst}.

`chain` is a whole look, up to ten years after the scene's epoch, in which the Earth's angle, in a double, loses 0.2 mm
of a satellite's way.

[All functions](stability.csv), those that work to a tolerance too, with the input of the largest error, and with
reasons for those left out. No draw raised a warning or an overflow, and no result was `nan` where a number exists. By
`--draws {draws} --seed {seed}`; the tests run each case with fewer draws.
"""


def main() -> None:
    """Draw, compare, and print or write what was found."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=1000,
        help="inputs of each function; slow references take fewer",
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} draws of each")
    parser.add_argument("--only", default="", help="functions whose name contains this")
    parser.add_argument("--write", type=Path, help="folder for the page, the plot and the CSV")
    chosen = parser.parse_args()
    draws = QUICK if chosen.quick else chosen.draws
    warnings.simplefilter("error")
    outcomes = [
        shown(measured(case, generator(chosen.seed, case.name), draws))
        for case in every_case()
        if chosen.only in case.name
    ]
    bounds = [
        shown(searched(case, generator(chosen.seed, case.name), draws))
        for case in every_bound()
        if chosen.only in case.name
    ]
    if chosen.write:
        write(chosen.write, outcomes, bounds, draws, chosen.seed)


def generator(seed: int, name: str) -> np.random.Generator:
    """Return the random numbers of a case: its own, whatever cases there are beside it."""
    return np.random.default_rng([seed, *name.encode()])


def shown(found: Any) -> Any:
    """Print the worst of a function, and return what was found."""
    row = found.worst
    if isinstance(found, Outcome):
        text = (
            f"error {found.error[row]:.1e}, condition {found.condition[row]:.1e}, scaled"
            f" {found.scaled[row]:.2g}"
        )
        text += f", raised {len(found.raised)}" * bool(found.raised)
    else:
        text = f"error {found.error[row]:.1e}, over its bound {found.ratio[row]:.2g}"
    print(f"{found.case.name}: {len(found.error)} draws, {text}", flush=True)
    return found


def write(
    folder: Path, outcomes: list[Outcome], bounds: list[Searched], draws: int, seed: int
) -> None:
    """Write the page, the CSV and the plot."""
    order = sorted(outcomes, key=lambda found: -found.scaled[found.worst])
    largest = order[0].scaled[order[0].worst]
    raised = sum(len(found.raised) for found in outcomes)
    kept = max((found.ratio[found.worst] for found in bounds), default=0.0)
    answer = (
        f"No. The largest error of any function is {largest:.2g} times what rounding its inputs"
        f" does, and every"
        f" tolerance is kept: at most {kept:.0%} of it is used."
        if largest < 100.0 and kept <= 1.0 and not raised
        else f"Yes: see the table; {raised} draws raised."
    )
    (folder / "stability.md").write_text(
        PAGE.format(
            answer=answer,
            count=f"{sum(len(found.error) for found in [*outcomes, *bounds]):,}".replace(",", " "),
            functions=len({found.case.name.partition(",")[0] for found in [*outcomes, *bounds]}),
            worst=worst_listed(order[:3]),
            draws=draws,
            seed=seed,
        ),
        encoding="utf-8",
    )
    with (folder / "stability.csv").open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(
            ["function", "draws", "error", "condition", "error_over_rounding_or_bound", "input"]
        )
        for found in outcomes:
            rows.writerow(csv_row(found, found.condition[found.worst], found.scaled[found.worst]))
        for found in bounds:
            rows.writerow(csv_row(found, np.nan, found.ratio[found.worst]))
        for name, reason in left_out().items():
            rows.writerow([name, 0, "", "", "", f"left out: {reason}"])
    plot(outcomes, folder / "stability.svg")


def csv_row(found: Any, condition: float, over: float) -> list[Any]:
    row = found.worst
    figures = [f"{value:.3g}" for value in (found.error[row], condition, over)]
    return [found.case.name, len(found.error), *figures, row_text(found.inputs, row)]


def worst_listed(order: list[Outcome]) -> str:
    return ", ".join(f"{found.scaled[found.worst]:.2g} (`{found.case.name}`)" for found in order)


def plot(outcomes: list[Outcome], path: Path) -> None:
    """Draw errors against condition numbers, and the condition of two-body arcs."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    import matplotlib.pyplot as plt

    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    condition = np.concatenate([found.condition for found in outcomes])
    error = np.concatenate([found.error for found in outcomes])
    has_both = (error > 0.0) & (condition > 0.0) & np.isfinite(error)
    kept = np.clip(condition[has_both], 1e-3, 1e12), np.clip(error[has_both], 1e-19, 1.0)
    left.hexbin(
        *kept, xscale="log", yscale="log", gridsize=60, bins="log", mincnt=1, cmap="viridis"
    )
    line = np.geomspace(1e-3, 1e12, 60)
    left.plot(line, (1.0 + line) * ROUNDOFF, "r-", linewidth=1.0)
    left.set_xlabel("condition number κ")
    left.set_ylabel("relative error")
    arcs = next((found for found in outcomes if found.case.name == "flight.propagate_kepler"), None)
    if arcs is not None:
        position, velocity, duration = arcs.inputs
        radius = np.sqrt((position**2).sum(axis=1))
        speed = np.sqrt((velocity**2).sum(axis=1)) / np.sqrt(3.986004418e14 / radius)
        turns = np.abs(duration) / (2.0 * np.pi * radius / np.sqrt(3.986004418e14 / radius))
        rows = (arcs.condition > 0.0) & (turns > 1e-9)
        cells = right.scatter(
            turns[rows], speed[rows], c=np.log10(arcs.condition[rows]), s=9, cmap="viridis"
        )
        right.set_xscale("log")
        right.set_yscale("log")
        right.set_xlabel("duration, turns of the circular orbit")
        right.set_ylabel("speed over circular speed")
        figure.colorbar(cells, label="log10 κ")
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    main()
