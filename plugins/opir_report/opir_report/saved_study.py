"""A study as `opir sweep` wrote it: its definition, and a row per design and figure."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from opir_scoring import percent_text

from opir_core.arrays import BoolArray
from opir_core.errors import Problem, SceneError, reason_of
from opir_core.output import FILES_KEY, file_digest, finish_interrupted
from opir_report.figure_data import FigureData
from opir_report.words import level_value, level_words, setting_words

DEFINITION = "study.json"
RESULTS = "results.parquet"
RUNS = "runs.parquet"
#: The setting by which studies side by side differ.
STUDY = "study"
#: The version of the definition that is read.
_VERSION = 2


@frozen(eq=False)
class SavedStudy:
    """A study: its definition (`study.json`) and its results (`results.parquet`), with short names
    of what varies.
    """

    definition: dict[str, Any]
    results: FigureData
    #: A row per run, if the folder has them.
    runs: FigureData | None = None

    @property
    def paths(self) -> list[str]:
        """The paths in the scene that vary."""
        return [str(path) for path in self.definition["vary"]]

    @property
    def question(self) -> str:
        """The question that the study answers, "" for none."""
        return str(self.definition.get("question", ""))

    @property
    def split(self) -> str:
        """The path whose values are answered one by one, "" for none."""
        return str(self.definition.get("split", ""))

    @property
    def units(self) -> dict[str, str]:
        """The unit of each figure, "" for none."""
        return dict(self.definition["figures"])

    @property
    def figures_of_metrics(self) -> dict[str, list[str]]:
        """The figures of each metric that have a value in some design."""
        known = set(self.results["figure"][np.isfinite(self.results["mean"])].tolist())
        own = {
            name: [each for each in figures if each in known]
            for name, figures in self.definition["metrics"].items()
        }
        return {name: figures for name, figures in own.items() if figures}

    @property
    def requirements(self) -> list[dict[str, Any]]:
        """The requirements on figures: `figure`, `limit`, and `is_least`, whether it is a lower
        bound.
        """
        return list(self.definition.get("requirements", ()))

    @property
    def shown(self) -> list[str]:
        """The figures that were asked for, by default the first of each metric; only those with a
        value.
        """
        known = self.figures_of_metrics
        every = {name for figures in known.values() for name in figures}
        asked = [name for name in self.definition.get("shown", ()) if name in every]
        return asked or [figures[0] for figures in known.values()]

    def constant(self, figure: str) -> float | None:
        """Return the value that a figure has for every launch of every run of every design, or
        None.
        """
        rows = self.rows(figure)
        means = rows["mean"]
        # Quantiles and mean of equal values are equal but for rounding.
        spread = [rows[name] for name in ("q10", "median", "q90")]
        if not len(means) or not self.is_whole(figure).all():
            return None
        if all(np.allclose(each, means[0], rtol=1e-9, atol=0.0) for each in (means, *spread)):
            return float(means[0]) if not np.any(rows["sd"] > 1e-9 * abs(means[0])) else None
        return None

    def is_whole(self, figure: str) -> BoolArray:
        """Return of which designs (n,) a figure's mean is over all launches that it applies to, in
        all runs.
        """
        return np.asarray(self.rows(figure)["share"] == 1.0)

    def share_text(self, figure: str, least: float, most: float) -> str:
        """Return of which share of launches, or else of runs, means are: `of 5 % of launches`, ""
        for all.
        """
        if least == most == 1.0:
            return ""
        ends = dict.fromkeys(map(percent_text, (least, most)))
        of = "launches" if figure in self.definition.get("shares", {}) else "runs"
        return f"of {' to '.join(ends)} of {of}"

    def shares_text(self, figure: str) -> str:
        """Return of which share of launches, or runs, the means of all designs are, "" for all of
        them.
        """
        shares = np.nan_to_num(self.rows(figure)["share"])
        return (
            self.share_text(figure, float(np.min(shares)), float(np.max(shares)))
            if len(shares)
            else ""
        )

    def rows(self, figure: str) -> FigureData:
        """Return the rows of a figure, one per design, with the intervals of means cut at the
        figure's bounds.

        Raises `KeyError` for an unknown figure.
        """
        if figure not in self.units:
            raise KeyError(f"the study has no figure {figure!r}; it has {', '.join(self.units)}")
        rows = self.results.where(self.results["figure"] == figure)
        return self.cut(figure, rows)

    def cut(self, figure: str, rows: FigureData) -> FigureData:
        """Return rows with the intervals of a figure's means, `low_95` and `high_95`, cut at the
        figure's bounds.
        """
        low, high = self.definition.get("bounds", {}).get(figure, (None, None))
        ends = -np.inf if low is None else low, np.inf if high is None else high
        return FigureData(
            {**rows.columns, **{name: np.clip(rows[name], *ends) for name in ("low_95", "high_95")}}
        )

    def is_met(self, requirement: Mapping[str, Any]) -> BoolArray:
        """Return whether each design meets a requirement: its mean does, and no launch or run lacks
        the figure.
        """
        return self.is_met_by_mean(requirement) & self.is_whole(requirement["figure"])

    def is_met_by_mean(self, requirement: Mapping[str, Any]) -> BoolArray:
        """Return whether the mean of each design meets a requirement, whatever it is over; nan does
        not.
        """
        mean = self.rows(requirement["figure"])["mean"]
        limit = requirement["limit"]
        return np.asarray(mean >= limit if requirement["is_least"] else mean <= limit)

    def labels(self, rows: FigureData, paths: Sequence[str] | None = None) -> list[str]:
        """Return the values of what varies in rows (n,), `scan period 50 ms, tracker imm`; by
        default of all paths.
        """
        return self._labels(rows, self.paths if paths is None else paths, level_words)

    def short_labels(self, rows: FigureData, paths: Sequence[str] | None = None) -> list[str]:
        """Return the values of what varies in rows (n,) without the names, `50 ms, imm`; `names`
        has them.
        """
        return self._labels(rows, self.paths if paths is None else paths, level_value)

    def names(self, paths: Sequence[str] | None = None) -> str:
        """Return the names of what varies, `scan period, tracker`."""
        return ", ".join(
            setting_words(path)[0] for path in (self.paths if paths is None else paths)
        )

    def _labels(
        self, rows: FigureData, paths: Sequence[str], words: Callable[[str, str], str]
    ) -> list[str]:
        columns = [
            [words(path, level_text(value)) for value in rows[path].tolist()] for path in paths
        ]
        return (
            [", ".join(parts) for parts in zip(*columns, strict=True)]
            if columns
            else [""] * len(rows)
        )


def level_text(value: object) -> str:
    """Return a value of what varies as text, whole numbers without decimals."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def is_study(path: Path) -> bool:
    """Return whether a path is the folder of a study, or its definition."""
    return (path / DEFINITION).is_file() or (path.name == DEFINITION and path.is_file())


def read_study(path: Path) -> SavedStudy:
    """Return the study in a folder; raises `SceneError` if it is damaged or of another version."""
    from pyarrow import ArrowException, parquet

    folder = path.parent if path.name == DEFINITION else path
    finish_interrupted(folder / DEFINITION)
    try:
        definition = json.loads((folder / DEFINITION).read_text(encoding="utf-8"))
        for entry in definition.get(FILES_KEY, ()):
            if file_digest(folder / entry["name"]) != entry["sha256"]:
                raise ValueError(f"{entry['name']} is not what was written: its SHA-256 differs")
        table = parquet.read_table(folder / RESULTS)
    except OSError as error:
        words = f"is no folder of a finished study: {reason_of(error)}; `opir sweep` makes one"
        raise SceneError([Problem("", words)], source=str(folder)) from error
    except (
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        RecursionError,
        ArrowException,
    ) as error:
        words = (
            f"has damaged results ({str(error).splitlines()[0]}); run the study again: its runs are"
            f" kept"
        )
        raise SceneError([Problem("", words)], source=str(folder)) from error
    version = definition.get("study_version") if isinstance(definition, dict) else None
    if version != _VERSION:
        words = f"of study version {version}, where {_VERSION} is read: run the study anew"
        raise SceneError([Problem("study_version", words)], source=str(folder / DEFINITION))
    runs = parquet.read_table(folder / RUNS) if (folder / RUNS).is_file() else None
    return SavedStudy(definition, _columns(table), None if runs is None else _columns(runs))


def _columns(table: Any) -> FigureData:
    return FigureData({name: np.array(table[name].to_pylist()) for name in table.column_names})


def joined_studies(studies: Sequence[SavedStudy]) -> SavedStudy:
    """Return studies side by side as one that varies the study too; raises `SceneError` if they
    vary other settings.

    Only the figures that all have are kept. Differences stay those from the first design of each
    study.
    """
    first = studies[0]
    if len(studies) == 1:
        return first
    for other in studies[1:]:
        if set(other.paths) != set(first.paths):
            ours, theirs = (", ".join(each.paths) or "nothing" for each in (first, other))
            words = (
                f"vary different settings: {first.definition['study']} {ours};"
                f" {other.definition['study']} {theirs}"
            )
            raise SceneError([Problem("", words)], source="the studies")
    figures = [name for name in first.units if all(name in each.units for each in studies)]
    names = _distinct([str(each.definition["study"]) for each in studies])
    counts = np.cumsum([0, *(len(each.definition["designs"]) for each in studies)])
    parts = [each.results.where(np.isin(each.results["figure"], figures)) for each in studies]
    definition = {
        **first.definition,
        "study": " and ".join(names),
        "vary": [STUDY, *first.paths],
        "figures": {name: first.units[name] for name in figures},
        "bounds": {name: _shared_bounds(studies, name) for name in figures},
        "metrics": {
            metric: [each for each in own if each in figures]
            for metric, own in first.definition["metrics"].items()
        },
        "designs": [design for each in studies for design in each.definition["designs"]],
    }
    return SavedStudy(definition, _joined(parts, names, counts))


def _shared_bounds(studies: Sequence[SavedStudy], figure: str) -> list[float | None]:
    """Return the bounds of a figure that all studies have."""
    own = [each.definition.get("bounds", {}).get(figure, (None, None)) for each in studies]
    return [
        end if all(each[side] == end for each in own) else None for side, end in enumerate(own[0])
    ]


def _distinct(names: list[str]) -> list[str]:
    return [
        f"{name} ({number})" if names.count(name) > 1 else name
        for number, name in enumerate(names, start=1)
    ]


def _joined(parts: Sequence[FigureData], names: Sequence[str], counts: Any) -> FigureData:
    """Return the rows of studies one after another, with the study's name and designs numbered
    on.
    """
    shared = [name for name in parts[0].columns if all(name in each.columns for each in parts)]
    columns = {name: np.concatenate([each[name] for each in parts]) for name in shared}
    columns["design"] = np.concatenate(
        [each["design"] + add for each, add in zip(parts, counts, strict=False)]
    )
    columns[STUDY] = np.repeat(np.array(names), [len(each) for each in parts])
    return FigureData(columns)
