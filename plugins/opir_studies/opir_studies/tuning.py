"""Choosing accuracy settings: the cheapest ones whose errors against an exact reference stay within given bounds."""

import time
from collections.abc import Callable, Mapping, Sequence
from itertools import count, islice
from statistics import median

from attrs import evolve, field, frozen

from opir_core import Run, Scene, compile_plan, run_of_plan
from opir_core.errors import Problem, SceneError, nearest
from opir_core.plugin import Host
from opir_core.reading import load_scene
from opir_studies.differences import MEASURES, OF_TRACKS, RunAnswers, answers_of, differences, over_runs, unanswered
from opir_studies.knobs import Knob, Overrides, knobs_of

#: The share of a wanted error that the choice may use on its own seeds: other seeds and scenes like it need the rest.
MARGIN = 0.5
#: A coarser level must be cheaper by this share to be taken: processor times repeat to a few per cent.
WORTH = 0.03
#: Seeds of the check are this far from those of the choice.
_OTHER_SEEDS = 1_000_000


@frozen
class Trial:
    """Settings that were run: a level of each knob, processor time per run, s, and errors against the reference."""

    levels: tuple[int, ...]
    time_s: float
    errors: Mapping[str, float]

    def worst(self, wanted: Mapping[str, float]) -> float:
        """Return the largest error over what is wanted of it; 1 and less is within."""
        return max(self.errors[name] / bound for name, bound in wanted.items())


@frozen
class Tuned:
    """A choice: its overrides, what it costs, and its errors on seeds that it was not chosen on."""

    overrides: Overrides
    chosen: Trial
    checked: Mapping[str, float]
    given: Trial
    reference_s: float
    knobs: Sequence[Knob]
    alone: Sequence[Trial]
    meets: bool


def tune(path: str, errors: Mapping[str, float], *, overrides: Sequence[str] = (), runs: int = 3) -> Tuned:
    """Return the cheapest settings found of a scene file whose errors are within `errors`, as `opir tune` does.

    `errors` are bounds by the names of `opir tune --error`, such as `{"impact_km": 1.0}`; `overrides` are as for
    `--set`; each setting is run with `runs` seeds. Raises `SceneError` for an unknown or impossible error.
    """
    return tuned(Tuner(path, overrides=overrides, runs=runs), errors)


def timed_run(scene: Scene, host: Host) -> tuple[Run, float]:
    """Return the run of a scene and its processor time, s, from the plan on."""
    start = time.process_time()
    run = run_of_plan(compile_plan(scene, host))
    return run, time.process_time() - start


@frozen(eq=False)
class Tuner:
    """A scene file with its knobs, and runs of it; answers of the reference are kept by seed."""

    path: str
    overrides: Sequence[str] = ()
    runs: int = 3
    host: Host = field(factory=Host.discover)
    simulate: Callable[[Scene, Host], tuple[Run, float]] = timed_run
    on_run: Callable[[], None] = lambda: None
    _references: dict[int, tuple[RunAnswers, float]] = field(factory=dict, init=False)

    def scene(self, extra: Overrides = ()) -> Scene:
        """Return the scene with more overrides, without outputs."""
        return evolve(load_scene(self.path, overrides=[*self.overrides, *extra], host=self.host), outputs=())

    def knobs(self) -> list[Knob]:
        """Return the knobs of the scene."""
        return knobs_of(self.scene())

    def trial(self, knobs: Sequence[Knob], levels: Sequence[int], seeds: Sequence[int]) -> Trial:
        """Return the time and errors of levels over runs with these seeds."""
        return self._trial(knobs, tuple(levels), overrides_at(knobs, levels), seeds)

    def as_given(self, knobs: Sequence[Knob], seeds: Sequence[int]) -> Trial:
        """Return the time and errors of the scene's own settings."""
        return self._trial(knobs, (), (), seeds)

    def reference_s(self, seeds: Sequence[int]) -> float:
        """Return the processor time of a reference run, s, of seeds that were run."""
        return median(self._references[seed][1] for seed in seeds)

    def _trial(
        self, knobs: Sequence[Knob], levels: tuple[int, ...], overrides: Overrides, seeds: Sequence[int]
    ) -> Trial:
        scene, found, times = self.scene(overrides), [], []
        for seed in seeds:
            reference = self._reference(knobs, seed)
            run, spent_s = self._run(evolve(scene, seed=seed))
            found.append(differences(answers_of(run), reference))
            times.append(spent_s)
        return Trial(levels, median(times), over_runs(found))

    def reference(self, seed: int) -> RunAnswers:
        """Return the answers of the reference run with a seed."""
        return self._reference(self.knobs(), seed)

    def _reference(self, knobs: Sequence[Knob], seed: int) -> RunAnswers:
        if seed not in self._references:
            scene = self.scene(overrides_at(knobs, [0] * len(knobs)))
            run, spent_s = self._run(evolve(scene, seed=seed))
            self._references[seed] = answers_of(run), spent_s
        return self._references[seed][0]

    def _run(self, scene: Scene) -> tuple[Run, float]:
        self.on_run()
        return self.simulate(scene, self.host)


def overrides_at(knobs: Sequence[Knob], levels: Sequence[int]) -> Overrides:
    """Return the overrides of a level of each knob."""
    return tuple(each for knob, level in zip(knobs, levels, strict=True) for each in knob.levels[level])


def tuned(tuner: Tuner, wanted: Mapping[str, float]) -> Tuned:
    """Return the cheapest settings found whose errors are within `wanted`, by the names of `MEASURES`.

    Each knob is loosened by itself as long as the errors stay within half of what is wanted; the levels that pay are
    then tried together, and the knob with the largest error is tightened until they fit. At last other seeds are run:
    where these exceed what is wanted, a knob is tightened and further seeds are run. `meets` says whether the last
    check held; it does not where even the reference differs from itself, which it never does.
    """
    _check(wanted)
    knobs, first = tuner.knobs(), tuner.scene().seed
    seeds = [first + number for number in range(tuner.runs)]
    tuner.trial(knobs, [0] * len(knobs), seeds[:1])  # what is imported at the first use is not counted
    _check_answered(tuner, wanted, first)
    given = tuner.as_given(knobs, seeds)
    within = {name: MARGIN * bound for name, bound in wanted.items()}
    alone = [_loosened(tuner, knobs, number, wanted, seeds) for number in range(len(knobs))]
    levels = [max(trials, key=lambda each: each.levels[number]).levels[number] for number, trials in enumerate(alone)]
    chosen = tuner.trial(knobs, levels, seeds)
    while chosen.worst(within) > 1.0 and any(levels):
        _tighten(levels, alone, within)
        chosen = tuner.trial(knobs, levels, seeds)
    for others in _fresh_seeds(first, tuner.runs):
        checked = tuner.trial(knobs, levels, others)
        meets = checked.worst(wanted) <= 1.0
        if meets or not any(levels):
            break
        _tighten(levels, alone, within)
        chosen = tuner.trial(knobs, levels, seeds)
    tried_alone = tuple(each for trials in alone for each in trials)
    overrides = overrides_at(knobs, levels)
    return Tuned(overrides, chosen, checked.errors, given, tuner.reference_s(seeds), knobs, tried_alone, meets)


def _loosened(
    tuner: Tuner, knobs: Sequence[Knob], number: int, wanted: Mapping[str, float], seeds: Sequence[int]
) -> list[Trial]:
    """Return the trials of one knob alone that are within bounds and each cheaper than the one before."""
    levels = [0] * len(knobs)
    kept = [tuner.trial(knobs, levels, seeds)]
    for level in range(1, len(knobs[number].levels)):
        if not knobs[number].allows(level, wanted):
            break
        levels[number] = level
        trial = tuner.trial(knobs, levels, seeds)
        if trial.worst(wanted) > MARGIN:
            break
        if trial.time_s <= (1.0 - WORTH) * kept[-1].time_s:
            kept.append(trial)
    return kept


def _tighten(levels: list[int], alone: Sequence[Sequence[Trial]], within: Mapping[str, float]) -> None:
    """Set the loosened knob with the largest error of its own to its next more exact level that paid."""
    loose = [number for number, level in enumerate(levels) if level]
    number = max(loose, key=lambda each: _own(alone[each], each, levels[each]).worst(within))
    levels[number] = max(each.levels[number] for each in alone[number] if each.levels[number] < levels[number])


def _own(trials: Sequence[Trial], number: int, level: int) -> Trial:
    return next(each for each in trials if each.levels[number] == level)


def _fresh_seeds(first: int, runs: int) -> Sequence[list[int]]:
    """Yield lists of seeds that nothing was chosen on."""
    start = (first + _OTHER_SEEDS) % (1 << 62)
    return [[*islice(count(start + block * runs), runs)] for block in range(100)]


def _check_answered(tuner: Tuner, wanted: Mapping[str, float], seed: int) -> None:
    """Refuse errors of what the scene does not tell, which no setting changes."""
    lacking = unanswered(tuner.reference(seed))
    tracker = f"its tracker is {tuner.scene().tracker.name}; name one that estimates it, e.g. --set tracker=imm, or "
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
            words = f"no error is called {name!r}{nearest(name, MEASURES)}; there are {', '.join(MEASURES)}"
            problems.append(Problem("--error", words))
        elif not bound > 0.0:
            problems.append(Problem("--error", f"{name}={bound:g} is not a positive error"))
    if not wanted:
        problems.append(Problem("--error", "name an error, e.g. --error impact_km=1"))
    if problems:
        raise SceneError(problems, source="command line")
