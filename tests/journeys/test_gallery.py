"""The scripts of the gallery run, and each makes its figures."""

import json
import os
import subprocess
import sys

import pytest
from repository import EXAMPLES, ROOT

SCRIPTS = sorted((EXAMPLES / "gallery").glob("plot_*.py"))

#: Runs scripts in one process, and each scene once for all of them; prints how many figures each
#: has made.
RUN = """
import json, runpy, sys
import opir_core
from matplotlib import pyplot

simulate, runs = opir_core.simulate, []

def simulated_once(scene):
    found = [run for known, run in runs if known == scene]
    if not found:
        found = [simulate(scene)]
        runs.append((scene, found[0]))
    return found[0]

pyplot.show = lambda: None
opir_core.simulate = simulated_once
made = {}
for script in sys.argv[2:]:
    runpy.run_path(script, run_name="__main__")
    for number in pyplot.get_fignums():
        figure = pyplot.figure(number)
        assert any(axes.has_data() or axes.tables for axes in figure.axes), (script, number)
        figure.savefig(f"{sys.argv[1]}/{number}.png")
    made[script] = len(pyplot.get_fignums())
    pyplot.close("all")
print(json.dumps(made))
"""


@pytest.mark.slow
def test_each_script_of_the_gallery_makes_its_figures(tmp_path):
    environment = {**os.environ, "MPLBACKEND": "agg", "MPLCONFIGDIR": str(tmp_path)}
    words = [sys.executable, "-c", RUN, str(tmp_path), *map(str, SCRIPTS)]
    done = subprocess.run(
        words,
        cwd=EXAMPLES / "gallery",
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    loads = json.loads(done.stdout.splitlines()[-1])
    assert loads == {
        str(script): 1 + script.read_text(encoding="utf-8").count("\n# %%\n") for script in SCRIPTS
    }


def test_the_pictures_of_pages_are_those_of_the_gallery():
    text = (ROOT / "docs" / "pictures.py").read_text(encoding="utf-8")
    for name in ("pacific-map", "coverage-map"):
        assert f'"{name}"' in text
        assert (ROOT / "docs" / "images" / f"{name}.png").is_file()
    assert {path.stem for path in SCRIPTS} >= {"plot_pacific_map", "plot_coverage_map"}
