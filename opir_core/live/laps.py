"""Laps: a scene run again and again, its scene time going on, each lap a run of its own.

When a launch goes up that is asked of a run: scene time counts from the scene's epoch, a lap's plan from its own.
"""

import threading
from collections.abc import Mapping
from concurrent.futures import Future
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import Problem, SceneError
from opir_core.interfaces.records import Tracks, Window
from opir_core.live.change_lock import PastError
from opir_core.live.change_validation import plan_of_lap
from opir_core.planning.plan import Plan
from opir_core.plugin.host import Host
from opir_core.scene.scene import Scene
from opir_core.simulation.engine import Engine


@frozen(eq=False)
class Shift:
    """How far a lap's windows are moved on: in time, and in the numbers of tracks."""

    time_ns: int = 0
    tracks: int = 0

    def shifted(self, window: Window) -> Window:
        """Return a window of a lap as one of the whole run."""
        if not self.time_ns:
            return window
        found, moved_s = window.detections, self.time_ns * 1e-9
        track: IntArray = np.where(found.track >= 0, found.track + self.tracks, found.track)
        return evolve(
            window,
            start_s=window.start_s + moved_s,
            end_s=window.end_s + moved_s,
            detections=evolve(found, time_ns=found.time_ns + self.time_ns, track=track).freeze(),
            tracks=self._tracks(window.tracks, moved_s),
            estimates=self._tracks(window.estimates, moved_s),
        )

    def _tracks(self, tracks: Tracks, moved_s: float) -> Tracks:
        return evolve(
            tracks,
            tick_s=tracks.tick_s + moved_s,
            track=tracks.track + self.tracks,
            launch=_later(tracks.launch, moved_s),
            impact=_later(tracks.impact, moved_s),
            burnout=_later(tracks.burnout, moved_s),
        )


def _later(event: FloatArray, moved_s: float) -> FloatArray:
    """Return events, whose last column is their time, moved on."""
    moved = event.copy()
    moved[:, -1] += moved_s
    return moved


@frozen(eq=False)
class Place:
    """Where a run is: the engine at work, its lap, and how far that lap's windows are moved on."""

    engine: Engine
    lap: int
    shift: Shift

    @property
    def time_ns(self) -> int:
        """Scene time, all laps, up to which the engine has come."""
        return self.engine.time_ns + self.shift.time_ns


class Laps:
    """Plans of the laps to come: the next is made in a thread of its own while one runs."""

    def __init__(self, base: Scene, host: Host, lap_ns: int) -> None:
        if lap_ns % 1000:
            raise SceneError([Problem("duration_s", "a scene that runs in a loop lasts whole microseconds")])
        self.lap_ns = lap_ns
        self._base = base
        self._host = host
        self._next: tuple[int, Future[Plan]] | None = None

    def prepare(self, lap: int, base: Scene | None = None) -> None:
        """Begin to make the plan of a lap; `base` is the scene from then on."""
        self._base = base or self._base
        made: Future[Plan] = Future()
        self._next = lap, made
        # A daemon: a plan in the making does not keep the process from ending.
        threading.Thread(target=self._make, args=(self._base, lap, made), name="opir-lap", daemon=True).start()

    def plan(self, lap: int) -> Plan:
        """Return the plan of a lap, as it was last prepared."""
        if self._next is None or self._next[0] != lap:
            self.prepare(lap)
        assert self._next is not None
        return self._next[1].result()

    def _make(self, base: Scene, lap: int, made: "Future[Plan]") -> None:
        try:
            made.set_result(plan_of_lap(base, self._host, lap, self.lap_ns // 1000))
        except BaseException as error:  # raised where the plan is asked for
            made.set_exception(error)


_NS = 1_000_000_000


@frozen
class Launched:
    """A launch that was taken in: its target's id, its moment of scene time, and the first cycle that may see it."""

    target_id: str
    time_s: float
    cycle: int


def timed(block: Mapping[str, Any], target_id: str, place: Place, soonest_ns: int) -> tuple[dict[str, Any], bool]:
    """Return a launch's block with an id and a time of the lap, and whether the time is ours to choose.

    A block without an id gets `target_id`, one without a time the millisecond after `soonest_ns` of the lap. Raises
    `PastError` for a time before the lap.
    """
    whole, before_ns = {"id": target_id, **block}, place.shift.time_ns
    launch = whole.get("launch")
    if not isinstance(launch, Mapping):
        return whole, False
    if launch.get("time_s") is None:
        return {**whole, "launch": {**launch, "time_s": -(-soonest_ns // 1_000_000) / 1000}}, True
    time_s = launch["time_s"]
    if isinstance(time_s, int | float) and not isinstance(time_s, bool) and before_ns:
        if time_s < before_ns / _NS:
            raise past(place.time_ns)
        whole["launch"] = {**launch, "time_s": time_s - before_ns / _NS}
    return whole, False


def past(time_ns: int) -> PastError:
    """Return the refusal of a launch that comes too late at a moment of scene time."""
    return PastError(f"launch.time_s is past: the scene's clock is at {time_ns / _NS:.3f} s; leave it out for now")
