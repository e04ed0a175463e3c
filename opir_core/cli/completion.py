"""`opir completion bash|zsh|fish`: print a completion script for all installed commands."""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence

from attrs import frozen

from opir_core.cli.main import full_parser


@frozen
class CompletedCommand:
    """A command for completion: its words after `opir`, its summary, options (with their help), and other words."""

    words: tuple[str, ...]
    summary: str
    options: tuple[tuple[str, str], ...]
    values: tuple[tuple[str, tuple[str, ...]], ...]
    choices: tuple[str, ...]


def completion_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        'bash: eval "$(opir completion bash)" in ~/.bashrc\n'
        'zsh:  eval "$(opir completion zsh)" in ~/.zshrc, after compinit\n'
        "fish: opir completion fish > ~/.config/fish/completions/opir.fish"
    )
    parser.add_argument("shell", choices=list(SCRIPTS), help="the shell")


def completion(arguments: argparse.Namespace) -> int:
    """Print the script."""
    sys.stdout.write(SCRIPTS[arguments.shell](list(completed_commands(full_parser()))))
    return 0


def completed_commands(
    parser: argparse.ArgumentParser, words: tuple[str, ...] = (), summary: str = ""
) -> Iterator[CompletedCommand]:
    """Yield a parser and the parsers of its subcommands, each before its own."""
    options, values, choices, inner = [], [], list[str](), list[tuple[str, argparse.ArgumentParser, str]]()
    for action in parser._actions:  # argparse has no public list of arguments
        if isinstance(action, argparse._SubParsersAction):
            helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
            inner += [(name, child, helps.get(name, "")) for name, child in action.choices.items()]
            choices += action.choices
        elif action.option_strings:
            options += [(option, _plain(action.help)) for option in action.option_strings]
            values += [
                (option, tuple(map(str, action.choices or ()))) for option in action.option_strings if action.nargs != 0
            ]
        else:
            choices += map(str, action.choices or ())
    yield CompletedCommand(words, summary, tuple(options), tuple(values), tuple(choices))
    for name, child, text in inner:
        yield from completed_commands(child, (*words, name), text)


def bash_script(commands: Sequence[CompletedCommand]) -> str:
    """Return the script for bash: options and choices by command, else file names."""
    inner = _bash_patterns(command.words for command in commands if command.words)
    return f"""\
_opir() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} previous=${{COMP_WORDS[COMP_CWORD - 1]}} given= candidates= i
    for ((i = 1; i < COMP_CWORD; i++)); do
        case "$given ${{COMP_WORDS[i]}}" in
            {inner}) given="$given ${{COMP_WORDS[i]}}" ;;
        esac
    done
    case "$given $previous" in
{_bash_values(commands)}
        *)
            case "$given" in
{_bash_words(commands)}
            esac
            ;;
    esac
    COMPREPLY=($(compgen -W "$candidates" -- "$current"))
    [[ ${{#COMPREPLY[@]}} -eq 0 && $current != -* ]] && COMPREPLY=($(compgen -f -- "$current"))
    return 0
}}
complete -o filenames -F _opir opir
"""


def zsh_script(commands: Sequence[CompletedCommand]) -> str:
    """Return the script for zsh: that for bash, through zsh's own `bashcompinit`."""
    return f"autoload -Uz bashcompinit && bashcompinit\n{bash_script(commands)}"


def fish_script(commands: Sequence[CompletedCommand]) -> str:
    """Return the script for fish."""
    return (
        "\n".join(["complete -c opir -f", *(line for command in commands for line in _fish_lines(command, commands))])
        + "\n"
    )


def _fish_lines(command: CompletedCommand, commands: Sequence[CompletedCommand]) -> Iterator[str]:
    inner = {one.words[-1]: one.summary for one in commands if one.words and one.words[:-1] == command.words}
    conditions = [f"__fish_seen_subcommand_from {word}" for word in command.words] or ["__fish_use_subcommand"]
    if command.words and inner:
        conditions.append(f"not __fish_seen_subcommand_from {' '.join(inner)}")
    start = f"complete -c opir -n {_quoted('; and '.join(conditions))}"
    for choice in command.choices:
        yield f"{start} -a {choice} -d {_quoted(inner.get(choice, ''))}"
    values = dict(command.values)
    for option, text in command.options:
        flag = f"-l {option[2:]}" if option.startswith("--") else f"-s {option[1:]}"
        free = " -r -F" if option in values else ""
        value = f" -x -a {_quoted(' '.join(values[option]))}" if values.get(option) else free
        yield f"{start} {flag}{value} -d {_quoted(text)}"
    if command.words and not command.choices:
        yield f"{start} -F"


SCRIPTS = {"bash": bash_script, "zsh": zsh_script, "fish": fish_script}


def _bash_words(commands: Sequence[CompletedCommand]) -> str:
    lines = []
    for command in commands:
        words = " ".join([*command.choices, *(option for option, _ in command.options)])
        lines.append(f'                {_bash_patterns([command.words])}) candidates="{words}" ;;')
    return "\n".join(lines)


def _bash_values(commands: Sequence[CompletedCommand]) -> str:
    """Return the cases of options with a value: its choices, none for free values."""
    options: dict[str, list[tuple[str, ...]]] = {}
    for command in commands:
        for option, choices in command.values:
            options.setdefault(" ".join(choices), []).append((*command.words, option))
    return "\n".join(
        f'        {_bash_patterns(words)}) candidates="{choices}" ;;' for choices, words in options.items()
    )


def _bash_patterns(several: Iterable[Sequence[str]]) -> str:
    """Return words as `case` patterns: `" run" | " check --kind"`."""
    return " | ".join('"' + "".join(f" {word}" for word in words) + '"' for words in several)


def _plain(text: str | None) -> str:
    """Return a help text in one line, with argparse's `%%` as one sign."""
    return " ".join((text or "").replace("%%", "%").split())


def _quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"
