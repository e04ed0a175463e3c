"""The check of a scene: all that a plan is refused for and warned about, without its lines of sight.

The looks of a run have a bound that needs no visibility. Only above the limits, and for launches that meet scan
instants, visibility is computed, in blocks that are not kept.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.arrays import BoolArray
from opir_core.host.boundary import PluginErrors
from opir_core.host.host import Host
from opir_core.planning.pair_compiler import PairCompiler
from opir_core.planning.plan import plan_parts, scan_starts
from opir_core.planning.sightlines import Pairs
from opir_core.planning.solar_exclusion import SolarExclusion, solar_exclusions
from opir_core.planning.work import Workload
from opir_core.scene.scene import Scene
from opir_core.simulation.plan_checks import CheckedScene, aligned_pairs


def check_scene(scene: Scene, host: Host | None = None) -> CheckedScene:
    """Return the check of a scene; raises what `compile_plan` raises for it."""
    host = host or Host.discover()
    with PluginErrors(host, scene):
        parts = plan_parts(scene, host)
        sensors, targets, end_ns = parts["sensors"], parts["targets"], parts["end_ns"]
        most_looks = float(_compiler(parts, ()).most_looks().sum())
        if not _workload(parts, Pairs.empty()).accepts(most_looks):
            everything = np.ones((len(sensors), len(targets.ids)), dtype=np.bool_)
            _workload(parts, _pairs(parts, everything)).require_run()
        met = aligned_pairs(sensors, targets, len(scene.targets), end_ns)
        pairs = _pairs(parts, met) if met.any() else Pairs.empty()
    return CheckedScene(scene=scene, sensors=sensors, targets=targets, pairs=pairs, end_ns=end_ns)


def _workload(parts: Mapping[str, Any], pairs: Pairs) -> Workload:
    return Workload(pairs, parts["sensors"], parts["detection"], parts["end_ns"], parts["scene"].limits)


def _pairs(parts: Mapping[str, Any], is_chosen: BoolArray) -> Pairs:
    """Return the chosen pairs (sensors, targets) with their looks."""
    scene: Scene = parts["scene"]
    return _compiler(parts, solar_exclusions(parts["sensors"], scene.epoch_us, scene.duration_s)).pairs(is_chosen)


def _compiler(parts: Mapping[str, Any], exclusions: Sequence[SolarExclusion | None]) -> PairCompiler:
    scene, sensors = parts["scene"], parts["sensors"]
    starts = scan_starts(scene.seed, sensors)
    return PairCompiler(sensors, parts["targets"], starts, scene.light_time, parts["end_ns"], exclusions)
