"""Choosing accuracy settings: the cheapest ones whose errors against an exact reference stay within
given bounds.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from itertools import count, islice
from statistics import median

import numpy as np
from attrs import evolve, field, frozen

from opir_core import Scene, compile_plan, reseeded, run_of_plan
from opir_core.errors import Problem, SceneError, nearest
from opir_core.plugin import Host
from opir_core.reading import load_scene, scene_hash, scene_mapping
from opir_studies.differences import (
    MEASURES,
    OF_TRACKS,
    OF_TRUTH,
    RunAnswers,
    answers_of,
    differences,
    from_truth_over_runs,
    over_runs,
    unanswered,
)
from opir_studies.knobs import Knob, Overrides, knobs_of

#: The share of a bound that the choice may use on its own seeds: other seeds and scenes like it need
#: the rest.
MARGIN = 0.5
#: A coarser level must be cheaper by this share to be taken: processor times repeat to a few per
#: cent.
WORTH = 0.03
#: An error that is larger by a smaller factor counts as equal.
MORE = 1.1
#: Seeds of the check are this far from those of the choice.
_OTHER_SEEDS = 1_000_000


@frozen
class Trial:
    """Settings that were run: a level of each knob, processor time per run, s, errors against the
    reference, those from the truth, and the shares of launches that the latter are of.
    """

    levels: tuple[int, ...]
    time_s: float
    errors: Mapping[str, float]
    from_truth: Mapping[str, float]
    estimated: Mapping[str, float]

    def error(self, name: str) -> float:
        """Return an error by its name in `MEASURES`: from the reference, or from the truth where
        that is less.

        Two runs that are as near to the truth may be far from each other, to no harm. Where only
        one of a run and its reference has an answer, the error is infinite.
        """
        error = abs(self.errors[name])
        return min(error, self.from_truth.get(name, error)) if math.isfinite(error) else error

    def worst(self, bounds: Mapping[str, float]) -> float:
        """Return the largest ratio of an error to its bound; 1 and less is within."""
        return max(self.error(name) / bound for name, bound in bounds.items())


@frozen
class Tuned:
    """A choice: its overrides, its cost, and its errors on seeds that it was not chosen on.

    `given` are the scene's own settings, at `own_levels` of the knobs, None for
    other settings; `exact` is the reference. The choice, at `levels`, may be the scene's own settings:
    it then has no overrides.
    """

    overrides: Overrides
    levels: Sequence[int | None]
    chosen: Trial
    checked: Trial
    given: Trial
    own_levels: Sequence[int | None]
    exact: Trial
    knobs: Sequence[Knob]
    alone: Sequence[Trial]
    meets: bool

    def not_asked(self, bounds: Mapping[str, float]) -> list[str]:
        """Return the errors that nobody asked for and that are larger than with the scene's own
        settings.
        """
        unasked = [name for name in MEASURES if name not in bounds]
        return [name for name in unasked if self.chosen.error(name) > MORE * self.given.error(name)]


def tune(
    path: str, errors: Mapping[str, float], *, overrides: Sequence[str] = (), runs: int = 3
) -> Tuned:
    """Return the cheapest settings found of a scene file whose errors are within `errors`, as `opir
    tune` does.

    `errors` are bounds by the names of `opir tune --error`, such as `{"impact_km": 1.0}`;
    `overrides` are as for `--set`; each setting is run with `runs` seeds. Raises `SceneError` for
    an unknown or impossible error.
    """
    return tuned(Tuner(path, overrides=overrides, runs=runs), errors)


#: Answers of runs with some seeds, and the processor time of one run, s.
Answered = tuple[list[RunAnswers], float]


def timed_answers(scene: Scene, seeds: Sequence[int], host: Host) -> Answered:
    """Return the answers of runs of a scene with these seeds, and the processor time of one, s,
    from the plan on.

    The plan is made once; what runs of one plan share is computed in each, as in a run by itself.
    """
    start = time.process_time()
    plan = compile_plan(evolve(scene, seed=seeds[0]), host)
    planned_s = time.process_time() - start
    answers = list[RunAnswers]()
    times = list[float]()
    for number, seed in enumerate(seeds):
        replicate = evolve(reseeded(plan, seed) if number else plan, kept={})
        start = time.process_time()
        run = run_of_plan(replicate)
        times.append(time.process_time() - start)
        answers.append(answers_of(run))
    return answers, planned_s + median(times)


@frozen(eq=False, slots=False)
class Tuner:
    """A scene file with its knobs, and runs of it; trials and the answers of the reference are
    kept.
    """

    path: str
    overrides: Sequence[str] = ()
    runs: int = 3
    host: Host = field(factory=Host.discover)
    simulate: Callable[[Scene, Sequence[int], Host], Answered] = timed_answers
    _references: dict[tuple[int, ...], Answered] = field(factory=dict, init=False)
    _trials: dict[tuple[str, tuple[int, ...]], Trial] = field(factory=dict, init=False)

    def scene(self, extra: Overrides = ()) -> Scene:
        """Return the scene with more overrides, without outputs."""
        return evolve(
            load_scene(self.path, overrides=[*self.overrides, *extra], host=self.host), outputs=()
        )

    @cached_property
    def knobs(self) -> list[Knob]:
        """Return the knobs of the scene."""
        return knobs_of(self.scene())

    def own_levels(self) -> list[int | None]:
        """Return the level of each knob in the scene itself; None for another setting."""
        settings = scene_mapping(self.scene())
        levels = list[int | None]()
        for knob in self.knobs:
            matches = (
                n
                for n, level in enumerate(knob.levels)
                if scene_mapping(self.scene(level)) == settings
            )
            levels.append(next(matches, None))
        return levels

    def trial(self, levels: Sequence[int], seeds: Sequence[int]) -> Trial:
        """Return the time and errors of levels over runs with these seeds."""
        return evolve(
            self._trial(overrides_at(self.knobs, levels), tuple(seeds)), levels=tuple(levels)
        )

    def as_given(self, seeds: Sequence[int]) -> Trial:
        """Return the time and errors of the scene's own settings."""
        return self._trial((), tuple(seeds))

    def reference(self, seeds: Sequence[int]) -> Answered:
        """Return the answers of the most exact settings with these seeds."""
        key = tuple(seeds)
        if key not in self._references:
            self._references[key] = self.simulate(self.scene(self._exact()), key, self.host)
        return self._references[key]

    def _exact(self) -> Overrides:
        return overrides_at(self.knobs, [0] * len(self.knobs))

    def _trial(self, overrides: Overrides, seeds: tuple[int, ...]) -> Trial:
        scene = self.scene(overrides)
        exact = self.reference(seeds)
        key = scene_hash(scene), seeds
        if key not in self._trials:
            is_exact = overrides == self._exact()
            answers, time_s = exact if is_exact else self.simulate(scene, seeds, self.host)
            errors = [differences(*pair) for pair in zip(answers, exact[0], strict=True)]
            truth = from_truth_over_runs([run.from_truth for run in answers])
            estimated = {
                name: float(np.mean([run.estimated[name] for run in answers])) for name in OF_TRUTH
            }
            self._trials[key] = Trial((), time_s, over_runs(errors), truth, estimated)
        return self._trials[key]


def overrides_at(knobs: Sequence[Knob], levels: Sequence[int]) -> Overrides:
    """Return the overrides of a level of each knob."""
    return tuple(
        override
        for knob, level in zip(knobs, levels, strict=True)
        for override in knob.levels[level]
    )


def tuned(tuner: Tuner, bounds: Mapping[str, float]) -> Tuned:
    """Return the cheapest settings found whose errors are within `bounds`, by the names of
    `MEASURES`.

    Each knob is loosened by itself as long as the errors stay within half of the bounds; the levels
    that pay are then tried together, and the knob with the largest error is tightened until they
    fit. The scene's own settings, if they are within the bounds, stay unless these are cheaper. At
    last other seeds are run: where these exceed the bounds, the scene's own settings are given up,
    or else a knob is tightened, and further seeds are run. `meets` says whether the last check
    held; it does not where even the reference differs from itself, which it never does.
    """
    _check(bounds)
    tuner.simulate(
        tuner.scene(), [tuner.scene().seed], tuner.host
    )  # imports at the first use are not counted
    choice = _Choice(tuner, bounds)
    _check_answered(tuner, bounds, choice.seeds)
    return choice.tuned()


class _Choice:
    """Levels of the knobs that are tightened until their errors are within bounds."""

    def __init__(self, tuner: Tuner, bounds: Mapping[str, float]) -> None:
        start = tuner.scene().seed
        self.seeds = [start + number for number in range(tuner.runs)]
        self._tuner = tuner
        self._bounds = bounds
        self._margins = {name: MARGIN * bound for name, bound in bounds.items()}

    def tuned(self) -> Tuned:
        """Return the choice, checked on other seeds."""
        tuner = self._tuner
        own_trial = tuner.as_given(self.seeds)
        numbers = range(len(tuner.knobs))
        self._loosened = [_loosened(tuner, n, self._bounds, self.seeds) for n in numbers]
        self._levels = [trials[-1].levels[n] for n, trials in enumerate(self._loosened)]
        self._trial = tuner.trial(self._levels, self.seeds)
        while self._trial.worst(self._margins) > 1.0 and any(self._levels):
            self._tighten()
        checked, stays = self._checked(own_trial)
        own_levels = tuner.own_levels()
        return Tuned(
            overrides=() if stays else overrides_at(tuner.knobs, self._levels),
            levels=own_levels if stays else self._levels,
            chosen=own_trial if stays else self._trial,
            checked=checked,
            given=own_trial,
            own_levels=own_levels,
            exact=tuner.trial([0] * len(tuner.knobs), self.seeds),
            knobs=tuner.knobs,
            alone=tuple(trial for trials in self._loosened for trial in trials),
            meets=checked.worst(self._bounds) <= 1.0,
        )

    def _checked(self, own_trial: Trial) -> tuple[Trial, bool]:
        """Return the last trial on other seeds, and whether the scene's own settings stay.

        They were not chosen among others, so that they may use all of the bounds.
        """
        may_stay = own_trial.worst(self._bounds) <= 1.0
        for seeds in _other_seeds(self.seeds[0], len(self.seeds)):
            stays = may_stay and (1.0 - WORTH) * own_trial.time_s <= self._trial.time_s
            tuner = self._tuner
            checked = tuner.as_given(seeds) if stays else tuner.trial(self._levels, seeds)
            if checked.worst(self._bounds) <= 1.0 or not (stays or any(self._levels)):
                break
            if stays:
                may_stay = False
            else:
                self._tighten()
        return checked, stays

    def _tighten(self) -> None:
        """Set the loosened knob with the largest error of its own to its next more exact level that
        paid.
        """
        worst = {
            number: _trial_at(trials, number, level).worst(self._margins)
            for number, (trials, level) in enumerate(zip(self._loosened, self._levels, strict=True))
            if level
        }
        number = max(worst, key=worst.__getitem__)
        paid = [trial.levels[number] for trial in self._loosened[number]]
        self._levels[number] = max(level for level in paid if level < self._levels[number])
        self._trial = self._tuner.trial(self._levels, self.seeds)


def _loosened(
    tuner: Tuner, number: int, bounds: Mapping[str, float], seeds: Sequence[int]
) -> list[Trial]:
    """Return the trials of one knob alone that are within bounds and each cheaper than the one
    before.
    """
    knob = tuner.knobs[number]
    levels = [0] * len(tuner.knobs)
    trials = [tuner.trial(levels, seeds)]
    for level in range(1, len(knob.levels)):
        if not knob.allows(level, bounds):
            break
        levels[number] = level
        trial = tuner.trial(levels, seeds)
        if trial.worst(bounds) > MARGIN:
            break
        if trial.time_s <= (1.0 - WORTH) * trials[-1].time_s:
            trials.append(trial)
    return trials


def _trial_at(trials: Sequence[Trial], number: int, level: int) -> Trial:
    """Return the trial with a level of the knob with a number."""
    return next(trial for trial in trials if trial.levels[number] == level)


def _other_seeds(seed: int, runs: int) -> Sequence[list[int]]:
    """Return lists of seeds that nothing was chosen on."""
    start = (seed + _OTHER_SEEDS) % (1 << 62)
    return [[*islice(count(start + block * runs), runs)] for block in range(100)]


def _check_answered(tuner: Tuner, bounds: Mapping[str, float], seeds: Sequence[int]) -> None:
    """Refuse errors of answers that the scene does not have, which no setting changes."""
    lacking = unanswered(tuner.reference(seeds)[0][0])
    tracker = (
        f"its tracker is {tuner.scene().tracker.name}; name one that estimates it, e.g. --set"
        f" tracker=imm, or "
    )
    problems = [
        Problem(
            f"--error {name}",
            f"even the most exact run has no answer whose error this is ({MEASURES[name]}): "
            f"{tracker if name in OF_TRACKS else ''}let the scene last longer",
        )
        for name in bounds
        if name in lacking
    ]
    if problems:
        raise SceneError(problems, source=tuner.path)


def _check(bounds: Mapping[str, float]) -> None:
    problems = []
    for name, bound in bounds.items():
        if name not in MEASURES:
            words = (
                f"no error is called {name!r}{nearest(name, MEASURES)}; there are"
                f" {', '.join(MEASURES)}"
            )
            problems.append(Problem("--error", words))
        elif not bound > 0.0:
            problems.append(Problem("--error", f"{name}={bound:g} is not a positive error"))
    if not bounds:
        problems.append(Problem("--error", "name an error, e.g. --error impact_km=1"))
    if problems:
        raise SceneError(problems, source="command line")
