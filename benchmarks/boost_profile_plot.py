"""The plot of `benchmarks/boost_profile.py`: errors over the expected bound, ANEES and held impacts, mark by mark."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

#: What is drawn of a cell, with the line that is asked of it, and the scale.
PANELS = (
    ("position", "position: RMSE / expected", 1.10, "linear"),
    ("velocity", "velocity: RMSE / expected", 1.10, "linear"),
    ("impact", "impact: RMSE / expected", 1.10, "linear"),
    ("anees", "ANEES / 6, as told", 1.0, "log"),
    ("held", "impacts in the 95 % ellipse, %", 95.0, "linear"),
)
STYLES = {"DSP": ":", "SBIRS-GEO": "--", "NEXTGEN-GEO": "-"}
COLOURS = {"SRBM": "tab:blue", "IRBM": "tab:orange", "ICBM": "tab:green"}


class Cell(NamedTuple):
    """One line of the table: ratios, ANEES as told over its degrees of freedom, the percentage held."""

    kind: str
    model: str
    sensors: int
    mark: int
    position: float
    velocity: float
    impact: float
    anees: float
    held: float


def plot(cells: list[Cell], marks: tuple[str, ...], path: Path) -> None:
    """Draw two rows of panels, of two sensors and of one, a line for each class and model."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams["svg.hashsalt"] = "opir"
    import matplotlib.pyplot as plt

    figure, grid = plt.subplots(2, len(PANELS), figsize=(15.0, 6.0), sharex=True, sharey="col", squeeze=False)
    for row, sensors in enumerate((2, 1)):
        for axes, (name, title, asked, scale) in zip(grid[row], PANELS, strict=True):
            axes.set_yscale(scale)
            axes.yaxis.set_major_formatter("{x:g}")
            axes.axhline(asked, color="black", linewidth=0.8)
            for model, style in STYLES.items():
                for kind, colour in COLOURS.items():
                    mine = [cell for cell in cells if cell[:3] == (kind, model, sensors)]
                    at, values = [cell.mark for cell in mine], [getattr(cell, name) for cell in mine]
                    axes.plot(at, values, style, color=colour, marker=".", linewidth=1.0, label=f"{kind}, {model}")
            axes.set_xticks(np.arange(len(marks)), marks, rotation=45)
            axes.set_title(title if row == 0 else "")
            axes.grid(alpha=0.3)
        grid[row, 0].set_ylabel(f"{sensors} sensors" if sensors > 1 else "1 sensor")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="lower center", ncols=len(STYLES) * len(COLOURS), fontsize="small")
    figure.tight_layout(rect=(0.0, 0.05, 1.0, 1.0))
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
