"""Output: windows to sinks, and the files of a run.

Each name is imported when it is first used, so that a run without files imports no encoder.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.output.delivery import RunOutcome, deliver
    from opir_core.output.events import detection_schema, schema
    from opir_core.output.pump import SinkReport
    from opir_core.output.run_files import TracksFile, TruthFile, read_tracks

_HOMES = {
    "RunOutcome": "output.delivery",
    "SinkReport": "output.pump",
    "TracksFile": "output.run_files",
    "TruthFile": "output.run_files",
    "deliver": "output.delivery",
    "detection_schema": "output.events",
    "read_tracks": "output.run_files",
    "schema": "output.events",
}

__all__ = [
    "RunOutcome",
    "SinkReport",
    "TracksFile",
    "TruthFile",
    "deliver",
    "detection_schema",
    "read_tracks",
    "schema",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.output' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
