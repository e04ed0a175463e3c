"""`opir schema NAME`: the JSON Schema of an event, by the encoder that makes it (`detection` is the default one's)."""

import argparse
import sys


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the name of the schema."""
    parser.add_argument("name", choices=["detection", "forge-c2", "udl"], help="which schema")


def run(arguments: argparse.Namespace) -> int:
    """Print the schema."""
    from opir_core.output.events import schema_text

    sys.stdout.write(schema_text(arguments.name))
    return 0
