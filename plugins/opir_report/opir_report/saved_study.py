"""A study as `opir sweep` wrote it: its definition, and a row per design and figure."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_scoring import percent_text

from opir_core.arrays import BoolArray
from opir_core.errors import BAD_DATA, Problem, SceneError, reason_of
from opir_core.output import FILES_KEY, file_digest, finish_interrupted
from opir_core.reading import STUDY_FORMAT
from opir_report.figure_data import FigureData
from opir_report.words import level_value, level_words, setting_words

DEFINITION = "study.json"
RESULTS = "results.parquet"
RUNS = "runs.parquet"
LAUNCHES = "launches.parquet"
SHARES = "shares.parquet"
SENSITIVITY = "sensitivity.csv"
#: The setting by which studies side by side differ.
STUDY = "study"
#: The setting that stands for all conditions of a study, and for what it is split by.
CONDITION = "condition"


#: Lists and blocks of a definition, and what is in them.
_PARTS: Mapping[type, Mapping[str, type]] = {
    list: {
        **dict.fromkeys(("vary", "conditions", "shown", "notes"), str),
        **dict.fromkeys(("requirements", "share_requirements", "designs"), dict),
    },
    dict: {
        **dict.fromkeys(("figures", "shares", "launches", "versions"), str),
        **dict.fromkeys(("metrics", "bounds"), list),
        "settings": dict,
    },
}
#: What each definition has.
_KEYS = ("study", "scene", "design", "designs", "vary", "figures", "metrics", "until")


@frozen(eq=False)
class SavedStudy:
    """A study: its definition (`study.json`) and its results (`results.parquet`), with short names
    of what varies.
    """

    definition: dict[str, Any]
    results: FigureData
    #: A row per run, if the folder has them.
    runs: FigureData | None = None
    #: A row per launch of each run, and one per required share of launches, if the folder has them.
    launches: FigureData | None = None
    shares: FigureData | None = None
    #: Sobol indices by figure and setting, of a study of that design.
    sensitivity: FigureData | None = None

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
    def choices(self) -> list[str]:
        """The paths that vary and are no conditions, nor what the study is split by."""
        return [path for path in self.paths if path != self.split]

    @property
    def varied(self) -> list[str]:
        """The paths that vary and are no conditions."""
        return [str(path) for path in self.definition.get("varied", self.definition["vary"])]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each figure, "" for none."""
        return dict(self.definition["figures"])

    @property
    def figures_of_metrics(self) -> dict[str, list[str]]:
        """The figures of each metric that have a value in some design."""
        known_figures = set(self.results["figure"][np.isfinite(self.results["mean"])].tolist())
        metrics = {
            metric: [figure for figure in figures if figure in known_figures]
            for metric, figures in self.definition["metrics"].items()
        }
        return {metric: figures for metric, figures in metrics.items() if figures}

    @property
    def requirements(self) -> list[dict[str, Any]]:
        """The requirements on figures: `figure`, `limit`, and `is_least`, whether it is a lower
        bound.
        """
        return list(self.definition.get("requirements", ()))

    def requirements_on(self, figure: str) -> list[dict[str, Any]]:
        """Return the requirements on a figure."""
        return [each for each in self.requirements if each["figure"] == figure]

    @property
    def shown(self) -> list[str]:
        """The requested figures, by default the first of each metric; only those with a value."""
        metrics = self.figures_of_metrics.values()
        names = {name for figures in metrics for name in figures}
        requested = [name for name in self.definition.get("shown", ()) if name in names]
        return requested or [figures[0] for figures in metrics]

    @property
    def varying(self) -> list[str]:
        """The figures of `shown` that are not constant."""
        return [figure for figure in self.shown if self.constant(figure) is None]

    def constant(self, figure: str) -> float | None:
        """Return the value that a figure has for every launch of every run of every design, or
        None.
        """
        rows = self.rows(figure)
        if not len(rows) or not self.is_whole(figure).all():
            return None
        value = float(rows["mean"][0])
        # Quantiles and mean of equal values are equal but for rounding.
        is_constant = all(
            np.allclose(rows[name], value, rtol=1e-9, atol=0.0)
            for name in ("mean", "q10", "median", "q90")
        ) and not np.any(rows["sd"] > 1e-9 * abs(value))
        return value if is_constant else None

    def is_whole(self, figure: str) -> BoolArray:
        """Return of which designs (n,) a figure's mean is over all launches that it applies to, in
        all runs.
        """
        return np.asarray(self.rows(figure)["share"] == 1.0)

    def share_text(self, figure: str, least: float, largest: float) -> str:
        """Return of which share of launches, or else of runs, means are: `of 5 % of launches`, ""
        for all.
        """
        if least == largest == 1.0:
            return ""
        ends = dict.fromkeys(map(percent_text, (least, largest)))
        events = "launches" if figure in self.definition.get("shares", {}) else "runs"
        return f"of {' to '.join(ends)} of {events}"

    def shares_text(self, figure: str) -> str:
        """Return of which share of launches, or runs, the means of all designs are, "" for all of
        them.
        """
        shares = np.nan_to_num(self.rows(figure)["share"])
        if not len(shares):
            return ""
        return self.share_text(figure, float(np.min(shares)), float(np.max(shares)))

    def rows(self, figure: str) -> FigureData:
        """Return the rows of a figure, one per design, with the intervals of means cut at the
        figure's bounds.

        Raises `KeyError` for an unknown figure.
        """
        if figure not in self.units:
            raise KeyError(f"the study has no figure {figure!r}; it has {', '.join(self.units)}")
        return self.cut(figure, self.results.at("figure", figure))

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
        columns = [rows[path].tolist() for path in paths]
        return [
            ", ".join(
                words(path, level_text(values[row]))
                for path, values in zip(paths, columns, strict=True)
            )
            for row in range(len(rows))
        ]


def level_text(value: object) -> str:
    """Return a value of what varies as text, whole numbers without decimals."""
    return f"{value:g}" if isinstance(value, float) else str(value)


def is_study(path: Path) -> bool:
    """Return whether a path is the folder of a study, or its definition."""
    return (path / DEFINITION).is_file() or (path.name == DEFINITION and path.is_file())


def read_study(path: Path) -> SavedStudy:
    """Return the study in a folder; raises `SceneError` if it is damaged or of another version."""
    from pyarrow import ArrowException

    folder = path.parent if path.name == DEFINITION else path
    finish_interrupted(folder / DEFINITION)
    try:
        return _study_in(folder)
    except OSError as error:
        words = f"is no folder of a finished study: {reason_of(error)}; `opir sweep` makes one"
        raise _study_error(words, folder) from error
    except (*BAD_DATA, ArrowException) as error:
        reason = (str(error) or type(error).__name__).splitlines()[0]
        words = f"has damaged results ({reason}); run the study again: its runs are kept"
        raise _study_error(words, folder) from error


def _study_in(folder: Path) -> SavedStudy:
    """Return the study in a folder; raises what damaged files lead to."""
    from pyarrow import parquet

    definition = _definition(folder)
    _require_kinds(definition)
    table = parquet.read_table(folder / RESULTS)
    version = definition.get("study_version")
    STUDY_FORMAT.require_readable(version, folder / DEFINITION, "study_version")
    if missing := [name for name in _KEYS if name not in definition]:
        raise ValueError(f"{missing[0]} is missing")
    runs, launches, shares = (
        _columns(parquet.read_table(folder / name)) if (folder / name).is_file() else None
        for name in (RUNS, LAUNCHES, SHARES)
    )
    sensitivity = _sensitivity(folder / SENSITIVITY)
    return _with_condition(
        SavedStudy(definition, _columns(table), runs, launches, shares, sensitivity)
    )


def _require_kinds(definition: Mapping[str, Any]) -> None:
    """Raise `ValueError` for a definition whose parts are of other kinds than those written."""
    for kind, parts in _PARTS.items():
        for name, inner in parts.items():
            part = definition.get(name, kind())
            items = part.values() if isinstance(part, dict) else part
            if not isinstance(part, kind) or not all(isinstance(item, inner) for item in items):
                raise ValueError(f"{name} is not a {kind.__name__} of {inner.__name__}")


def _sensitivity(path: Path) -> FigureData | None:
    """Return the Sobol indices of a study, nan for those that are not known; None without any."""
    if not path.is_file():
        return None
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    names = 2
    cells = [(*row[:names], *(float(cell or "nan") for cell in row[names:])) for row in rows]
    return FigureData.of_rows(head, cells)


def _with_condition(study: SavedStudy) -> SavedStudy:
    """Return a study whose conditions are one setting, which it is split by: `night, overcast`."""
    conditions = list(study.definition.get("conditions", ()))
    if not conditions:
        return study
    joined = list(dict.fromkeys([*([study.split] if study.split else []), *conditions]))

    vary = [*(path for path in study.paths if path not in joined), CONDITION]
    return evolve(
        study,
        definition={
            **study.definition,
            "vary": vary,
            "split": CONDITION,
            "varied": [path for path in study.paths if path not in conditions],
        },
        results=_merged(study, study.results, joined) or study.results,
        runs=_merged(study, study.runs, joined),
        launches=_merged(study, study.launches, joined),
    )


def _definition(folder: Path) -> Any:
    """Return the definition of a study; raises `ValueError` if a file of it has changed."""
    definition = json.loads((folder / DEFINITION).read_text(encoding="utf-8"))
    for entry in definition.get(FILES_KEY, ()):
        if file_digest(folder / entry["name"]) != entry["sha256"]:
            raise ValueError(f"{entry['name']} is not what was written: its SHA-256 differs")
    return definition


def _study_error(words: str, source: object) -> SceneError:
    return SceneError([Problem("", words)], source=str(source))


def _columns(table: Any) -> FigureData:
    return FigureData({name: np.array(table[name].to_pylist()) for name in table.column_names})


def _merged(study: SavedStudy, rows: FigureData | None, paths: Sequence[str]) -> FigureData | None:
    """Return rows with some settings as one column, `CONDITION`; None without rows."""
    if rows is None:
        return None
    columns = {name: column for name, column in rows.columns.items() if name not in paths}
    return FigureData({**columns, CONDITION: np.array(study.short_labels(rows, paths))})


def joined_studies(studies: Sequence[SavedStudy]) -> SavedStudy:
    """Return studies side by side as one that varies the study too; raises `SceneError` if they
    vary other settings.

    The study has only the figures that all studies have. Differences are from the first design of
    each study.
    """
    if len(studies) == 1:
        return studies[0]
    _check_paths(studies)
    definition = studies[0].definition
    figures = [name for name in studies[0].units if all(name in study.units for study in studies)]
    names = _distinct([str(study.definition["study"]) for study in studies])
    metrics = definition["metrics"].items()
    shared = {
        "study": " and ".join(names),
        "vary": [STUDY, *studies[0].paths],
        "figures": {name: studies[0].units[name] for name in figures},
        "bounds": {name: _shared_bounds(studies, name) for name in figures},
        "metrics": {
            metric: [name for name in own_figures if name in figures]
            for metric, own_figures in metrics
        },
        "designs": [design for study in studies for design in study.definition["designs"]],
    }
    return SavedStudy({**definition, **shared}, _joined(studies, names, figures))


def _check_paths(studies: Sequence[SavedStudy]) -> None:
    """Raise `SceneError` for studies that vary different settings."""
    first = studies[0]
    for study in studies[1:]:
        if set(study.paths) != set(first.paths):
            settings, other_settings = (
                f"{each.definition['study']} {', '.join(each.paths) or 'nothing'}"
                for each in (first, study)
            )
            words = f"vary different settings: {settings}; {other_settings}"
            raise _study_error(words, "the studies")


def _shared_bounds(studies: Sequence[SavedStudy], figure: str) -> list[float | None]:
    """Return the bounds of a figure that all studies have."""
    bounds = [study.definition.get("bounds", {}).get(figure, (None, None)) for study in studies]
    return [ends[0] if len(set(ends)) == 1 else None for ends in zip(*bounds, strict=True)]


def _distinct(names: list[str]) -> list[str]:
    return [
        f"{name} ({number})" if names.count(name) > 1 else name
        for number, name in enumerate(names, start=1)
    ]


def _joined(
    studies: Sequence[SavedStudy], names: Sequence[str], figures: Sequence[str]
) -> FigureData:
    """Return the rows of figures of studies one after another, with the study's name and designs
    numbered on.
    """
    tables = [study.results.where(np.isin(study.results["figure"], figures)) for study in studies]
    shared = [name for name in tables[0].columns if all(name in table.columns for table in tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in shared}
    lengths = [len(table) for table in tables]
    counts = [len(study.definition["designs"]) for study in studies]
    columns["design"] += np.repeat(np.cumsum([0, *counts[:-1]]), lengths)
    columns[STUDY] = np.repeat(np.array(names), lengths)
    return FigureData(columns)
