"""The best design of a study under requirements, found by evaluating a small part of its
designs.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from attrs import evolve, frozen

from opir_core.errors import Problem, SceneError
from opir_core.host import DEAD_AFTER_S
from opir_core.plugin import ExecutorContext, Host
from opir_studies.axes import Axis, Design, axes_of
from opir_studies.finished import FinishedRuns, StudyRuns
from opir_studies.planning import PlannedStudy, planned_study
from opir_studies.refusals import refusal
from opir_studies.requirements import FigureRequirement, require_figures
from opir_studies.result import StudyResult, written_result
from opir_studies.search import DesignSearch, Outcome, Point
from opir_studies.share_requirements import is_sentence
from opir_studies.statistics import interval
from opir_studies.study import Study
from opir_studies.sweeping import StudyProgress, SweepState

_WANTED = {"min": False, "max": True}


@frozen
class Objective:
    """The figure whose mean is to be as large as possible if `is_largest`, else as small."""

    figure: str
    is_largest: bool

    @classmethod
    def of(cls, text: str) -> "Objective":
        """Return the objective of a text, `max warning_time_s`; raises `SceneError` for any other
        text.
        """
        direction, _, figure = text.strip().partition(" ")
        if direction not in _WANTED or not figure.strip():
            words = f"{text!r} is not 'min FIGURE' or 'max FIGURE', such as 'max warning_time_s'"
            raise refusal("objective", words, "optimise")
        return cls(figure.strip(), _WANTED[direction])


@frozen(eq=False)
class Optimised:
    """The result of an optimisation: the designs in the order of their evaluation, and the number
    of the best one.

    `is_feasible` is whether the best design meets all requirements, `possible` the number of
    designs that there are.
    """

    result: StudyResult
    best: int
    is_feasible: bool
    possible: int

    def __repr__(self) -> str:
        """Return the best design and the number of evaluations, in one line."""
        return f"<Optimised: {self.result!r}, best is design {self.best}>"

    def _repr_html_(self) -> str:
        """Return the result as a notebook shows it."""
        return self.result._repr_html_()


def optimise(
    study: Study,
    folder: str | Path,
    objective: str,
    *,
    evaluations: int = 100,
    workers: int | None = None,
    dead_after_s: float = DEAD_AFTER_S,
    on_progress: Callable[[StudyProgress], None] = lambda _progress: None,
) -> Optimised:
    """Evaluate designs of a study to find the best one under its requirements; write the folder of
    a study.

    All combinations of what varies are possible; a design is evaluated by the means of its runs,
    which all have the same seeds. Runs that are in the folder are not made again. Raises as
    `sweep`, and `PluginError` without Optuna.
    """
    goal = Objective.of(objective)
    axes = _axes(study)
    context = ExecutorContext(workers=workers, dead_after_s=dead_after_s)
    work = _Evaluation(study, axes, goal, Path(folder), context, on_progress)
    search = DesignSearch(
        tuple(len(axis.levels) for axis in axes),
        tuple(_is_ordered(axis) for axis in axes),
        study.seed,
    )
    work.require_objective()
    search.run(evaluations, work.outcomes)
    points = list(search.outcomes)
    planned = planned_study(
        study, work.host, [work.design(number, point) for number, point in enumerate(points)]
    )
    runs = FinishedRuns.of(planned, Path(folder)).first([work.counts[point] for point in points])
    extra = {
        "objective": {"figure": goal.figure, "is_largest": goal.is_largest},
        "design": "optimise",
    }
    result = written_result(planned, Path(folder), runs, extra)
    best = points.index(search.best)
    return Optimised(
        result, best, search.outcomes[search.best].is_feasible, math.prod(search.levels)
    )


def _axes(study: Study) -> list[Axis]:
    problems = list[Problem]()
    axes = axes_of(study.vary, "vary", problems)
    if study.conditions:
        problems.append(Problem("conditions", "are for opir sweep: a search has one condition"))
    if any(map(is_sentence, map(str, study.requirements))):
        problems.append(
            Problem("requirements", "on shares are for opir sweep; give bounds of means")
        )
    if not study.vary:
        problems.append(Problem("vary", "nothing varies: give --vary PATH=VALUES"))
    if problems:
        raise SceneError(problems, source=f"study {study.study}")
    # Numbers in order, so that neighbours are alike.
    return [
        evolve(axis, levels=tuple(sorted(axis.levels, key=lambda level: float(level.label or 0.0))))
        if _is_ordered(axis)
        else axis
        for axis in axes
    ]


def _is_ordered(axis: Axis) -> bool:
    return all(
        isinstance(level.label, int | float) and not isinstance(level.label, bool)
        for level in axis.levels
    )


class _Evaluation:
    """Runs designs and ranks them."""

    def __init__(
        self,
        study: Study,
        axes: Sequence[Axis],
        objective: Objective,
        folder: Path,
        context: ExecutorContext,
        on_progress: Callable[[StudyProgress], None],
    ) -> None:
        self.host = Host.discover()
        #: The number of runs of each design.
        self.counts: dict[Point, int] = {}
        self._study = study
        self._axes = axes
        self._objective = objective
        self._folder = folder
        self._context = context
        self._on_progress = on_progress

    def design(self, number: int, point: Point) -> Design:
        """Return the design of the numbers of its levels."""
        levels = tuple(axis.levels[place] for axis, place in zip(self._axes, point, strict=True))
        return Design(number, levels, tuple(axis.path for axis in self._axes))

    def require_objective(self) -> None:
        """Raise `SceneError` if no metric gives the figure of the objective."""
        planned = planned_study(self._study, self.host, [self.design(0, (0,) * len(self._axes))])
        require_figures(
            [self._objective.figure], "objective", planned.units, f"study {self._study.study}"
        )

    def outcomes(self, points: Sequence[Point]) -> list[Outcome]:
        """Run designs and return their outcomes."""
        planned = planned_study(
            self._study, self.host, [self.design(*record) for record in enumerate(points)]
        )
        state = SweepState.of(planned, self._folder, self._context, self._on_progress)
        counts = state.finished_run()
        state.require_no_failure()
        self.counts |= zip(points, counts, strict=True)
        runs = state.runs.first(counts)
        return [self._outcome(planned, runs, place) for place in range(len(points))]

    def _outcome(self, planned: PlannedStudy, runs: StudyRuns, place: int) -> Outcome:
        values = {name: runs.values(place, name) for name in planned.units}
        means = {name: interval(column)[0] for name, column in values.items()}
        shares = {name: planned.share_of(values, name) for name in planned.units}
        return outcome_of(means, shares, planned.requirements, self._objective)


def outcome_of(
    means: Mapping[str, float],
    shares: Mapping[str, float],
    requirements: Sequence[FigureRequirement],
    objective: Objective,
) -> Outcome:
    """Return the rank of a design, by the means of its figures and the shares of launches, or runs,
    that have them.
    """
    counted = dict.fromkeys(
        [objective.figure, *(requirement.figure for requirement in requirements)]
    )
    without = sum(1.0 - shares[name] if shares[name] == shares[name] else 1.0 for name in counted)
    violation = sum(
        requirement.violation(means[requirement.figure]) for requirement in requirements
    )
    value = means[objective.figure]
    if math.isnan(value):
        return Outcome(without, violation, math.inf)
    return Outcome(without, violation, -value if objective.is_largest else value)


def best_row(optimised: Optimised) -> Mapping[str, Any]:
    """Return the best design as a mapping of its paths and values."""
    design: Mapping[str, Any] = optimised.result.definition["designs"][optimised.best]
    return {path: design[path] for path in optimised.result.paths}
