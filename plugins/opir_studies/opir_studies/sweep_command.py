"""`opir sweep`: read the study, run it with progress and remaining time, print a table."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from attrs import evolve

from opir_core.cli import grouped, table
from opir_core.errors import install_command
from opir_core.host import ended_if_stuck
from opir_core.notebook import progress
from opir_core.reading import InvalidNode
from opir_studies.axes import value_of_text, vary_argument
from opir_studies.refusals import refusal, require_positive
from opir_studies.result import RESULTS_CSV, SENSITIVITY, StudyResult
from opir_studies.result_words import (
    cell,
    difference_cell,
    share_lines,
    share_verdict_lines,
    verdict_lines,
)
from opir_studies.sharding import sweep_shard
from opir_studies.study import SOBOL, Study, is_study, read_study
from opir_studies.subsets import SUBSET_PATHS
from opir_studies.sweeping import Shard, StudyProgress, shown_runs, sweep as result_of_sweep

#: The most designs that are printed; all are in the files.
_MOST_ROWS = 40
#: Columns of a terminal that a table fills.
_WIDEST = 100
#: The most figures that are printed, the first of each metric, unless the user names them.
_MOST_FIGURES = 4


def sweep(arguments: argparse.Namespace) -> int:
    """Run the study of the arguments, write its report, and print its results."""
    write_report = report_writer(arguments)
    study = study_of(arguments)
    folder = Path(arguments.out or f"{Path(arguments.study).stem}-study")
    limits = {"workers": arguments.workers, "dead_after_s": arguments.dead_after}
    if arguments.shard is not None:
        return _shard(arguments, study, folder, limits)
    with watched_runs(arguments, folder) as on_progress:
        result = result_of_sweep(
            study, folder, **limits, on_progress=on_progress, on_notes=_shown_notes(arguments)
        )
    written = write_report(folder)
    if arguments.quiet:
        return 0
    text = (
        json.dumps(_plain(result), indent=2)
        if arguments.json
        else "\n".join([as_text(result), *written])
    )
    sys.stdout.write(text + "\n")
    return 0


def _shard(
    arguments: argparse.Namespace, study: Study, folder: Path, limits: Mapping[str, Any]
) -> int:
    """Make the shard of the arguments, and print how many runs it has."""
    shard = Shard.of(arguments.shard)
    if arguments.report is not None or arguments.figures is not None or arguments.json:
        raise refusal("--shard", "has no results to print or draw; `opir merge` joins all shards")
    with watched_runs(arguments, folder) as on_progress:
        runs = sweep_shard(study, folder, shard, **limits, on_progress=on_progress)
    if not arguments.quiet:
        sys.stdout.write(f"{runs} runs in {folder}; join all shards with `opir merge`\n")
    return 0


def report_writer(arguments: argparse.Namespace) -> Callable[[Path], Sequence[str]]:
    """Return a function that writes the report of the arguments, and returns lines on the files.

    Raises `SceneError`, before a run is made, where the package that draws is missing.
    """
    page = arguments.report
    figures = arguments.figures
    if page is None and figures is None:
        return lambda _folder: ()
    try:
        from opir_report import write_study_figures, write_study_report  # takes a second
    except ImportError as error:
        flag = "--report" if page is not None else "--figures"
        raise refusal(flag, f"needs opir-report; {install_command('opir-report')}") from error

    def write(folder: Path) -> Sequence[str]:
        lines = []
        if page is not None:
            lines.append(f"Report: {write_study_report(folder, Path(page))[0]}")
        if figures is not None:
            write_study_figures(folder, Path(figures))
            lines.append(f"Figures: {figures}")
        return lines

    return write


def study_of(arguments: argparse.Namespace) -> Study:
    """Return the study of the arguments: that of the file, or of a scene, with what the command
    line changes.
    """
    if arguments.workers is not None:
        require_positive("--workers", arguments.workers, "workers")
    path = arguments.study
    study = read_study(path) if is_study(path) else Study(scene=path, study=Path(path).stem)
    metrics = tuple(_value("--metric", words) for words in arguments.metrics)
    study = evolve(
        study,
        vary={**study.vary, **dict(map(vary_argument, arguments.vary))},
        conditions={
            **study.conditions,
            **dict(vary_argument(words, "--condition") for words in arguments.conditions),
        },
        overrides={**study.overrides, **dict(map(_override, arguments.overrides))},
        metrics=metrics or study.metrics,
        show=tuple(arguments.show) or study.show,
        requirements=tuple(arguments.requirements) or study.requirements,
    )
    for name in ("runs", "executor", "until", "design", "samples", "seed"):
        value = getattr(arguments, name)
        if value is None:
            continue
        if name == "executor":
            value = _value("--executor", value)
        try:
            study = evolve(study, **{name: value})
        except ValueError as error:
            raise refusal(f"--{name}", str(error)) from error
    return study


def _override(words: str) -> tuple[str, Any]:
    path, equals, text = words.partition("=")
    if not equals:
        raise refusal("--set", f"{words!r} has no '='; write PATH=VALUE")
    return path.strip(), _value("--set", text)


def _value(flag: str, text: str) -> Any:
    try:
        return value_of_text(text)
    except (InvalidNode, IndexError) as refused:
        complaints = [complaint.message for complaint in getattr(refused, "complaints", ())]
        raise refusal(flag, "; ".join(complaints) or "a value is missing") from refused


@contextmanager
def watched_runs(
    arguments: argparse.Namespace, folder: Path
) -> Iterator[Callable[[StudyProgress], None]]:
    """Show the progress of runs, end the process if one is stuck, and say after an interrupt how to
    go on.
    """
    is_shown = sys.stderr.isatty() and not arguments.quiet
    try:
        with (
            ended_if_stuck(arguments.dead_after),
            progress(is_shown=is_shown) as update,
        ):
            yield partial(shown_runs, update)
    except KeyboardInterrupt:
        sys.stderr.write(
            f"stopped; finished runs are kept in {folder}, and the same command continues\n"
        )
        raise


def _shown_notes(arguments: argparse.Namespace) -> Callable[[Sequence[str]], None]:
    """Return a function that shows notes on a terminal before the first run; they follow with the
    results too.
    """
    is_shown = sys.stderr.isatty() and not arguments.quiet

    def show(notes: Sequence[str]) -> None:
        if is_shown:
            sys.stderr.writelines(f"note: {note}\n" for note in notes)

    return show


def as_text(result: StudyResult) -> str:
    """Return which designs meet the requirements, and a table: the figures that were asked for,
    with intervals.

    A mean over some of the launches, or runs, has their share in brackets. Figures that have one
    value in all runs are a line of text below the table.
    """
    shown, constant = _shown(result)
    rows = {name: result.shown_rows(name) for name in result.units}
    designs = result.definition["designs"]
    head = [*map(_short, result.paths), "runs", *shown]
    body = [
        [
            *(str(design[path]) for path in result.paths),
            str(rows[next(iter(rows))][place]["runs"]),
            *(cell(rows[name][place]) for name in shown),
        ]
        for place, design in enumerate(designs[:_MOST_ROWS])
    ]
    more = len(designs) - len(body)
    return "\n\n".join(
        [
            *map("note: {}".format, result.definition["notes"]),
            _heading(result),
            *verdict_lines(result),
            *share_verdict_lines(result),
            *_tables(head, body, len(head) - len(shown)),
            *([f"and {more} more designs"] if more > 0 else []),
            *share_lines(result, shown),
            *([f"In every run: {', '.join(constant)}"] if constant else []),
            *_differences(result, shown, rows),
            *_sensitivity(result, shown),
            f"All figures: {result.folder / RESULTS_CSV}",
        ]
    )


def _shown(result: StudyResult) -> tuple[Sequence[str], Sequence[str]]:
    """Return the figures of the table, and in words those that have one value in all runs."""
    requested = result.definition["shown"]
    if requested:
        return requested, []
    leading = [names[0] for names in result.definition["metrics"].values()]
    values = {name: np.unique(result.values(name)).tolist() for name in leading}
    complete = [name for name in leading if all(row["share"] == 1.0 for row in result.rows(name))]
    constant = [
        name
        for name in complete
        if len(values[name]) == 1 and len(result.definition["designs"]) > 1
    ]
    words = [f"{name} {values[name][0]:g} {result.units[name]}".strip() for name in constant]
    varying = [name for name in leading if name not in constant][:_MOST_FIGURES]
    return (varying, words) if varying else (leading[:_MOST_FIGURES], [])


def _tables(head: Sequence[str], body: Sequence[Sequence[str]], fixed: int) -> Sequence[str]:
    """Return a table, or several where it would be too wide; each begins with the `fixed` first
    columns.
    """
    widths = [max(len(row[column]) for row in (head, *body)) + 2 for column in range(len(head))]
    room = _WIDEST - sum(widths[:fixed])
    groups = [[fixed]]
    space = room - widths[fixed]
    for column in range(fixed + 1, len(head)):
        if widths[column] > space:
            groups.append([])
            space = room
        groups[-1].append(column)
        space -= widths[column]
    places = [[*range(fixed), *group] for group in groups]
    return [
        table(
            [head[column] for column in row], [[cells[column] for column in row] for cells in body]
        )
        for row in places
    ]


def _heading(result: StudyResult) -> str:
    definition = result.definition
    runs = result.run_count
    count = len(definition["designs"])
    words = "mean [95 % interval] over runs" if runs > count else "one run of each, so no intervals"
    return (
        f"{definition['study']}: {grouped(count)} design{'s' if count != 1 else ''},"
        f" {grouped(runs)} runs; {words}"
    )


def _differences(
    result: StudyResult, shown: Sequence[str], rows: Mapping[str, Sequence[Any]]
) -> Sequence[str]:
    """Return the table of differences from the first design, of the same seeds; none for a single
    design.
    """
    conditions = result.definition["conditions"]
    if result.definition["design"] == SOBOL:
        return ()
    designs = result.definition["designs"][:_MOST_ROWS]
    count = len({tuple(design[path] for path in conditions) for design in designs})
    if len(designs) <= count:
        return ()
    head = [f"minus the first design{' in that condition' if conditions else ''}", *shown]
    body = [
        [
            ", ".join(str(design[path]) for path in result.paths),
            *(difference_cell(rows[name][place], rows[name][place % count]) for name in shown),
        ]
        for place, design in enumerate(designs)
        if place >= count
    ]
    return _tables(head, body, 1)


def _sensitivity(result: StudyResult, shown: Sequence[str]) -> Sequence[str]:
    """Return a table of the Sobol indices of the shown figures; none for another design."""
    if result.definition["design"] != SOBOL:
        return ()
    with (result.folder / SENSITIVITY).open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["figure"] in shown]
    body = [
        [
            row["figure"],
            _short(row["setting"]),
            *(
                f"{float(row[name]):.2f} ± {float(row[f'{name}_half_95']):.2f}"
                if row[name]
                else "-"
                for name in ("first", "total")
            ),
        ]
        for row in rows
    ]
    return [table(["Sobol indices", "setting", "alone", "in all"], body)]


def _short(path: str) -> str:
    if path in SUBSET_PATHS:
        return path
    *_, parent, setting = ["", *path.split(".")]
    return (
        f"{parent}.{setting}" if setting.isupper() else setting
    )  # a target class needs its parent


def _plain(result: StudyResult) -> Mapping[str, Any]:
    rows = [
        {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in row.items()
        }
        for row in result.table.to_pylist()
    ]
    return {**result.definition, "results": rows}
