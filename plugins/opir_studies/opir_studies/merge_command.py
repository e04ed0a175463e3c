"""`opir merge`: the shards of a study as one study."""

import argparse
import sys
from pathlib import Path

from opir_studies.sharding import merged
from opir_studies.sweep_command import as_text, report_writer, watched_runs


def merge(arguments: argparse.Namespace) -> int:
    """Merge the shards of the arguments, write the report, and print the results."""
    write_report = report_writer(arguments)
    folder = Path(arguments.out)
    with watched_runs(arguments, folder) as on_progress:
        result = merged(
            arguments.folders, folder, workers=arguments.workers, on_progress=on_progress
        )
    written = write_report(folder)
    if not arguments.quiet:
        sys.stdout.write("\n".join([as_text(result), *written]) + "\n")
    return 0
