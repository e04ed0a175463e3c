"""Many runs of one scene with several trackers: the same detections to each, run by run."""

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

from attrs import evolve

from opir_core.errors import Problem, SceneError
from opir_core.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.protocols import Tracker
from opir_core.reading import load_scene
from opir_core.records import Detections, IntArray, Tracks
from opir_core.run import run_of_plan
from opir_core.scene import Scene
from opir_core.scoring.evidence import Evidence, evidence_of_run
from opir_core.scoring.scorecard import USUAL_SETTINGS, Scorecard, ScoreSettings, scorecard


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
    on_run: Callable[[str, int], None] = lambda _tracker, _number: None,
) -> Mapping[str, Scorecard]:
    """Return the scorecard of each tracker over `runs` runs of a scene file; run k has the scene's seed plus k.

    `trackers` are what a scene may write after `tracker:`; None takes the scene's own. A scene without a tracker, and
    no tracker given, is a `SceneError`. `on_run` is told of each run that is done: whose, and how many now.
    """
    host = Host.discover()
    named = list(dict.fromkeys(trackers)) if trackers else [None]
    # All are read before any is run: what is wrong with the last is told at once.
    scenes = [_scene(path, name, overrides, host) for name in named]
    cards = {}
    for name, scene in zip(named, scenes, strict=True):
        label = name or scene.tracker.name
        cards[label] = scorecard(_evidences(scene, runs, host, partial(on_run, label)), settings)
    return cards


def _scene(path: str, name: str | None, overrides: Sequence[str], host: Host) -> Scene:
    """Return the scene with the tracker of a name, or its own; `SceneError` where that makes no tracks."""
    chosen = [] if name is None else [f"tracker={name}"]
    scene = evolve(load_scene(path, overrides=[*overrides, *chosen], host=host), outputs=())
    if compile_plan(scene, host).tracker.cadence_s is None:
        words = f"{scene.tracker.name} makes no tracks to judge; name those that do with --tracker"
        raise SceneError([Problem("tracker", words)], source=path)
    return scene


def _evidences(scene: Scene, runs: int, host: Host, on_run: Callable[[int], None]) -> Iterator[Evidence]:
    for number in range(runs):
        yield _evidence(compile_plan(evolve(scene, seed=scene.seed + number), host))
        on_run(number + 1)


def _evidence(plan: Plan) -> Evidence:
    timed = TimedTracker(plan.tracker)
    run = run_of_plan(evolve(plan, tracker=timed))
    return evidence_of_run(run, plan, timed.seconds)
