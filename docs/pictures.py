"""Writes the pictures of the README and the pages from the gallery's scripts: `python docs/pictures.py`."""

import os
import runpy
import warnings
from pathlib import Path

import matplotlib
from matplotlib import pyplot

DOCS = Path(__file__).resolve().parent
GALLERY = DOCS.parent / "examples" / "gallery"
#: The script of each picture, and the number of its figure.
PICTURES = {
    "pacific-map": ("plot_pacific_map", 1),
    "impact-regions": ("plot_impact_regions", 1),
    "coverage-map": ("plot_coverage_map", 1),
}


def main() -> None:
    """Run each script, and save one of its figures as PNG."""
    matplotlib.use("agg")
    warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive")
    for name, (script, number) in PICTURES.items():
        pyplot.close("all")
        os.chdir(GALLERY)
        runpy.run_path(f"{script}.py", run_name="__main__")
        pyplot.figure(number).savefig(DOCS / "images" / f"{name}.png", dpi=130, metadata={"Software": None})


if __name__ == "__main__":
    main()
