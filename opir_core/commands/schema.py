"""`opir schema detection`: the JSON Schema of an event."""

import argparse
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the name of the schema."""
    parser.add_argument("name", choices=["detection"], help="which schema")


def run(_arguments: argparse.Namespace) -> int:
    """Print the schema."""
    from opir_core.events import detection_schema_text

    sys.stdout.write(detection_schema_text())
    return 0
