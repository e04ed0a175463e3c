"""Broken metrics, exporters, run views and executors, and sound ones that they are made of."""

import math
import time
from collections.abc import Mapping

from broken_components.offers import SOUND, mutant
from opir_core.plugin import ExecutorModel, ExporterModel, MetricModel, RunView


def made_of(kind, name, caught_by):
    """Offer an object of the decorated class."""

    def offered(component):
        mutant(kind, name, caught_by)(lambda _config, _context: component())
        return component

    return offered


def sound(kind, name):
    """Offer an object of the decorated class in which no test is to find a fault."""
    SOUND.add((kind.hook, name))
    return made_of(kind, name, "none")


@sound(MetricModel, "sound-metric")
class DetectionCount:
    units: Mapping[str, str] = {"detections": "", "tracks": ""}

    def values(self, run):
        return {
            "detections": float(len(run.detections)),
            "tracks": float(len(run.tracks)) or math.nan,
        }


@made_of(MetricModel, "nameless", "test_figures_have_names_and_units")
class Nameless(DetectionCount):
    units: Mapping[str, str] = {}

    def values(self, run):
        return {}


@made_of(MetricModel, "without-values", "test_build_returns_a_complete_part")
class WithoutValues:
    units: Mapping[str, str] = {"detections": ""}


@made_of(MetricModel, "forgetful", "test_every_run_has_every_figure")
class Forgetful(DetectionCount):
    def values(self, run):
        return {name: value for name, value in super().values(run).items() if value == value}


@made_of(MetricModel, "endless", "test_figures_are_finite_or_nan")
class Endless(DetectionCount):
    def values(self, run):
        return {
            name: -math.inf if value == 0.0 else value
            for name, value in super().values(run).items()
        }


@made_of(MetricModel, "survivors", "test_figures_that_launches_lack_name_their_share")
class Survivors(DetectionCount):
    units: Mapping[str, str] = {"detections": "", "tracks": "", "tracked": ""}
    shares: Mapping[str, str] = {"tracks": "tracked"}

    def values(self, run):
        return {**super().values(run), "tracked": 1.0}


@made_of(MetricModel, "timed", "test_figures_depend_only_on_the_run")
class Timed(DetectionCount):
    def values(self, run):
        return {**super().values(run), "tracks": float(time.time_ns() % 2)}


@made_of(MetricModel, "unpicklable", "test_a_built_metric_pickles")
class Unpicklable(DetectionCount):
    def __init__(self):
        self.held = lambda: None


@sound(ExporterModel, "sound-exporter")
class Lines:
    suffix = ".txt"

    def write(self, run, path):
        path.write_text(f"{run!r}\n")
        return [path]


@made_of(ExporterModel, "without-a-dot", "test_the_ending_is_stated")
class WithoutADot(Lines):
    suffix = "txt"


@made_of(ExporterModel, "silent", "test_every_run_can_be_written")
class Silent(Lines):
    def write(self, run, path):
        return super().write(run, path) if len(run.detections) else []


@made_of(ExporterModel, "leaves-things", "test_every_run_can_be_written")
class LeavesThings(Lines):
    def write(self, run, path):
        path.with_suffix(".tmp").write_text("half")
        return super().write(run, path)


@made_of(ExporterModel, "hollow", "test_files_have_content")
class Hollow(Lines):
    def write(self, run, path):
        path.touch()
        return [path]


@made_of(ExporterModel, "dated", "test_the_same_run_gives_the_same_bytes")
class Dated(Lines):
    def write(self, run, path):
        path.write_text(str(time.time_ns()))
        return [path]


@made_of(ExporterModel, "held-open", "test_a_built_exporter_pickles")
class HeldOpen(Lines):
    def __init__(self):
        self.held = lambda: None


@mutant(RunView, "sound-view", "none")
def one_line(run):
    return repr(run)


SOUND.add((RunView.hook, "sound-view"))


@mutant(RunView, "none-to-show", "test_every_run_has_a_view")
def of_detections(run):
    return repr(run) if len(run.detections) else None


@mutant(RunView, "numbered", "test_the_same_run_gives_the_same_view")
def numbered(run, _count=[0]):  # noqa: B006 - the fault
    _count[0] += 1
    return f"{_count[0]} {run!r}"


@mutant(RunView, "keeps-notes", "test_runs_are_not_modified")
def with_notes(run):
    counts = run.summary["counts"]
    counts["shown"] = counts.get("shown", 0) + 1
    return repr(run)


@mutant(RunView, "wants-settings", "test_build_takes_the_run")
def of_settings(config, run):
    return repr(run)


@sound(ExecutorModel, "sound-executor")
class InTurn:
    def results(self, function, tasks):
        for index, task in enumerate(tasks):
            yield index, function(task)

    def close(self):
        return


@made_of(ExecutorModel, "skips-the-last", "test_every_task_is_run_once")
class SkipsTheLast(InTurn):
    def results(self, function, tasks):
        return super().results(function, tasks[:-1])


@made_of(ExecutorModel, "invents-one", "test_no_task_is_no_result")
class InventsOne(InTurn):
    def results(self, function, tasks):
        return super().results(function, tasks) if tasks else iter([(0, None)])


@made_of(ExecutorModel, "keeps-quiet", "test_errors_arrive")
class KeepsQuiet(InTurn):
    def results(self, function, tasks):
        try:
            yield from super().results(function, tasks)
        except ZeroDivisionError:
            return


@made_of(ExecutorModel, "closes-once", "test_closing_twice_is_allowed")
class ClosesOnce(InTurn):
    is_open = True

    def close(self):
        if not self.is_open:
            raise RuntimeError("closed")
        self.is_open = False
