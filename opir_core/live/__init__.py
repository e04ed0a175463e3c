"""Live runs: a scene paced by the clock in its own thread, with launches and changed settings between two windows."""

from opir_core.live.running import LiveRun, LiveSettings, LiveWindow
from opir_core.live.status import LiveStatus
from opir_core.live.watchdog import Notifier, Progress, Watchdog

__all__ = ["LiveRun", "LiveSettings", "LiveStatus", "LiveWindow", "Notifier", "Progress", "Watchdog"]
