"""`opir rerun`: make a study or a run again, and say whether it has the same bytes."""

import argparse
import json
import sys
from pathlib import Path

from attrs import asdict

from opir_studies.refusals import require_positive
from opir_studies.rerunning import rerun as made_again
from opir_studies.sweep_command import watched_runs

#: The exit code where a file differs.
DIFFERENT = 4


def rerun(arguments: argparse.Namespace) -> int:
    """Make the study or run of the arguments again; return 4 if a file differs."""
    if arguments.workers is not None:
        require_positive("--workers", arguments.workers, "workers")
    source = Path(arguments.source)
    name = source.name.removesuffix(".manifest.json").removesuffix(".json")
    folder = Path(arguments.out or f"{name}-again")
    with watched_runs(arguments, folder) as on_progress:
        result = made_again(source, folder, workers=arguments.workers, on_progress=on_progress)
    count = len(result.same) + len(result.different)
    lines = [
        f"{len(result.same)} of {count} files have the same bytes, in {result.folder}",
        *(f"differs: {name}" for name in result.different),
        *(f"because: {reason}" for reason in result.reasons),
    ]
    if not arguments.quiet:
        plain = {**asdict(result), "folder": str(result.folder)}
        text = json.dumps(plain, indent=2) if arguments.json else "\n".join(lines)
        sys.stdout.write(text + "\n")
    return DIFFERENT if result.different else 0
