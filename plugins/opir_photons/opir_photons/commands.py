"""`opir physics`: formulae of light on the command line."""

from typing import Any

from opir_core.plugin import hookimpl


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir physics`."""
    from opir_photons.physics import physics, physics_arguments

    parser = commands.add_parser("physics", help="evaluate a radiometric formula")
    physics_arguments(parser)
    parser.set_defaults(run=physics)
