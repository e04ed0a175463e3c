"""The scripts of the gallery run, and each makes its figures."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from repository import EXAMPLES, ROOT

SCRIPTS = sorted((EXAMPLES / "gallery").glob("plot_*.py"))

RUN = """
import runpy, sys
from matplotlib import pyplot
pyplot.show = lambda: None
runpy.run_path(sys.argv[1], run_name="__main__")
for number in pyplot.get_fignums():
    figure = pyplot.figure(number)
    assert any(axes.has_data() or axes.tables for axes in figure.axes), number
    figure.savefig(f"{sys.argv[2]}/{number}.png")
"""


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_of_the_gallery_makes_its_figures(script: Path, tmp_path: Path) -> None:
    environment = {**os.environ, "MPLBACKEND": "agg", "MPLCONFIGDIR": str(tmp_path)}
    words = [sys.executable, "-c", RUN, str(script), str(tmp_path)]
    done = subprocess.run(words, cwd=script.parent, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    figures = list(tmp_path.glob("*.png"))
    assert len(figures) == 1 + script.read_text(encoding="utf-8").count("\n# %%\n")


def test_the_pictures_of_pages_are_those_of_the_gallery() -> None:
    text = (ROOT / "docs" / "pictures.py").read_text(encoding="utf-8")
    for name in ("pacific-map", "impact-regions"):
        assert f'"{name}"' in text
        assert (ROOT / "docs" / "images" / f"{name}.png").is_file()
    assert {path.stem for path in SCRIPTS} >= {"plot_pacific_map", "plot_impact_regions"}
