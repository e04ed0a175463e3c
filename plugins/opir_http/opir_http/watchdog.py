"""The watchdog of a live run: who is notified that it runs, or is stuck."""

import os
import socket
import time
from collections.abc import Callable, Mapping
from typing import Protocol

from attrs import define, field, frozen

from opir_core import host
from opir_core.live import Progress


@frozen
class Notifier:
    """Sends systemd's notifications (sd_notify) as single datagrams; without an address it does
    nothing.
    """

    address: str | None = None
    #: Interval, s, within which systemd expects a notification; None if it does not.
    within_s: float | None = None

    @classmethod
    def of(cls, environment: Mapping[str, str] = os.environ) -> "Notifier":
        """Return the notifier of an environment: `NOTIFY_SOCKET`, `WATCHDOG_USEC` and
        `WATCHDOG_PID`.
        """
        usec = environment.get("WATCHDOG_USEC", "")
        is_ours = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        within_s = (
            int(usec) * 1e-6
            if is_ours and usec.isascii() and usec.isdigit() and int(usec) > 0
            else None
        )
        return cls(environment.get("NOTIFY_SOCKET") or None, within_s)

    def send(self, message: str) -> None:
        """Send a message; a socket that cannot be reached is ignored, as the protocol requires."""
        if self.address is None:
            return
        # A leading @ stands for the zero byte of an abstract socket.
        address = f"\0{self.address[1:]}" if self.address.startswith("@") else self.address
        try:
            with socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | getattr(socket, "SOCK_CLOEXEC", 0)
            ) as sending:
                sending.setblocking(False)
                sending.sendto(message.encode(), address)
        except OSError:
            return


class WatchedRun(Protocol):
    """What a `RunWatchdog` needs of a run."""

    @property
    def state(self) -> str:
        """The state, as in `LiveStatus`."""

    def progress(self) -> Progress:
        """Return the progress; never waits."""


@define(eq=False)
class RunWatchdog:
    """A thread that checks a run: it notifies systemd while cycles end, and reports a stuck or
    failed run once.

    `on_stuck` is called with the reason in the watchdog's thread; None only stops the
    notifications. It watches its own beat first: after a pause of the process, a run is not called
    stuck before it had `dead_after_s` again.
    """

    run: WatchedRun
    on_stuck: Callable[[str], None] | None = None
    notifier: Notifier = field(factory=Notifier)
    dead_after_s: float = 30.0
    #: The thread: it knows the pauses of the process too.
    thread: host.Watchdog = field(init=False)
    _notified_s: float = field(default=-float("inf"), init=False)

    def __attrs_post_init__(self) -> None:
        within_s = self.notifier.within_s
        self.thread = host.Watchdog(
            reason=self._stuck,
            on_stuck=self._report if self.on_stuck else None,
            dead_after_s=self.dead_after_s,
            on_well=self._notify,
            final=lambda: "the run has failed" if self.run.state == "failed" else "",
            interval_s=host.CHECK_S if within_s is None else min(host.CHECK_S, within_s / 4.0),
        )

    def start(self) -> None:
        """Report that the run is ready and start the thread."""
        self.notifier.send("READY=1")
        self.thread.start()

    def stop(self) -> None:
        """End the checks and notify systemd that the service stops."""
        self.thread.stop()
        self.notifier.send("STOPPING=1")

    def _stuck(self) -> str:
        return "; ".join(self.run.progress().stuck)

    def _report(self, reason: str) -> None:
        self.notifier.send(f"STATUS={reason}")
        if self.on_stuck is not None:
            self.on_stuck(reason)

    def _notify(self) -> None:
        within_s = self.notifier.within_s
        if within_s is not None and time.monotonic() - self._notified_s >= within_s / 3.0:
            self._notified_s = time.monotonic()
            self.notifier.send("WATCHDOG=1")
