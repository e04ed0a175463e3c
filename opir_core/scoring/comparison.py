"""Many runs of one scene with several trackers: the same detections to each, run by run."""

import time
from collections.abc import Iterator, Mapping, Sequence

from attrs import evolve

from opir_core.errors import Problem, SceneError
from opir_core.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.protocols import Tracker
from opir_core.reading import load_scene
from opir_core.records import Detections, IntArray, Tracks
from opir_core.run import run_of_plan
from opir_core.scoring.evidence import Evidence, evidence_of_run
from opir_core.scoring.scorecard import USUAL_SETTINGS, Scorecard, ScoreSettings, scorecard


class TimedTracker:
    """A tracker whose time is taken."""

    def __init__(self, tracker: Tracker) -> None:
        self._tracker = tracker
        self.seconds = 0.0

    @property
    def cadence_s(self) -> float | None:
        """Time between ticks, s."""
        return self._tracker.cadence_s

    def associate(self, detections: Detections) -> IntArray:
        """Return the track numbers of detections."""
        start = time.process_time()
        found = self._tracker.associate(detections)
        self.seconds += time.process_time() - start
        return found

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at a tick."""
        start = time.process_time()
        told = self._tracker.step(tick_s, detections)
        self.seconds += time.process_time() - start
        return told


def compared(
    path: str,
    *,
    trackers: Sequence[str] | None,
    runs: int,
    overrides: Sequence[str] = (),
    settings: ScoreSettings = USUAL_SETTINGS,
) -> Mapping[str, Scorecard]:
    """Return the scorecard of each tracker over `runs` runs of a scene file; run k has the scene's seed plus k.

    `trackers` are what a scene may write after `tracker:`; None takes the scene's own. A scene without a tracker, and
    no tracker given, is a `SceneError`.
    """
    host = Host.discover()
    named = list(trackers) if trackers else [None]
    return {
        _label(path, name, overrides, host): scorecard(_evidences(path, name, runs, overrides, host), settings)
        for name in named
    }


def _label(path: str, name: str | None, overrides: Sequence[str], host: Host) -> str:
    return name or load_scene(path, overrides=overrides, host=host).tracker.name


def _evidences(path: str, name: str | None, runs: int, overrides: Sequence[str], host: Host) -> Iterator[Evidence]:
    chosen = [] if name is None else [f"tracker={name}"]
    scene = load_scene(path, overrides=[*overrides, *chosen], host=host)
    for number in range(runs):
        plan = compile_plan(evolve(scene, seed=scene.seed + number, outputs=()), host)
        if plan.tracker.cadence_s is None:
            raise SceneError([Problem("tracker", f"{scene.tracker.name} makes no tracks to judge")], source=path)
        yield _evidence(plan)


def _evidence(plan: Plan) -> Evidence:
    timed = TimedTracker(plan.tracker)
    run = run_of_plan(evolve(plan, tracker=timed))
    return evidence_of_run(run, plan, timed.seconds)
