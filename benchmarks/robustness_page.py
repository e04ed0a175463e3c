"""Page and plot of `robustness.py`, drawn from its CSV file."""

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from result_files import (
    CLASS_COLOURS,
    CLASS_MARKERS,
    GREY,
    RED,
    Row,
    column,
    estimate,
    markdown_table,
    number,
    read_csv,
    svg_plot,
)

PAGE = """# Robustness of boost-profile

What happens to `boost-profile` when a target, a sensor or the environment is outside its assumptions?

* Where the assumptions hold, its position error is {ratio_family} of stereo-filter's. For staged and tabulated boosts
  there is no gain.
* With two sensors the 95 % impact ellipses are consistent in every case whose error sources the tracker knows.
* It is overconfident where drag is not modelled, where pointing biases are not stated, and during the burn of staged
  and tabulated boosts (ANEES / 6 {staged} and {tabulated} at half the burn).
* With one sensor it reports few impacts of staged and tabulated boosts, and their ellipses are too small.

![Errors, ANEES and containment 5 s after burnout, by case](robustness.svg)

5 s after burnout, all classes, with 95 % intervals:

{table}

Ratio: position RMSE over that of [stereo-filter](../explanation/association.md) on the same detections and
associations. ANEES / 6: 1 is consistent, above 1 is overconfident. Reported: flights with a predicted impact point.
Contained: reported impacts inside the 95 % ellipse.

## Impacts before burnout

With `impacts_in_burn: true`, {family_share} % of the boost family's flights have an impact at 95 % of the burn, and
{family_held} % of these are contained. Of tabulated boosts {tabulated_share} % have one at half the burn, and
{tabulated_held} % are contained. Leave the option off unless targets fly as their class priors state.

## Method

Two SBIRS-GEO sensors, or one: 0.1 s scan period, 20 µrad, P_d 0.80, 0.72 and 0.60 for ICBM, IRBM and SRBM. Up to {runs}
flights a class. Type reports: UNKNOWN. The classes are equally likely a priori, so covariances can be consistent
for all classes together, not for each.

* *staged*: ICBM three stages, the others two, with gaps of 0.5 to 1.5 s. *tabulated*: thrust sags, pitch overshoots,
  heading changes.
* *J2 and drag*: ballistic coefficient 5000 kg/m² (notional). *Not modelled*: the tracker assumes two-body motion.
* *bias 3σ*: constant bias of each sensor and target, standard deviation 60 µrad an axis.
* *outliers*: uniform within 4.5σ of the target, or within 0.15 rad of the Earth's centre.

[robustness.csv](robustness.csv): every case, class and time (50 % and 95 % of the burn, 5 s and 20 s after burnout),
with medians and stereo-filter's figures; figures of fewer than 20 flights are empty.

```
python benchmarks/robustness.py --runs {runs} --write docs/benchmarks
python benchmarks/robustness.py --from-csv docs/benchmarks/robustness.csv
```
"""

WHEN, IN_BURN = "5 s after burnout", ("50 % of burn", "95 % of burn")
CONTAINED = "impacts_in_95_ellipse_percent"
HEAD = ("case", "position, m", "ratio", "ANEES / 6", "reported, %", "contained, %")


def write_page(source: Path, labels: Mapping[str, str]) -> None:
    """Write page and plot beside a CSV file; `labels` has the name of each case."""
    rows = read_csv(source)
    whole = [row for row in rows if row["class"] == "all" and row["time"] == WHEN]
    early = {
        "family": figures(rows, "family-asked", IN_BURN[1]),
        "tabulated": figures(rows, "tabulated-asked", IN_BURN[0]),
    }
    page = PAGE.format(
        table=markdown_table(HEAD, (headline(row, labels) for row in whole if not row["case"].endswith("-asked"))),
        ratio_family=figures(rows, "family", WHEN)["position_rmse_ratio"],
        staged=figures(rows, "staged", IN_BURN[0])["anees_over_6"],
        tabulated=figures(rows, "tabulated", IN_BURN[0])["anees_over_6"],
        **{f"{name}_share": row["impact_reported_percent"] for name, row in early.items()},
        **{f"{name}_held": estimate(row, CONTAINED) for name, row in early.items()},
        runs=max((row["flights"] for row in rows if row["class"] != "all"), key=int),
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(rows, labels, source.with_suffix(".svg"))


def figures(rows: list[dict[str, str]], case: str, when: str) -> Row:
    """Return the figures of all classes of a case at a time, dashes where there are none."""
    keys = {"case": case, "class": "all", "time": when}
    return next((row for row in rows if keys.items() <= row.items()), defaultdict(lambda: "–"))


def headline(row: Row, labels: Mapping[str, str]) -> tuple[str, ...]:
    """Return a case's row of the short table."""
    return (
        labels[row["case"]],
        row["position_rmse_m"],
        estimate(row, "position_rmse_ratio"),
        row["anees_over_6"],
        row["impact_reported_percent"],
        estimate(row, CONTAINED),
    )


#: Columns of the plot: what is drawn, its title, the value to expect, and the scale.
PANELS = (
    ("position_rmse_ratio", "position RMSE /\nstereo-filter", 1.0, "linear"),
    ("impact_rmse_ratio", "impact RMSE /\nstereo-filter", 1.0, "linear"),
    ("anees_over_6", "ANEES / 6\n(1 is consistent)", 1.0, "log"),
    ("impact_reported_percent", "impacts reported,\n%", 100.0, "linear"),
    (CONTAINED, "impacts in the\n95 % ellipse, %", 95.0, "linear"),
)


def plot(rows: list[dict[str, str]], labels: Mapping[str, str], path: Path) -> None:
    """Draw the figures 5 s after burnout, a line for each case: classes in colour, all of them in black."""
    names = list(dict.fromkeys(row["case"] for row in rows))
    late = [row for row in rows if row["time"] == WHEN]
    with svg_plot(path, 1, len(PANELS), figsize=(12.5, 6.0), sharey=True) as (figure, axes):
        for axis, (name, title, expected, scale) in zip(axes, PANELS, strict=True):
            draw(axis, late, names, name)
            axis.axvline(expected, color=RED, linewidth=0.8)
            axis.set_xscale(scale)
            axis.set_title(title, fontsize="medium")
            axis.grid(alpha=0.3)
        axes[0].set_yticks(range(len(names)), [labels[name] for name in names])
        axes[0].invert_yaxis()
        figure.legend(*axes[2].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)


def draw(axis: Any, rows: list[dict[str, str]], names: list[str], name: str) -> None:
    """Draw one column of the plot."""
    for kind, colour in CLASS_COLOURS.items():
        mine = [row for row in rows if row["class"] == kind]
        places = [names.index(row["case"]) for row in mine]
        axis.plot(column(mine, name), places, CLASS_MARKERS[kind], color=colour, markersize=4.5, label=kind)
    whole = [row for row in rows if row["class"] == "all"]
    places = [names.index(row["case"]) for row in whole]
    if name == "anees_over_6":
        axis.plot(column(whole, f"stereo_filter_{name}"), places, "|", color=GREY, markersize=9, label="stereo-filter")
    if f"{name}_low95" in rows[0]:
        for row, place in zip(whole, places, strict=True):
            ends = number(row[f"{name}_low95"]), number(row[f"{name}_high95"])
            axis.plot(ends, (place, place), color="black", linewidth=1.2)
    axis.plot(column(whole, name), places, "D", color="black", markersize=3.5, label="all classes")
