"""`opir validate`: read a scene and compute its trajectories as `opir run` would; say what is wrong with it."""

import argparse
import sys

from opir_core.cli.scene_arguments import add_scene_arguments, plan_of, scene_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene and its settings."""
    add_scene_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read and plan the scene; a problem is raised."""
    from opir_core.plugin.host import Host

    host = Host.discover()
    plan = plan_of(arguments, scene_of(arguments, host), host)
    sensors, targets = len(plan.sensors), len(plan.targets.ids)
    sys.stdout.write(f"{arguments.scene}: good ({sensors} sensors, {targets} targets)\n")
    return 0
