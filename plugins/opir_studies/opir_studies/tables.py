"""The tables of a study's result, from the columns of its runs.

A table with a row per run or launch is written a group of rows at a time: memory does not grow with
it.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from opir_studies.axes import Level
from opir_studies.finished import StudyRuns
from opir_studies.launches import FACTS
from opir_studies.parts import LAUNCHES, launch_type
from opir_studies.planning import PlannedStudy
from opir_studies.shares import SHARE_COLUMNS, share_rows
from opir_studies.sobol import sobol_indices
from opir_studies.statistics import difference_of, figures_of
from opir_studies.study import SOBOL

#: Rows of a group in a file.
_GROUP = 1 << 14
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


def write_rows(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    """Write the rows of tables into a Parquet file, group by group."""
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        waiting = list[pa.Table]()
        for table in tables:
            waiting.append(table)
            if sum(each.num_rows for each in waiting) >= _GROUP:
                writer.write_table(pa.concat_tables(waiting), row_group_size=_GROUP)
                waiting = []
        writer.write_table(pa.concat_tables([*waiting, schema.empty_table()]))


def runs_schema(planned: PlannedStudy) -> pa.Schema:
    """Return the columns of the table of runs."""
    figures = [(name, pa.float64()) for name in planned.units]
    return pa.schema([*_label_fields(planned), *_SEED_FIELDS, *figures])


def runs_tables(planned: PlannedStudy, runs: StudyRuns) -> Iterator[pa.Table]:
    """Yield the rows of runs, design by design."""
    names = {name: name for name in ("replicate", "seed", *planned.units)}
    for design in range(len(planned.designs)):
        for table in runs.tables(design, names, _GROUP):
            labels = design_labels(planned, [design] * table.num_rows)
            yield pa.table({**labels, **dict(zip(table.column_names, table.columns, strict=True))})


def launches_schema(planned: PlannedStudy) -> pa.Schema:
    """Return the columns of the table of launches."""
    facts = [(name, pa.string()) for name in FACTS]
    columns = [(name, launch_type(unit)) for name, unit in planned.launch_units.items()]
    return pa.schema([*_label_fields(planned), *_SEED_FIELDS, *facts, *columns])


def launches_tables(planned: PlannedStudy, runs: StudyRuns) -> Iterator[pa.Table]:
    """Yield the rows of launches, design by design."""
    columns = {f"{LAUNCHES}{name}": name for name in planned.launch_units}
    names = {"replicate": "replicate", "seed": "seed", **columns}
    for design, each in enumerate(planned.designs):
        count = len(each.launches)
        for table in runs.tables(design, names, max(1, _GROUP // max(1, count))):
            rows = table.num_rows
            run = np.repeat(np.arange(rows), count)
            launch = np.tile(np.arange(count), rows)
            facts = [
                pa.array([names[place] for names in each.launches], pa.string())
                for place in range(len(FACTS))
            ]
            yield pa.table(
                {
                    **design_labels(planned, [design] * (rows * count)),
                    **{name: table[name].take(run) for name in ("replicate", "seed")},
                    **{
                        name: values.take(launch) for name, values in zip(FACTS, facts, strict=True)
                    },
                    **{
                        name: table[name].combine_chunks().flatten()
                        for name in planned.launch_units
                    },
                }
            )


def shares_table(planned: PlannedStudy, runs: StudyRuns) -> pa.Table:
    """Return a row per required share."""
    rows = share_rows(planned, runs)
    labels = _labels_of(planned, [design for design, _ in rows], tuple(planned.study.vary))
    columns = {
        name: pa.array([row[name] for _, row in rows], kind) for name, kind in SHARE_COLUMNS.items()
    }
    return pa.table({**labels, **columns})


def sensitivity_table(planned: PlannedStudy, table: pa.Table) -> pa.Table | None:
    """Return the Sobol indices of each figure and setting, of means over all conditions; None for
    another design.
    """
    study = planned.study
    if study.design != SOBOL:
        return None
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
    return pa.Table.from_pylist(rows)


def results_table(
    planned: PlannedStudy, runs: StudyRuns
) -> tuple[pa.Table, dict[str, list[float | None]]]:
    """Return a row per design and figure, and the bounds of each figure's mean: 0 where no run has
    less, and 1 of shares; None for no bound.

    Of the values of runs there are no more in memory than of a figure of two designs.
    """
    counts = [len(runs.numbers(design)) for design in range(len(planned.designs))]
    rows = dict[tuple[int, str], dict[str, Any]]()
    bounds = dict[str, list[float | None]]()
    shares = set(planned.shares.values())
    for name in planned.units:
        lowest = np.inf
        for design, values, row in _rows_of_figure(planned, runs, name):
            rows[design, name] = {**_head(planned, runs, design, name, counts[design]), **row}
            lowest = min(lowest, np.nanmin(values, initial=np.inf))
        is_share = name.startswith(_SHARES) or name in shares
        bounds[name] = [None if lowest < 0.0 else 0.0, 1.0 if is_share else None]
    designs = range(len(planned.designs))
    ordered = [rows[design, name] for design in designs for name in planned.units]
    labels = np.repeat(np.arange(len(planned.designs)), len(planned.units)).tolist()
    return _table(design_labels(planned, labels), ordered), bounds


def _rows_of_figure(
    planned: PlannedStudy, runs: StudyRuns, name: str
) -> Iterator[tuple[int, Any, dict[str, Any]]]:
    """Yield each design, the values (n,) of a figure and what the table has of them."""
    share_name = planned.shares.get(name)
    # Designs are compared with the first one in the same condition.
    conditions = len(planned.groups[0])
    for condition in range(conditions):
        reference = _by_number(runs, condition, runs.values(condition, name))
        for design in range(condition, len(planned.designs), conditions):
            values = runs.values(design, name)
            figures = {name: values}
            if share_name is not None:
                figures[share_name] = runs.values(design, share_name)
            share = planned.share_of(figures, name)
            differences = difference_of(_by_number(runs, design, values), reference)
            yield design, values, {"share": share, **figures_of(values), **differences}


def _by_number(runs: StudyRuns, design: int, values: Any) -> Any:
    """Return values (n,) at the numbers of their runs (count,), nan for runs that failed."""
    count = runs.counts[design]
    if len(values) == count:
        return values
    placed = np.full(count, np.nan)
    placed[runs.numbers(design)] = values
    return placed


def _head(
    planned: PlannedStudy, runs: StudyRuns, design: int, name: str, count: int
) -> dict[str, Any]:
    first_seed = planned.designs[design].scene.seed
    return {
        "figure": name,
        "unit": planned.units[name],
        "runs": count,
        "first_seed": first_seed,
        "last_seed": first_seed + runs.counts[design] - 1,
    }


def times_table(planned: PlannedStudy, runs: StudyRuns) -> pa.Table:
    """Return the processor times of the runs of each design."""
    designs = range(len(planned.designs))
    rows = [{"unit": "s", **figures_of(runs.values(design, "run_time_s"))} for design in designs]
    return _table(design_labels(planned, list(designs)), rows)


def _table(columns: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> pa.Table:
    """Return a table of columns, and of rows that follow them."""
    return pa.table(
        {**columns, **{name: pa.array([row[name] for row in rows]) for name in rows[0]}}
    )


_SEED_FIELDS = [("replicate", pa.int64()), ("seed", pa.int64())]


def _label_fields(planned: PlannedStudy) -> list[pa.Field]:
    return list(pa.table(design_labels(planned, range(len(planned.designs)))).schema)


def design_labels(planned: PlannedStudy, rows: Sequence[int]) -> dict[str, pa.Array]:
    """Return the columns of designs by their numbers (n,), with all paths."""
    return _labels_of(planned, rows, planned.designs[0].design.paths)


def _labels_of(
    planned: PlannedStudy, rows: Sequence[int], paths: Sequence[str]
) -> dict[str, pa.Array]:
    """Return the columns of designs by their numbers (n,): the number, and the label of each
    path.
    """
    designs = [design.design for design in planned.designs]
    numbers = pa.array(rows, pa.int64())
    columns = {"design": numbers}
    for place, path in enumerate(paths):
        labels = _labels_of_one_kind([design.levels[place] for design in designs])
        columns[path] = pa.array(labels).take(numbers)
    return columns


def _labels_of_one_kind(levels: Sequence[Level]) -> list[Any]:
    """Return labels as numbers if all are, else as text."""
    labels: list[Any] = [level.label for level in levels]
    if all(isinstance(label, int | float) and not isinstance(label, bool) for label in labels):
        return [float(label) for label in labels]
    return [
        label if isinstance(label, str) else level.text
        for label, level in zip(labels, levels, strict=True)
    ]
