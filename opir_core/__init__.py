"""opir: a plugin-based simulator of overhead infrared (OPIR) missile-warning sensors.

The names below are the public door; each is imported when it is first used, so `import opir_core` costs next to
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core._version import __version__

if TYPE_CHECKING:
    from opir_core.engine import Engine
    from opir_core.errors import ModelError, OpirError, PluginError, Problem, SceneError, SinkError
    from opir_core.plan import Plan, compile_plan
    from opir_core.plugin.host import Host
    from opir_core.reading import load_scene, scene_from_mapping
    from opir_core.records import Detections, Run, Tracks, Window
    from opir_core.run import simulate, windows
    from opir_core.scene import Scene

_HOMES = {
    "Detections": "records",
    "Engine": "engine",
    "Host": "plugin.host",
    "ModelError": "errors",
    "OpirError": "errors",
    "Plan": "plan",
    "PluginError": "errors",
    "Problem": "errors",
    "Run": "records",
    "Scene": "scene",
    "SceneError": "errors",
    "SinkError": "errors",
    "Tracks": "records",
    "Window": "records",
    "compile_plan": "plan",
    "load_scene": "reading",
    "scene_from_mapping": "reading",
    "simulate": "run",
    "windows": "run",
}

__all__ = [
    "Detections",
    "Engine",
    "Host",
    "ModelError",
    "OpirError",
    "Plan",
    "PluginError",
    "Problem",
    "Run",
    "Scene",
    "SceneError",
    "SinkError",
    "Tracks",
    "Window",
    "__version__",
    "compile_plan",
    "load_scene",
    "scene_from_mapping",
    "simulate",
    "windows",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
