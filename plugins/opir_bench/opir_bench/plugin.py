"""The command `opir physics`."""

from typing import Any

from opir_core.plugin import hookimpl


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir physics`."""
    from opir_bench.arguments import physics_arguments

    parser = commands.add_parser(
        "physics", help="evaluate a radiometric formula, or put a sensor on the bench"
    )
    parser.set_defaults(group="look")
    physics_arguments(parser)
