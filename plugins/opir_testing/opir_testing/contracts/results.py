"""Conformance tests of metrics, exporters, run views and executors."""

import json
import math
import tempfile
from collections.abc import Mapping
from functools import cache
from inspect import signature
from pathlib import Path
from typing import Any

from attrs import evolve

from opir_core import Run, run_of_plan
from opir_core.plugin import (
    Executor,
    ExecutorContext,
    ExecutorModel,
    Exporter,
    ExporterContext,
    ExporterModel,
    Metric,
    MetricContext,
    MetricModel,
    NoConfig,
    RunView,
)
from opir_testing.bench import bench_scene, planned
from opir_testing.contracts.contract import (
    REPEAT,
    Contract,
    complete_part,
    require,
    require_equal,
    require_no_outside_inputs,
    require_pickling,
)
from opir_testing.contracts.outputs import edge_case_windows
from opir_testing.doubles import stub_estimates, stub_regions

_ALONE = (
    "Compute everything from the run that is passed: no clock, no network, no random numbers, no"
    " earlier runs."
)


class ResultContract(Contract):
    """What conformance tests of metrics, exporters and run views share: runs of the test scene."""

    @classmethod
    @cache
    def runs(cls) -> Mapping[str, Run]:
        """Return runs by description: with tracks and regions, without tracks, without
        detections.
        """
        observed, silent = (
            run_of_plan(planned(bench_scene(**changes), cls.host()))
            for changes in ({}, {"detection": "never"})
        )
        regions = [stub_regions(9.0, 167.7), stub_regions(10.0, 179.9), ()]
        tracks = stub_estimates(
            3,
            state=[-6.5e6, -1e6, 2e6, 1e3, 2e3, 3e3],
            launch=[0.6, -2.1, 2.0],
            impact=[0.16, 2.9, 1900.0],
            impact_regions=regions,
        )
        estimates = evolve(
            observed,
            tracks=evolve(
                edge_case_windows()["with tracks alone"].tracks, tick_s=tracks.tick_s[:2]
            ),
        )
        return {
            "with tracks": evolve(observed, tracks=tracks.freeze()),
            "with tracks at the poles": evolve(estimates, tracks=estimates.tracks.freeze()),
            "without tracks": observed,
            "without detections": silent,
        }


class MetricContract(ResultContract):
    """Conformance tests of a metric."""

    kind = MetricModel

    @classmethod
    @cache
    def metric(cls) -> Metric:
        """Return the built metric."""
        return cls.built(Metric, cls.config(), MetricContext())

    @classmethod
    def part(cls) -> Any:
        """Return the built metric."""
        return cls.metric()

    def exercise(self) -> object:
        """Build the metric and compute the figures of a run."""
        return self.metric().values(self.runs()["with tracks"])

    def test_figures_have_names_and_units(self) -> None:
        """There is at least one figure; names are identifiers, units are text."""
        units = dict(self.metric().units)
        names = all(str(name).isidentifier() for name in units)
        require(
            units and names and all(isinstance(unit, str) for unit in units.values()),
            f"units are {units!r}",
            'Return a unit for each figure, {"latency_s": "s", "detected": ""}, with names that are'
            " identifiers.",
        )

    def test_every_run_has_every_figure(self) -> None:
        """Each run gives a number, or nan, for each figure."""
        for name, run in self.runs().items():
            values = self.metric().values(run)
            numbers = all(isinstance(value, int | float) for value in values.values())
            require(
                values.keys() == self.metric().units.keys() and numbers,
                f"a run {name} gives {dict(values)!r}, where the figures are"
                f" {', '.join(self.metric().units)}",
                "Return a float for each key of units, nan where the run has none.",
            )

    def test_figures_are_finite_or_nan(self) -> None:
        """No figure is infinite."""
        for name, run in self.runs().items():
            endless = [key for key, value in self.metric().values(run).items() if math.isinf(value)]
            require(
                not endless,
                f"a run {name} gives infinite {', '.join(endless)}",
                "Return nan where there is none.",
            )

    def test_figures_that_launches_lack_name_their_share(self) -> None:
        """`shares`, if any, maps figures to shares from 0 to 1; a figure has a value where its
        share is not 0.
        """
        units = self.metric().units
        shares = dict(getattr(self.metric(), "shares", {}))
        change = (
            "Map each figure that some launches lack to the figure that is the share of those that"
            " have it."
        )
        unknown = sorted({*shares, *shares.values()} - set(units))
        require(not unknown, f"shares names {', '.join(unknown)}, which units does not", change)
        for name, run in self.runs().items():
            values = self.metric().values(run)
            for figure, share in shares.items():
                value = values[figure]
                of = values[share]
                words = f"a run {name} gives {figure} {value} and {share} {of}"
                require(
                    math.isnan(of) or 0.0 <= of <= 1.0,
                    words,
                    "Return a share from 0 to 1, nan without launches.",
                )
                require(math.isfinite(value) == (of > 0.0), words, change)

    def test_figures_depend_only_on_the_run(self) -> None:
        """A second call gives the same figures; clock, network and global random state are not
        used.
        """
        figures = {name: _exact(self.metric().values(run)) for name, run in self.runs().items()}
        repeated = {
            name: _exact(self.metric().values(run)) for name, run in [*self.runs().items()][::-1]
        }
        require(figures == repeated, "a second call gives other figures", _ALONE, REPEAT)
        require_no_outside_inputs(self.use(), _ALONE)

    def test_a_built_metric_pickles(self) -> None:
        """The built metric can be pickled, and its copy gives the same figures."""
        copy = require_pickling(self.metric())
        run = self.runs()["with tracks"]
        is_equal = _exact(copy.values(run)) == _exact(self.metric().values(run))
        require_equal(
            is_equal, "a pickled copy gives other figures", "Keep all state in fields that pickle."
        )


class ExporterContract(ResultContract):
    """Conformance tests of an exporter, in folders of their own."""

    kind = ExporterModel

    @classmethod
    @cache
    def exporter(cls) -> Exporter:
        """Return the built exporter."""
        return cls.built(Exporter, cls.config(), ExporterContext())

    @classmethod
    def part(cls) -> Any:
        """Return the built exporter."""
        return cls.exporter()

    def written(self, run: Run) -> Mapping[str, bytes]:
        """Return the content of the files of a run by their paths in the folder."""
        with tempfile.TemporaryDirectory(prefix="opir-check-") as folder:
            root = Path(folder)
            listed = self.exporter().write(run, root / f"run{self.exporter().suffix}")
            file_names = {
                path.relative_to(root).as_posix(): path.read_bytes()
                for path in root.rglob("*")
                if path.is_file()
            }
            names = sorted(Path(path).relative_to(root).as_posix() for path in listed)
            require(
                names == sorted(file_names),
                f"write returns {names}, and the folder has {sorted(file_names)}",
                "Return the path of each file written, and remove temporary files.",
            )
            return file_names

    def exercise(self) -> object:
        """Build the exporter and write a run."""
        return self.written(self.runs()["with tracks"])

    def test_the_ending_is_stated(self) -> None:
        """The suffix is empty, for a folder, or begins with a dot."""
        suffix = self.exporter().suffix
        valid = not suffix or str(suffix).startswith(".")
        require(valid, f"the suffix is {suffix!r}", 'Set suffix = ".kml", or "" for a folder.')

    def test_every_run_can_be_written(self) -> None:
        """Runs with tracks, at the poles and the antimeridian, without tracks and without
        detections are written.
        """
        for name, run in self.runs().items():
            require(self.written(run), f"a run {name} gives no file", "Write a file for each run.")

    def test_files_have_content(self) -> None:
        """No file of a run with detections and tracks is empty."""
        empty = [
            path
            for path, content in self.written(self.runs()["with tracks"]).items()
            if not content
        ]
        require(
            not empty,
            f"{', '.join(empty)}: empty",
            "Write the format's header at least, or no file.",
        )

    def test_the_same_run_gives_the_same_bytes(self) -> None:
        """A second export gives the same bytes; clock, network and global random state are not
        used.
        """
        run = self.runs()["with tracks"]
        is_equal = self.written(run) == self.written(run)
        require(is_equal, "a second export gives other bytes", _ALONE, REPEAT)
        require_no_outside_inputs(self.use(), _ALONE)

    def test_a_built_exporter_pickles(self) -> None:
        """The built exporter can be pickled."""
        require_pickling(self.exporter())


class RunViewContract(ResultContract):
    """Conformance tests of a run view."""

    kind = RunView

    def view(self, run: Run) -> Any:
        """Return the view of a run."""
        return self.component().build(run)

    @classmethod
    def part(cls) -> Any:
        """Return the view of a run."""
        return complete_part(object, cls().view(cls.runs()["without tracks"]))

    def exercise(self) -> object:
        """Build the view of a run with tracks."""
        return self.view(self.runs()["with tracks"])

    def test_build_takes_the_run(self) -> None:
        """`build` takes one argument, the run, and no settings."""
        build = self.component().build
        config = self.component().config
        try:
            signature(build).bind(None)
        except TypeError as error:
            require(
                False,
                f"build(run): {error}",
                "Write def build(run): a view has no settings and no context.",
            )
        require(config is NoConfig, f"it has the settings {config.__name__}", "Leave out config.")

    def test_every_run_has_a_view(self) -> None:
        """Runs with tracks, at the poles and the antimeridian, without tracks and without
        detections have a view.
        """
        for name, run in self.runs().items():
            require(
                self.view(run) is not None,
                f"a run {name} gives None",
                "Return an empty view where there is none.",
            )

    def test_the_same_run_gives_the_same_view(self) -> None:
        """A second call gives a view of the same type, and the same text if it is text."""
        for run in self.runs().values():
            view = self.view(run)
            repeated_view = self.view(run)
            is_equal = type(view) is type(repeated_view) and (
                not isinstance(view, str) or view == repeated_view
            )
            require(is_equal, "a second call gives another view", _ALONE, REPEAT)
        require_no_outside_inputs(self.use(), _ALONE)

    def test_runs_are_not_modified(self) -> None:
        """A view does not change the run: not its summary, not its manifest."""
        for run in self.afresh().runs().values():
            text = json.dumps([run.summary, run.manifest])
            self.view(run)
            is_equal = json.dumps([run.summary, run.manifest]) == text
            require_equal(
                is_equal,
                "summary or manifest change when the view is made",
                "Copy what you change.",
            )


class ExecutorContract(Contract):
    """Conformance tests of an executor; its workers can import this module."""

    kind = ExecutorModel

    @classmethod
    def executor(cls) -> Executor:
        """Return a newly built executor of two workers."""
        return cls.built(Executor, cls.config(), ExecutorContext(workers=2))

    @classmethod
    def part(cls) -> Any:
        """Return the built executor."""
        return cls.executor()

    def exercise(self) -> object:
        """Build an executor, run tasks and close it."""
        return self.results(square, [1, 2, 3])

    def results(self, function: Any, tasks: list[Any]) -> dict[int, Any]:
        """Return the results of tasks by index; each index may come once."""
        executor = self.executor()
        task_results = {}
        try:
            for index, result in executor.results(function, tasks):
                require(
                    index not in task_results,
                    f"task {index} gives two results",
                    "Yield each task once.",
                )
                task_results[index] = result
        finally:
            executor.close()
        return task_results

    def test_every_task_is_run_once(self) -> None:
        """Each task gives its result under its own index, once."""
        task_results = self.results(square, list(range(20)))
        change = "Yield (index in tasks, function(task)) for each task."
        require(
            task_results == {task: task * task for task in range(20)},
            f"20 tasks give {task_results}",
            change,
        )

    def test_no_task_is_no_result(self) -> None:
        """No tasks give no results."""
        task_results = self.results(square, [])
        require(not task_results, f"no tasks give {task_results}", "Yield nothing.")

    def test_errors_arrive(self) -> None:
        """An exception of the function is raised to the caller, with its type and text."""
        try:
            self.results(fail, [1])
        except ZeroDivisionError as error:
            require(
                "on purpose" in str(error),
                f"it arrives as {error!r}",
                "Raise the function's own exception.",
            )
            return
        except Exception as error:
            require(False, f"it arrives as {error!r}", "Raise the function's own exception.")
        require(
            False, "an exception of the function is lost", "Raise the function's own exception."
        )

    def test_closing_twice_is_allowed(self) -> None:
        """`close` ends the workers, before or after results, and may be called again."""
        executor = self.executor()
        list(executor.results(square, [3]))
        executor.close()
        executor.close()
        self.executor().close()


def square(task: int) -> int:
    """Return the square of a task: a function that workers can import."""
    return task * task


def fail(task: int) -> int:
    """Raise `ZeroDivisionError`: a function that fails in a worker."""
    raise ZeroDivisionError(f"on purpose, task {task}")


def _exact(values: Mapping[str, float]) -> Mapping[str, str]:
    """Return figures as text that shows every bit, and makes nan equal to itself."""
    return {name: float(value).hex() for name, value in values.items()}
