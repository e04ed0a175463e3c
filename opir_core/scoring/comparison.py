"""Many runs of one scene with several trackers: the same detections to each, run by run."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import NamedTuple

from attrs import evolve

from opir_core.arrays import IntArray
from opir_core.errors import OpirError, Problem, SceneError
from opir_core.interfaces.protocols import Tracker
from opir_core.interfaces.records import Detections, Tracks
from opir_core.planning.plan import compile_plan
from opir_core.plugin.host import Host
from opir_core.scene.reading import load_scene
from opir_core.scene.scene import Scene
from opir_core.scoring.evidence import evidence_of_run
from opir_core.scoring.scorecard import USUAL_SETTINGS, Scorecard, ScoredRun, ScoreSettings, scorecard_of, scored_run
from opir_core.simulation.run import run_of_plan


class TimedTracker:
    """A tracker whose time is taken; calls that import something, as the first of a process do, are not counted."""

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
        known, start = len(sys.modules), time.process_time()
        yield
        if len(sys.modules) == known:
            self.seconds += time.process_time() - start


def compared(
    path: str,
    *,
    trackers: Sequence[str] | None,
    runs: int,
    overrides: Sequence[str] = (),
    settings: ScoreSettings = USUAL_SETTINGS,
    workers: int = 1,
    on_run: Callable[[str, int], None] = lambda _tracker, _number: None,
) -> Mapping[str, Scorecard]:
    """Return the scorecard of each tracker over `runs` runs of a scene file; run k has the scene's seed plus k.

    `trackers` are what a scene may write after `tracker:`; None takes the scene's own. A scene without a tracker, and
    no tracker given, is a `SceneError`. With several `workers` so many processes run at once, started anew: a script
    that asks for them does so under `if __name__ == "__main__":`. Figures do not depend on their number, but for times.
    `on_run` is told of each run that is done: whose, and how many now.
    """
    host = Host.discover()
    named = list(dict.fromkeys(trackers)) if trackers else [None]
    # All are read before any is run: what is wrong with the last is told at once.
    scenes = {name or scene.tracker.name: scene for name in named for scene in [_scene(path, name, overrides, host)]}
    tasks = [_Task(scene, number, settings) for scene in scenes.values() for number in range(runs)]
    found, cards = _scored_runs(tasks, workers, host), {}
    for label in scenes:
        judged = []
        for number in range(runs):
            judged.append(next(found))
            on_run(label, number + 1)
        cards[label] = scorecard_of(judged, settings)
    return cards


def _scene(path: str, name: str | None, overrides: Sequence[str], host: Host) -> Scene:
    """Return the scene with the tracker of a name, or its own; `SceneError` where that makes no tracks."""
    chosen = [] if name is None else [f"tracker={name}"]
    scene = evolve(load_scene(path, overrides=[*overrides, *chosen], host=host), outputs=())
    if compile_plan(scene, host).make_tracker().cadence_s is None:
        words = f"{scene.tracker.name} makes no tracks to judge; name those that do with --tracker"
        raise SceneError([Problem("tracker", words)], source=path)
    return scene


class _Task(NamedTuple):
    """A run to judge: the scene, the number of the run, and how."""

    scene: Scene
    number: int
    settings: ScoreSettings


def _scored_runs(tasks: Sequence[_Task], workers: int, host: Host) -> Iterator[ScoredRun]:
    """Yield what is found in runs, in their order, so many at once."""
    if min(workers, len(tasks)) < 2:
        yield from (_scored(task, host) for task in tasks)
        return
    from concurrent.futures import ProcessPoolExecutor
    from concurrent.futures.process import BrokenProcessPool
    from multiprocessing import get_context

    # Not forked: other threads, such as a progress bar's, may hold locks.
    with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=get_context("spawn")) as pool:
        try:
            yield from pool.map(_scored, tasks)
        except BrokenProcessPool as error:
            words = "a worker's process ended before its run did, perhaps for want of memory; give fewer --workers"
            raise OpirError(words) from error


def _scored(task: _Task, host: Host | None = None) -> ScoredRun:
    plan = compile_plan(evolve(task.scene, seed=task.scene.seed + task.number), host)
    timed = TimedTracker(plan.make_tracker())
    run = run_of_plan(evolve(plan, make_tracker=lambda: timed))
    return scored_run(evidence_of_run(run, plan, timed.seconds), task.settings)
