"""What `opir report` does: read a run or a study, write its report, list the files."""

import argparse
import sys
from pathlib import Path

from opir_core import load_run
from opir_core.errors import Problem, SceneError
from opir_report.pages.run_report import write_run_report
from opir_report.pages.study_report import write_study_report
from opir_report.saved_study import is_study

_SCENES = {".yaml", ".yml"}


def report(arguments: argparse.Namespace) -> int:
    """Write the report of the arguments' run or study."""
    path, out = Path(arguments.path), Path(arguments.out)
    if path.suffix in _SCENES:
        words = f"is a scene: run it first, `opir run {path}`, then give the events, `opir report events.jsonl`"
        raise SceneError([Problem("", words)], source=str(path))
    if not out.name or out.is_dir():
        raise SceneError([Problem("--out", f"{str(out)!r} is a folder; give the path of a file in it")], source=_HERE)
    if is_study(path):
        written = write_study_report(path, out, with_data=not arguments.no_data)
    else:
        written = write_run_report(load_run(path), out, with_data=not arguments.no_data)
    sys.stdout.write(f"{written[0]}: report\n")
    if len(written) > 1:
        sys.stdout.write(f"{written[1].parent}: data of {len(written) - 1} figures\n")
    return 0


_HERE = "command line"
