"""When, by the machine's steady clock, a moment of scene time is due.

A process that keeps a live run's pace: what the interpreter does of its own accord holds up no cycle for long.
"""

import gc
import sys
import threading
import time

#: How long a thread keeps the interpreter from the run's, s. By default it is 5 ms, each time.
SWITCH_S = 0.001


def steady_process() -> None:
    """Prepare this process for a live run, once the run is made and before it starts.

    What is alive by now lives as long as the run: it is taken out of the garbage collector's sight, which would
    otherwise go through all of it every quarter of a minute, some 20 ms each time.
    """
    gc.collect()
    gc.freeze()
    sys.setswitchinterval(SWITCH_S)


#: Scene time that one cycle takes in where no clock paces the run, ns.
UNPACED_STEP_NS = 1_000_000_000

#: The most cycles that are worked through as one to catch up.
_CATCHING_UP = 20


class Pace:
    """Scene time against the steady clock, which no change of the wall clock moves.

    `speed` is scene time per real time, None for as fast as it goes; `cycle_ns` the real time of a cycle.
    """

    def __init__(self, speed: float | None, cycle_ns: int) -> None:
        self.speed = speed
        self._step_ns = UNPACED_STEP_NS if speed is None else max(1, round(cycle_ns * speed))
        self._start_ns = time.monotonic_ns()

    def start(self) -> None:
        """Make scene time 0 due at this moment."""
        self._start_ns = time.monotonic_ns()

    def step_ns(self, scene_ns: int) -> int:
        """Return the scene time that the next cycle takes in: more than one cycle's where the run is behind."""
        behind_ns = self.late_ns(scene_ns)
        if self.speed is None or behind_ns <= 0:
            return self._step_ns
        owed = int(behind_ns * self.speed) // self._step_ns
        return self._step_ns * max(1, min(owed, _CATCHING_UP))

    def late_ns(self, scene_ns: int) -> int:
        """Return how long ago a moment of scene time was due, ns; below 0 if it is still to come; 0 unpaced."""
        if self.speed is None:
            return 0
        return time.monotonic_ns() - self._start_ns - int(scene_ns / self.speed)

    def wait(self, scene_ns: int, stopping: threading.Event) -> bool:
        """Wait until a moment of scene time is due; return whether to go on, which is not when `stopping` is set."""
        ahead_ns = -self.late_ns(scene_ns)
        if ahead_ns > 0:
            return not stopping.wait(ahead_ns * 1e-9)
        return not stopping.is_set()
