"""The protocols of components that work on finished runs: metrics, exporters, and the executors of
studies.

A run is an `opir_core.Run`; a metric or an exporter changes nothing of it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

from attrs import frozen


@frozen(kw_only=True)
class MetricContext:
    """The context of a metric; it has no fields."""


@frozen(kw_only=True)
class ExporterContext:
    """The context of an exporter; it has no fields."""


@frozen(kw_only=True)
class ExecutorContext:
    """The context of an executor.

    `workers` is the number of workers that the user asks for, None for the executor's default. A
    worker ends if one call of a component lasts `dead_after_s`.
    """

    workers: int | None = None
    dead_after_s: float = 600.0


class Metric(Protocol):
    """Figures of a run, one number each; a study averages them over the runs of each design.

    >>> class Length(Metric):
    ...     units = {"length": "s"}
    ...
    ...     def values(self, run):
    ...         return {"length": run.plan.scene.duration_s}
    >>> Length().units
    {'length': 's'}
    """

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units, "" for none."""

    def values(self, run: Any) -> Mapping[str, float]:
        """Return the figures of an `opir_core.Run`, with the keys of `units`; nan for what the run
        does not have.

        The figures depend on the run alone. A metric may have `shares`: for each figure that some
        launches lack, the name of the figure that is the share of those that have it. Without one,
        it is a share of runs.

        A metric may add columns to the launches of a study, by an attribute "launch_units", their
        names with units, and a method "launches(run)", one value per launch of the scene in each;
        inf is never, nan does not apply. Its attribute "launch_containments" has the stated share
        of columns that are 1 where a region contained the true impact.
        """


class Executor(Protocol):
    """Runs a function over many tasks, in one process or in many.

    >>> class InOrder(Executor):
    ...     def results(self, function, tasks):
    ...         yield from enumerate(map(function, tasks))
    ...
    ...     def close(self):
    ...         pass
    >>> list(InOrder().results(abs, [-1, -2]))
    [(0, 1), (1, 2)]
    """

    def results(
        self, function: Callable[[Any], Any], tasks: Sequence[Any]
    ) -> Iterator[tuple[int, Any]]:
        """Yield the index and the result of each task once, in any order, as they end.

        Function, tasks and results can be pickled. An exception of the function is raised here. A
        task whose worker dies is run again.
        """

    def close(self) -> None:
        """End the workers; allowed several times."""


class Exporter(Protocol):
    """Writes a run in a format of other programs.

    >>> class Count(Exporter):
    ...     suffix = ".txt"
    ...
    ...     def write(self, run, path):
    ...         path.write_text(str(len(run.detections)))
    ...         return [path]
    >>> Count().suffix
    '.txt'
    """

    @property
    def suffix(self) -> str:
        """Return the usual ending of the file, `.kml` for instance; "" for a folder."""

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write an `opir_core.Run` to a file, or to a new folder; return the files written.

        The same run gives the same bytes.
        """
