"""What `opir report` does: read a run or studies, write their report, list the files."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from opir_core import load_run
from opir_core.errors import Problem, SceneError
from opir_report.pages.files import write_page
from opir_report.pages.page import ReportPage
from opir_report.pages.paper import FORMS, write_figures
from opir_report.pages.run_report import run_page
from opir_report.pages.study_report import studies_in, study_page
from opir_report.saved_study import is_study

_SCENES = {".yaml", ".yml"}
_COMMAND = "command line"


def report(arguments: argparse.Namespace) -> int:
    """Write the report of the arguments' run or studies."""
    out = _page_path(arguments.out)
    page = _page([Path(path) for path in arguments.paths])
    written = write_page(page, out, with_data=not arguments.no_data)
    sys.stdout.write(f"{written[0]}: report\n")
    if len(written) > 1:
        sys.stdout.write(f"{written[1].parent}: data of {len(written) - 1} figures\n")
    if arguments.figures is not None:
        files = write_figures(page, Path(arguments.figures), _forms(arguments.formats))
        tables = sum(file.suffix == ".tex" for file in files)
        names = len({file.stem for file in files}) - tables
        sys.stdout.write(f"{arguments.figures}: {names} figures, {tables} tables\n")
    return 0


def _page_path(text: str) -> Path:
    """Return the path of the report; raises SceneError if it is a folder."""
    out = Path(text)
    if not out.name or out.is_dir():
        raise SceneError(
            [Problem("--out", f"{str(out)!r} is a folder; give the path of a file in it")],
            source=_COMMAND,
        )
    return out


def _page(paths: Sequence[Path]) -> ReportPage:
    for path in paths:
        if path.suffix in _SCENES:
            words = (
                f"is a scene: run it first, `opir run {path}`, then give the events, `opir report"
                f" events.jsonl`"
            )
            raise SceneError([Problem("", words)], source=str(path))
    if all(map(is_study, paths)):
        return study_page(studies_in(paths))
    if len(paths) > 1:
        words = "several reports in one are of studies: give one run, or the folders of studies"
        raise SceneError([Problem("", words)], source=_COMMAND)
    return run_page(load_run(paths[0]))


def _forms(text: str) -> Sequence[str]:
    forms = [form.strip().lower() for form in text.split(",")]
    unknown = [form for form in forms if form not in FORMS]
    if unknown:
        words = f"{unknown[0]!r} is no format; there are {', '.join(FORMS)}"
        raise SceneError([Problem("--formats", words)], source=_COMMAND)
    return forms
