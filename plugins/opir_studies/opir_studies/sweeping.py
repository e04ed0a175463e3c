"""Running a study: missing runs are made in rounds, and each is kept as it ends."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import define, evolve, field, frozen
from opir_scoring import NOT_SHOWN

from opir_core.arrays import IntArray
from opir_core.errors import OpirError
from opir_core.host import DEAD_AFTER_S
from opir_core.notebook import progress as shown_progress
from opir_core.plugin import Executor, ExecutorContext
from opir_studies.executors import LostTasksError
from opir_studies.finished import FinishedRuns
from opir_studies.planning import PlannedStudy, built_executor, planned_study
from opir_studies.refusals import cut_short, refusal
from opir_studies.result import StudyResult, written_result
from opir_studies.runs import RunTask, TaskResult, installed_version, result_of
from opir_studies.shares import verdict_of
from opir_studies.study import Study
from opir_studies.until import DECIDED, rounds

#: Approximate number of tasks of a round; each is one file when it has ended.
_TASKS = 64
_LONGEST_TASK = 200
_DIED = "its worker process ended three times, possibly out of memory"
#: The most failed runs that a message lists.
_SHOWN = 10


class StudyError(OpirError):
    """Runs of a study that failed; all others are kept."""

    exit_code = 4


@frozen
class Shard:
    """A part of each design's runs: every `count`-th from `place` on, from 0."""

    place: int
    count: int

    def numbers(self, runs: int) -> range:
        """Return the numbers of the runs of a design that are in the shard."""
        return range(self.place, runs, self.count)

    @classmethod
    def of(cls, text: str) -> "Shard":
        """Return the shard of a text, `2/7`; raises `SceneError` for any other text."""
        place, slash, count = text.partition("/")
        is_whole = slash and place.strip().isdigit() and count.strip().isdigit()
        if not is_whole or not 1 <= int(place) <= int(count):
            raise refusal("--shard", f"{text!r} is not I/N, such as 2/7 for the second of seven")
        return cls(int(place) - 1, int(count))


WHOLE = Shard(0, 1)


@frozen
class StudyProgress:
    """How far a study is: finished runs of those that it needs at most, and those that were on the
    disk before.
    """

    done: int
    total: int
    found: int


def sweep(
    study: Study,
    folder: str | Path,
    *,
    workers: int | None = None,
    dead_after_s: float = DEAD_AFTER_S,
    on_progress: Callable[[StudyProgress], None] = lambda _progress: None,
    on_notes: Callable[[Sequence[str]], None] = lambda _notes: None,
    progress: bool = False,
) -> StudyResult:
    """Run a study into a folder and return its result; runs that are there already are not run
    again.

    `on_notes` is given what a reader must know of the scenes and requirements, before the first
    run. `progress` shows a bar, in a notebook's cell or on standard error.

    `workers` is for the study's executor; a run fails in which one call of a component lasts
    `dead_after_s`. A script with the executor `processes` needs `if __name__ == "__main__":`.
    Raises `SceneError` or `PluginError` for an invalid study before the first run, and
    `StudyError`, when everything else has ended, with the runs that failed.
    """
    planned = planned_study(study)
    on_notes(planned.notes)
    place = Path(folder)
    context = ExecutorContext(workers=workers, dead_after_s=dead_after_s)
    with shown_progress(is_shown=progress) as update:

        def report(runs: StudyProgress) -> None:
            on_progress(runs)
            shown_runs(update, runs)

        state = SweepState.of(planned, place, context, report)
        counts = state.finished_run()
    result = written_result(planned, place, state.runs.first(counts))
    state.require_no_failure()
    return result


def shown_runs(update: Callable[[str, float, float], None], study: StudyProgress) -> None:
    """Set the bar of a study by the update of `opir_core.notebook.progress`.

    Runs that were there before took no time now: the remaining time is that of the others.
    """
    update("runs", study.done - study.found, study.total - study.found)


@define
class SweepState:
    """The state of a study that runs."""

    planned: PlannedStudy
    runs: FinishedRuns
    context: ExecutorContext
    on_progress: Callable[[StudyProgress], None]
    shard: Shard = WHOLE
    executor: Executor | None = None
    found: int = field(init=False)
    done: int = field(init=False)
    failures: list[str] = field(factory=list)
    #: The numbers of the designs' runs that failed.
    failed: list[set[int]] = field(init=False)

    def __attrs_post_init__(self) -> None:
        self.found = self.runs.count(self.shard.numbers(self.planned.study.runs))
        self.done = self.found
        self.failed = [set() for _ in self.planned.designs]

    @classmethod
    def of(
        cls,
        planned: PlannedStudy,
        folder: Path,
        context: ExecutorContext,
        on_progress: Callable[[StudyProgress], None],
        shard: Shard = WHOLE,
    ) -> "SweepState":
        """Return the state of a study, or of a shard of its runs, with the runs that are in its
        folder.
        """
        return cls(planned, FinishedRuns.of(planned, folder), context, on_progress, shard)

    def finished_run(self) -> Sequence[int]:
        """Make the missing runs as `run` does, and end the workers."""
        try:
            return self.run()
        finally:
            self.close()

    def run(self) -> Sequence[int]:
        """Make the missing runs, round by round; return the number of runs of each design."""
        planned = self.planned
        counts = [0] * len(self.planned.designs)
        active = list(range(len(counts)))
        for number in rounds(planned.study.runs, stops_early=bool(planned.study.until)):
            for place in active:
                counts[place] = number
            self._run_missing(counts, active)
            if planned.study.until == DECIDED:
                active = self._undecided(counts, active)
            else:
                active = [place for place in active if not self._is_narrow(place, number)]
        return counts

    def _undecided(self, counts: Sequence[int], active: Sequence[int]) -> list[int]:
        """Return the designs of which a requirement on a share is not decided, with all their
        conditions.
        """
        planned = self.planned
        runs = self.runs.first(counts)
        undecided = [
            group
            for group in planned.groups
            if group[0] in active
            and any(
                verdict_of(planned, each, runs, group) == NOT_SHOWN
                for each in planned.share_requirements
            )
        ]
        return [place for group in undecided for place in group]

    def close(self) -> None:
        """End the executor's workers."""
        if self.executor is not None:
            self.executor.close()

    def require_no_failure(self) -> None:
        """Raise `StudyError` with the runs that failed."""
        count = len(self.failures)
        if count:
            runs = "runs" if count > 1 else "run"
            head = f"{count} {runs} failed; the others are kept in {self.runs.parts.folder.parent}"
            raise StudyError("\n  ".join([head, *cut_short(self.failures, _SHOWN)]))

    def _is_narrow(self, place: int, number: int) -> bool:
        until = self.planned.until
        if until is None:
            return True
        counts = [number] * len(self.planned.designs)
        return until.is_met(self.runs.first(counts).values(place, until.figure))

    def _run_missing(self, counts: Sequence[int], active: Sequence[int]) -> None:
        tasks = self._tasks(counts, active)
        self._report(counts)
        if tasks.runs:
            lost = list(self._lost(tasks, counts))
            # Which run of a lost task is the cause shows when each is a task of its own.
            singles = [(place, number[None]) for (place, numbers), _ in lost for number in numbers]
            again = evolve(tasks, runs=singles)
            for (place, numbers), reason in (
                lost if len(singles) == len(lost) else self._lost(again, counts)
            ):
                self._fail(place, int(numbers[0]), reason)

    def _tasks(self, counts: Sequence[int], active: Sequence[int]) -> "_Tasks":
        missing = {
            place: self._missing(place, self.shard.numbers(counts[place])) for place in active
        }
        size = min(max(1, sum(map(len, missing.values())) // _TASKS), _LONGEST_TASK)
        longest = max(map(len, missing.values()), default=0)
        runs = [
            (place, numbers[start : start + size])
            for start in range(0, longest, size)
            for place, numbers in missing.items()
            if start < len(numbers)
        ]
        return _Tasks(self.planned, runs)

    def _missing(self, place: int, numbers: range) -> IntArray:
        missing = self.runs.missing(place, numbers)
        failed = self.failed[place]
        return missing[~np.isin(missing, list(failed))] if failed else missing

    def _lost(
        self, tasks: "_Tasks", counts: Sequence[int]
    ) -> Iterator[tuple[tuple[int, IntArray], str]]:
        """Run tasks and keep their records; yield those whose worker died again and again or was
        ended, and why.
        """
        self.executor = self.executor or built_executor(self.planned.study, self.context)
        try:
            for index, result in self.executor.results(result_of, tasks):
                self._keep(tasks.runs[index][0], result)
                self._report(counts)
        except LostTasksError as error:
            yield from (
                (tasks.runs[index], error.reasons.get(index, _DIED)) for index in error.tasks
            )

    def _keep(self, place: int, result: TaskResult) -> None:
        for name, version in result.versions.items():
            if version != (installed := installed_version(name)):
                words = f"a worker has {name} {version}, and this is {installed}; install the same on both"
                raise refusal("executor", words, "study")
        finished = [record for record in result.records if not record.failure]
        self.runs.add(place, finished)
        self.done += len(finished)
        for record in result.records:
            if record.failure:
                self._fail(place, record.replicate, record.failure)

    def _fail(self, place: int, replicate: int, reason: str) -> None:
        design = self.planned.designs[place]
        self.failed[place].add(replicate)
        self.done += 1
        self.failures.append(
            f"{design.design.name}, seed {design.scene.seed + replicate}: {reason}"
        )

    def _report(self, counts: Sequence[int]) -> None:
        total = sum(len(self.shard.numbers(count)) for count in counts)
        self.on_progress(StudyProgress(self.done, total, self.found))


@frozen
class _Tasks(Sequence[RunTask]):
    """The tasks of a round, each made when it is asked for; `runs` are their designs and the
    numbers (n,) of their runs.
    """

    planned: PlannedStudy
    runs: Sequence[tuple[int, IntArray]]

    def __len__(self) -> int:
        return len(self.runs)

    def __getitem__(self, index: Any) -> Any:
        place, numbers = self.runs[index]
        scene = self.planned.designs[place].scene
        return RunTask(scene, tuple(numbers.tolist()), self.planned.metrics)
