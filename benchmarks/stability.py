"""Every public function in float64 against 40 digits, with condition numbers, at inputs drawn.

Draws are usual inputs and those at the ends of what a double holds. Floating-point warnings are
errors. `--quick` draws 20 of each.
"""

import sys
import warnings
from pathlib import Path

import numpy as np
from pages import Table, options_of, publish, svg_plot

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))
from exact_cases import every_bound, every_case, left_out
from exact_cases.measure import ROUNDOFF, measured, row_text, searched

MU_M3_S2 = 3.986004418e14

PAGE = """# Numerical stability

Does opir lose digits that its inputs do not?

{answer} {count} inputs were drawn for {functions} functions, each computed in float64 and in 40
digits or more.

![Error against condition number, and the condition number of two-body arcs](stability.svg)

The relative error of a good formula is about (1 + κ) u (the line on the left): u = 1.1·10⁻¹⁶ is
the rounding of a double, and the condition number κ is the factor by which an input's relative
change grows on its way to the result. So 10⁻⁹ may be right, and 10⁻¹⁴ a defect. On the right κ of
`propagate_kepler` by number of turns and speed: after a thousand turns three digits are gone,
whatever computes them. The largest errors over (1 + κ) u: {worst}.

`chain` is a whole look, up to ten years after the scene's epoch, in which the Earth's angle, in a
double, loses 0.2 mm of a satellite's way.

[All functions](stability.csv), those that work to a tolerance too, with the input of the largest
error, and with reasons for those left out. No draw raised a warning or an overflow, and no result
was `nan` where a number exists. By `--draws {draws} --seed {seed}`; the tests run each case with
fewer draws.
"""


def generator(seed, name):
    """Return the random numbers of a case: its own, whatever cases there are beside it."""
    return np.random.default_rng([seed, *name.encode()])


def rows_of(outcomes, options, facts):
    """Yield the row of each function, and keep outcomes for the plot."""
    draws = 20 if options.quick else options.draws
    facts |= {"draws": draws, "seed": options.seed, "raised": 0}
    for case in every_case():
        if options.only in case.name:
            outcome = measured(case, generator(options.seed, case.name), draws)
            outcomes.append(outcome)
            facts["raised"] += len(outcome.raised)
            condition = float(outcome.condition[outcome.worst])
            yield row_of(outcome, condition, outcome.scaled[outcome.worst])
    for bound in every_bound():
        if options.only in bound.name:
            result = searched(bound, generator(options.seed, bound.name), draws)
            yield row_of(result, np.nan, result.ratio[result.worst])
    for name, reason in left_out().items():
        blank = {"error": "", "condition": "", "error_over_rounding_or_bound": ""}
        yield {"function": name, "draws": 0, **blank, "input": f"left out: {reason}"}


def row_of(result, condition, ratio):
    """Return the row of a function at the input with the largest error."""
    return {
        "function": result.case.name,
        "draws": len(result.error),
        "error": float(result.error[result.worst]),
        "condition": condition,
        "error_over_rounding_or_bound": float(ratio),
        "input": row_text(result.inputs, result.worst),
    }


def page(table):
    """Return the page."""
    column = "error_over_rounding_or_bound"
    drawn = Table(row for row in table if row["draws"])
    exact = sorted((row for row in drawn if row["condition"] != ""), key=lambda row: -row[column])
    bounds = [row[column] for row in drawn if row["condition"] == ""]
    raised = table.facts["raised"]
    answer = f"Yes: see the table; {raised} draws raised."
    if exact[0][column] < 100.0 and max(bounds, default=0.0) <= 1.0 and not raised:
        answer = (
            f"No. The largest error of any function is {exact[0][column]:.2g} times what rounding"
            " its inputs does, and every tolerance is kept: at most"
            f" {max(bounds, default=0.0):.0%} of it is used."
        )
    return PAGE.format(
        answer=answer,
        count=f"{sum(drawn.column('draws')):,}".replace(",", " "),
        functions=len({row["function"].partition(",")[0] for row in drawn}),
        worst=", ".join(f"{row[column]:.2g} (`{row['function']}`)" for row in exact[:3]),
        **table.facts,
    )


def draw(path, outcomes):
    """Draw errors against condition numbers, and the condition of two-body arcs."""
    with svg_plot(path, 1, 2, figsize=(10.0, 4.2)) as (figure, (left, right)):
        condition = np.concatenate([outcome.condition for outcome in outcomes])
        error = np.concatenate([outcome.error for outcome in outcomes])
        drawn = (error > 0.0) & (condition > 0.0) & np.isfinite(error)
        across = np.clip(condition[drawn], 1e-3, 1e12)
        up = np.clip(error[drawn], 1e-19, 1.0)
        scales = {"xscale": "log", "yscale": "log", "bins": "log"}
        left.hexbin(across, up, gridsize=60, mincnt=1, **scales)
        line = np.geomspace(1e-3, 1e12, 60)
        left.plot(line, (1.0 + line) * ROUNDOFF, "r-", linewidth=1.0)
        left.set(xlabel="condition number κ", ylabel="relative error")
        for arcs in outcomes:
            if arcs.case.name == "flight.propagate_kepler":
                position, velocity, duration = arcs.inputs
                radius = np.sqrt((position**2).sum(axis=1))
                circular = np.sqrt(MU_M3_S2 / radius)
                speed = np.sqrt((velocity**2).sum(axis=1)) / circular
                turns = np.abs(duration) * circular / (2.0 * np.pi * radius)
                rows = (arcs.condition > 0.0) & (turns > 1e-9)
                digits = np.log10(arcs.condition[rows])
                cells = right.scatter(turns[rows], speed[rows], c=digits, s=9)
                figure.colorbar(cells, label="log10 κ")
        right.set(xscale="log", yscale="log", ylabel="speed over circular speed")
        right.set_xlabel("duration, turns of the circular orbit")


def main():
    """Draw and compare; write page, plot and data where asked."""
    options = options_of(__doc__, draws=1000, seed=1, quick=False, only="")
    warnings.simplefilter("error")
    outcomes = []
    facts = {}
    rows = [] if options.from_csv else list(rows_of(outcomes, options, facts))
    warnings.simplefilter("default")
    # The plot shows all draws, the data the worst of each function.
    plot = None if options.from_csv else lambda path, _: draw(path, outcomes)
    publish(options, page, plot, facts, stability=rows)


if __name__ == "__main__":
    main()
