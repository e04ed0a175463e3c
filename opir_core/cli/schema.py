"""`opir schema NAME`: the JSON Schema of a message (`detection` is that of the default encoder)."""

import argparse
import sys

from opir_core.output.events import SCHEMAS, schema_text


def schema_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the name of the schema."""
    parser.add_argument("name", choices=list(SCHEMAS), help="which schema")


def schema(arguments: argparse.Namespace) -> int:
    """Print the schema."""
    sys.stdout.write(schema_text(arguments.name))
    return 0
