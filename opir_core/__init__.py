"""opir: a plugin-based simulator of overhead infrared (OPIR) missile-warning sensors.

The names below are the public door; each is imported when it is first used, so `import opir_core` costs next to
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core._version import __version__

if TYPE_CHECKING:
    from opir_core.errors import ModelError, OpirError, PluginError, Problem, SceneError, SinkError
    from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
    from opir_core.planning.plan import Plan, compile_plan
    from opir_core.plugin.host import Host
    from opir_core.scene.reading import load_scene, scene_from_mapping
    from opir_core.scene.scene import Scene
    from opir_core.simulation.engine import Engine
    from opir_core.simulation.run import Run, plan_windows, run_of_plan, simulate, windows

_HOMES = {
    "Detections": "interfaces.records",
    "Engine": "simulation.engine",
    "Host": "plugin.host",
    "ModelError": "errors",
    "OpirError": "errors",
    "Plan": "planning.plan",
    "PluginError": "errors",
    "Problem": "errors",
    "Run": "simulation.run",
    "Scene": "scene.scene",
    "SceneError": "errors",
    "SinkError": "errors",
    "Tracks": "interfaces.records",
    "Window": "interfaces.records",
    "compile_plan": "planning.plan",
    "load_scene": "scene.reading",
    "scene_from_mapping": "scene.reading",
    "DetectionTruth": "interfaces.records",
    "plan_windows": "simulation.run",
    "run_of_plan": "simulation.run",
    "simulate": "simulation.run",
    "windows": "simulation.run",
}

__all__ = [
    "DetectionTruth",
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
    "plan_windows",
    "run_of_plan",
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
