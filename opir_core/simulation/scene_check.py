"""The check of a scene: all that a plan is refused for and warned about, without its lines of
sight.

The looks of a run have a bound that needs no visibility. Only above the limits, and for launches
that meet scan instants, visibility is computed, in blocks that are not kept.
"""

import numpy as np
from attrs import asdict

from opir_core.arrays import BoolArray
from opir_core.host.boundary import PluginErrors
from opir_core.host.host import Host
from opir_core.planning.plan import PlanParts, plan_parts
from opir_core.planning.sightlines import Pairs
from opir_core.scene.scene import Scene
from opir_core.simulation.plan_checks import CheckedScene, aligned_pairs


def check_scene(scene: Scene, host: Host | None = None) -> CheckedScene:
    """Return the check of a scene; raises what `compile_plan` raises for it."""
    host = host or Host.discover()
    with PluginErrors(host, scene):
        scene_parts = plan_parts(scene, host)
        most_looks = float(scene_parts.pair_compiler(()).most_looks().sum())
        if not scene_parts.work_of(Pairs.empty()).accepts(most_looks):
            everything = np.ones(
                (len(scene_parts.sensors), len(scene_parts.targets.ids)), dtype=np.bool_
            )
            scene_parts.work_of(_pairs(scene_parts, everything)).require_run()
        met = aligned_pairs(
            scene_parts.sensors, scene_parts.targets, len(scene.targets), scene_parts.end_ns
        )
        pairs = _pairs(scene_parts, met) if met.any() else Pairs.empty()
    return CheckedScene(**asdict(scene_parts, recurse=False), pairs=pairs)


def _pairs(scene_parts: PlanParts, is_chosen: BoolArray) -> Pairs:
    """Return the chosen pairs (sensors, targets) with their looks."""
    return scene_parts.pair_compiler(scene_parts.solar_exclusions()).pairs(is_chosen)
