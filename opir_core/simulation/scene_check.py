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
        parts = plan_parts(scene, host)
        most_looks = float(parts.pair_compiler(()).most_looks().sum())
        if not parts.work_of(Pairs.empty()).accepts(most_looks):
            everything = np.ones((len(parts.sensors), len(parts.targets.ids)), dtype=np.bool_)
            parts.work_of(_pairs(parts, everything)).require_run()
        met = aligned_pairs(parts.sensors, parts.targets, len(scene.targets), parts.end_ns)
        pairs = _pairs(parts, met) if met.any() else Pairs.empty()
    return CheckedScene(**asdict(parts, recurse=False), pairs=pairs)


def _pairs(parts: PlanParts, is_chosen: BoolArray) -> Pairs:
    """Return the chosen pairs (sensors, targets) with their looks."""
    return parts.pair_compiler(parts.solar_exclusions()).pairs(is_chosen)
