"""Page and plot of `exact_posteriors.py`, drawn from its CSV file."""

from pathlib import Path

import numpy as np
from result_files import CLASS_COLOURS, RED, column, markdown_table, read_csv, svg_plot

PAGE = """# Containment of boost-profile against exact posteriors

How much of the exact posterior do the ellipses and ellipsoids of `boost-profile` contain?

The median over cells is within {worst:.1f} percentage points of the nominal share. A cell is a class, a sensor model
and a time, with {sensors} sensor{plural}; {few} of {cells} cells have at least {least} flights and count here:

{table}

![Contained share of the exact posterior, by class, sensor model and time](exact_posteriors.svg)

Error bars are standard errors of the mean over flights. [exact_posteriors.csv](exact_posteriors.csv) has all cells.

## Method

One flight either lies in an ellipse or not, so that a share of 95 % needs thousands of flights. The contained share of
the exact posterior, given a flight's detections, needs few. Flights, detections and times are those of
[boost_profile](boost_profile.md): {drawn} flights a class and sensor model.

* **Exact.** Nothing is linearised: likelihoods of the trajectories themselves, of the first detection, and of the
  missed detections since the last one; priors of the natural parameters.
* **Importance sampling.** {samples} boosts a flight, drawn from a mixture of Student's t distributions about hypotheses
  that are fitted near several starts and burnouts, and weighted by the posterior over that mixture.
* **Exclusion.** A flight counts if its effective sample size is above {effective:.0f}. The excluded posteriors are the
  widest or the narrowest: 5 s after burnout {late} of {late_of} flights count.

```
python benchmarks/exact_posteriors.py --runs {drawn} --samples {samples}{option} --write docs/benchmarks
python benchmarks/exact_posteriors.py --from-csv docs/benchmarks/exact_posteriors.csv
```
"""

#: Names of the times, in order, and how the plot has them.
TIMES = {
    "20 s after first detection": "20 s",
    "50 % of median burn": "50 %",
    "75 % of median burn": "75 %",
    "95 % of median burn": "95 %",
    "5 s after burnout": "burnout\n+ 5 s",
}

#: An effective sample size up to this is too small.
EFFECTIVE = 60.0

#: The short table leaves out cells of fewer flights.
LEAST = 20

NOMINAL = (50, 90, 95)
HEAD = ("contained share", "nominal", "median cell", "least", "largest")
MARKERS = {"DSP": "o", "SBIRS-GEO": "s", "NEXTGEN-GEO": "^"}


def share(nominal: int, what: str) -> str:
    """Return the name of a column."""
    return f"posterior_in_{nominal}_{what}_region_percent"


def write_page(source: Path) -> None:
    """Write page and plot beside a CSV file."""
    rows = read_csv(source)
    known = [row for row in rows if int(row["flights_counted"]) >= LEAST]
    late = [row for row in rows if row["time"] == "5 s after burnout"]
    names = {f"{what}, {nominal} % region": share(nominal, what) for what in ("impact", "state") for nominal in NOMINAL}
    table = [
        summary(known, label, name, nominal) for (label, name), nominal in zip(names.items(), 2 * NOMINAL, strict=True)
    ]
    page = PAGE.format(
        worst=max(abs(np.median(column(known, share(n, what))) - n) for n in NOMINAL for what in ("impact", "state")),
        few=len(known),
        cells=len(rows),
        sensors={"1": "one", "2": "two"}[rows[0]["sensors"]],
        plural="" if rows[0]["sensors"] == "1" else "s",
        least=LEAST,
        table=markdown_table(HEAD, [*table, summary(known, "NEES / 6 (median of flights)", "median_nees_over_6", 1)]),
        drawn=rows[0]["flights_drawn"],
        samples=rows[0]["samples_per_posterior"],
        effective=EFFECTIVE,
        late=sum(int(row["flights_counted"]) for row in late),
        late_of=sum(int(row["flights"]) for row in late),
        option="" if rows[0]["sensors"] == "1" else f" --sensors {rows[0]['sensors']}",
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(rows, source.with_suffix(".svg"))


def summary(rows: list[dict[str, str]], label: str, name: str, nominal: int) -> tuple[str, ...]:
    """Return a row of the short table: the median, least and largest figure of a column."""
    cells = sorted((row[name] for row in rows), key=float) or ["–"]
    return label, str(nominal), cells[len(cells) // 2], cells[0], cells[-1]


def plot(rows: list[dict[str, str]], path: Path) -> None:
    """Draw contained shares with their standard errors."""
    series = [(kind, model) for model in MARKERS for kind in CLASS_COLOURS]
    with svg_plot(path, 2, len(NOMINAL), figsize=(12.0, 6.5), sharex=True, sharey="col") as (figure, grid):
        for line, what in zip(grid, ("impact", "state"), strict=True):
            for axes, nominal in zip(line, NOMINAL, strict=True):
                name = share(nominal, what)
                axes.axhline(nominal, color=RED, linewidth=0.8)
                for number, (kind, model) in enumerate(series):
                    mine = [row for row in rows if (row["class"], row["sensor_model"]) == (kind, model)]
                    places = [list(TIMES).index(row["time"]) + 0.08 * (number - 4) for row in mine]
                    errors = column(mine, f"{name}_standard_error")
                    axes.errorbar(
                        places,
                        column(mine, name),
                        errors,
                        fmt=MARKERS[model],
                        color=CLASS_COLOURS[kind],
                        markersize=3.5,
                        linewidth=1.0,
                        label=f"{kind}, {model}",
                    )
                axes.set_xticks(range(len(TIMES)), TIMES.values(), fontsize="small")
                axes.set_title(f"{nominal} % regions" if what == "impact" else "", fontsize="medium")
                axes.grid(alpha=0.3)
            line[0].set_ylabel(f"{what}: contained, %")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
