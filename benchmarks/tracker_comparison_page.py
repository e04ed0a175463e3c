"""Page and plot of `tracker_comparison.py`, drawn from its CSV file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from result_files import BLUE, ORANGE, RED, Row, column, markdown_table, number, read_csv, svg_plot

SCENE = "examples/pacific_test_range.yaml"
SENSORS = "sensors=[{constellation: SBIRS-GEO}]"

#: What is written after `--tracker`, what the page calls it, and how it is drawn.
TRACKERS = {
    "kepler-arc": ("kepler-arc", RED, "-"),
    "{model: kepler-arc, memory_s: 5}": ("kepler-arc, memory 5 s", ORANGE, "--"),
    "imm": ("imm", BLUE, "-."),
}

PAGE = """# Comparison of trackers on one scene

Which tracker is how accurate, how consistent and how fast?

* `imm` is the more accurate from {ahead} s after ignition on, its velocity always, and consistent to slightly
  conservative. Until then `kepler-arc` has the better position: where one sensor sees a target, it assumes an altitude.
* `kepler-arc`, the paper's tracker, has errors that grow during the burn, and covariances that do not show them.

![Position and velocity RMSE, error over the bound, and NEES, by time since ignition](comparing-trackers.svg)

{table}

Intervals are 95 %. An ICBM, an IRBM and an SRBM (`{scene}`), observed by the default fleet of SBIRS-GEO, in {runs}
runs. All trackers get the same detections and data association, so only their estimates differ ({tracked} of the
launches tracked, {tracks} tracks per launch, {false} false tracks per run, purity {purity}). Every figure in 20 s
bins, with the confusion of types: [comparing-trackers.csv](comparing-trackers.csv); [score
tracks](../how-to/score-tracks.md) defines them. The comparison again:

```
opir compare {scene} --set "{sensors}" \\
    {words} --runs {runs}
```

* **kepler-arc** fits one Keplerian arc to all detections of a boost. A thrusting target is on no such arc, so the
  errors grow to many times the Cramér–Rao bound, while the least-squares covariance shrinks with each detection. The
  arc gives the mean speed of the boost, not the speed at burnout: the predicted range falls short and the estimated
  type is too small. No ellipse of the paper's σ₀ exp(−k n/N) contains the impact.
* **kepler-arc with `memory_s: 5`** fits the last seconds. It does not diverge, but lags an accelerating target by about
  the acceleration times the memory, which its covariance does not include.
* **imm** has the specific force in its state and does not lag. It assumes a boost about along the velocity, so it may
  be below the bound *with the thrust unknown*, which allows any force. Its impact regions include what the target may
  still burn: they are large in the burn, and shrink at burnout.
"""

#: Rows of the short table: its name, the quantity, the bin's start, and whether the interval is
#: shown.
LINES = (
    ("position RMSE, 100–120 s, m", "position_rmse_m", "100", False),
    ("velocity RMSE, 100–120 s, m/s", "velocity_rmse_m_s", "100", False),
    ("NEES / 6, 100–120 s (1 is consistent)", "nees_over_6", "100", False),
    ("last launch point, RMSE, m", "launch_rmse_m", "", False),
    ("last impact point, RMSE, km", "impact_rmse_km", "", False),
    ("impacts in the 95 % ellipse, %", "impact_in_95_ellipse_percent", "", True),
    ("types correct", "type_correct_share", "", False),
)

#: Panels of the plot: the quantity, its axis, and the value to expect.
PANELS = (
    ("position_rmse_m", "position RMSE, m", None),
    ("velocity_rmse_m_s", "velocity RMSE, m/s", None),
    ("position_rmse_over_bound_thrust_unknown", "position RMSE / bound,\nthrust unknown", 1.0),
    ("nees_over_6", "NEES / 6 (1 is consistent)", 1.0),
)


def write_page(source: Path) -> None:
    """Write page and plot beside a CSV file."""
    rows = read_csv(source)
    names = [name for name in TRACKERS if any(row["tracker"] == name for row in rows)]
    head = ("", *(TRACKERS[name][0] for name in names))
    table = [
        (label, *(shown(found(rows, name, quantity, start), has_interval) for name in names))
        for label, quantity, start, has_interval in LINES
    ]
    times = [number(found(rows, name, "time_per_detection_us")["value"]) for name in names]
    table.append(
        ("processor time over that of imm", *(f"{each / times[-1]:.1f}" for each in times))
    )
    first = {key: found(rows, names[0], key)["value"] for key in ("runs", *ASSOCIATION.values())}
    page = PAGE.format(
        table=markdown_table(head, table),
        scene=SCENE,
        sensors=SENSORS,
        words=" ".join(
            f'--tracker "{name}"' if " " in name else f"--tracker {name}" for name in TRACKERS
        ),
        runs=first["runs"],
        ahead=ahead_s(rows),
        **{key: first[quantity] for key, quantity in ASSOCIATION.items()},
    )
    source.with_suffix(".md").write_text(page, encoding="utf-8")
    plot(rows, names, source.with_suffix(".svg"))


#: Figures of the data association, which all trackers share.
ASSOCIATION = {
    "tracked": "launches_tracked_share",
    "tracks": "tracks_per_launch",
    "false": "false_tracks_per_run",
    "purity": "purity_share",
}


def found(rows: list[dict[str, str]], tracker: str, quantity: str, start: str = "") -> Row:
    """Return the row of a quantity, of all launches or of the bin that starts then."""
    key = {"tracker": tracker, "quantity": quantity, "from_s": start}
    return next(row for row in rows if key.items() <= row.items())


def ahead_s(rows: list[dict[str, str]]) -> str:
    """Return the start of the bin from which on imm has the least position RMSE of all trackers."""
    errors = [row for row in rows if row["quantity"] == "position_rmse_m"]
    starts = list(dict.fromkeys(row["from_s"] for row in errors))
    of_start = [[row for row in errors if row["from_s"] == start] for start in starts]
    best = [min(each, key=lambda row: number(row["value"]))["tracker"] for each in of_start]
    behind = [place for place, name in enumerate(best) if name != "imm"]
    return [*starts, "–"][max(behind, default=-1) + 1]


def shown(row: Row, has_interval: bool) -> str:
    """Return a cell of the short table."""
    if not row["value"]:
        return "–"
    return (
        f"{row['value']} [{row['low']}, {row['high']}]"
        if has_interval and row["low"]
        else row["value"]
    )


def plot(rows: list[dict[str, str]], names: Sequence[str], path: Path) -> None:
    """Draw figures by time since ignition, with their 95 % intervals."""
    with svg_plot(path, 2, 2, figsize=(10.0, 7.0), sharex=True) as (figure, grid):
        for axes, (quantity, label, expected) in zip(grid.flat, PANELS, strict=True):
            if expected:
                axes.axhline(expected, color="black", linewidth=0.8)
            for name in names:
                mine = [
                    row for row in rows if row["tracker"] == name and row["quantity"] == quantity
                ]
                draw(axes, mine, name)
            axes.set_yscale("log")
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
        for axes in grid[1]:
            axes.set_xlabel("time since ignition, s")
        figure.legend(
            *grid[0, 0].get_legend_handles_labels(),
            loc="outside lower center",
            ncols=4,
            frameon=False,
        )


def draw(axes: Any, rows: Sequence[Row], tracker: str) -> None:
    """Draw a tracker's figures in the middle of their bins."""
    label, colour, style = TRACKERS[tracker]
    middle = [0.5 * (number(row["from_s"]) + number(row["to_s"])) for row in rows]
    axes.plot(middle, column(rows, "value"), style, color=colour, label=label)
    if all(row["interval"].endswith("confidence") for row in rows):
        axes.fill_between(
            middle,
            column(rows, "low"),
            column(rows, "high"),
            color=colour,
            alpha=0.2,
            linewidth=0.0,
        )
