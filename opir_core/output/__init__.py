"""Output: windows to sinks, and the files of a run.

Each name is imported when it is first used, so that a run without files imports no encoder.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.output.delivery import RunOutcome, deliver
    from opir_core.output.events import detection_schema, schema
    from opir_core.output.pump import SinkReport
    from opir_core.output.run_files import TruthFile
    from opir_core.output.tracks_file import TracksFile, read_tracks

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "output.delivery": "RunOutcome deliver",
    "output.events": "detection_schema schema",
    "output.pump": "SinkReport",
    "output.run_files": "TruthFile",
    "output.tracks_file": "TracksFile read_tracks",
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
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.output' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
