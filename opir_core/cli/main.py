"""The command `opir`: parse, run the command, turn opir's own errors into one message and an exit code.

Each command imports what it needs when it runs, so `opir --version` costs little more than Python itself.
"""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from opir_core._version import __version__

#: The core's commands and what they do; each is a module of `opir_core.cli` with `add_arguments` and `run`.
COMMANDS = {
    "run": "simulate a scene and write its events, truth, tracks and manifest",
    "validate": "read a scene and say what is wrong with it",
    "explain": "say what a scene will compute, and what it skips and why",
    "score": "judge the tracks of a run against the truth",
    "compare": "run a scene with several trackers, many times, and judge them",
    "plugins": "list the installed plugins and what they offer",
    "describe": "say what a component is and what a scene may set of it",
    "physics": "work out a radiometric quantity from its formula",
    "new-plugin": "write a package with a component of your own, that installs and passes at once",
    "check": "say whether a component keeps the promises of its kind, and what to change",
    "schema": "print the JSON Schema of an event",
}

_INTERRUPTED = 130
_BROKEN_PIPE = 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        arguments = _parser(words).parse_args(words)
        return int(arguments.run(arguments))
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        sys.stderr.close()
        return _BROKEN_PIPE
    except Exception as error:
        return _told(error)


def _told(error: Exception) -> int:
    """Print one of opir's own errors and return its exit code; let any other through."""
    from opir_core.errors import OpirError

    if not isinstance(error, OpirError):
        raise error
    print(f"opir: {error}", file=sys.stderr)  # noqa: T201
    return error.exit_code


def _parser(words: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="opir", description="Simulate overhead infrared missile-warning sensors.")
    parser.add_argument("--version", action="version", version=f"opir {__version__}")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    wanted = next((word for word in words if not word.startswith("-")), None)
    for name, summary in COMMANDS.items():
        command = commands.add_parser(name, help=summary, description=summary)
        if name == wanted:
            _fill(command, name)
    if wanted not in COMMANDS and "--version" not in words:
        _add_plugin_commands(commands, wanted)
    return parser


def _fill(command: argparse.ArgumentParser, name: str) -> None:
    module = import_module(f"opir_core.cli.{name.replace('-', '_')}")
    module.add_arguments(command)
    command.set_defaults(run=module.run)


def _add_plugin_commands(commands: Any, wanted: str | None) -> None:
    from opir_core.plugin.host import Host

    added = Host.discover().add_commands(commands, wanted)
    if wanted is not None and not added:  # it is no command: argparse is to list all that there are
        Host.discover().add_commands(commands)
