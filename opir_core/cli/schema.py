"""`opir schema NAME`: the JSON Schema of an encoder (`detection` is that of `forge`, `track` that
of `tracks`).
"""

import argparse
import sys

from opir_core.errors import PluginError
from opir_core.host.components import EventEncoder
from opir_core.host.host import Host
from opir_core.output.events import SCHEMAS, schema_text


def schema_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the name of the schema."""
    parser.add_argument("name", metavar="NAME", help=f"{', '.join(SCHEMAS)}, or an event encoder")


def schema(arguments: argparse.Namespace) -> int:
    """Print the schema; an unknown encoder, and one without a schema, raise `PluginError`."""
    if arguments.name in SCHEMAS:
        sys.stdout.write(schema_text(arguments.name))
        return 0
    encoder = Host.discover().component(EventEncoder, arguments.name)
    if encoder.schema is None:
        raise PluginError(f"the event encoder {encoder.name!r} states no schema")
    sys.stdout.write(encoder.schema())
    return 0
