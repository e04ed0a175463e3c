"""The arguments of every command that reads a scene."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeVar

from opir_core.cli.terminal import grouped, slow_notice
from opir_core.errors import SceneError
from opir_core.host.host import Host
from opir_core.host.watchdog import DEAD_AFTER_S, STUCK
from opir_core.reading import load_scene, placed
from opir_core.scene.scene import Scene

if TYPE_CHECKING:
    from opir_core.planning.plan import Plan
    from opir_core.simulation.plan_checks import CheckedScene

Made = TypeVar("Made")


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene's path and the overrides."""
    parser.add_argument("scene", metavar="SCENE", help="a scene file (YAML)")
    parser.add_argument("--seed", metavar="N", help="random seed, instead of the scene's")
    parser.add_argument("--tracker", metavar="NAME", help="tracker, instead of the scene's")
    add_overrides(parser)


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add the overrides of a scene's values."""
    parser.add_argument(
        "--set",
        metavar="PATH=VALUE",
        action="append",
        default=[],
        dest="overrides",
        help="override one value, e.g. sensors[0].scan_period_ms=50, or sensors[*]. for every item;"
        " repeatable",
    )


def add_dead_after(
    parser: argparse.ArgumentParser, default: float | None = DEAD_AFTER_S, more: str = ""
) -> None:
    """Add the time after which the watchdog ends the command; `more` ends its help."""
    words = (
        f"end with exit code {STUCK} if one call of a component lasts S seconds (default"
        f" {DEAD_AFTER_S:g} s){more}"
    )
    parser.add_argument("--dead-after", metavar="S", type=seconds, default=default, help=words)


def seconds(text: str) -> float:
    """Return a duration in s; argparse names this function in its message about another text."""
    if not 0.0 < float(text) < float("inf"):
        raise ValueError(text)
    return float(text)


def scene_of(
    arguments: argparse.Namespace,
    host: Host,
    *,
    first: Sequence[str] = (),
    otherwise: Sequence[str] = (),
) -> Scene:
    """Return the scene that the arguments name, with their overrides.

    The overrides in `first` precede those of the user; `otherwise` applies to a scene without
    outputs.
    """
    options = [*first, *_shorthand(arguments)]
    with slow_notice(f"reading {arguments.scene}", is_shown=_is_shown(arguments)):
        scene = load_scene(arguments.scene, overrides=[*options, *arguments.overrides], host=host)
        if scene.outputs or not otherwise:
            return scene
        return load_scene(
            arguments.scene, overrides=[*otherwise, *options, *arguments.overrides], host=host
        )


def _shorthand(arguments: argparse.Namespace) -> list[str]:
    """Return the overrides that options of their own stand for."""
    values = {"seed": arguments.seed, "tracker": arguments.tracker}
    return [f"{key}={value}" for key, value in values.items() if value is not None]


def plan_of(arguments: argparse.Namespace, scene: Scene, host: Host) -> "Plan":
    """Return the scene's plan."""
    from opir_core.planning.plan import compile_plan

    return _made(arguments, scene, "planning", lambda: compile_plan(scene, host))


def check_of(arguments: argparse.Namespace, scene: Scene, host: Host) -> "CheckedScene":
    """Return the scene's check; errors are those of `plan_of`."""
    from opir_core.simulation.scene_check import check_scene

    return _made(arguments, scene, "checking", lambda: check_scene(scene, host))


def _made(
    arguments: argparse.Namespace, scene: Scene, doing: str, make: Callable[[], Made]
) -> Made:
    """Return the result of `make`, a step that may be slow; its errors name the scene's file."""
    size = f"{grouped(len(scene.sensors))} sensors and {grouped(len(scene.targets))} targets"
    try:
        with slow_notice(f"{doing} {arguments.scene} ({size})", is_shown=_is_shown(arguments)):
            return make()
    except SceneError as error:
        overrides = [*_shorthand(arguments), *arguments.overrides]
        raise SceneError(
            placed(error.problems, arguments.scene, overrides), source=arguments.scene
        ) from error


def _is_shown(arguments: argparse.Namespace) -> bool:
    """Return whether the progress of a command is shown: on a terminal, and not with `--quiet`."""
    return sys.stderr.isatty() and not getattr(arguments, "quiet", False)
