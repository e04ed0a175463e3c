"""The commands `opir check`, `opir claims` and `opir new-plugin`."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from opir_core.plugin import hookimpl

_SUMMARIES = {
    "check": "run the conformance tests of a component",
    "claims": "list what opir claims, and what each claim was held against",
    "new-plugin": "write the package of a new plugin, ready to install",
}


@hookimpl
def opir_add_commands(commands: Any) -> None:
    """Add `opir check`, `opir claims` and `opir new-plugin`."""
    for name, summary in _SUMMARIES.items():
        module = import_module(f"opir_testing.commands.{name.replace('-', '_')}")
        parser = commands.add_parser(name, help=summary)
        getattr(module, f"{name.replace('-', '_')}_arguments")(parser)
        parser.set_defaults(run=_run(module, name.replace("-", "_")), group="maintain")


def _run(module: Any, name: str) -> Callable[[Any], int]:
    def run(arguments: Any) -> int:
        return int(getattr(module, name)(arguments))

    return run
