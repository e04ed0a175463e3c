"""The command `opir paper`; what it computes with is imported when the command is given."""

from typing import Any

from opir_core.plugin import deferred, hookimpl


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir paper`."""
    parser = commands.add_parser(
        "paper", help="check the figures of the paper behind opir, one by one"
    )
    parser.add_argument("--seed", type=int, default=1, help="seed of the simulations (default 1)")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print plain data")
    form.add_argument("--html", action="store_true", help="print a page, with the errata in words")
    form.add_argument(
        "--scene",
        action="store_true",
        help="print the scene that is simulated, and simulate nothing",
    )
    parser.set_defaults(run=deferred("opir_paper.command.paper"), group="study")
