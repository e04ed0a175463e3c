"""Comparison of trackers over many runs of one scene, with the same detections for each tracker."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any, NamedTuple

from attrs import evolve, frozen
from opir_scoring import (
    USUAL_SETTINGS,
    Scorecard,
    ScoredRun,
    ScoreSettings,
    comparison_text,
    evidence_of_run,
    paired_figures,
    scorecard_of,
    scored_run,
)

from opir_core import Scene, compile_plan, run_of_plan
from opir_core.arrays import IntArray
from opir_core.errors import OpirError
from opir_core.host import DEAD_AFTER_S
from opir_core.plugin import Detections, Host, Tracker, Tracks
from opir_core.reading import load_scene
from opir_studies.axes import Design, combinations
from opir_studies.executors import LostTasksError, ProcessesExecutor, SerialExecutor
from opir_studies.refusals import refusal
from opir_studies.runs import PLANS


class TimedTracker(Tracker):
    """A tracker with its processor time measured; calls that import modules, as the first ones do,
    are not counted.
    """

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self.seconds = 0.0

    @property
    def cadence_s(self) -> float | None:
        """Time between ticks, s."""
        return self._tracker.cadence_s

    def associate(self, detections: Detections) -> IntArray:
        """Return the track numbers of detections."""
        with self._timed():
            return self._tracker.associate(detections)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at a tick."""
        with self._timed():
            return self._tracker.step(tick_s, detections)

    @contextmanager
    def _timed(self) -> Iterator[None]:
        modules = len(sys.modules)
        start = time.process_time()
        yield
        if len(sys.modules) == modules:
            self.seconds += time.process_time() - start


@frozen(eq=False)
class Comparison:
    """Trackers on the same runs: the scorecard of each by its name, and their paired figures
    (`paired_figures`).

    `automatic` are the components that `auto` chose (`Scene.automatic`).
    """

    cards: Mapping[str, Scorecard]
    paired: Mapping[str, Any]
    automatic: Sequence[str] = ()

    def __repr__(self) -> str:
        """Return the names of the trackers, in one line."""
        return f"<Comparison of {', '.join(self.cards)}>"

    def _repr_html_(self) -> str:
        """Return the scores as a notebook shows them."""
        return f"<pre>{escape(comparison_text(self.paired, self.cards))}</pre>"

    def as_plain(self) -> Any:
        """Return the figures for JSON, with null for unknown values."""
        cards = {name: card.as_plain() for name, card in self.cards.items()}
        return {
            "paired": Scorecard(self.paired).as_plain(),
            "trackers": cards,
            "automatic": list(self.automatic),
        }


class _Scored(NamedTuple):
    """A scored run, and whether it has impacts by the paper's law."""

    run: ScoredRun
    has_paper_impacts: bool


def compared(
    path: str,
    *,
    trackers: Sequence[str] | None,
    runs: int,
    vary: Mapping[str, Any] | None = None,
    overrides: Sequence[str] = (),
    settings: ScoreSettings = USUAL_SETTINGS,
    workers: int = 1,
    dead_after_s: float = DEAD_AFTER_S,
    on_run: Callable[[str, int], None] = lambda _tracker, _number: None,
) -> Comparison:
    """Return the scores of trackers over `runs` runs of a scene file; run k has the scene's seed
    plus k.

    `trackers` are values of a scene's `tracker:`; None is the scene's own. With `vary`, values of
    settings by their paths as in a study, each is scored with all combinations of these. Without
    any tracker a `SceneError` is raised. `workers` is the number of processes; a script with several needs `if
    __name__ == "__main__":`, because they are spawned. Figures other than times do not depend on
    it. The figure `impact_method` is `paper` for a tracker with impacts by the paper's law.
    `on_run` is called after each run with its tracker and number.
    """
    host = Host.discover()
    named = list(dict.fromkeys(trackers)) if trackers else [None]
    # All scenes are read before the first run, so that errors in any of them appear at once.
    scenes = {
        _label(name or scene.tracker.name, design): scene
        for name in named
        for design in combinations(vary or {})
        for scene in [_scene(path, name, overrides, host, design)]
    }
    tasks = [_Task(scene, number, settings) for scene in scenes.values() for number in range(runs)]
    scored = _scored_runs(tasks, list(scenes), workers, dead_after_s, on_run)
    rows = {label: scored[place * runs : (place + 1) * runs] for place, label in enumerate(scenes)}
    paired = paired_figures(
        {label: [row.run for row in rows_of_label] for label, rows_of_label in rows.items()},
        settings,
    )
    cards = {label: _card(rows_of_label, settings) for label, rows_of_label in rows.items()}
    scene = next(iter(scenes.values()))
    return Comparison(cards, paired, scene.automatic)


def _label(tracker: str, design: Design) -> str:
    """Return the name of a tracker with the settings of a design, shortened to their keys."""
    settings = design.labels.replace("tracker.", "")
    return f"{tracker} {settings}" if settings else tracker


def _card(rows: Sequence[_Scored], settings: ScoreSettings) -> Scorecard:
    """Return the scorecard of runs, with the method of their impacts."""
    card = scorecard_of([row.run for row in rows], settings)
    method = "paper" if any(row.has_paper_impacts for row in rows) else "posterior"
    return evolve(card, figures={**card.figures, "impact_method": method})


def _scene(
    path: str, name: str | None, overrides: Sequence[str], host: Host, design: Design
) -> Scene:
    """Return the scene with the named tracker, or its own, and a design's settings; `SceneError`
    where that reports no tracks.
    """
    setting = [] if name is None else [f"tracker={name}"]
    changes = [*overrides, *setting, *design.overrides]
    scene = evolve(load_scene(path, overrides=changes, host=host), outputs=())
    if compile_plan(scene, host).make_tracker().cadence_s is None:
        words = f"{scene.tracker.name} makes no tracks to score; name other trackers with --tracker"
        raise refusal("tracker", words, path)
    return scene


class _Task(NamedTuple):
    """A run to score: the scene, the number of the run, and the settings."""

    scene: Scene
    number: int
    settings: ScoreSettings


def _scored_runs(
    tasks: Sequence[_Task],
    labels: Sequence[str],
    workers: int,
    dead_after_s: float,
    on_run: Callable[[str, int], None],
) -> Sequence[_Scored]:
    """Return scored runs in the order of their tasks, made by an executor."""
    workers = min(workers, len(tasks))
    runs = len(tasks) // len(labels)
    executor = SerialExecutor() if workers < 2 else ProcessesExecutor(workers, dead_after_s)
    results: dict[int, _Scored] = {}
    done = dict.fromkeys(labels, 0)
    try:
        for index, scored in executor.results(_scored, tasks):
            results[index] = scored
            label = labels[index // runs]
            done[label] += 1
            on_run(label, done[label])
    except LostTasksError as error:
        if error.reasons:
            raise
        words = (
            "a worker process ended before its run was complete, possibly out of memory; use fewer"
            " --workers"
        )
        raise OpirError(words) from error
    finally:
        executor.close()
    return [results[index] for index in range(len(tasks))]


def _scored(task: _Task) -> _Scored:
    plan = PLANS.of(task.scene, task.scene.seed + task.number)
    timed = TimedTracker(plan.make_tracker())
    run = run_of_plan(evolve(plan, make_tracker=lambda: timed))
    impacts = [row["impact"] for row in run.summary["tracks"] if row["impact"] is not None]
    has_paper_impacts = any(impact["method"] == "paper" for impact in impacts)
    return _Scored(
        scored_run(evidence_of_run(run, plan, timed.seconds), task.settings), has_paper_impacts
    )
