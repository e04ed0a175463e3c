"""The result of a study: tidy tables in a folder, the same bytes whatever ran them and in which
order.

`results.parquet` and `results.csv` have a row per design and figure, `runs.parquet` a row per run,
`launches.parquet` a row per launch of each run, `shares.parquet` and `shares.csv` a row per required
share, `study.json` the definition. Processor times are in `run_times.csv` alone, which differs from one
execution to the next.
"""

import csv
import io
import json
import math
from collections.abc import Mapping
from functools import cached_property
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from attrs import asdict, frozen

from opir_core.arrays import FloatArray
from opir_core.errors import BAD_DATA, reason_of
from opir_core.output import FILES_KEY, OutputFiles, file_digest, finish_interrupted
from opir_core.random_streams import SCHEME
from opir_core.reading import STUDY_FORMAT, data_of_node, node_of_yaml
from opir_core.scene import file_bytes, text_of
from opir_studies.finished import StudyRuns
from opir_studies.parts import parquet_bytes
from opir_studies.planning import PlannedStudy
from opir_studies.refusals import refusal
from opir_studies.study import Study
from opir_studies.tables import (
    launches_schema,
    launches_tables,
    results_table,
    runs_schema,
    runs_tables,
    sensitivity_table,
    shares_table,
    times_table,
    write_rows,
)

RESULTS = "results.parquet"
RESULTS_CSV = "results.csv"
RUNS = "runs.parquet"
LAUNCHES = "launches.parquet"
SHARES = "shares.parquet"
SHARES_CSV = "shares.csv"
SENSITIVITY = "sensitivity.csv"
DEFINITION = "study.json"
TIMES = "run_times.csv"


@frozen(eq=False)
class StudyResult:
    """A study's result.

    `table` has a row per design and figure: `design`, a column for each path that varies, `figure`,
    `unit`, `runs`, `first_seed`, `last_seed`, `share`, `runs_with_value`, `mean`, `low_95`,
    `high_95`, `sd`, `q10`, `median`, `q90`, and the paired `difference` from design 0 with its 95 %
    interval. `share` is that of launches, or else of runs, which have a value; all that follows is
    of these alone. `runs` has a row per run: `design`, the paths, `replicate`, `seed` and a column
    per figure. `launches` has a row per launch of each run: `design`, the paths, `replicate`,
    `seed`, `launch`, `class`, `site` and the columns of `launch_units`; inf is never, nan does not
    apply. `shares` has the rows of `share_rows`. `definition` is the content of `study.json`.
    """

    folder: Path
    definition: Mapping[str, Any]
    table: pa.Table
    shares: pa.Table

    @cached_property
    def runs(self) -> pa.Table:
        """The table of runs, read when it is first asked for."""
        return pq.read_table(self.folder / RUNS)

    @cached_property
    def launches(self) -> pa.Table:
        """The table of launches, read when it is first asked for."""
        return pq.read_table(self.folder / LAUNCHES)

    def values(self, figure: str) -> FloatArray:
        """Return a figure of all runs (n,), in the order of `runs`, reading nothing else."""
        column = pq.read_table(self.folder / RUNS, columns=[figure])[figure]
        return np.asarray(column.to_numpy())

    @property
    def run_count(self) -> int:
        """Return the number of runs of all designs."""
        return int(pq.read_metadata(self.folder / RUNS).num_rows)

    @property
    def paths(self) -> tuple[str, ...]:
        """Return the paths that vary."""
        return tuple(self.definition["vary"])

    @property
    def units(self) -> Mapping[str, str]:
        """Return the units of the figures by name."""
        return self.definition["figures"]

    def rows(self, figure: str) -> list[dict[str, Any]]:
        """Return the rows of a figure, one per design; raises `KeyError` for an unknown figure."""
        if figure not in self.units:
            raise KeyError(f"{figure}; there are {', '.join(self.units)}")
        return [row for row in self.table.to_pylist() if row["figure"] == figure]

    def shown_rows(self, figure: str) -> list[dict[str, Any]]:
        """Return the rows of a figure with the intervals of means cut at the figure's bounds, as
        tables show them.
        """
        low, high = self.definition["bounds"][figure]
        lowest = -math.inf if low is None else low
        largest = math.inf if high is None else high
        return [
            {**row, "low_95": max(row["low_95"], lowest), "high_95": min(row["high_95"], largest)}
            for row in self.rows(figure)
        ]

    def to_pandas(self) -> Any:
        """Return the table as a data frame of pandas."""
        return self.table.to_pandas()

    def _repr_html_(self) -> str:
        """Return verdicts, tables and differences as a notebook shows them."""
        text = import_module("opir_studies.sweep_command").as_text(self)
        return f"<pre>{escape(text)}</pre>"

    def __repr__(self) -> str:
        """Return the study with its size, in one line."""
        name = self.definition["study"]
        designs = len(self.definition["designs"])
        runs = self.run_count
        return f"<StudyResult {name}: {designs} designs, {runs} runs, {len(self.units)} figures>"


def load_study(folder: str | Path) -> StudyResult:
    """Return the result of a study from its folder; raises `SceneError` without one."""
    place = Path(folder)
    finish_interrupted(place / DEFINITION)
    try:
        definition = json.loads((place / DEFINITION).read_text(encoding="utf-8"))
        STUDY_FORMAT.require_readable(definition.get("study_version"), place, "study_version")
        for entry in definition.get(FILES_KEY, ()):
            if file_digest(place / entry["name"]) != entry["sha256"]:
                raise ValueError(f"{entry['name']} is not what was written: its SHA-256 differs")
        tables = [pq.read_table(place / name) for name in (RESULTS, SHARES)]
        for name in (RUNS, LAUNCHES):
            pq.read_metadata(place / name)
        return StudyResult(place, definition, *tables)
    except OSError as error:
        words = f"is no folder of a finished study: {reason_of(error)}; `opir sweep` makes one"
        raise refusal("", words, str(place)) from error
    except (*BAD_DATA, pa.ArrowException) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        words = f"has damaged results ({reason}); run the study again: its runs are kept"
        raise refusal("", words, str(place)) from error


def written_result(
    planned: PlannedStudy, folder: Path, runs: StudyRuns, extra: Mapping[str, Any] | None = None
) -> StudyResult:
    """Write the result of a study from its finished runs; return it.

    `extra` is added to its definition.
    """
    table, bounds = results_table(planned, runs)
    shares = shares_table(planned, runs)
    sensitivity = sensitivity_table(planned, table)
    contents = {
        RESULTS: parquet_bytes(table),
        RESULTS_CSV: _csv_bytes(table),
        SHARES: parquet_bytes(shares),
        SHARES_CSV: _csv_bytes(shares),
        **({SENSITIVITY: _csv_bytes(sensitivity)} if sensitivity is not None else {}),
    }
    with (
        OutputFiles() as times
    ):  # they differ from one execution to the next, and are listed nowhere
        times.make_folder(folder, parents=True)
        content = _csv_bytes(times_table(planned, runs))
        times.write(folder / TIMES, content, "study's", is_made_up=True)
    rows = {
        RUNS: (runs_schema(planned), runs_tables(planned, runs)),
        LAUNCHES: (launches_schema(planned), launches_tables(planned, runs)),
    }
    files = OutputFiles(folder / DEFINITION, is_made_up=True)
    try:
        for name, (schema, tables) in rows.items():
            with files.writing(folder / name, "study's", is_made_up=True) as place:
                write_rows(place, schema, tables)
        for name, content in contents.items():
            files.write(folder / name, content, "study's", is_made_up=True)
        definition = files.commit({**_definition(planned, runs), "bounds": bounds, **(extra or {})})
    except BaseException:
        files.abandon()
        raise
    return StudyResult(folder, definition, table, shares)


def _failure_notes(runs: StudyRuns) -> list[str]:
    """Return a note on runs that failed, none without any."""
    total = sum(runs.counts)
    failed = total - sum(len(runs.numbers(design)) for design in range(len(runs.counts)))
    words = f"{failed} of {total} runs failed: no mean and no share counts them"
    return [words] if failed else []


def _definition(planned: PlannedStudy, runs: StudyRuns) -> Mapping[str, Any]:
    study = planned.study
    return {
        "study_version": STUDY_FORMAT.version,
        "study": study.study,
        "question": study.question,
        "split": study.split,
        "scene": planned.designs[0].scene.name,
        "design": study.design,
        "vary": list(planned.designs[0].design.paths),
        "conditions": list(study.conditions),
        "runs": study.runs,
        "until": study.until,
        "figures": dict(planned.units),
        "shares": dict(planned.shares),
        "launches": dict(planned.launch_units),
        "containments": dict(planned.containments),
        "shown": list(study.show),
        "requirements": [asdict(required) for required in planned.requirements],
        "share_requirements": [
            {**asdict(required), "bound": None if math.isnan(required.bound) else required.bound}
            for required in planned.share_requirements
        ],
        "notes": [*_failure_notes(runs), *planned.notes],
        "settings": json.loads(
            json.dumps(dict(planned.settings))
        ),  # tuples as the lists that are read back
        "metrics": {
            name: list(metric.units)
            for name, metric in zip(planned.names, planned.metrics, strict=True)
        },
        "versions": dict(planned.versions),
        "random_numbers": SCHEME,
        "made_of": made_of(study),
        "designs": [
            {
                "design": planned_design.design.number,
                **{
                    path: level.label
                    for path, level in zip(
                        planned_design.design.paths, planned_design.design.levels, strict=True
                    )
                },
                "runs_of": planned_design.identity,
            }
            for planned_design in planned.designs
        ],
    }


def made_of(study: Study) -> Mapping[str, Any]:
    """Return the keys of a study, with its scene, from which it is made again; without what changes
    no result.
    """
    keys = asdict(study, recurse=False)
    del keys["executor"]
    if not isinstance(study.scene, Mapping):
        keys["scene"] = data_of_node(node_of_yaml(text_of(file_bytes(study.scene))))
        if "manifest_version" in keys["scene"]:
            keys["scene"] = keys["scene"]["scene"]
    return dict(json.loads(json.dumps(keys, default=float)))


def _csv_bytes(table: pa.Table) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.column_names)
    for row in table.to_pylist():
        writer.writerow(["" if value != value else value for value in row.values()])
    return text.getvalue().encode()
