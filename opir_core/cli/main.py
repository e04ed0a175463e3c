"""The command `opir`: parse the command line, run the command, report opir's own errors with an
exit code.

A command's module is imported only when the command is given, so `opir --version` costs little more
than Python itself.
"""

import argparse
import os
import sys
from collections.abc import Iterable, Sequence
from importlib import import_module
from typing import Any, NamedTuple, NoReturn

from opir_core._version import __version__
from opir_core.cli.streams import open_streams


class CoreCommand(NamedTuple):
    """A command of the core: its module in `opir_core.cli`, its group in the help, its summary.

    For a command `new-plugin` the module has `new_plugin_arguments(parser)` and
    `new_plugin(arguments) -> exit code`.
    """

    module: str
    group: str
    summary: str


COMMANDS = {
    "run": CoreCommand("run", "run", "simulate a scene; write events, truth, tracks and manifest"),
    "validate": CoreCommand("explain", "run", "check a scene without simulating it"),
    "explain": CoreCommand(
        "explain", "look", "show what a scene computes, and what it skips and why"
    ),
    "plugins": CoreCommand(
        "components", "maintain", "list the installed plugins and their components"
    ),
    "describe": CoreCommand(
        "components", "look", "show the settings of a component: units, ranges, defaults, sources"
    ),
    "schema": CoreCommand("schema", "data", "print the JSON Schema of an event"),
    "completion": CoreCommand("completion", "maintain", "print a completion script for a shell"),
}

#: The groups of commands in the help, in its order; a command of a plugin that states none of them
#: is in the last one.
GROUPS = {
    "run": "run a scene",
    "study": "study many runs",
    "look": "look at scenes and runs",
    "data": "convert data",
    "maintain": "maintain the installation",
    "other": "other commands",
}

EXIT_CODES = """\
exit codes:
  0    success
  1    internal error
  2    invalid command line or scene
  3    component missing, ambiguous or broken
  4    a model returned invalid values, or a conformance test failed
  5    an output failed
  6    a component did not return, a service failed, or its address is in use
  130  interrupted
  141  the reader of standard output stopped reading
"""

#: The option of every command that prints tracebacks.
DEBUG = "--debug"

#: Variables that set the threads of libraries of linear algebra. Our matrices are small: with a
#: tracker several threads took 1.8 times the processor time and slowed a raid down by a sixth.
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    if argv is None:
        open_streams()
        for name in THREADS:
            os.environ.setdefault(name, "1")
    words = list(sys.argv[1:] if argv is None else argv)
    is_debugged = DEBUG in words
    arguments = None
    is_core = False
    try:
        arguments, is_core = _parsed([word for word in words if word != DEBUG])
        return int(arguments.run(arguments))
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 141
    except BaseException as error:
        # argparse ends the program with SystemExit, and so may commands of plugins.
        is_meant = isinstance(error, SystemExit) and not (arguments is not None and is_core)
        # With `--debug` also the tracebacks of plugins, whose exceptions are the causes of opir's
        # own errors.
        if is_meant or (
            is_debugged and not (hasattr(error, "exit_code") and error.__cause__ is None)
        ):
            raise
        from opir_core.cli.error_report import report

        return report(error)


def _parsed(words: Sequence[str]) -> tuple[argparse.Namespace, bool]:
    """Return the parsed arguments, and whether the command is the core's own."""
    name = next((word for word in words if not word.startswith("-")), None)
    parser, commands = _empty_parser([name] if name in COMMANDS else COMMANDS)
    if name in COMMANDS:
        _add_arguments(commands.choices[name], name)
    elif "--version" not in words:
        _add_plugin_commands(commands, name)
    arguments, unknown = parser.parse_known_args(words)
    if unknown:
        _refuse(unknown, commands.choices.get(name, parser))
    return arguments, name in COMMANDS


def _refuse(unknown: Sequence[str], command: argparse.ArgumentParser) -> NoReturn:
    """End with the usage of the command, not that of all commands, and the option that is most like
    the unknown one.
    """
    from opir_core.errors import nearest

    options = [word for word in unknown if word.startswith("--")]
    options_known = (
        option for action in command._actions for option in action.option_strings
    )  # argparse has no public list
    hint = nearest(options[0].partition("=")[0], options_known) if options else ""
    command.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")


def full_parser() -> argparse.ArgumentParser:
    """Return the parser with the arguments of all commands, those of plugins included."""
    parser, commands = _empty_parser(COMMANDS)
    for name in COMMANDS:
        _add_arguments(commands.choices[name], name)
    _add_plugin_commands(commands, None)
    return parser


def _empty_parser(names: Iterable[str]) -> tuple[argparse.ArgumentParser, Any]:
    """Return a parser and its commands of these names: making one takes as long as importing a
    small module.
    """
    parser = _Parser()
    commands = parser.commands
    for name in names:
        summary = COMMANDS[name].summary
        description = f"{summary[0].upper()}{summary[1:]}."
        command = commands.add_parser(
            name, help=summary, description=description, formatter_class=_formatter
        )
        command.set_defaults(group=COMMANDS[name].group)
    return parser, commands


class _Parser(argparse.ArgumentParser):
    """The parser of `opir`, whose help lists the commands by their groups."""

    def __init__(self) -> None:
        super().__init__(
            prog="opir",
            description="Simulate overhead infrared missile-warning sensors.",
            epilog=EXIT_CODES,
            formatter_class=_formatter,
            add_help=False,
        )
        self._options = [
            self.add_argument(
                "-h", "--help", action="help", help="show this help message and exit"
            ),
            self.add_argument(
                DEBUG, action="store_true", help="print the traceback of an internal error"
            ),
            self.add_argument(
                "--version",
                action="version",
                version=f"opir {__version__}",
                help="show program's version number and exit",
            ),
        ]
        self.commands = self.add_subparsers(
            metavar="COMMAND", required=True, parser_class=argparse.ArgumentParser
        )

    def format_help(self) -> str:
        """Return the help: options, then the commands of each group."""
        formatter = _formatter(self.prog)
        formatter.add_text(self.description)
        formatter.start_section("options")
        formatter.add_arguments(self._options)
        formatter.end_section()
        formatter.start_section("commands")
        commands_by_group = self._commands_by_group()
        for group, title in GROUPS.items():
            formatter.start_section(title)
            formatter.add_arguments(commands_by_group.get(group, ()))
            formatter.end_section()
        formatter.end_section()
        formatter.add_text(self.epilog)
        return f"{self.format_usage()}\n{formatter.format_help()}"

    def _commands_by_group(self) -> dict[str, list[argparse.Action]]:
        """Return the commands by group as rows of the help; aliases are left out."""
        rows: dict[str, list[argparse.Action]] = {}
        parsers = {parser: name for name, parser in reversed(self.commands.choices.items())}
        for parser, name in reversed(parsers.items()):
            group = parser.get_default("group")
            summary = (parser.description or "").replace("%", "%%")
            row = argparse.Action([], name, help=summary)
            rows.setdefault(group if group in GROUPS else "other", []).append(row)
        return rows


def _formatter(prog: str) -> argparse.HelpFormatter:
    """Return a formatter as wide as the terminal: without a width each parser would import `shutil`
    to ask for it.
    """
    try:
        columns = int(os.environ.get("COLUMNS") or os.get_terminal_size().columns)
    except (OSError, ValueError):
        columns = 80
    return argparse.RawDescriptionHelpFormatter(prog, width=columns - 2)


def _add_arguments(command: argparse.ArgumentParser, name: str) -> None:
    module = import_module(f"opir_core.cli.{COMMANDS[name].module}")
    function = name.replace("-", "_")
    getattr(module, f"{function}_arguments")(command)
    command.set_defaults(run=getattr(module, function))


def _add_plugin_commands(commands: Any, name: str | None) -> None:
    from opir_core.cli.plugin_commands import add_commands

    add_commands(commands, name)
