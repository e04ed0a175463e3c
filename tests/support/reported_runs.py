"""Runs that reports and plots are tested with, made once for all tests of a process."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from opir_report import write_run_report
from opir_report.pages.page import ReportPage
from opir_report.pages.run_report import run_page
from opir_report.pages.study_report import studies_in, study_page
from pyarrow import parquet
from repository import EXAMPLES
from scored_scene import SCENE

import opir_core as opir


@cache
def scored_run():
    """Return 300 s of one ICBM, seen by two sensors and followed to a predicted impact."""
    tracker = {"model": "imm"}
    return opir.simulate(
        opir.scene_from_mapping({**SCENE, "duration_s": 300.0, "tracker": tracker})
    )


@cache
def example_run(name, **settings):
    """Return a run of an example with some of its values replaced."""
    overrides = [f"{key}={value}" for key, value in settings.items()]
    return opir.simulate(opir.load_scene(EXAMPLES / f"{name}.yaml", overrides=overrides))


@cache
def empty_run():
    """Return a run without targets: nothing is launched, detected, tracked or predicted."""
    return opir.simulate(opir.scene_from_mapping({**SCENE, "scene": "empty", "targets": []}))


def report_page(run: opir.Run) -> ReportPage:
    """Return the page of a run's report."""
    return run_page(run)


def study_report_page(*folders: Path) -> ReportPage:
    """Return the page of the report of the studies in folders."""
    return study_page(studies_in(folders))


@cache
def report_data(run: opir.Run) -> dict[str, Any]:
    """Return the data of the figures of a run's report, record arrays by the name of the figure."""
    with TemporaryDirectory() as folder:
        _, *files = write_run_report(run, Path(folder) / "report.html")
        return {file.stem: _records(parquet.read_table(file)) for file in files}


def _records(table: Any) -> Any:
    columns = [np.array(table[name].to_pylist()) for name in table.column_names]
    return np.rec.fromarrays(columns, names=table.column_names)
