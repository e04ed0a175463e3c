"""The health of a service: one judgement, in the same words in the status, readiness, metrics and
the log.
"""

import re
import threading
import time
from collections.abc import Callable, Sequence

from attrs import frozen

from opir_core.host import Watchdog, warn
from opir_core.output import SinkStatus

_RISES = 3
#: Minimum interval, s, between two checks of the backlogs of sinks, and between two looks of the
#: log.
LOOK_S = 1.0


@frozen
class Health:
    """Whether a service is ready and alive, and the reasons if not; how long its last cycle is ago,
    s; its pauses.

    A pause is a time in which the whole process did not run.
    """

    ready: bool
    alive: bool
    reasons: tuple[str, ...]
    stuck: tuple[str, ...]
    beat_age_s: float
    pauses: int
    longest_pause_s: float

    @classmethod
    def of(
        cls,
        reasons: Sequence[str],
        stuck: Sequence[str],
        beat_age_s: float,
        watchdog: Watchdog | None,
    ) -> "Health":
        """Return the health for some reasons; without a watchdog no pauses are known."""
        return cls(
            ready=not reasons,
            alive=not stuck,
            reasons=tuple(reasons),
            stuck=tuple(stuck),
            beat_age_s=round(beat_age_s, 6),
            pauses=0 if watchdog is None else watchdog.pauses,
            longest_pause_s=0.0 if watchdog is None else round(watchdog.longest_pause_s, 3),
        )


class Backlogs:
    """What waits in the outputs, as it was at the last looks."""

    def __init__(self) -> None:
        self._waiting: dict[str, tuple[int, float, int]] = {}

    def reason(self, sink: SinkStatus) -> str:
        """Return why an output is not ready, or ""."""
        tried = f" (failed attempts: {sink.attempts})" if sink.attempts else ""
        if sink.state == "failed":
            return f"the sink {sink.path} has failed: {sink.error}"
        if sink.state == "parked":
            return f"the sink {sink.path} is refused and keeps its events: {sink.error}{tried}"
        if sink.state == "open" and sink.error:
            return f"the sink {sink.path} delivers nothing: {sink.error}{tried}"
        return f"the backlog of the sink {sink.path} grows" if self._grows(sink) else ""

    def _grows(self, sink: SinkStatus) -> bool:
        """Return whether a backlog has grown at the last looks, without shrinking between them."""
        waiting = sink.spooled + sink.queued_windows
        now_s = time.monotonic()
        before, looked_s, rises = self._waiting.get(sink.path, (waiting, now_s, 0))
        if now_s - looked_s >= LOOK_S:
            rises = 0 if waiting == 0 or waiting < before else rises + (waiting > before)
            self._waiting[sink.path] = waiting, now_s, rises
        else:
            self._waiting.setdefault(sink.path, (before, looked_s, rises))
        return rises >= _RISES


#: The reason of a run that was stopped: the log is over then, for a run reports its own end.
STOPPED = "the run has stopped"
#: What changes in a reason that stays: its figures, but not the number in a path like outputs[0].
_FIGURES = re.compile(r" \(failed attempts: \d+\)|(?<![\[\d.])\d[\d.]*")


def log_health(health: Callable[[], Health], stopping: threading.Event) -> None:
    """Log why a service is not ready, once for each reason, and that it is ready again, in a thread
    of its own.
    """

    def look() -> None:
        known: set[str] = set()
        while not stopping.wait(LOOK_S) and STOPPED not in (found := health().reasons):
            reasons = {_FIGURES.sub("", reason): reason for reason in found}
            for kind, reason in reasons.items():
                if kind not in known:
                    warn(f"not ready: {reason}")
            if known and not reasons:
                warn("ready again")
            known = set(reasons)

    threading.Thread(target=look, name="opir-health", daemon=True).start()
