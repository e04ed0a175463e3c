"""Latency and impact area against the revisit interval: the picture of the page `tutorials/revisit.md`.

opir sweep examples/studies/revisit.yaml --out revisit-study
python docs/design/revisit_plot.py revisit-study/results.csv
"""

import csv
import shutil
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
from matplotlib import pyplot  # noqa: E402

PAGE = Path(__file__).parents[1] / "tutorials" / "revisit"
PERIOD = "sensors[*].scan_period_ms"
#: The figure, its label, the divisor of its values, and the scale.
PANELS = (
    ("latency_s", "latency, s", 1.0, "linear"),
    ("launch_error_m", "launch point error, m", 1.0, "linear"),
    ("impact_area_last_estimate_km2", "95 % impact region, million km²", 1e6, "log"),
)


def main(source: Path) -> None:
    """Copy the table beside the page, and draw means with their 95 % intervals."""
    if source.resolve() != PAGE.with_suffix(".csv").resolve():
        shutil.copyfile(source, PAGE.with_suffix(".csv"))
    with source.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    figure, axes = pyplot.subplots(1, len(PANELS), layout="constrained", figsize=(9.0, 3.0))
    for panel, (name, label, divisor, scale) in zip(axes, PANELS, strict=True):
        own = [row for row in rows if row["figure"] == name]
        period_s = [float(row[PERIOD]) / 1e3 for row in own]
        mean, low, high = ([float(row[key]) / divisor for row in own] for key in ("mean", "low_95", "high_95"))
        errors = [[a - b for a, b in zip(mean, low, strict=True)], [b - a for a, b in zip(mean, high, strict=True)]]
        panel.errorbar(period_s, mean, yerr=errors, marker="o", capsize=3, color="#0072B2")
        panel.set(xlabel="revisit interval, s", ylabel=label, xscale="log", yscale=scale)
        panel.set_xticks(period_s, [f"{each:g}" for each in period_s])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
    figure.savefig(PAGE.with_suffix(".svg"), metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE.with_suffix(".csv"))
