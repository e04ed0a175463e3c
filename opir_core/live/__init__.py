"""Live runs: a scene paced by the clock in its own thread, with launches and changed settings between two windows."""

from opir_core.live.running import LiveRun, LiveSettings, LiveStatus, LiveWindow

__all__ = ["LiveRun", "LiveSettings", "LiveStatus", "LiveWindow"]
