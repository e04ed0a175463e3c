"""`opir prior fit`: a law of vehicles from recorded flights."""

from typing import Any

from opir_core.plugin import hookimpl


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir prior`."""
    from opir_forecast.prior_command import fit, prior_arguments

    parser = commands.add_parser("prior", help="fit the boosts that the tracker imm expects")
    prior_arguments(parser)
    parser.set_defaults(run=fit, group="data")
