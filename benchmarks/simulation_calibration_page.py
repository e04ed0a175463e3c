"""The page and the plot of `simulation_calibration.py`, from its CSV.

python benchmarks/simulation_calibration_page.py docs/benchmarks
"""

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from result_files import BLUE, GREY, ORANGE, Row, markdown_table, read_csv, svg_plot
from scipy.stats import chi2, ncx2, norm

from opir_core.interfaces import TRACK_CONTAINMENTS

#: p above which ranks count as uniform.
LEAST_P = 0.01

PAGE = """# Is `imm` calibrated on its own prior?

If the world is as the tracker assumes, is the truth where it says, as often as it says? {verdict} of {tests} tests have
p above {least_p:g}.

{table}

![Ranks of the truth in what is reported](simulation_calibration.svg)

p of a χ² test, number of flights in brackets. A column is a time since the first detection. Of {flights} flights, the
test finds a standard deviation that is a fifth too small or too large in {fifth} %, one that is a third off in {third}.

## How it is asked

Simulation-based calibration ([Talts et al., 2018](https://arxiv.org/abs/1804.06788)): a truth is drawn from the prior
and observed. Its rank in the posterior is uniform if the tracker computes with that prior; too few ranks at both ends
say that what is reported is too wide, too many that it is too narrow. This says nothing of other flights: for them
there are [regions on foreign flights](tracker_honesty.md).

- **Flights**: missiles with log-uniform ranges and space launchers, with the stages, steering and failures of the
  tracker's prior, half from sites at sea level, half as high as land is; half are hidden by clouds for up to 80 s.
  SciPy flies them. Each is a scene of its own, before two SBIRS-GEO.
- **Launch**: ranks of place and time in the tracker's mixture over launch times and sites, which is kept after 10 s; of
  what is first seen in flight, in a normal distribution with the moments that ascents of the law leave.
- **State**: the containment of the ellipsoid of position and velocity on which the truth lies, up to 40 s after
  burnout: many ranks near 0 say that the covariance is too wide, near 1 that it is too narrow. Where it is wrong the
  filter is, and regions with it; where it is right and regions are wrong, the forecast.
- **Impact region**: the smallest of the 50, 90 and 95 % regions that holds the impact, or none; of regions whose
  condition ("the burn is over" or not) is true.
- **P(orbit), P(burn over)**: how often what is stated is true, in bins (Hosmer and Lemeshow). P(orbit) is given that it
  is a missile or reaches orbit, for neither gliders nor others are drawn. Numbers are in
  [simulation_calibration.csv](simulation_calibration.csv).

## What the standard deviation of a launch time means

The mixture is not normal. Of launches that are seen at once, it has some 95 % within a tenth of a second of the first
detection, and the rest seconds earlier, for a launch that clouds hid for a few seconds looks the same. The tracker
reports mean and variance of all of it: a standard deviation of one to three seconds where the error is mostly 0.1 s.
These moments are no interval: the mean of error² / variance is {square} (1 is consistent, above 1
is overconfident).

By `--flights N --write docs/benchmarks`, 150 by default, three minutes of processor time. Flights that clouds hide
throughout, and those without an estimate at a mark, are left out.
"""


def write_page(folder: Path) -> None:
    """Write the page and the plot beside the CSV."""
    rows = read_csv(folder / "simulation_calibration.csv")
    tested = [row for row in rows if row["p"]]
    marks = sorted({row["since_first_detection_s"] for row in tested}, key=float)
    names = list(dict.fromkeys(row["quantity"] for row in tested))
    cells = {
        (row["quantity"], row["since_first_detection_s"]): f"{row['p']} ({row['flights']})"
        for row in tested
    }
    table = markdown_table(
        ["", *(f"{mark} s" for mark in marks)],
        [[name, *(cells.get((name, mark), "–") for mark in marks)] for name in names],
    )
    square = [float(row["chi2"]) / float(row["degrees_of_freedom"]) for row in rows if not row["p"]]
    passed = sum(float(row["p"]) > LEAST_P for row in tested)
    flights = max(int(row["flights"]) for row in tested)
    page = PAGE.format(
        flights=flights,
        fifth=shares_found(flights, 1.2),
        third=shares_found(flights, 4.0 / 3.0),
        verdict="All" if passed == len(tested) else f"{passed}",
        tests=len(tested),
        least_p=LEAST_P,
        table=table,
        square=f"{square[0]:.2f}" if square else "unknown",
    )
    (folder / "simulation_calibration.md").write_text(page, encoding="utf-8")
    draw(
        [row for row in tested if row["quantity"][:2] != "P("],
        folder / "simulation_calibration.svg",
    )


def shares_found(flights: int, factor: float, bins: int = 10) -> str:
    """Return in how many of 100 cases the test of ranks finds a standard deviation larger or
    smaller by a factor.
    """
    edges = norm.ppf(np.linspace(0.0, 1.0, bins + 1))
    freedom = bins - 1
    percent = []
    for wrong in (factor, 1.0 / factor):
        share = np.diff(norm.cdf(edges * wrong))
        shift = flights * bins * float(np.sum(np.square(share - 1.0 / bins)))
        percent.append(100.0 * float(ncx2.sf(chi2.isf(LEAST_P, freedom), freedom, shift)))
    return f"{min(percent):.0f} to {max(percent):.0f}"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the counts of ranks over those expected, and two standard deviations about 1."""
    shares = [0.0, *TRACK_CONTAINMENTS, 1.0]
    with svg_plot(path, 3, 3, figsize=(10.0, 7.5), sharey=True) as (_, axes):
        for axis, row in zip(axes.ravel(), rows, strict=False):
            count = [float(each) for each in row["counts"].split()]
            total = sum(count)
            cells = row["quantity"] == "impact region"
            edges = (
                [*shares[: len(count)], 1.0]
                if cells
                else [place / len(count) for place in range(len(count) + 1)]
            )
            width = [high - low for low, high in pairwise(edges)]
            sigma = [2.0 * ((1.0 - share) / (share * total)) ** 0.5 for share in width]
            height = [each / (share * total) for each, share in zip(count, width, strict=True)]
            axis.bar(
                edges[:-1],
                height,
                width,
                align="edge",
                color=ORANGE if cells else BLUE,
                edgecolor="white",
            )
            centre = [low + 0.5 * share for low, share in zip(edges, width, strict=False)]
            axis.errorbar(centre, [1.0] * len(count), sigma, fmt="none", ecolor=GREY, linewidth=1.0)
            axis.axhline(1.0, color=GREY, linewidth=0.8)
            axis.set_title(f"{row['quantity']}, {row['since_first_detection_s']} s", fontsize=10)
            axis.set(xlabel="containment" if cells else "rank", xlim=(0.0, 1.0))
        for axis in axes[:, 0]:
            axis.set_ylabel("count / expected")


if __name__ == "__main__":
    write_page(Path(sys.argv[1]))
