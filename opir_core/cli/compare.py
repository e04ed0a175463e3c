"""`opir compare`: run a scene with several trackers, many times, and judge them side by side."""

import argparse
import json
import sys

from opir_core.cli.scene_arguments import add_overrides
from opir_core.cli.score import add_settings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scene, the trackers, the number of runs, and the form of the answer."""
    parser.add_argument("scene", metavar="SCENE", help="a scene file (YAML)")
    parser.add_argument(
        "--tracker",
        metavar="NAME",
        action="append",
        dest="trackers",
        help="a tracker to judge, a name or a YAML block; given again for each (default: the scene's)",
    )
    parser.add_argument(
        "--runs", metavar="N", type=int, default=20, help="runs of each, with seeds from the scene's on"
    )
    parser.add_argument(
        "--workers", metavar="N", type=int, default=1, help="processes that run at once, beside which times are longer"
    )
    add_overrides(parser)
    add_settings(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run and judge every tracker."""
    from opir_core.cli.progress import run_progress
    from opir_core.cli.scorecard_text import as_text, settings_of
    from opir_core.errors import Problem, SceneError
    from opir_core.scoring.comparison import compared

    if arguments.runs < 1:
        complaint = f"{arguments.runs} is not a number of runs; give 1 or more"
        raise SceneError([Problem("--runs", complaint)], source="command line")
    if arguments.workers < 1:
        complaint = f"{arguments.workers} is not a number of processes; give 1 or more"
        raise SceneError([Problem("--workers", complaint)], source="command line")
    with run_progress(arguments.runs, is_shown=sys.stderr.isatty()) as on_run:
        cards = compared(
            arguments.scene,
            trackers=arguments.trackers,
            runs=arguments.runs,
            overrides=arguments.overrides,
            settings=settings_of(arguments),
            workers=arguments.workers,
            on_run=on_run,
        )
    plain = {name: card.as_plain() for name, card in cards.items()}
    sys.stdout.write((json.dumps(plain, indent=2) if arguments.json else as_text(cards)) + "\n")
    return 0
