"""The page and the plot of `tracker_honesty.py`, from its CSV.

python benchmarks/tracker_honesty_page.py docs/benchmarks
"""

import csv
import sys
from pathlib import Path
from typing import Any

PAGE = """# Are the regions of imm true?

Does a track's 95 % region hold the impact, on flights that share nothing with the tracker? From a quarter of the burn
on it holds {pooled:.0f} % of the impacts over all marks and lines of flights, dark gaps between stages among them; by
mark and line {least:.0f} to {most:.0f} % of {flights} flights.

![Share of impacts in the 50 % and 95 % regions, and median area, by time](tracker_honesty.svg)

| flights | impact in 95 % | in 50 % | velocity, m/s | velocity over bound | 95 % area, half and +20 s, 10³ km² |
|---|---|---|---|---|---|
{rows}

Impact in the 95 % region: the least share of the marks, with its 95 % interval (Wilson); in the 50 % region the mean.
Velocity: RMSE at 95 % of the burn, and the median error over the posterior Cramér–Rao bound of an estimator that knows
the law of these flights and has its parameters to find. All figures with their 95 % intervals:
[tracker_honesty.csv](tracker_honesty.csv).

A velocity is above its bound until a new stage has shown itself: `imm` must expect one at any time, the bound knows how
many there are. It knows no class, so the bound of class profiles is out of its reach.

Flights are gravity turns of one to three stages, integrated by SciPy, and class profiles of `ballistic`, over 150 to
12 000 km. The tracker's prior (`vehicles.json`) knows neither. Each is a scene of its own, seen by two SBIRS-GEO,
or one; default settings. Marks are 25, 50, 75 and 95 % of the time from ignition to the last burnout, and 5 and 20 s
after it. The tracker does not know how much of a burn is over, so its 50 % region cannot hold half of the impacts at
each mark; over all marks together it holds {half:.0f} %.

By `--flights {flights} --write docs/benchmarks`, then `tracker_honesty_page.py docs/benchmarks`.
"""


#: The lines in the table of the page; the CSV file has all.
SHOWN = (
    "1 stage",
    "3 stages with gaps",
    "class profiles",
    "2 stages with gaps: one sensor",
    "2 stages: biases of 3σ",
)


def over_bound(rows: list[list[str]], head: list[str], name: str) -> str:
    """Return the median error of velocity at 95 % of the burn over its bound, a dash where there is
    none.
    """
    row = next(row for row in rows if row[:2] == [name, "95 %"])
    return row[head.index("velocity_over_bound_median")] or "–"


def least_share(marks: list[list[float]]) -> str:
    """Return the least share of impacts in the 95 % region over the marks, with its 95 %
    interval.
    """
    share, low, high = min(mark[8:11] for mark in marks)
    return f"{share:.0f} % [{low:.0f}–{high:.0f}]"


def main() -> None:
    """Write the page and the plot beside the CSV."""
    folder = Path(sys.argv[1])
    with (folder / "tracker_honesty.csv").open(encoding="utf-8") as text:
        head, *rows = list(csv.reader(text))
    names = list(dict.fromkeys(row[0] for row in rows))
    lines = {
        name: [[float(cell) for cell in row[2:16]] for row in rows if row[0] == name]
        for name in names
    }
    # Columns: flown, tracked, state (3), half (3), most (3), velocity, areas (2).
    table = [
        f"| {name} | {least_share(marks)} | {sum(mark[5] for mark in marks) / len(marks):.0f} %"
        f" | {marks[3][11]:.0f} | {over_bound(rows, head, name)}"
        f" | {1e-3 * marks[1][13]:.0f}, {1e-3 * marks[5][13]:.0f} |"
        for name, marks in lines.items()
        if name in SHOWN
    ]
    every = [mark for marks in lines.values() for mark in marks]
    page = PAGE.format(
        pooled=sum(mark[8] for mark in every) / len(every),
        least=min(mark[8] for mark in every),
        most=max(mark[8] for mark in every),
        flights=f"{every[0][0]:.0f}",
        rows="\n".join(table),
        half=sum(mark[5] for mark in every) / len(every),
    )
    (folder / "tracker_honesty.md").write_text(page, encoding="utf-8")
    draw(lines, [row[1] for row in rows[:6]], folder)


def draw(lines: dict[str, list[list[float]]], marks: list[str], folder: Path) -> None:
    """Draw shares and areas by mark."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(10.0, 4.4), layout="constrained")
    at: Any = range(len(marks))
    for number, (name, rows) in enumerate(lines.items()):
        shift = [place + 0.06 * (number - 0.5 * len(lines)) for place in at]
        style = {"color": f"C{number}", "markersize": 3.5, "linewidth": 0.8}
        low, high = ([abs(row[8] - row[8 + side]) for row in rows] for side in (1, 2))
        axes[0].errorbar(shift, [row[8] for row in rows], (low, high), fmt="o", label=name, **style)
        axes[0].plot(shift, [row[5] for row in rows], "x", **style)
        axes[1].semilogy(at, [row[13] for row in rows], "o-", **style)
    for level in (50.0, 95.0):
        axes[0].axhline(level, color="0.5", linewidth=0.8, linestyle="--")
    axes[0].set(ylabel="impacts in the 95 % (o) and 50 % (x) regions, %", ylim=(0.0, 102.0))
    axes[1].set(ylabel="median area of the 95 % region, km²")
    for axis in axes:
        axis.set_xticks(list(at), marks)
        axis.set_xlabel("share of the burn, and time after it")
        axis.grid(alpha=0.3)
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize=8,
    )
    figure.savefig(folder / "tracker_honesty.svg", metadata={"Date": None})


if __name__ == "__main__":
    main()
