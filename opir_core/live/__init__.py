"""Live runs: a scene paced by the clock in its own thread, with launches and changed settings between two windows.

Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.live.running import LiveRun, LiveSettings, LiveStatus, LiveWindow

_HOMES = {
    "LiveRun": "live.running",
    "LiveSettings": "live.running",
    "LiveStatus": "live.running",
    "LiveWindow": "live.running",
}

__all__ = [
    "LiveRun",
    "LiveSettings",
    "LiveStatus",
    "LiveWindow",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.live' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
