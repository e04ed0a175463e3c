"""Live runs: a scene paced by the clock in its own thread, with launches and changed settings between two windows.

Each name is imported when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.live.running import LiveRun, LiveSettings, LiveStatus, LiveWindow

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "live.running": "LiveRun LiveSettings LiveStatus LiveWindow",
}

__all__ = [
    "LiveRun",
    "LiveSettings",
    "LiveStatus",
    "LiveWindow",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.live' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
