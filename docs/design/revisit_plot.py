"""Latency and impact area against the revisit interval: the picture of the page
`tutorials/revisit.md`.

opir sweep examples/studies/revisit.yaml --out revisit-study
opir sweep examples/studies/revisit_raid.yaml --out revisit-raid-study
python docs/design/revisit_plot.py revisit-study/results.csv revisit-raid-study/results.csv
"""

import csv
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
from matplotlib import pyplot  # noqa: E402

FOLDER = Path(__file__).parents[1] / "tutorials"
PERIOD = "sensors[*].scan_period_ms"
#: The table of each study, its name and style.
STUDIES = {
    "revisit.csv": ("one ICBM", {"color": "#0072B2", "marker": "o"}),
    "revisit_raid.csv": ("raid of 100", {"color": "#D55E00", "marker": "s", "linestyle": "--"}),
}
#: The figure, its label, the divisor of its values, and the scale.
PANELS = (
    ("latency_s", "latency, s", 1.0, "linear"),
    ("launch_error_m", "launch point error, m", 1.0, "log"),
    ("impact_area_last_estimate_km2", "95 % impact region, million km²", 1e6, "log"),
)


def main(sources: Sequence[Path]) -> None:
    """Copy the tables beside the page, and draw means with their 95 % intervals."""
    figure, axes = pyplot.subplots(1, len(PANELS), layout="constrained", figsize=(9.0, 3.2))
    for source, (name, (label, style)) in zip(sources, STUDIES.items(), strict=True):
        if source.resolve() != FOLDER / name:
            shutil.copyfile(source, FOLDER / name)
        with source.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        for axis, (figure_name, _, divisor, _) in zip(axes, PANELS, strict=True):
            draw(axis, [row for row in rows if row["figure"] == figure_name], divisor, label, style)
    for axis, (_, label, _, scale) in zip(axes, PANELS, strict=True):
        axis.set(xlabel="revisit interval, s", ylabel=label, xscale="log", yscale=scale)
        axis.set_xticks([0.5, 1, 2, 5, 10], ["0.5", "1", "2", "5", "10"])
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].legend(frameon=False)
    figure.savefig(FOLDER / "revisit.svg", metadata={"Date": None})


def draw(
    axis: Any, rows: Sequence[dict[str, str]], divisor: float, label: str, style: dict[str, str]
) -> None:
    """Draw one figure of one study."""
    period_s = [float(row[PERIOD]) / 1e3 for row in rows]
    mean, low, high = (
        [float(row[key]) / divisor for row in rows] for key in ("mean", "low_95", "high_95")
    )
    errors = [
        [a - b for a, b in zip(mean, low, strict=True)],
        [b - a for a, b in zip(mean, high, strict=True)],
    ]
    axis.errorbar(period_s, mean, yerr=errors, capsize=3, label=label, **style)


if __name__ == "__main__":
    main([Path(each) for each in sys.argv[1:]] or [FOLDER / name for name in STUDIES])
