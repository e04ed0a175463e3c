"""`opir score` scores the tracks of a run, or tracks on a benchmark set, against the truth."""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

from opir_core.errors import Problem, SceneError
from opir_scoring.benchmark_figures import figures_by_case, scored_set, set_text
from opir_scoring.benchmark_tables import DESCRIPTION
from opir_scoring.evidence import RunEvidence, evidence_of_files
from opir_scoring.scorecard_tables import scorecard_text
from opir_scoring.scorecards import Scorecard, ScoreSettings, scorecard
from opir_scoring.sensor_scores import sensor_scores, sensor_text


def score(arguments: argparse.Namespace) -> int:
    """Read the run, or the benchmark set and tracks on it, and print the scores."""
    if (Path(arguments.events) / DESCRIPTION).exists():
        return _score_set(arguments)
    if arguments.case:
        problem = Problem("--case", f"{arguments.events} is no benchmark set")
        raise SceneError([problem], source="command line")
    settings = score_settings(arguments)
    evidence = _evidence(arguments)
    card = scorecard([evidence], settings)
    # Tracks from elsewhere are not those of the run's tracker.
    tracker = Path(arguments.tracks).name if arguments.tracks else evidence.plan.scene.tracker.name
    sensors = [] if arguments.tracks else sensor_scores(evidence)
    if arguments.json:
        text = json.dumps({**card.as_plain(), "sensors": sensors}, indent=2)
    else:
        text = _text(card, tracker, sensors)
    sys.stdout.write(text + "\n")
    return 0


def _text(card: Scorecard, tracker: str, sensors: list[dict[str, Any]]) -> str:
    return "\n\n".join(filter(None, [scorecard_text({tracker: card}), sensor_text(sensors)]))


def _evidence(arguments: argparse.Namespace) -> RunEvidence:
    paths = {
        name: Path(path)
        for name in ("truth", "tracks", "manifest")
        if (path := getattr(arguments, name))
    }
    return evidence_of_files(Path(arguments.events), **paths)


def _score_set(arguments: argparse.Namespace) -> int:
    """Print the scores of tracks on a benchmark set."""
    problems = [
        Problem(f"--{name}", "is of a run; a benchmark set has its own")
        for name in ("truth", "manifest")
        if getattr(arguments, name)
    ]
    if not arguments.tracks:
        problems.append(Problem("--tracks", "a benchmark set needs the file of your tracks"))
    if problems:
        raise SceneError(problems, source="command line")
    about, scores = scored_set(Path(arguments.events), Path(arguments.tracks), arguments.case)
    figures = figures_by_case([scene for _, scene in scores])
    plain = {**about, "cases": figures}
    text = json.dumps(plain, indent=2) if arguments.json else set_text(about, figures)
    sys.stdout.write(text + "\n")
    return 0


def score_settings(arguments: argparse.Namespace) -> ScoreSettings:
    """Return the score settings of the arguments; raises `SceneError` for values out of range."""
    problems = _setting_problems(arguments)
    if problems:
        raise SceneError(problems, source="command line")
    return ScoreSettings(
        bin_s=arguments.bin_s,
        cutoff_m=arguments.cutoff_m,
        order=arguments.order,
        alpha=arguments.alpha,
        launch_probability=arguments.launch_probability,
        unknown=tuple(arguments.unknown),
    )


def _setting_problems(arguments: argparse.Namespace) -> list[Problem]:
    return [
        Problem(flag, message)
        for flag, is_wrong, message in (
            ("--bin-s", not 0.01 <= arguments.bin_s < math.inf, "must be at least 0.01 and finite"),
            ("--cutoff-m", not 0.0 < arguments.cutoff_m < math.inf, "must be positive and finite"),
            ("--order", not 1.0 <= arguments.order < math.inf, "must be at least 1 and finite"),
            (
                "--launch-probability",
                not 0.0 <= arguments.launch_probability < 1.0,
                "must be in [0, 1)",
            ),
            ("--alpha", not 0.0 < arguments.alpha <= 2.0, "must be in (0, 2]"),
            (
                "--order",
                _is_beyond(arguments.cutoff_m, arguments.order),
                "too large: the cut-off to this power overflows",
            ),
        )
        if is_wrong
    ]


def _is_beyond(cutoff_m: float, order: float) -> bool:
    """Whether p-th powers of distances up to the cut-off overflow or underflow in a double, or
    leave no room for their sums.
    """
    is_valid = 0.0 < cutoff_m < math.inf and 1.0 <= order < math.inf
    return is_valid and abs(order * math.log10(cutoff_m)) > 280.0
