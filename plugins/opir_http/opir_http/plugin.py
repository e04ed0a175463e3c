"""The command `opir serve`; web libraries are imported when it runs."""

import argparse
from typing import Any

from opir_core.plugin import hookimpl

_SUMMARY = "run a scene in real time, with an HTTP interface and a web page"


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir serve`."""
    from opir_http.arguments import add_arguments

    parser = commands.add_parser("serve", help=_SUMMARY, description=_SUMMARY)
    add_arguments(parser)
    parser.set_defaults(run=_serve)


def _serve(arguments: argparse.Namespace) -> int:
    from opir_http.serving import serve

    return serve(arguments)
