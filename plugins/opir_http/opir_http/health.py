"""The health of a service: one judgement, in the same words in the status, readiness, metrics and
the log.
"""

import re
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

from opir_core.host import warn
from opir_core.output import SinkStatus
from opir_http.answers import Health

#: Minimum interval, s, between two checks of the backlogs of sinks, and of the log.
LOOK_S = 1.0


class SinkBacklog(NamedTuple):
    """Events and windows that wait in an output, events that have left it so far, the time of the
    last check, and how often more waited.
    """

    waiting: int
    gone: int
    checked_s: float
    rises: int


class Backlogs:
    """The backlogs of the outputs at the last checks."""

    def __init__(self) -> None:
        self._backlogs: dict[str, SinkBacklog] = {}

    def reason(self, sink: SinkStatus) -> str:
        """Return why an output is not ready, or ""."""
        attempts = f" (failed attempts: {sink.attempts})" if sink.attempts else ""
        if sink.state == "failed":
            return f"the sink {sink.path} has failed: {sink.error}"
        if sink.state == "parked":
            return f"the sink {sink.path} is refused and keeps its events: {sink.error}{attempts}"
        if sink.state == "open" and sink.error:
            return f"the sink {sink.path} delivers nothing: {sink.error}{attempts}"
        words = (
            f"the backlog of the sink {sink.path} grows: it takes fewer events than the run makes"
        )
        return words if self._grows(sink) else ""

    def _grows(self, sink: SinkStatus) -> bool:
        """Whether a backlog has grown at the last checks, without shrinking between them.

        What is as little as the output took since the last check is on its way: no backlog.
        """
        gone = sink.delivered + sink.dropped + sink.withheld
        waiting = lag(sink) + sink.queued_windows
        time_s = time.monotonic()
        backlog = self._backlogs.setdefault(sink.path, SinkBacklog(waiting, gone, time_s, 0))
        if time_s - backlog.checked_s >= LOOK_S:
            is_less = waiting <= gone - backlog.gone or waiting < backlog.waiting
            rises = 0 if is_less else backlog.rises + (waiting > backlog.waiting)
            backlog = SinkBacklog(waiting, gone, time_s, rises)
            self._backlogs[sink.path] = backlog
        return backlog.rises >= 3


def lag(sink: SinkStatus) -> int:
    """Return the number of events of a sink, of this and earlier runs, that are still on their
    way.
    """
    return max(0, sink.given + sink.recovered - sink.delivered - sink.dropped - sink.withheld)


#: The reason of a run that was stopped: the log is over then, for a run reports its own end.
STOPPED = "the run has stopped"
#: The figures of a reason, which change; not the number in a path like outputs[0].
_FIGURES = re.compile(r" \(failed attempts: \d+\)|(?<![\[\d.])\d[\d.]*")


def log_health(health: Callable[[], Health], stopping: threading.Event) -> None:
    """Log why a service is not ready, once for each reason, and that it is ready again, in a thread
    of its own.
    """

    def look() -> None:
        logged: set[str] = set()
        while not stopping.wait(LOOK_S) and STOPPED not in (causes := health().reasons):
            reasons = {_FIGURES.sub("", cause): cause for cause in causes}
            for kind, reason in reasons.items():
                if kind not in logged:
                    warn(f"not ready: {reason}")
            if logged and not reasons:
                warn("ready again")
            logged = set(reasons)

    threading.Thread(target=look, name="opir-health", daemon=True).start()
