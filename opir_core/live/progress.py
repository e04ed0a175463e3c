"""The progress of a live run: which calls do not return, and what follows for its health.

A run is unready if no cycle has ended for `unready_after_s`, or a sink has been in one call for as
long; it is stuck after `dead_after_s`. Both are measured while the call lasts.
"""

from attrs import frozen

from opir_core.host.boundary import place_of_thread


@frozen
class Progress:
    """The progress of a run: age of the last finished cycle, s, and why it is not ready (`delays`)
    or `stuck`.
    """

    cycle_age_s: float = 0.0
    delays: tuple[str, ...] = ()
    stuck: tuple[str, ...] = ()


@frozen
class RunningCall:
    """A call that has not returned: what does not happen meanwhile, its duration, s, and its
    thread.
    """

    what: str
    duration_s: float
    thread: int | None

    def __str__(self) -> str:
        """Return the call as one line, with the line of code that its thread executes."""
        place = place_of_thread(self.thread)
        return f"{self.what} for {self.duration_s:.1f} s{f': in {place}' if place else ''}"


def progress_of(
    calls: list[RunningCall], cycle_age_s: float, unready_after_s: float, dead_after_s: float
) -> Progress:
    """Return the progress that follows from the calls that have not returned."""
    slow = [call for call in calls if call.duration_s > unready_after_s]
    delays = {call: str(call) for call in slow}
    stuck = tuple(text for call, text in delays.items() if call.duration_s > dead_after_s)
    return Progress(cycle_age_s, tuple(delays.values()), stuck)
