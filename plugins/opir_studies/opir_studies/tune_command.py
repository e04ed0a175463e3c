"""`opir tune`: choose accuracy settings for wanted errors, and print their cost."""

import argparse
import json
import math
import sys
from collections.abc import Mapping
from shlex import quote
from typing import Any

from opir_scoring import percent_text

from opir_core.cli import prints_on_standard_error, table
from opir_core.host import ended_if_stuck
from opir_studies.differences import MEASURES, OF_TRUTH
from opir_studies.refusals import refusal, require_positive
from opir_studies.tuning import Trial, Tuned, tune as tune_scene


def tune(arguments: argparse.Namespace) -> int:
    """Choose the settings and print them; exit code 2 where no choice is within the errors."""
    require_positive("--runs", arguments.runs, "runs")
    bounds = wanted_of(arguments)
    with prints_on_standard_error(), ended_if_stuck(arguments.dead_after):
        choice = tune_scene(
            arguments.scene, bounds, overrides=arguments.overrides, runs=arguments.runs
        )
    sys.stdout.write(
        (as_json(choice, bounds) if arguments.json else as_text(arguments.scene, choice, bounds))
        + "\n"
    )
    return 0 if choice.meets else 2


def wanted_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the errors that the command line names."""
    bounds = {}
    for words in arguments.errors:
        name, _, text = words.partition("=")
        try:
            bounds[name.strip()] = float(text)
        except ValueError:
            remedy = "write NAME=VALUE, e.g. impact_km=1"
            raise refusal("--error", f"{words!r} has no number; {remedy}") from None
    return bounds


def as_text(scene: str, choice: Tuned, bounds: Mapping[str, float]) -> str:
    """Return the choice, its errors and its cost."""
    head = ["error", "wanted", "these settings", "the scene's own", "what it is"]
    rows = [
        [
            name,
            f"{bound:g}",
            f"{choice.checked.error(name):.2g}",
            f"{choice.given.error(name):.2g}",
            MEASURES[name],
        ]
        for name, bound in bounds.items()
    ]
    chosen_s = choice.chosen.time_s
    own_s = choice.given.time_s
    exact_s = choice.exact.time_s
    command = " ".join(
        ["opir run", quote(scene), *(f"--set {quote(override)}" for override in choice.overrides)]
    )
    cost = (
        f"{chosen_s:.2f} s a run, {chosen_s / own_s:.2f} of the scene's own settings ({own_s:.2f} s),"
        f" {chosen_s / exact_s:.2f} of the most exact ({exact_s:.2f} s); processor time"
    )
    return "\n\n".join(
        [
            cost,
            table(head, rows, numbers=(1, 2, 3)),
            *_not_asked(choice, bounds),
            *_from_truth(choice),
            _levels(choice),
            command if choice.meets else "no settings are within the errors on other seeds",
        ]
    )


def _not_asked(choice: Tuned, bounds: Mapping[str, float]) -> list[str]:
    """Return the table of errors that were not asked for and are larger than with the scene's own
    settings, if any.
    """
    head = ["not asked for, and larger", "these settings", "the scene's own", "what it is"]
    rows = [
        [
            name,
            f"{choice.chosen.error(name):.2g}",
            f"{choice.given.error(name):.2g}",
            MEASURES[name],
        ]
        for name in choice.not_asked(bounds)
    ]
    return [table(head, rows, numbers=(1, 2))] if rows else []


def _from_truth(choice: Tuned) -> list[str]:
    """Return the table of errors from the truth, if the scene has estimates whose truth is known.

    The share of launches with an estimate follows where it is not all.
    """
    trials = (choice.exact, choice.chosen, choice.given)
    rows = [
        [name, *(_with_share(trial.from_truth[name], trial.estimated[name]) for trial in trials)]
        for name in OF_TRUTH
        if math.isfinite(choice.exact.from_truth[name])
    ]
    head = ["error from the truth", "most exact", "these settings", "the scene's own"]
    return [table(head, rows, numbers=(1, 2, 3))] if rows else []


def _with_share(error: float, share: float) -> str:
    return f"{error:.2g}" if share == 1.0 else f"{error:.2g} ({percent_text(share)} of launches)"


def _levels(choice: Tuned) -> str:
    """Return the table of the chosen levels."""
    rows = []
    for knob, level, own_level in zip(choice.knobs, choice.levels, choice.own_levels, strict=True):
        overrides = " ".join(knob.levels[level]) if level is not None and choice.overrides else ""
        place = "none" if level is None else f"{level + 1} of {len(knob.levels)}"
        rows.append(
            [
                knob.name,
                overrides or "as in the scene",
                place,
                "none" if own_level is None else f"{own_level + 1}",
            ]
        )
    return table(["setting", "chosen", "level, 1 is exact", "the scene's own level"], rows)


def as_json(choice: Tuned, bounds: Mapping[str, float]) -> str:
    """Return the choice as one JSON document."""
    return json.dumps(
        {
            "overrides": list(choice.overrides),
            "meets": choice.meets,
            "errors": {name: choice.checked.error(name) for name in MEASURES},
            "not_asked": choice.not_asked(bounds),
            "time_s": choice.chosen.time_s,
            "from_truth": _finite(choice.chosen.from_truth),
            "estimated": _finite(choice.chosen.estimated),
            "own_settings": _as_plain(choice.given),
            "reference": _as_plain(choice.exact),
        },
        indent=2,
    )


def _as_plain(trial: Trial) -> dict[str, Any]:
    return {
        "time_s": trial.time_s,
        "errors": dict(trial.errors),
        "from_truth": _finite(trial.from_truth),
        "estimated": _finite(trial.estimated),
    }


def _finite(errors: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in errors.items() if math.isfinite(value)}
