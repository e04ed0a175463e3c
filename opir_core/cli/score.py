"""`opir score`: judge the tracks of a run against the truth."""

import argparse
import json
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the run, its truth, and the form of the answer."""
    parser.add_argument("events", metavar="RUN", help="a run's events; tracks and manifest lie beside them")
    parser.add_argument("--truth", metavar="PATH", help="the run's truth (default: beside the events)")
    parser.add_argument(
        "--tracks", metavar="PATH", help="tracks of its events, the run's or another tracker's (as above)"
    )
    parser.add_argument("--manifest", metavar="PATH", help="the run's manifest (as above)")
    add_settings(parser)


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add what a score depends on, and the form of the answer."""
    parser.add_argument("--bin-s", type=float, default=20.0, help="width of the bins of time since ignition, s")
    parser.add_argument("--cutoff-m", type=float, default=5000.0, help="GOSPA's cut-off distance c, m")
    parser.add_argument("--order", type=float, default=2.0, help="GOSPA's order p")
    parser.add_argument("--alpha", type=float, default=2.0, help="GOSPA's alpha, in (0, 2]")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Read the run and tell its scores."""
    from opir_core.cli.scorecard_text import as_text, settings_of
    from opir_core.scoring import scorecard
    from opir_core.scoring.files import evidence_of_files

    settings = settings_of(arguments)
    elsewhere = {name: getattr(arguments, name) for name in ("truth", "tracks", "manifest")}
    given = {name: Path(path) for name, path in elsewhere.items() if path}
    evidence = evidence_of_files(Path(arguments.events), **given)
    card = scorecard([evidence], settings)
    # Tracks from elsewhere are not those of the run's tracker.
    tracker = Path(arguments.tracks).name if arguments.tracks else evidence.plan.scene.tracker.name
    told = json.dumps(card.as_plain(), indent=2) if arguments.json else as_text({tracker: card})
    sys.stdout.write(told + "\n")
    return 0
