"""CSV file, page and plot of `tracking.py`."""

import re
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from peers import left_out, times_faster

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from result_files import (
    BLUE,
    ORANGE,
    PURPLE,
    RED,
    SKY,
    Row,
    markdown_table,
    number,
    read_csv,
    svg_plot,
    write_csv,
)

__all__ = ["Line", "RaidLines", "raid_rows", "single_rows", "write_csv", "write_page"]

PAGE = """# Tracking: run time against error

What does `imm` cost, and what does it reach, compared with Stone Soup and FilterPy on the same detections?

On one target it reaches the Cramér–Rao bound, {single_faster} times faster than Stone Soup's EKF at 1 s. On a hundred
targets with clutter it is {raid_faster} to {spread_faster} times faster than its GNN; the table has GOSPA.

![Left: time per detection against RMSE over the bound. Right: time per frame against GOSPA per target](tracking.svg)

Processor time of one core; ratios count, not times. [tracking.csv](tracking.csv) has all figures.
{left_out}
**One target, association known.** Two geostationary sensors, 10 looks a second each, 20 µrad an axis, {duration} s of
free flight, initial error 1 km and 50 m/s. RMSE of the final position over {runs} runs (to about {interval:.0f} %); the
peers, and the line "same runs", have the first {peer_runs} only. The bound for known dynamics is {bound} m.

{single}

**A hundred targets, association unknown.** P_d 0.9, 20 clutter points a frame, 20 frames a second, {raid_duration} s;
targets spread over 2000 km or within 100 km (raid). GOSPA (c = 5 km, p = 2, alpha = 2) per target over the last half:
median of {seeds} seeds [least, largest]; for Stone Soup the first seed. With the true association `imm` has {known} m
in both. Its constants were tuned on seeds 0 to 15. Slices of 1 s (`slice_s`):

{raid}

By `--runs {runs} --peer-runs {peer_runs} --raid-seeds {seeds}`.
"""


class Line(NamedTuple):
    """What one tracker took and reached."""

    name: str
    micro_s: float
    ratio: float
    runs: int


#: By tracker, ms a frame and GOSPA a target, m, of each seed.
RaidLines = dict[str, list[tuple[float, float]]]

COLUMNS = (
    "scene",
    "tracker",
    "duration_s",
    "runs",
    "time_per_detection_us",
    "time_per_frame_ms",
    "speed_over_stone_soup",
    "position_rmse_over_bound",
    "bound_m",
    "gospa_per_target_m",
    "gospa_least_m",
    "gospa_largest_m",
)


def single_rows(lines: list[Line], bound_m: float, duration_s: int) -> list[dict[str, str]]:
    """Return the rows of the CSV file of one target."""
    stone = next((line.micro_s for line in lines if line.name.startswith("Stone Soup EKF")), None)
    return [
        _row(
            scene="one target",
            tracker=line.name,
            duration_s=str(duration_s),
            runs=str(line.runs),
            time_per_detection_us=f"{line.micro_s:.1f}",
            speed_over_stone_soup=_ratio(stone, line.micro_s),
            position_rmse_over_bound=f"{line.ratio:.3f}",
            bound_m=f"{bound_m:.1f}",
        )
        for line in lines
    ]


def raid_rows(scenes: dict[str, RaidLines], duration_s: int) -> list[dict[str, str]]:
    """Return the rows of the CSV file of scenes of a hundred targets, by name."""
    rows = []
    for scene, found in scenes.items():
        stone = next(
            (lines[0][0] for name, lines in found.items() if name.startswith("Stone Soup")), None
        )
        for name, lines in found.items():
            taken = float(np.median([line[0] for line in lines]))
            scores = [line[1] for line in lines]
            figures = {"gospa_per_target_m": f"{np.median(scores):.0f}"}
            if np.isfinite(taken):
                figures |= {
                    "time_per_frame_ms": f"{taken:.2f}",
                    "speed_over_stone_soup": _ratio(stone, taken),
                }
            if len(scores) > 1:
                figures |= {
                    "gospa_least_m": f"{min(scores):.0f}",
                    "gospa_largest_m": f"{max(scores):.0f}",
                }
            rows.append(
                _row(
                    scene=scene,
                    tracker=name,
                    duration_s=str(duration_s),
                    runs=str(len(lines)),
                    **figures,
                )
            )
    return rows


def _row(**cells: str) -> dict[str, str]:
    return {name: cells.get(name, "") for name in COLUMNS}


def _ratio(reference: float | None, value: float) -> str:
    return times_faster(
        reference, value, 0 if reference is not None and reference / value >= 0.995 else 2
    )


def write_page(source: Path) -> None:
    """Write page and plot beside a CSV file."""
    rows = read_csv(source)
    single = [row for row in rows if row["scene"] == "one target"]
    raid = [row for row in rows if row["scene"] != "one target"]
    shown = [row for row in raid if row["tracker"] == SHOWN]
    runs = int(single[0]["runs"])
    page = PAGE.format(
        single_faster=next(row for row in single if row["tracker"] == "imm, coast, 1 s")[
            "speed_over_stone_soup"
        ],
        spread_faster=shown[0]["speed_over_stone_soup"],
        raid_faster=shown[-1]["speed_over_stone_soup"],
        duration=single[0]["duration_s"],
        raid_duration=raid[0]["duration_s"],
        runs=runs,
        interval=100.0 / np.sqrt(2 * 2 * runs),
        peer_runs=single[-1]["runs"],
        bound=single[0]["bound_m"],
        seeds=raid[0]["runs"],
        known=" and ".join(
            dict.fromkeys(row["gospa_per_target_m"] for row in raid if not row["time_per_frame_ms"])
        ),
        left_out=left_out(rows),
        single=markdown_table(
            ("tracker, cadence", "µs per detection", "faster than Stone Soup EKF", "RMSE / bound"),
            [
                (
                    row["tracker"],
                    row["time_per_detection_us"],
                    row["speed_over_stone_soup"],
                    row["position_rmse_over_bound"],
                )
                for row in single
                if row["tracker"] not in UNSHOWN
            ],
        ),
        raid=markdown_table(
            (
                "scene",
                "association",
                "ms per frame",
                "faster than Stone Soup GNN",
                "GOSPA per target, m",
            ),
            [
                (
                    row["scene"],
                    row["tracker"].split(", slices")[0],
                    row["time_per_frame_ms"],
                    row["speed_over_stone_soup"],
                    _spread(row),
                )
                for row in raid
                if row["time_per_frame_ms"]
                and (not row["tracker"].startswith("imm") or row["tracker"] == SHOWN)
            ],
        ),
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(single, raid, source.with_suffix(".svg"))


#: Cadences that the short table leaves out.
UNSHOWN = ("imm, coast, 0.1 s", "imm, coast, 5 s", "imm, coast, 10 s", "Stone Soup UKF, two-body")
#: The slices that the short table has.
SHOWN = "imm, slices of 1.0 s"


def _spread(row: Row) -> str:
    least = row["gospa_least_m"]
    largest = row["gospa_largest_m"]
    return (
        f"{row['gospa_per_target_m']} [{least}, {largest}]" if least else row["gospa_per_target_m"]
    )


#: What a line's name has in it, its marker and colour, and its name in the legend.
MARKS = (
    ("FilterPy", "X", RED, "FilterPy EKF"),
    ("UKF", "v", ORANGE, "Stone Soup UKF"),
    ("JPDA", "P", ORANGE, "Stone Soup EKF, JPDA"),
    ("Stone Soup", "^", ORANGE, "Stone Soup EKF (GNN)"),
    ("boost and coast", "s", SKY, "imm, boost and coast"),
    ("same runs", "D", PURPLE, "imm, the peers' runs"),
    ("slices", "o", BLUE, "imm"),
    ("", "o", BLUE, "imm, coast"),
)


def plot(single: list[dict[str, str]], raid: list[dict[str, str]], path: Path) -> None:
    """Draw time against error, of one target and of a hundred."""
    with svg_plot(path, 1, 3, figsize=(12.0, 4.6)) as (_, (left, *rest)):
        for row in single:
            draw(left, row, "time_per_detection_us", "position_rmse_over_bound")
        left.axhline(1.0, color="black", linewidth=0.8)
        left.set_ylim(0.0, 2.2)
        left.set_xlabel("µs per detection")
        left.set_ylabel("position RMSE / bound")
        left.set_title("one target, cadence")
        rest[1].sharey(rest[0])
        for axes, scene in zip(rest, ("spread", "raid"), strict=True):
            mine = [row for row in raid if row["scene"] == scene]
            for row in mine:
                draw(axes, row, "time_per_frame_ms", "gospa_per_target_m")
            axes.axhline(number(mine[0]["gospa_per_target_m"]), color="black", linewidth=0.8)
            axes.set_ylim(150.0, 1.1 * max(number(row["gospa_per_target_m"]) for row in raid))
            axes.set_xlabel("ms per frame")
            axes.set_ylabel("GOSPA per target, m (line: known)")
            axes.set_title(f"a hundred targets, {scene}, slice")
        for axes in (left, *rest):
            axes.set_xscale("log")
            axes.grid(alpha=0.3)
            handles, labels = axes.get_legend_handles_labels()
            unique = dict(zip(labels, handles, strict=True))
            axes.legend(unique.values(), unique.keys(), fontsize=7, frameon=False)


def draw(axes: Any, row: Row, across: str, up: str) -> None:
    """Draw one line of the table as a marker, with its cadence or slice."""
    if not row[across]:
        return
    place = number(row[across]), number(row[up])
    marker, colour, label = next(mark[1:] for mark in MARKS if mark[0] in row["tracker"])
    axes.plot(*place, marker, color=colour, label=label)
    if length := re.search(r"[\d.]+ s\b", row["tracker"]):
        axes.annotate(length[0], place, fontsize=6.5, xytext=(3, 4), textcoords="offset points")
