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

#: The share of a wanted error that the choice may use on its own seeds: other seeds and scenes like
#: it need the rest.
MARGIN = 0.5
#: A coarser level must be cheaper by this share to be taken: processor times repeat to a few per
#: cent.
WORTH = 0.03
#: An error that is larger by less than this is no other.
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

    def worst(self, wanted: Mapping[str, float]) -> float:
        """Return the largest error over what is wanted of it; 1 and less is within."""
        return max(self.error(name) / bound for name, bound in wanted.items())


@frozen
class Tuned:
    """A choice: its overrides, what it costs, and its errors on seeds that it was not chosen on.

    `given` are the scene's own settings, at `own_levels` of the knobs, None where that is none of
    the levels; `exact` is the reference. The choice, at `levels`, may be the scene's own settings:
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

    def not_asked(self, wanted: Mapping[str, float]) -> list[str]:
        """Return the errors that nobody asked for and that are larger than with the scene's own
        settings.
        """
        rest = [name for name in MEASURES if name not in wanted]
        return [name for name in rest if self.chosen.error(name) > MORE * self.given.error(name)]


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
    found = list[RunAnswers]()
    times = list[float]()
    for number, seed in enumerate(seeds):
        own = evolve(reseeded(plan, seed) if number else plan, kept={})
        start = time.process_time()
        run = run_of_plan(own)
        times.append(time.process_time() - start)
        found.append(answers_of(run))
    return found, planned_s + median(times)


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
        """Return the level of each knob that the scene itself has; None where it has none of
        them.
        """
        own = scene_mapping(self.scene())
        found = list[int | None]()
        for knob in self.knobs:
            same = (
                n for n, level in enumerate(knob.levels) if scene_mapping(self.scene(level)) == own
            )
            found.append(next(same, None))
        return found

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
            found, time_s = exact if is_exact else self.simulate(scene, seeds, self.host)
            errors = [differences(one, other) for one, other in zip(found, exact[0], strict=True)]
            truth = from_truth_over_runs([each.from_truth for each in found])
            estimated = {
                name: float(np.mean([each.estimated[name] for each in found])) for name in OF_TRUTH
            }
            self._trials[key] = Trial((), time_s, over_runs(errors), truth, estimated)
        return self._trials[key]


def overrides_at(knobs: Sequence[Knob], levels: Sequence[int]) -> Overrides:
    """Return the overrides of a level of each knob."""
    return tuple(
        each for knob, level in zip(knobs, levels, strict=True) for each in knob.levels[level]
    )


def tuned(tuner: Tuner, wanted: Mapping[str, float]) -> Tuned:
    """Return the cheapest settings found whose errors are within `wanted`, by the names of
    `MEASURES`.

    Each knob is loosened by itself as long as the errors stay within half of what is wanted; the
    levels that pay are then tried together, and the knob with the largest error is tightened until
    they fit. The scene's own settings, if they are within what is wanted, stay unless these are
    cheaper. At last other seeds are run: where these exceed what is wanted, the scene's own
    settings are given up, or else a knob is tightened, and further seeds are run. `meets` says
    whether the last check held; it does not where even the reference differs from itself, which it
    never does.
    """
    _check(wanted)
    knobs = tuner.knobs
    first = tuner.scene().seed
    seeds = [first + number for number in range(tuner.runs)]
    tuner.simulate(
        tuner.scene(), seeds[:1], tuner.host
    )  # what is imported at the first use is not counted
    _check_answered(tuner, wanted, seeds)
    given = tuner.as_given(seeds)
    within = {name: MARGIN * bound for name, bound in wanted.items()}
    alone = [_loosened(tuner, number, wanted, seeds) for number in range(len(knobs))]
    levels = [
        max(trials, key=lambda each: each.levels[number]).levels[number]
        for number, trials in enumerate(alone)
    ]
    chosen = tuner.trial(levels, seeds)
    while chosen.worst(within) > 1.0 and any(levels):
        _tighten(levels, alone, within)
        chosen = tuner.trial(levels, seeds)
    # Nothing chose them among others, so that all of what is wanted is theirs to use.
    may_stay = given.worst(wanted) <= 1.0
    for others in _fresh_seeds(first, tuner.runs):
        stays = may_stay and (1.0 - WORTH) * given.time_s <= chosen.time_s
        checked = tuner.as_given(others) if stays else tuner.trial(levels, others)
        meets = checked.worst(wanted) <= 1.0
        if meets or not (stays or any(levels)):
            break
        if stays:
            may_stay = False
            continue
        _tighten(levels, alone, within)
        chosen = tuner.trial(levels, seeds)
    tried_alone = tuple(each for trials in alone for each in trials)
    exact = tuner.trial([0] * len(knobs), seeds)
    own_levels = tuner.own_levels()
    if stays:
        return Tuned(
            (), own_levels, given, checked, given, own_levels, exact, knobs, tried_alone, meets
        )
    overrides = overrides_at(knobs, levels)
    return Tuned(
        overrides, levels, chosen, checked, given, own_levels, exact, knobs, tried_alone, meets
    )


def _loosened(
    tuner: Tuner, number: int, wanted: Mapping[str, float], seeds: Sequence[int]
) -> list[Trial]:
    """Return the trials of one knob alone that are within bounds and each cheaper than the one
    before.
    """
    knob = tuner.knobs[number]
    levels = [0] * len(tuner.knobs)
    kept = [tuner.trial(levels, seeds)]
    for level in range(1, len(knob.levels)):
        if not knob.allows(level, wanted):
            break
        levels[number] = level
        trial = tuner.trial(levels, seeds)
        if trial.worst(wanted) > MARGIN:
            break
        if trial.time_s <= (1.0 - WORTH) * kept[-1].time_s:
            kept.append(trial)
    return kept


def _tighten(
    levels: list[int], alone: Sequence[Sequence[Trial]], within: Mapping[str, float]
) -> None:
    """Set the loosened knob with the largest error of its own to its next more exact level that
    paid.
    """
    loose = [number for number, level in enumerate(levels) if level]
    number = max(loose, key=lambda each: _own(alone[each], each, levels[each]).worst(within))
    levels[number] = max(
        each.levels[number] for each in alone[number] if each.levels[number] < levels[number]
    )


def _own(trials: Sequence[Trial], number: int, level: int) -> Trial:
    return next(each for each in trials if each.levels[number] == level)


def _fresh_seeds(first: int, runs: int) -> Sequence[list[int]]:
    """Yield lists of seeds that nothing was chosen on."""
    start = (first + _OTHER_SEEDS) % (1 << 62)
    return [[*islice(count(start + block * runs), runs)] for block in range(100)]


def _check_answered(tuner: Tuner, wanted: Mapping[str, float], seeds: Sequence[int]) -> None:
    """Refuse errors of what the scene has no answer to, which no setting changes."""
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
        for name in wanted
        if name in lacking
    ]
    if problems:
        raise SceneError(problems, source=tuner.path)


def _check(wanted: Mapping[str, float]) -> None:
    problems = []
    for name, bound in wanted.items():
        if name not in MEASURES:
            words = (
                f"no error is called {name!r}{nearest(name, MEASURES)}; there are"
                f" {', '.join(MEASURES)}"
            )
            problems.append(Problem("--error", words))
        elif not bound > 0.0:
            problems.append(Problem("--error", f"{name}={bound:g} is not a positive error"))
    if not wanted:
        problems.append(Problem("--error", "name an error, e.g. --error impact_km=1"))
    if problems:
        raise SceneError(problems, source="command line")
