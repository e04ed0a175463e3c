"""The paper's trade study, one setting at a time: the picture and the table of the page
`tutorials/trade-study.md`.

opir sweep examples/studies/trade.yaml --out trade-study
python docs/design/trade_plot.py trade-study/results.csv

The table is printed, in Markdown.
"""

import csv
import shutil
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("svg")
mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
from matplotlib import pyplot  # noqa: E402

PAGE = Path(__file__).parents[1] / "tutorials" / "trade-study"
#: The settings of a design: column of the table, and how its value is written.
SETTINGS = (
    ("sensors", "{}"),
    ("sensors[*].scan_period_ms", "{:g} ms"),
    ("sensors[*].detection_probability.ICBM", "P_d {:g}"),
)
#: The figure, its label, the divisor of its values, the scale, and decimals in the table.
PANELS = (
    ("latency_s", "latency, s", 1.0, "linear", 2),
    ("position_rmse_m", "position RMSE, m", 1.0, "log", 0),
    ("launch_error_m", "launch point error, m", 1.0, "linear", 0),
    ("impact_area_last_estimate_km2", "95 % impact region,\nmillion km²", 1e6, "log", 2),
)


def labels(rows: list[dict[str, str]]) -> list[str]:
    """Return what each design changes against the first."""
    first = rows[0]
    found = []
    for row in rows:
        changed = [(key, text) for key, text in SETTINGS if row[key] != first[key]]
        values = [
            text.format(row[key] if key == "sensors" else float(row[key])) for key, text in changed
        ]
        found.append(", ".join(values) or "SBIRS-GEO, 1000 ms, P_d 0.9")
    return found


def main(source: Path) -> None:
    """Copy the table beside the page, draw means with their 95 % intervals, and print them."""
    if source.resolve() != PAGE.with_suffix(".csv").resolve():
        shutil.copyfile(source, PAGE.with_suffix(".csv"))
    with source.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    cells: list[list[str]] = []
    figure, axes = pyplot.subplots(
        1, len(PANELS), layout="constrained", figsize=(11.0, 3.2), sharey=True
    )
    for panel, (name, label, divisor, scale, digits) in zip(axes, PANELS, strict=True):
        own = [row for row in rows if row["figure"] == name]
        names = labels(own)
        cells = cells or [[each] for each in names]
        for index, row in enumerate(own):
            mean, low, high = (float(row[key]) / divisor for key in ("mean", "low_95", "high_95"))
            panel.errorbar(
                mean,
                index,
                xerr=[[mean - low], [high - mean]],
                marker="o",
                capsize=3,
                color="#0072B2",
            )
            cells[index].append(f"{mean:.{digits}f} [{low:.{digits}f}, {high:.{digits}f}]")
        panel.axvline(float(own[0]["mean"]) / divisor, color="0.6", linewidth=0.8)
        panel.set(xlabel=label, xscale=scale)
        panel.set_yticks(range(len(names)), names)
        panel.grid(alpha=0.3, axis="x")
        if scale == "linear":
            panel.set_xlim(left=0.0)
    axes[0].invert_yaxis()
    figure.savefig(PAGE.with_suffix(".svg"), metadata={"Date": None})
    sys.stdout.writelines("| " + " | ".join(row) + " |\n" for row in cells)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else PAGE.with_suffix(".csv"))
