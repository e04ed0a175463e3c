"""The page that tracking.py writes: its text, its tables and its plot."""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np

PAGE = """# Tracking: work and precision

Made by `python benchmarks/work_precision/tracking.py --write docs/benchmarks`; every line on the same detections in one
run; processor time of one core. "Over Stone Soup" is Stone Soup's time over the line's.

## One target

Two geostationary sensors at 10° E and 100° E, 10 looks a second each, 20 µrad an axis, {seconds} s of free flight,
started 1 km and 50 m/s off. The error is the RMSE of the position at the end, over {runs} runs for the stereo filter
(to about {interval:.0f} %) and the first {peer_runs} of them for the others; "same runs" is the stereo filter's
coast mode at 1 s on those alone. The bound is Cramér and Rao's for known dynamics, {bound:.1f} m.

{single}

![Time a detection against error over the bound](tracking.svg)

## A hundred targets

P_d 0.9, 20 clutter points a frame, {raid_seconds} s, 20 frames a second, association unknown; GOSPA (c = 5 km, p = 2,
alpha = 2) a target, over the last half: the median of {raid_seeds} seeds and the least and largest of them, for Stone
Soup the first seed alone. "Known" is the stereo filter told which ray is whose, at the same times. Constants of the
tracker were chosen on seeds 0 to 15.

{raid}
"""


class Line(NamedTuple):
    """What one tracker took and reached."""

    name: str
    micro_s: float
    ratio: float
    runs: int


#: By tracker, ms a frame and GOSPA a target, m, of each seed.
RaidLines = dict[str, list[tuple[float, float]]]


def page(single: str, raid: str, bound: float, chosen: argparse.Namespace) -> str:
    """Return the page of these tables, whose bound is `bound`, m, made as was chosen."""
    return PAGE.format(
        single=single,
        raid=raid,
        runs=chosen.runs,
        peer_runs=chosen.peer_runs,
        seconds=chosen.seconds,
        raid_seconds=chosen.raid_seconds,
        raid_seeds=chosen.raid_seeds,
        interval=100.0 / np.sqrt(2 * 2 * chosen.runs),
        bound=bound,
    )


def single_table(lines: list[Line]) -> str:
    """Return the lines of one target as a table."""
    stone = next(line.micro_s for line in lines if line.name.startswith("Stone Soup EKF"))
    rows = [
        f"| {line.name} | {line.micro_s:.1f} | {stone / line.micro_s:.0f} | {line.ratio:.3f} | {line.runs} |"
        for line in lines
    ]
    head = [
        "| tracker, cadence | µs a detection | over Stone Soup EKF | RMSE / bound | runs |",
        "|---|---|---|---|---|",
    ]
    return "\n".join([*head, *rows])


def raid_table(scenes: dict[str, RaidLines]) -> str:
    """Return the lines of scenes of a hundred targets, by name, as a table."""
    rows = ["| scene | association | ms a frame | over Stone Soup GNN | GOSPA a target, m |", "|---|---|---|---|---|"]
    for scene, found in scenes.items():
        stone = next(lines[0][0] for name, lines in found.items() if name.startswith("Stone Soup"))
        rows += [_raid_row(scene, name, lines, stone) for name, lines in found.items()]
    return "\n".join(rows)


def _raid_row(scene: str, name: str, lines: list[tuple[float, float]], stone: float) -> str:
    taken = float(np.median([line[0] for line in lines]))
    scores = [line[1] for line in lines]
    spread = f" [{min(scores):.0f}, {max(scores):.0f}]" if len(scores) > 1 else ""
    row = f"| {scene} | {name} | {taken:.2f} | {stone / taken:.0f} | {np.median(scores):.0f}{spread} |"
    return row.replace("nan", "")


def plot(lines: list[Line], path: Path) -> None:
    """Draw time against error."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.5, 4.5))
    for line in lines:
        axes.loglog(line.micro_s, line.ratio, "o")
        axes.annotate(line.name, (line.micro_s, line.ratio), fontsize=7, xytext=(4, 4), textcoords="offset points")
    axes.set_xlabel("µs a detection")
    axes.set_ylabel("RMSE / bound")
    axes.grid(True, which="both", alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, metadata={"Date": None})
