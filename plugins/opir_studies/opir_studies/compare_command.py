"""`opir compare`: several trackers on the same runs of a scene."""

import argparse
import json
import sys

from opir_scoring import comparison_text, score_settings, scorecard_text

from opir_core.cli import progress
from opir_core.errors import Problem, SceneError
from opir_core.host import ended_if_stuck
from opir_studies.comparison import Comparison, compared

_HERE = "command line"


def compare(arguments: argparse.Namespace) -> int:
    """Run the scene with every tracker and print the scores."""
    if arguments.runs < 1:
        raise SceneError(
            [Problem("--runs", f"{arguments.runs} is not a number of runs; give 1 or more")],
            source=_HERE,
        )
    if arguments.workers < 1:
        problem = f"{arguments.workers} is not a number of processes; give 1 or more"
        raise SceneError([Problem("--workers", problem)], source=_HERE)
    watched = ended_if_stuck(arguments.dead_after)
    with watched, progress(arguments.runs, is_shown=sys.stderr.isatty()) as on_run:
        found = compared(
            arguments.scene,
            trackers=arguments.trackers,
            runs=arguments.runs,
            overrides=arguments.overrides,
            settings=score_settings(arguments),
            workers=arguments.workers,
            dead_after_s=arguments.dead_after,
            on_run=on_run,
        )
    text = (
        json.dumps(found.as_plain(), indent=2)
        if arguments.json
        else _text(found, arguments.details)
    )
    sys.stdout.write(text + "\n")
    return 0


def _text(found: Comparison, has_details: bool) -> str:
    parts = [comparison_text(found.paired, found.cards)]
    parts += [scorecard_text(found.cards)] if has_details else []
    notes = list(found.automatic)
    notes += [
        f"{name}: impacts by the paper's law, without containment"
        for name, card in found.cards.items()
        if card.figures["impact_method"] == "paper"
    ]
    return "\n\n".join([*parts, *(["\n".join(notes)] if notes else [])])
