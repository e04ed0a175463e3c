"""A whole run at once: simulate a scene, sum it up, and say what is needed to repeat it."""

from collections.abc import Iterable, Iterator

from attrs import evolve

from opir_core.arrays import IntArray
from opir_core.engine import Engine
from opir_core.manifest import run_manifest
from opir_core.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.records import Detections, DetectionTruth, Run, Tracks, Window
from opir_core.scene import Scene
from opir_core.summary import Tally
from opir_core.windowing import window_edges_ns


def simulate(scene: Scene, host: Host | None = None, *, window_s: float | None = None) -> Run:
    """Return the run of a scene: all detections and tracks as columns in memory.

    `window_s` sets the length of the windows worked through, which changes no result. For scenes too large for memory,
    use `opir_core.windows`.
    """
    return run_of_plan(compile_plan(scene, host), window_s)


def run_of_plan(plan: Plan, window_s: float | None = None) -> Run:
    """Return the run of a plan; run again, it gives the same run again.

    A tracker that was put in the place of the plan's own runs once: raises `OpirError` the second time.
    """
    tally = Tally(plan)
    return _collected(plan, tally, list(tally.over(plan_windows(plan, window_s))))


def windows(scene: Scene, host: Host | None = None, *, window_s: float | None = None) -> Iterator[Window]:
    """Yield the windows of a scene, in order of time; `window_s` sets their length, which changes no result."""
    yield from plan_windows(compile_plan(scene, host), window_s)


def plan_windows(plan: Plan, window_s: float | None = None) -> Iterator[Window]:
    """Yield the windows of a plan, in order of time."""
    engine = Engine(plan)
    for edge_ns in window_edges_ns(plan, window_s):
        yield engine.advance(edge_ns)


def _collected(plan: Plan, tally: Tally, windows: Iterable[Window]) -> Run:
    parts = list(windows)
    return Run(
        detections=_with_run_estimates(parts),
        truth=DetectionTruth.concatenate(part.truth for part in parts),
        tracks=Tracks.concatenate(part.tracks for part in parts),
        estimates=Tracks.concatenate(part.estimates for part in parts),
        sensors=plan.sensors,
        target_ids=plan.targets.ids,
        summary=tally.summary(),
        manifest=run_manifest(plan, tally.counts()),
    )


def _with_run_estimates(parts: Iterable[Window]) -> Detections:
    """Return all detections, their `estimate` counted over the whole run."""
    shifted, rows = [], 0
    for part in parts:
        shifted.append(part.detections if rows == 0 else _shifted(part.detections, rows))
        rows += len(part.estimates)
    return Detections.concatenate(shifted).freeze()


def _shifted(detections: Detections, rows: int) -> Detections:
    estimate: IntArray = detections.estimate + rows * (detections.estimate >= 0)
    return evolve(detections, estimate=estimate)
