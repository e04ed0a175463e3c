"""The run manifest: everything needed to repeat a run exactly, and nothing that differs between two
runs of a scene.
"""

import platform
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core._version import __version__
from opir_core.host.components import Constellation, EventEncoder
from opir_core.interfaces.records import CommandRecord
from opir_core.planning.partial_looks import stated_sensors
from opir_core.planning.plan import Plan
from opir_core.random_streams.philox import SCHEME
from opir_core.reading import scene_hash, scene_mapping
from opir_core.reading.format_versions import MANIFEST_FORMAT, RUN_FORMATS
from opir_core.scene.target_classes import TargetClass


def run_manifest(
    plan: Plan, counts: Mapping[str, Any], commands: Sequence[CommandRecord] = ()
) -> Mapping[str, Any]:
    """Return the manifest: the scene, its hash, versions, formats, files and plugins used, random streams,
    counts, and when each sensor watched its whole field of regard, after what became of commands.
    """
    end_s = plan.end_ns / 1e9
    return {
        "manifest_version": MANIFEST_FORMAT.version,
        "formats": {known.name: known.version for known in RUN_FORMATS},
        "scene_hash": scene_hash(plan.scene),
        "seed": plan.scene.seed,
        "random_numbers": SCHEME,
        "versions": {
            "opir-core": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "components": components_used(plan),
        "files": [
            file for trajectories in plan.targets.trajectories for file in trajectories.files
        ],
        "sensors": [] if plan.bias is None else plan.bias.by_sensor(plan.sensors),
        "watched_s": {
            sensor.id: [list(span) for span in sensor.spans_until_s(end_s)]
            for sensor in stated_sensors(plan.sensors, commands, end_s)
        },
        "counts": dict(counts),
        "scene": scene_mapping(plan.scene),
    }


def components_used(plan: Plan) -> list[Mapping[str, str]]:
    """Return the components of a plan by kind and name, with distribution and version."""
    names = {(choice.hook, choice.name) for choice in plan.scene.choices}
    outputs = [choice.config for choice in plan.scene.outputs if hasattr(choice.config, "encoder")]
    names |= {(EventEncoder.hook, str(config.encoder)) for config in outputs}
    fleets = {
        (Constellation.hook, sensor.constellation)
        for sensor in plan.scene.sensors
        if sensor.constellation
    }
    launched = plan.targets.class_names[: len(plan.scene.targets)]
    classes = {(TargetClass.hook, name) for name in launched}
    return [_with_provenance(plan, hook, name) for hook, name in sorted(names | fleets | classes)]


def _with_provenance(plan: Plan, hook: str, name: str) -> Mapping[str, str]:
    source = plan.host.provenance(hook, name)
    return {
        "kind": hook.removeprefix("opir_"),
        "name": name,
        "plugin": source.plugin,
        "distribution": source.distribution,
        "version": source.version,
    }
