"""The search of the best design: the tree-structured Parzen estimator of Optuna, then the
neighbours of the best one.

Its suggestions depend on the seed and the results alone, so that a search that was stopped takes
the same way again.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from attrs import define, field, frozen

from opir_core.errors import PluginError, install_command

#: A design by the numbers of its levels.
Point = tuple[int, ...]

#: Designs that are evaluated together, whatever the number of workers.
BATCH = 4
#: The share of the evaluations before neighbours of the best design are tried.
_EXPLORING = 0.4
#: Suggestions in a row that were evaluated before, after which a design is drawn at random.
_REPEATED = 20
#: Beyond any value of a figure.
_VIOLATED = 1e30


@frozen(order=True)
class Outcome:
    """The rank of a design, less is better; the first attribute counts most.

    `without` are the shares of launches, or else of runs, that lack a figure which is required or
    the objective, added up: such a mean is not a value of the design. `violation` is the share by
    which the requirements are missed.
    """

    without: float
    violation: float
    value: float

    @property
    def is_feasible(self) -> bool:
        """Whether all requirements are met, and the value is that of all launches."""
        return self.without == 0.0 and self.violation == 0.0 and math.isfinite(self.value)


@define
class DesignSearch:
    """A search over designs: numbers of levels of each axis, and which of these are ordered
    numbers.
    """

    levels: tuple[int, ...]
    is_ordered: tuple[bool, ...]
    seed: int
    outcomes: dict[Point, Outcome] = field(factory=dict)
    _study: Any = field(init=False)
    _rng: np.random.Generator = field(init=False)

    def __attrs_post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self._study = _optuna_study(self.seed)

    @property
    def best(self) -> Point:
        """The best design so far; the earliest of equals."""
        return min(self.outcomes, key=self.outcomes.__getitem__)

    def run(
        self, evaluations: int, evaluate: Callable[[Sequence[Point]], Sequence[Outcome]]
    ) -> None:
        """Evaluate designs, a batch at a time, until there are `evaluations` of them or none is
        left.
        """
        limit = min(evaluations, int(np.prod(self.levels, dtype=np.float64)))
        while len(self.outcomes) < limit:
            neighbours = (
                []
                if len(self.outcomes) < _EXPLORING * evaluations
                else list(self._neighbours(self.best))
            )
            trials = [] if neighbours else self._asked(min(BATCH, limit - len(self.outcomes)))
            points = neighbours[: limit - len(self.outcomes)] or [point for _, point in trials]
            self.outcomes.update(zip(points, evaluate(points), strict=True))
            for trial, point in trials:
                self._tell(trial, self.outcomes[point])

    def _neighbours(self, point: Point) -> Iterator[Point]:
        """Yield designs not evaluated yet that differ by one step of a number, or by any other
        name, on one axis.
        """
        for axis, (place, count) in enumerate(zip(point, self.levels, strict=True)):
            steps = (place - 1, place + 1) if self.is_ordered[axis] else range(count)
            for level in steps:
                neighbour = (*point[:axis], level, *point[axis + 1 :])
                if 0 <= level < count and neighbour not in self.outcomes:
                    yield neighbour

    def _asked(self, count: int) -> list[tuple[Any, Point]]:
        """Return trials of Optuna with designs that were not evaluated.

        Optuna may suggest a design again: it is given the outcome of that design if there is one,
        and asked again.
        """
        suggestions: dict[Point, Any] = {}
        repeated = 0
        while len(suggestions) < count:
            trial = self._study.ask()
            point = self._suggested(trial)
            if repeated >= _REPEATED:
                self._study.tell(trial, state=_failed())
                trial = None
                point = self._drawn()
            if point in self.outcomes or point in suggestions:
                repeated += 1
                if trial is not None and point in self.outcomes:
                    self._tell(trial, self.outcomes[point])
                elif trial is not None:
                    self._study.tell(trial, state=_failed())
                continue
            suggestions[point] = trial
        return [(trial, point) for point, trial in suggestions.items()]

    def _suggested(self, trial: Any) -> Point:
        return tuple(
            trial.suggest_int(str(axis), 0, count - 1)
            if self.is_ordered[axis]
            else trial.suggest_categorical(str(axis), list(range(count)))
            for axis, count in enumerate(self.levels)
        )

    def _drawn(self) -> Point:
        return tuple(int(self._rng.integers(count)) for count in self.levels)

    def _tell(self, trial: Any, outcome: Outcome) -> None:
        if trial is None:
            return
        # The estimator uses the order of values alone: those that violate requirements come after
        # all others, and those that launches lack come last.
        missed = outcome.violation / (1.0 + outcome.violation)
        worse = 2.0 + outcome.without if outcome.without > 0.0 else 1.0 + missed
        self._study.tell(trial, outcome.value if outcome.is_feasible else _VIOLATED * worse)


def _optuna_study(seed: int) -> Any:
    try:
        import optuna
    except ModuleNotFoundError as error:
        remedy = install_command("opir-studies", "optimise")
        raise PluginError(
            f"opir optimise needs Optuna, which is not installed; {remedy}"
        ) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    return optuna.create_study(
        direction="minimize", sampler=optuna.samplers.TPESampler(seed=seed, multivariate=True)
    )


def _failed() -> Any:
    from optuna.trial import TrialState

    return TrialState.FAIL
