"""The pace of a live run: due times of scene times by the monotonic clock, and limits on the interpreter's pauses."""

import gc
import sys
import threading
import time

#: Interval, s, after which another thread releases the interpreter to the run; Python's default is 5 ms.
SWITCH_S = 0.001


def limit_pauses() -> None:
    """Prepare this process for a live run; call it between construction and start of the run.

    All objects alive now live as long as the run. They are excluded from garbage collection, which would otherwise
    traverse them every 15 s, for about 20 ms.
    """
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)


#: Scene time of a cycle of an unpaced run, ns.
UNPACED_STEP_NS = 1_000_000_000

#: Maximum number of cycles that a late run processes as one.
_CATCHING_UP = 20


class Pace:
    """Scene time against the monotonic clock, which is independent of changes of the wall clock.

    `speed` is scene time per real time, None for unpaced; `cycle_ns` the real time of a cycle.
    """

    def __init__(self, speed: float | None, cycle_ns: int) -> None:
        self.speed = speed
        self._step_ns = UNPACED_STEP_NS if speed is None else max(1, round(cycle_ns * speed))
        self._start_ns = time.monotonic_ns()

    def start(self) -> None:
        """Make scene time 0 due now."""
        self._start_ns = time.monotonic_ns()

    def step_ns(self, scene_ns: int) -> int:
        """Return the scene time of the next cycle, ns: several cycles' if the run is late."""
        late_ns = self.late_ns(scene_ns)
        if self.speed is None or late_ns <= 0:
            return self._step_ns
        owed = int(late_ns * self.speed) // self._step_ns
        return self._step_ns * max(1, min(owed, _CATCHING_UP))

    def late_ns(self, scene_ns: int) -> int:
        """Return the time since a scene time was due, ns; negative before it is due; 0 if unpaced."""
        if self.speed is None:
            return 0
        return time.monotonic_ns() - self._start_ns - int(scene_ns / self.speed)

    def wait(self, scene_ns: int, stopping: threading.Event) -> bool:
        """Wait until a scene time is due; return whether to continue: False if `stopping` is set."""
        ahead_ns = -self.late_ns(scene_ns)
        if ahead_ns > 0:
            return not stopping.wait(ahead_ns * 1e-9)
        return not stopping.is_set()
