"""`opir compare`: several trackers on the same runs of a scene."""

import argparse
import json
import sys

from opir_scoring import comparison_text, score_settings, scorecard_text

from opir_core.host import ended_if_stuck
from opir_core.notebook import progress
from opir_studies.axes import vary_argument
from opir_studies.comparison import Comparison, compared
from opir_studies.refusals import require_positive


def compare(arguments: argparse.Namespace) -> int:
    """Run the scene with every tracker and print the scores."""
    require_positive("--runs", arguments.runs, "runs")
    require_positive("--workers", arguments.workers, "processes")
    watched = ended_if_stuck(arguments.dead_after)
    with watched, progress(is_shown=sys.stderr.isatty()) as update:
        comparison = compared(
            arguments.scene,
            trackers=arguments.trackers,
            vary=dict(map(vary_argument, arguments.vary)),
            runs=arguments.runs,
            overrides=arguments.overrides,
            settings=score_settings(arguments),
            workers=arguments.workers,
            dead_after_s=arguments.dead_after,
            on_run=lambda tracker, number: update(tracker, number, arguments.runs),
        )
    text = (
        json.dumps(comparison.as_plain(), indent=2)
        if arguments.json
        else _text(comparison, arguments.details)
    )
    sys.stdout.write(text + "\n")
    return 0


def _text(comparison: Comparison, has_details: bool) -> str:
    paragraphs = [comparison_text(comparison.paired, comparison.cards)]
    paragraphs += [scorecard_text(comparison.cards)] if has_details else []
    notes = list(comparison.automatic)
    notes += [
        f"{name}: impacts by the paper's law, without containment"
        for name, card in comparison.cards.items()
        if card.figures["impact_method"] == "paper"
    ]
    return "\n\n".join([*paragraphs, *(["\n".join(notes)] if notes else [])])
