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
from collections.abc import Mapping, Sequence
from html import escape
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from attrs import asdict, frozen

from opir_core.errors import reason_of
from opir_core.output import FILES_KEY, OutputFiles, file_digest, finish_interrupted
from opir_core.random_streams import SCHEME
from opir_core.reading import STUDY_FORMAT, data_of_node, node_of_yaml
from opir_core.scene import file_bytes, text_of
from opir_studies.axes import Level
from opir_studies.launches import FACTS
from opir_studies.parts import launch_type, parquet_bytes
from opir_studies.planning import PlannedStudy
from opir_studies.refusals import refusal
from opir_studies.runs import RunRecord
from opir_studies.shares import SHARE_COLUMNS, share_rows
from opir_studies.sobol import sobol_indices
from opir_studies.statistics import difference_of, figures_of
from opir_studies.study import SOBOL, Study

RESULTS = "results.parquet"
RESULTS_CSV = "results.csv"
RUNS = "runs.parquet"
LAUNCHES = "launches.parquet"
SHARES = "shares.parquet"
SHARES_CSV = "shares.csv"
SENSITIVITY = "sensitivity.csv"
DEFINITION = "study.json"
TIMES = "run_times.csv"
#: How the names of figures begin that are shares of launches; others without a unit are counts,
#: which may exceed 1.
_SHARES = (
    "detected",
    "tracked",
    "completeness",
    "warned",
    "warning_contained",
    "impact_contained",
    "impact_predicted",
)


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
    runs: pa.Table
    launches: pa.Table
    shares: pa.Table

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
        runs = self.runs.num_rows
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
        tables = (pq.read_table(place / name) for name in (RESULTS, RUNS, LAUNCHES, SHARES))
        return StudyResult(place, definition, *tables)
    except OSError as error:
        words = f"is no folder of a finished study: {reason_of(error)}; `opir sweep` makes one"
        raise refusal("", words, str(place)) from error
    except (
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
        pa.ArrowException,
    ) as error:
        words = (
            f"has damaged results ({str(error).splitlines()[0]}); run the study again: its runs are"
            f" kept"
        )
        raise refusal("", words, str(place)) from error


def written_result(
    planned: PlannedStudy,
    folder: Path,
    records: Sequence[Sequence[RunRecord | None]],
    extra: Mapping[str, Any] | None = None,
) -> StudyResult:
    """Write the result of a study from the records of each design's runs, None for a run that
    failed; return it.

    `extra` is added to its definition.
    """
    runs = _runs_table(planned, records)
    table = _results_table(planned, records)
    launches = _launches_table(planned, records)
    shares = _shares_table(planned, records)
    contents = {
        RUNS: parquet_bytes(runs),
        RESULTS: parquet_bytes(table),
        RESULTS_CSV: _csv_bytes(table),
        LAUNCHES: parquet_bytes(launches),
        SHARES: parquet_bytes(shares),
        SHARES_CSV: _csv_bytes(shares),
        **_sensitivity_file(planned, table),
    }
    with (
        OutputFiles() as times
    ):  # they differ from one execution to the next, and are listed nowhere
        times.make_folder(folder, parents=True)
        times.write(
            folder / TIMES, _csv_bytes(_times_table(planned, records)), "study's", is_made_up=True
        )
    files = OutputFiles(folder / DEFINITION, is_made_up=True)
    try:
        for name, content in contents.items():
            files.write(folder / name, content, "study's", is_made_up=True)
        definition = files.commit(
            {**_definition(planned, records), "bounds": _bounds(planned, runs), **(extra or {})}
        )
    except BaseException:
        files.abandon()
        raise
    return StudyResult(folder, definition, table, runs, launches, shares)


def _failure_notes(records: Sequence[Sequence[RunRecord | None]]) -> list[str]:
    """Return a note on runs that failed, none without any."""
    failed = sum(run is None for runs in records for run in runs)
    words = f"{failed} of {sum(map(len, records))} runs failed: no mean and no share counts them"
    return [words] if failed else []


def _definition(
    planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]
) -> Mapping[str, Any]:
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
        "notes": [*_failure_notes(records), *planned.notes],
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


def _bounds(planned: PlannedStudy, runs: pa.Table) -> dict[str, list[float | None]]:
    """Return the bounds of each figure's mean: 0 where no run has less, and 1 of shares; None for
    no bound.
    """
    shares = set(planned.shares.values())
    bounds = dict[str, list[float | None]]()
    for name in planned.units:
        is_negative = any(value < 0.0 for value in runs[name].to_pylist())
        is_share = name.startswith(_SHARES) or name in shares
        bounds[name] = [None if is_negative else 0.0, 1.0 if is_share else None]
    return bounds


def _labels(planned: PlannedStudy, counts: Sequence[int]) -> dict[str, pa.Array]:
    """Return the columns of the designs, repeated `counts` times."""
    rows = np.repeat(np.arange(len(planned.designs)), counts).tolist()
    return _labels_of(planned, rows, planned.designs[0].design.paths)


def _labels_of(
    planned: PlannedStudy, rows: Sequence[int], paths: Sequence[str]
) -> dict[str, pa.Array]:
    """Return the columns of designs by their numbers (n,): the number, and the label of each
    path.
    """
    designs = [design.design for design in planned.designs]
    columns = {"design": pa.array(rows, pa.int64())}
    for place, path in enumerate(paths):
        labels = _labels_of_one_kind([design.levels[place] for design in designs])
        columns[path] = pa.array([labels[row] for row in rows])
    return columns


def _labels_of_one_kind(levels: Sequence[Level]) -> list[Any]:
    """Return labels as numbers if all are, else as text."""
    labels = [level.label for level in levels]
    if all(isinstance(label, int | float) and not isinstance(label, bool) for label in labels):
        return [float(label) for label in labels if label is not None]
    return [
        label if isinstance(label, str) else level.text
        for label, level in zip(labels, levels, strict=True)
    ]


def _runs_table(planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]) -> pa.Table:
    finished = [list(filter(None, runs)) for runs in records]
    runs = [run for runs in finished for run in runs]
    columns = _labels(planned, list(map(len, finished)))
    columns["replicate"] = pa.array([run.replicate for run in runs], pa.int64())
    columns["seed"] = pa.array([run.seed for run in runs], pa.int64())
    for place, name in enumerate(planned.units):
        columns[name] = pa.array([run.values[place] for run in runs], pa.float64())
    return pa.table(columns)


def _launches_table(
    planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]
) -> pa.Table:
    finished = [list(filter(None, runs)) for runs in records]
    pairs = zip(planned.designs, finished, strict=True)
    counts = [len(runs) * len(design.launches) for design, runs in pairs]
    columns = _labels(planned, counts)
    rows = [
        (run, facts, place)
        for design, runs in zip(planned.designs, finished, strict=True)
        for run in runs
        for place, facts in enumerate(design.launches)
    ]
    columns["replicate"] = pa.array([run.replicate for run, *_ in rows], pa.int64())
    columns["seed"] = pa.array([run.seed for run, *_ in rows], pa.int64())
    for number, name in enumerate(FACTS):
        columns[name] = pa.array([facts[number] for _, facts, _ in rows], pa.string())
    for number, (name, unit) in enumerate(planned.launch_units.items()):
        values = [run.launches[number][place] for run, _, place in rows]
        columns[name] = pa.array(values, launch_type(unit))
    return pa.table(columns)


def _shares_table(planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]) -> pa.Table:
    rows = share_rows(planned, records)
    labels = _labels_of(planned, [design for design, _ in rows], tuple(planned.study.vary))
    columns = {
        name: pa.array([row[name] for _, row in rows], kind) for name, kind in SHARE_COLUMNS.items()
    }
    return pa.table({**labels, **columns})


def _sensitivity_file(planned: PlannedStudy, table: pa.Table) -> dict[str, bytes]:
    """Return the file of Sobol indices of each figure and setting, of means over all conditions;
    none for another design.
    """
    study = planned.study
    if study.design != SOBOL:
        return {}
    rows = list[dict[str, Any]]()
    means = np.array(table["mean"].to_pylist()).reshape(len(planned.groups), -1, len(planned.units))
    for place, figure in enumerate(planned.units):
        index = sobol_indices(means[:, :, place].mean(axis=1), len(study.vary), study.seed)
        columns = {name: column.tolist() for name, column in index._asdict().items()}
        rows += [
            {
                "figure": figure,
                "setting": path,
                "first": columns["first"][row],
                "first_half_95": columns["first_half"][row],
                "total": columns["total"][row],
                "total_half_95": columns["total_half"][row],
            }
            for row, path in enumerate(study.vary)
        ]
    return {SENSITIVITY: _csv_bytes(pa.Table.from_pylist(rows))}


def _results_table(
    planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]
) -> pa.Table:
    units = planned.units
    values = [_values(runs, len(units)) for runs in records]
    rows = list[dict[str, Any]]()
    # Designs are compared with the first one in the same condition.
    conditions = len(planned.groups[0])
    references = [values[row % conditions] for row in range(len(values))]
    for design, runs, columns, reference in zip(
        planned.designs, records, values, references, strict=True
    ):
        finished = columns[[run is not None for run in runs]]
        seeds = {
            "runs": len(finished),
            "first_seed": design.scene.seed,
            "last_seed": design.scene.seed + len(columns) - 1,
        }
        rows += [
            {
                "figure": name,
                "unit": unit,
                **seeds,
                "share": planned.share_of(finished, name),
                **figures_of(columns[:, place]),
                **difference_of(columns[:, place], reference[:, place]),
            }
            for place, (name, unit) in enumerate(units.items())
        ]
    return _table(_labels(planned, [len(units)] * len(records)), rows)


def _table(columns: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return a table of columns, and of rows that follow them."""
    return pa.table(
        {**columns, **{name: pa.array([row[name] for row in rows]) for name in rows[0]}}
    )


def _values(records: Sequence[RunRecord | None], figures: int) -> Any:
    """Return the values (runs, figures), nan for runs that failed."""
    nothing = (np.nan,) * figures
    rows = [record.values if record else nothing for record in records]
    return np.array(rows, dtype=np.float64).reshape(-1, figures)


def _times_table(planned: PlannedStudy, records: Sequence[Sequence[RunRecord | None]]) -> pa.Table:
    rows = [
        {"unit": "s", **figures_of(np.array([run.run_time_s for run in filter(None, runs)]))}
        for runs in records
    ]
    return _table(_labels(planned, [1] * len(records)), rows)


def _csv_bytes(table: pa.Table) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.column_names)
    for row in table.to_pylist():
        writer.writerow(["" if value != value else value for value in row.values()])
    return text.getvalue().encode()
