"""What a report of a run costs, counted: imports, drawings of figures."""

import json
import subprocess
import sys
from pathlib import Path

from repository import EXAMPLES

#: Packages that a report needs not: pandas, which Arrow looks for, and SciPy's distributions.
NEVER = ("pandas", "scipy.stats", "pyarrow.compute")

PROGRAM = """
import json, sys
from matplotlib.figure import Figure
from opir_core.cli.main import main

drawn = []
original = Figure.draw
Figure.draw = lambda figure, renderer: (drawn.append(id(figure)), original(figure, renderer))
assert main(["run", sys.argv[1], "--set", "duration_s=60", "--tracker", "imm", "-q", "-o", "e.jsonl"]) == 0
assert main(["report", "e.jsonl", "-o", "report.html"]) == 0
print(json.dumps({"modules": sorted(sys.modules), "drawn": len(drawn)}))
"""


def test_a_report_imports_and_draws_what_it_shows(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(EXAMPLES / "photons.yaml")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    used = json.loads(done.stdout.splitlines()[-1])
    assert not set(NEVER) & set(used["modules"])
    figures = (tmp_path / "report.html").read_text(encoding="utf-8").count("<svg ")
    assert 0 < used["drawn"] <= figures
