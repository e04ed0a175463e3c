"""The watchdog of a live run: who is notified that it runs, or is stuck."""

import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from typing import Protocol

from attrs import field, frozen

from opir_core.live import Progress

#: Longest interval, s, between two checks of a run.
CHECK_S = 0.5
#: A check that comes so much too late, s, shows that the process was paused: stopped, or its machine suspended.
PAUSED_S = 2.0


@frozen
class Notifier:
    """Sends systemd's notifications (sd_notify) as single datagrams; without an address it does nothing."""

    address: str | None = None
    #: Interval, s, within which systemd expects a notification; None if it does not.
    within_s: float | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str] = os.environ) -> "Notifier":
        """Return the notifier of an environment: `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID`."""
        usec = environment.get("WATCHDOG_USEC", "")
        is_ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        within_s = int(usec) * 1e-6 if is_ours and usec.isascii() and usec.isdigit() and int(usec) > 0 else None
        return cls(environment.get("NOTIFY_SOCKET") or None, within_s)

    def send(self, message: str) -> None:
        """Send a message; a socket that cannot be reached is ignored, as the protocol requires."""
        if self.address is None:
            return
        # A leading @ stands for the zero byte of an abstract socket.
        address = f"\0{self.address[1:]}" if self.address.startswith("@") else self.address
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | getattr(socket, "SOCK_CLOEXEC", 0)) as sending:
                sending.setblocking(False)
                sending.sendto(message.encode(), address)
        except OSError:
            return


class WatchedRun(Protocol):
    """What a `Watchdog` needs of a run."""

    @property
    def state(self) -> str:
        """The state, as in `LiveStatus`."""

    def progress(self) -> Progress:
        """Return the progress; never waits."""


@frozen(eq=False)
class Watchdog:
    """A thread that checks a run: it notifies systemd while cycles end, and reports a stuck or failed run once.

    `on_stuck` is called with the reason in the watchdog's thread; None only stops the notifications. It watches its own
    beat first: after a pause of the process, a run is not called stuck before it had `dead_after_s` again.
    """

    run: WatchedRun
    on_stuck: Callable[[str], None] | None = None
    notifier: Notifier = field(factory=Notifier)
    dead_after_s: float = 30.0
    _stopping: threading.Event = field(factory=threading.Event, init=False)

    def start(self) -> None:
        """Report that the run is ready and start the thread."""
        self.notifier.send("READY=1")
        threading.Thread(target=self._work, name="opir-watchdog", daemon=True).start()

    def stop(self) -> None:
        """End the checks and notify systemd that the service stops."""
        self._stopping.set()
        self.notifier.send("STOPPING=1")

    def _work(self) -> None:
        within_s = self.notifier.within_s
        interval_s = CHECK_S if within_s is None else min(CHECK_S, within_s / 4.0)
        notified_s = -float("inf")
        beat_s, judged_from_s = time.monotonic(), -float("inf")
        while not self._stopping.wait(interval_s):
            now_s = time.monotonic()
            if now_s - beat_s > interval_s + PAUSED_S:
                judged_from_s = now_s + self.dead_after_s
            beat_s = now_s
            reason = self._reason(is_judged=now_s >= judged_from_s)
            if reason is None:
                if within_s is not None and time.monotonic() - notified_s >= within_s / 3.0:
                    notified_s = time.monotonic()
                    self.notifier.send("WATCHDOG=1")
            elif self.on_stuck is not None:
                self.notifier.send(f"STATUS={reason}")
                self.on_stuck(reason)
                return

    def _reason(self, *, is_judged: bool) -> str | None:
        """Return why the run is stuck; None if it is not. A check that fails itself counts as stuck."""
        try:
            if self.run.state == "failed":
                return "the run has failed"
            stuck = self.run.progress().stuck
        except BaseException as error:
            return f"the watchdog has failed: {type(error).__name__}: {error}"
        return "; ".join(stuck) if stuck and is_judged else None
