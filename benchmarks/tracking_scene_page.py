"""Page and plot of `tracking_scene.py`, drawn from its CSV file."""

import sys
from pathlib import Path
from typing import Any

from peers import left_out

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from result_files import (
    BLUE,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    Row,
    estimate,
    markdown_table,
    number,
    read_csv,
    svg_plot,
    write_csv as write_csv,
)

PAGE = """# Tracking: every tracker on one scene

How accurate and how fast are opir's trackers and their peers on the same detections of one boosting ICBM?

imm at 1 s is {faster} times faster than Stone Soup's EKF at about the same error; kepler-arc is far from the
bound.

![Time per detection against RMSE over the bound with the thrust unknown](tracking_scene.svg)

{table}
{left_out}
One ICBM in boost, two SBIRS-GEO (10 looks a second each, P_d 0.8), {detections} detections in {runs} runs of
{duration} s (seeds {first} to {last}). Processor time of one core, of the tracker alone; ratios count, not times.
Position and velocity are RMSE over the Cramér–Rao bound with specific force and jerk in the state, from {start} s after
ignition on, with 95 % intervals over runs ([bounds](../how-to/score-tracks.md)). A tracker below 1 uses more than lines
of sight: imm assumes a boost about along the velocity. kepler-arc assumes a Keplerian arc, which a thrusting target
does not fly. The two share one data association; Stone Soup's trackers have their own.

Figures with the thrust known too: [tracking_scene.csv](tracking_scene.csv), by `--runs {runs}`.
"""

UNKNOWN = "rmse_over_bound_thrust_unknown"
#: Lines that are in the data and the plot, not in the table.
UNSHOWN = ("imm, 0.2 s", "imm, 5 s", "kepler-arc, memory 5 s, 1 s", "Stone Soup EKF, jerk, 1 s")
HEAD = (
    "tracker, cadence",
    "µs per detection",
    "faster than Stone Soup EKF",
    "position / bound",
    "velocity / bound",
)


def write_page(source: Path) -> None:
    """Write page and plot beside a CSV file."""
    rows = read_csv(source)
    first = rows[0]
    runs = int(rows[0]["runs"])
    page = PAGE.format(
        left_out=left_out(rows),
        table=markdown_table(HEAD, [cells(row) for row in rows if row["tracker"] not in UNSHOWN]),
        faster=next(
            (row["speed_over_stone_soup"] for row in rows if row["tracker"] == "imm, 1 s"), "–"
        ),
        detections=first["detections"],
        runs=runs,
        duration=first["duration_s"],
        first=first["first_seed"],
        last=int(first["first_seed"]) + runs - 1,
        start=first["errors_from_s"],
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(rows, source.with_suffix(".svg"))


def cells(row: Row) -> tuple[str, ...]:
    """Return a row of the table."""
    return (
        row["tracker"],
        row["time_per_detection_us"],
        row["speed_over_stone_soup"],
        estimate(row, f"position_{UNKNOWN}"),
        estimate(row, f"velocity_{UNKNOWN}"),
    )


#: What a line's name begins with, its colour and its markers.
MARKS = {
    "kepler-arc": (RED, "ov"),
    "imm": (BLUE, "os^D"),
    "Stone Soup EKF": (ORANGE, "os"),
    "Stone Soup UKF": (PURPLE, "D"),
    "FilterPy": (SKY, "X"),
}


def plot(rows: list[dict[str, str]], path: Path) -> None:
    """Draw time per detection against error over the bound with the thrust unknown."""
    with svg_plot(path, 1, 2, figsize=(11.0, 4.8), sharex=True) as (figure, pair):
        for axes, what in zip(pair, ("position", "velocity"), strict=True):
            draw(axes, rows, f"{what}_{UNKNOWN}")
            axes.set_ylabel(f"{what} RMSE / bound, thrust unknown")
            axes.set_xlabel("µs per detection")
            axes.grid(alpha=0.3)
        figure.legend(
            *pair[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
        )


def draw(axes: Any, rows: list[dict[str, str]], name: str) -> None:
    """Draw one panel."""
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.loglog()
    for begin, (colour, markers) in MARKS.items():
        mine = [row for row in rows if row["tracker"].startswith(begin)]
        for row, marker in zip(mine, markers, strict=False):
            place = number(row["time_per_detection_us"])
            axes.plot(
                (place, place),
                (number(row[f"{name}_low95"]), number(row[f"{name}_high95"])),
                color=colour,
            )
            axes.plot(place, number(row[name]), marker, color=colour, label=row["tracker"])
