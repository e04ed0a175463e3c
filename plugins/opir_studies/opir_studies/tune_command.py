"""`opir tune`: choose accuracy settings for wanted errors, and print what they cost."""

import argparse
import json
import sys
from collections.abc import Mapping
from shlex import quote

from opir_core.cli import prints_on_standard_error, table
from opir_core.errors import Problem, SceneError
from opir_core.host import ended_if_stuck
from opir_studies.differences import MEASURES
from opir_studies.tuning import Tuned, tune as tune_scene


def tune(arguments: argparse.Namespace) -> int:
    """Choose the settings and print them; exit code 2 where no choice is within the errors."""
    if arguments.runs < 1:
        words = f"{arguments.runs} is not a number of runs; give 1 or more"
        raise SceneError([Problem("--runs", words)], source="command line")
    wanted = wanted_of(arguments)
    with prints_on_standard_error(), ended_if_stuck(arguments.dead_after):
        found = tune_scene(arguments.scene, wanted, overrides=arguments.overrides, runs=arguments.runs)
    sys.stdout.write((as_json(found) if arguments.json else as_text(arguments.scene, found, wanted)) + "\n")
    return 0 if found.meets else 2


def wanted_of(arguments: argparse.Namespace) -> dict[str, float]:
    """Return the errors that the command line names."""
    wanted = {}
    for words in arguments.errors:
        name, _, text = words.partition("=")
        try:
            wanted[name.strip()] = float(text)
        except ValueError:
            problem = Problem("--error", f"{words!r} has no number; write NAME=VALUE, e.g. impact_km=1")
            raise SceneError([problem], source="command line") from None
    return wanted


def as_text(scene: str, found: Tuned, wanted: Mapping[str, float]) -> str:
    """Return the choice, its errors and its cost."""
    head = ["error", "wanted", "these settings", "the scene's own", "what it is"]
    rows = [
        [name, f"{bound:g}", f"{found.checked[name]:.2g}", f"{found.given.errors[name]:.2g}", MEASURES[name]]
        for name, bound in wanted.items()
    ]
    chosen, given = found.chosen.time_s, found.given.time_s
    levels = [
        [knob.name, " ".join(knob.levels[level]) or "as in the scene", f"{level + 1} of {len(knob.levels)}"]
        for knob, level in zip(found.knobs, found.chosen.levels, strict=True)
    ]
    sets = " ".join(f"--set {quote(each)}" for each in found.overrides)
    cost = (
        f"{chosen:.2f} s a run, {chosen / given:.2f} of the scene's own settings ({given:.2f} s),"
        f" {chosen / found.reference_s:.2f} of the most exact ({found.reference_s:.2f} s); processor time"
    )
    return "\n\n".join(
        [
            cost,
            table(head, rows, numbers=(1, 2, 3)),
            table(["setting", "chosen", "level, 1 is exact"], levels),
            f"opir run {quote(scene)} {sets}" if found.meets else "no settings are within the errors on other seeds",
        ]
    )


def as_json(found: Tuned) -> str:
    """Return the choice as one JSON document."""
    return json.dumps(
        {
            "overrides": list(found.overrides),
            "meets": found.meets,
            "errors": dict(found.checked),
            "time_s": found.chosen.time_s,
            "own_settings": {"time_s": found.given.time_s, "errors": dict(found.given.errors)},
            "reference": {"time_s": found.reference_s},
        },
        indent=2,
    )
