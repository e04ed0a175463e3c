"""`opir explain`: what a scene will compute, what it skips, and why."""

import argparse
import json
import sys
from collections.abc import Mapping
from typing import Any

from opir_core.cli.scene_arguments import add_scene_arguments, plan_of, scene_of
from opir_core.cli.summary_text import counted, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, its settings and the form of the answer."""
    add_scene_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Compile the scene's plan and tell it."""
    from opir_core.plugin.host import Host
    from opir_core.simulation.explanation import explained

    host = Host.discover()
    told = explained(plan_of(arguments, scene_of(arguments, host), host))
    sys.stdout.write((json.dumps(told, indent=2) if arguments.json else _as_text(told)) + "\n")
    return 0


def _as_text(told: Mapping[str, Any]) -> str:
    components = [(row["kind"], row["name"], f"{row['distribution']} {row['version']}") for row in told["components"]]
    pairs = [_pair_cells(row) for row in told["pairs"]]
    skipped = [(row["sensor_id"], row["target_id"], row["reason"]) for row in told["skipped"]]
    parts = [
        f"{told['scene']}: {counted(told['looks'])} looks of {len(pairs)} pairs; forces {', '.join(told['forces'])}",
        table(("kind", "name", "from"), components),
        table(("sensor", "target", "looks", "from s", "to s", "visible", "P_d"), pairs, numbers=(2, 3, 4, 6)),
    ]
    if skipped:
        parts.append(table(("sensor", "target", "skipped because"), skipped))
    if told["noise"]:
        noise = [(row["sensor_id"], f"{row['per_scan']:.3g}", f"{row['per_hour']:.3g}") for row in told["noise"]]
        parts.append(table(("sensor", "detections of noise alone: a scan", "an hour"), noise, numbers=(1, 2)))
    return "\n\n".join([*parts, "\n".join(f"not computed: {line}" for line in told["not_computed"])])


def _pair_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    probability = row["probability"]
    return (
        row["sensor_id"],
        row["target_id"],
        counted(row["looks"]),
        f"{row['first_look_s']:.3f}",
        f"{row['last_look_s']:.3f}",
        row["visible"],
        "varies" if probability is None else f"{probability:g}",
    )
