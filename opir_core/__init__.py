"""opir: a plugin-based simulator of overhead infrared (OPIR) missile-warning sensors.

The names below are the public door; each is imported when it is first used, so `import opir_core` costs next to
nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core._version import __version__

if TYPE_CHECKING:
    from opir_core.errors import ModelError, OpirError, PluginError, Problem, SceneError, SinkError
    from opir_core.host.host import Host
    from opir_core.interfaces.impact_regions import ImpactRegion
    from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
    from opir_core.output.saved_runs import load_run
    from opir_core.planning.plan import Plan, compile_plan
    from opir_core.reading import load_scene, scene_from_mapping
    from opir_core.scene.scene import Scene
    from opir_core.simulation.engine import Engine
    from opir_core.simulation.run import Run, plan_windows, run_of_plan, simulate, windows

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "errors": "ModelError OpirError PluginError Problem SceneError SinkError",
    "interfaces.impact_regions": "ImpactRegion",
    "interfaces.records": "DetectionTruth Detections Tracks Window",
    "output.saved_runs": "load_run",
    "planning.plan": "Plan compile_plan",
    "host.host": "Host",
    "reading": "load_scene scene_from_mapping",
    "scene.scene": "Scene",
    "simulation.engine": "Engine",
    "simulation.run": "Run plan_windows run_of_plan simulate windows",
}

__all__ = [
    "DetectionTruth",
    "Detections",
    "Engine",
    "Host",
    "ImpactRegion",
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
    "load_run",
    "load_scene",
    "plan_windows",
    "run_of_plan",
    "scene_from_mapping",
    "simulate",
    "windows",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
