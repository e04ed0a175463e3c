"""`opir tune`: choose accuracy settings for wanted errors, and print what they cost."""

import argparse
import json
import math
import sys
from collections.abc import Mapping
from shlex import quote
from typing import Any

from opir_scoring import percent_text

from opir_core.cli import prints_on_standard_error, table
from opir_core.errors import Problem, SceneError
from opir_core.host import ended_if_stuck
from opir_studies.differences import MEASURES, OF_TRUTH
from opir_studies.tuning import Trial, Tuned, tune as tune_scene


def tune(arguments: argparse.Namespace) -> int:
    """Choose the settings and print them; exit code 2 where no choice is within the errors."""
    if arguments.runs < 1:
        words = f"{arguments.runs} is not a number of runs; give 1 or more"
        raise SceneError([Problem("--runs", words)], source="command line")
    wanted = wanted_of(arguments)
    with prints_on_standard_error(), ended_if_stuck(arguments.dead_after):
        found = tune_scene(
            arguments.scene, wanted, overrides=arguments.overrides, runs=arguments.runs
        )
    sys.stdout.write(
        (as_json(found, wanted) if arguments.json else as_text(arguments.scene, found, wanted))
        + "\n"
    )
    return 0 if found.meets else 2


def wanted_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the errors that the command line names."""
    wanted = {}
    for words in arguments.errors:
        name, _, text = words.partition("=")
        try:
            wanted[name.strip()] = float(text)
        except ValueError:
            problem = Problem(
                "--error", f"{words!r} has no number; write NAME=VALUE, e.g. impact_km=1"
            )
            raise SceneError([problem], source="command line") from None
    return wanted


def as_text(scene: str, found: Tuned, wanted: Mapping[str, float]) -> str:
    """Return the choice, its errors and its cost."""
    head = ["error", "wanted", "these settings", "the scene's own", "what it is"]
    rows = [
        [
            name,
            f"{bound:g}",
            f"{found.checked.error(name):.2g}",
            f"{found.given.error(name):.2g}",
            MEASURES[name],
        ]
        for name, bound in wanted.items()
    ]
    chosen = found.chosen.time_s
    given = found.given.time_s
    exact = found.exact.time_s
    command = " ".join(
        ["opir run", quote(scene), *(f"--set {quote(each)}" for each in found.overrides)]
    )
    cost = (
        f"{chosen:.2f} s a run, {chosen / given:.2f} of the scene's own settings ({given:.2f} s),"
        f" {chosen / exact:.2f} of the most exact ({exact:.2f} s); processor time"
    )
    return "\n\n".join(
        [
            cost,
            table(head, rows, numbers=(1, 2, 3)),
            *_not_asked(found, wanted),
            *_from_truth(found),
            _levels(found),
            command if found.meets else "no settings are within the errors on other seeds",
        ]
    )


def _not_asked(found: Tuned, wanted: Mapping[str, float]) -> list[str]:
    """Return the table of errors that were not asked for and are larger than with the scene's own
    settings, if any.
    """
    head = ["not asked for, and larger", "these settings", "the scene's own", "what it is"]
    rows = [
        [name, f"{found.chosen.error(name):.2g}", f"{found.given.error(name):.2g}", MEASURES[name]]
        for name in found.not_asked(wanted)
    ]
    return [table(head, rows, numbers=(1, 2))] if rows else []


def _from_truth(found: Tuned) -> list[str]:
    """Return the table of errors from the truth, if the scene has estimates whose truth is known.

    The share of launches with an estimate follows where it is not all.
    """
    trials = (found.exact, found.chosen, found.given)
    rows = [
        [name, *(_with_share(each.from_truth[name], each.estimated[name]) for each in trials)]
        for name in OF_TRUTH
        if math.isfinite(found.exact.from_truth[name])
    ]
    head = ["error from the truth", "most exact", "these settings", "the scene's own"]
    return [table(head, rows, numbers=(1, 2, 3))] if rows else []


def _with_share(error: float, share: float) -> str:
    return f"{error:.2g}" if share == 1.0 else f"{error:.2g} ({percent_text(share)} of launches)"


def _levels(found: Tuned) -> str:
    """Return the table of the chosen levels."""
    rows = []
    for knob, level, own in zip(found.knobs, found.levels, found.own_levels, strict=True):
        chosen = " ".join(knob.levels[level]) if level is not None and found.overrides else ""
        place = "none" if level is None else f"{level + 1} of {len(knob.levels)}"
        rows.append(
            [knob.name, chosen or "as in the scene", place, "none" if own is None else f"{own + 1}"]
        )
    return table(["setting", "chosen", "level, 1 is exact", "the scene's own level"], rows)


def as_json(found: Tuned, wanted: Mapping[str, float]) -> str:
    """Return the choice as one JSON document."""
    return json.dumps(
        {
            "overrides": list(found.overrides),
            "meets": found.meets,
            "errors": {name: found.checked.error(name) for name in MEASURES},
            "not_asked": found.not_asked(wanted),
            "time_s": found.chosen.time_s,
            "from_truth": _finite(found.chosen.from_truth),
            "estimated": _finite(found.chosen.estimated),
            "own_settings": _as_plain(found.given),
            "reference": _as_plain(found.exact),
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
