"""Page and plot of `boost_profile.py`, drawn from its CSV file."""

from collections.abc import Callable
from pathlib import Path

from result_files import (
    CLASS_COLOURS,
    RED,
    Row,
    column,
    markdown_table,
    number,
    read_csv,
    svg_plot,
)

PAGE = """# Accuracy and consistency of boost-profile

How accurate is `boost-profile`, and are its covariances consistent, when targets fly as its class priors state?

* Position RMSE is {position[0]} to {position[1]} times the expected bound, velocity RMSE {velocity[0]} to {velocity[1]}
  times.
* ANEES / 6 is {stereo[0]} to {stereo[1]} with two sensors and {mono[0]} to {mono[1]} with one. Of {cells} cells
  {outside} is outside its 99 % band, and {few_p} has p < {least_p} in the Kolmogorov–Smirnov test ({by_chance:.1f} by
  chance).
* The 95 % impact ellipses contain {contained[0]} to {contained[1]} % of the impacts.

![RMSE over the expected bound, ANEES, and impacts in the 95 % ellipse](boost_profile.svg)

SBIRS-GEO, 50 % of the median burn, 5 s after burnout:

{table}

[boost_profile.csv](boost_profile.csv) adds DSP, NEXTGEN-GEO, all times, bounds and intervals.

## Method

Flights are drawn from the tracker's priors, including the time under cloud. One or two equal
geostationary sensors observe them. The fit gets the detections and the class of each flight; data association is not
part of this benchmark. Impact ellipses of any size count.

**Times.** 20 s after the first detection; 50, 75 and 95 % of the class's median burn time after it, for flights
detected in the last second; 5 s after burnout, for flights that were detected for 20 s. The detections alone select
the flights; a selection by the unknown truth would make every posterior inconsistent.

**Bounds.** Information of the priors and of the detected lines of sight along the true flight. After burnout the end
of the burn counts as measured, as well as the detections give it. The start prior counts as normal, although no start
is after the first detection, so early errors may be below both bounds.

* *bound*: van Trees; information and Jacobians averaged over flights in heading axes, then inverted. It is far below
  the errors where flights differ in observability.
* *expected*: mean over flights of the inverse at the truth, after Gill and Levit (Bernoulli 1, 1995, 59) without the
  term of varying weights. It is no bound with one sensor, nor for impacts before burnout.

**Consistency.** With one sensor NEES is not χ²-distributed, for the posterior is not normal. The tracker therefore
reports the radii of its 50, 90 and 95 % ellipsoids (`state_sigmas`); NEES is rescaled by them. The 99 % band of
ANEES / 6 of {whole} flights is {lower:.2f} to {upper:.2f}. Intervals are bootstrap, or Wilson (containment).

**Doubtful cells** (ANEES, p, error above {efficient} of expected, containment outside {held[0]:.0f} to {held[1]:.0f} %)
are repeated with up to {fresh} other flights (`sample` is `repeat`): {few_again} of {again} has p < {least_p}.
[Exact posteriors](exact_posteriors.md) give containment to half a percent.

```
python benchmarks/boost_profile.py --runs {batch} --batches {batches} --again {again_batches} --write docs/benchmarks
python benchmarks/boost_profile.py --from-csv docs/benchmarks/boost_profile.csv
```
"""

#: Names of the times, in order.
TIMES = (
    "20 s after first detection",
    "50 % of median burn",
    "75 % of median burn",
    "95 % of median burn",
    "5 s after burnout",
)
SHORT_TIMES = ("20 s", "50 %", "75 %", "95 %", "burnout\n+ 5 s")

#: Below this p a distribution is in doubt.
LEAST_P = 0.01

#: Errors over the expected bound that are in doubt from half the burn on.
EFFICIENT = 1.1

#: Containment of 95 % ellipses that is not in doubt, %.
HELD = (93.0, 97.0)

CONTAINED = "impacts_in_95_ellipse_percent"
HEAD = ("class", "sensors", "time", "position, m", "velocity, m/s", "impact, km", "ANEES / 6", "contained, %")


def write_page(source: Path, band_of: Callable[[int], tuple[float, float]]) -> None:
    """Write page and plot beside a CSV file; `band_of` returns the 99 % band of ANEES / 6 of so many flights."""
    rows = read_csv(source)
    first, again = ([row for row in rows if row["sample"] == sample] for sample in ("first", "repeat"))
    stereo, mono = ([row for row in first if row["sensors"] == count] for count in ("2", "1"))
    sizes = [(int(part[0]["batch_size"]), int(part[0]["batches"])) if part else (0, 0) for part in (first, again)]
    band = band_of(sizes[0][0] * sizes[0][1])
    page = PAGE.format(
        **{name: limits(first, f"{name}_rmse_over_expected") for name in ("position", "velocity", "impact")},
        stereo=limits(stereo, "rescaled_anees_over_6"),
        mono=limits(mono, "rescaled_anees_over_6"),
        outside=sum(row["rescaled_anees_outside_band99"] == "1" for row in first),
        cells=len(first),
        few_p=unlikely(first),
        least_p=LEAST_P,
        by_chance=LEAST_P * len(first),
        contained=limits(first, CONTAINED),
        table=markdown_table(HEAD, [headline(row) for row in first if is_shown(row)]),
        lower=band[0],
        upper=band[1],
        whole=sizes[0][0] * sizes[0][1],
        fresh=sizes[1][0] * sizes[1][1],
        efficient=EFFICIENT,
        held=HELD,
        again=len(again),
        few_again=unlikely(again),
        batch=sizes[0][0],
        batches=sizes[0][1],
        again_batches=sizes[1][1],
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(first, source.with_suffix(".svg"))


def limits(rows: list[dict[str, str]], name: str) -> tuple[str, str]:
    """Return the least and the largest figure of a column, as they are written."""
    cells = sorted((row[name] for row in rows), key=float) or ["–"]
    return cells[0], cells[-1]


def unlikely(rows: list[dict[str, str]]) -> int:
    """Return how many distributions are in doubt."""
    return sum(number(row["ks_p"]) < LEAST_P for row in rows)


def is_shown(row: Row) -> bool:
    """Return whether the short table has a row."""
    return row["sensor_model"] == "SBIRS-GEO" and row["time"] in (TIMES[1], TIMES[-1])


def headline(row: Row) -> tuple[str, ...]:
    """Return a row of the short table."""
    return (
        row["class"],
        row["sensors"],
        "50 %" if row["time"] == TIMES[1] else "5 s",
        row["position_rmse_m"],
        row["velocity_rmse_m_s"],
        row["impact_rmse_km"],
        row["rescaled_anees_over_6"],
        row[CONTAINED],
    )


#: Columns of the plot: what is drawn, its title, and the value that is asked for.
PANELS = (
    ("position_rmse_over_expected", "position:\nRMSE / expected", EFFICIENT),
    ("velocity_rmse_over_expected", "velocity:\nRMSE / expected", EFFICIENT),
    ("impact_rmse_over_expected", "impact:\nRMSE / expected", EFFICIENT),
    ("rescaled_anees_over_6", "ANEES / 6\n(1 is consistent)", 1.0),
    (CONTAINED, "impacts in the\n95 % ellipse, %", 95.0),
)
STYLES = {"DSP": ":", "SBIRS-GEO": "--", "NEXTGEN-GEO": "-"}


def plot(rows: list[dict[str, str]], path: Path) -> None:
    """Draw two rows of panels, of two sensors and of one, a line for each class and sensor model."""
    with svg_plot(path, 2, len(PANELS), figsize=(13.0, 6.0), sharex=True, sharey="col") as (figure, grid):
        for line, sensors in zip(grid, ("2", "1"), strict=True):
            for axes, (name, title, asked) in zip(line, PANELS, strict=True):
                axes.axhline(asked, color=RED, linewidth=0.8)
                for model, style in STYLES.items():
                    for kind, colour in CLASS_COLOURS.items():
                        key = {"sensors": sensors, "class": kind, "sensor_model": model}
                        mine = [row for row in rows if key.items() <= row.items()]
                        places = [TIMES.index(row["time"]) for row in mine]
                        values, label = column(mine, name), f"{kind}, {model}"
                        axes.plot(places, values, style, color=colour, linewidth=1.4, label=label)
                axes.set_xticks(range(len(TIMES)), SHORT_TIMES, fontsize="small")
                axes.set_title(title if sensors == "2" else "", fontsize="medium")
                axes.grid(alpha=0.3)
            line[0].set_ylabel("two sensors" if sensors == "2" else "one sensor")
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
