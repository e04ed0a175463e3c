"""A study as `opir sweep` wrote it: its definition, and a row per design and figure."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.errors import Problem, SceneError, reason_of
from opir_core.output import FILES_KEY, file_digest, finish_interrupted
from opir_report.figure_data import FigureData

DEFINITION, RESULTS = "study.json", "results.parquet"
#: The version of the definition that is read.
_VERSION = 1


@frozen(eq=False)
class SavedStudy:
    """A study: its definition (`study.json`) and its results (`results.parquet`), with short names of what varies."""

    definition: dict[str, Any]
    results: FigureData

    @property
    def paths(self) -> list[str]:
        """The paths in the scene that vary."""
        return [str(path) for path in self.definition["vary"]]

    @property
    def units(self) -> dict[str, str]:
        """The unit of each figure, "" for none."""
        return dict(self.definition["figures"])

    @property
    def figures_of_metrics(self) -> dict[str, list[str]]:
        """The figures of each metric that have a value in some design."""
        known = set(self.results["figure"][np.isfinite(self.results["mean"])].tolist())
        own = {
            name: [each for each in figures if each in known] for name, figures in self.definition["metrics"].items()
        }
        return {name: figures for name, figures in own.items() if figures}

    def short(self, path: str) -> str:
        """Return the last part of a path, or all of it where two paths end alike."""
        ends = [each.rpartition(".")[2] for each in self.paths]
        return path.rpartition(".")[2] if ends.count(path.rpartition(".")[2]) == 1 else path

    def rows(self, figure: str) -> FigureData:
        """Return the rows of a figure, one per design; raises `KeyError` for an unknown figure."""
        if figure not in self.units:
            raise KeyError(f"the study has no figure {figure!r}; it has {', '.join(self.units)}")
        return self.results.where(self.results["figure"] == figure)

    def labels(self, rows: FigureData, paths: Sequence[str] | None = None) -> list[str]:
        """Return the values of what varies in rows (n,), `scan_period_ms 50, tracker imm`; by default of all paths."""
        chosen = self.paths if paths is None else paths
        columns = [[f"{self.short(path)} {level_text(value)}" for value in rows[path].tolist()] for path in chosen]
        return [", ".join(parts) for parts in zip(*columns, strict=True)] if columns else [""] * len(rows)


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
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, ArrowException) as error:
        words = f"has damaged results ({str(error).splitlines()[0]}); run the study again: its runs are kept"
        raise SceneError([Problem("", words)], source=str(folder)) from error
    version = definition.get("study_version") if isinstance(definition, dict) else None
    if version != _VERSION:
        words = f"of study version {version}, where {_VERSION} is read: run the study anew"
        raise SceneError([Problem("study_version", words)], source=str(folder / DEFINITION))
    columns = {name: np.array(table[name].to_pylist()) for name in table.column_names}
    return SavedStudy(definition, FigureData(columns))
