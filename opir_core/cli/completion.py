"""`opir completion SHELL`: print a completion script for all installed commands, made by shtab."""

import argparse
import sys
from importlib import import_module

from opir_core.cli.main import full_parser
from opir_core.errors import PluginError, install_command


def completion_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.epilog = (
        f"needs shtab; {install_command('opir-core', 'completion')}\n\n"
        'bash: eval "$(opir completion bash)" in ~/.bashrc\n'
        'zsh:  eval "$(opir completion zsh)" in ~/.zshrc, after compinit\n'
        "fish: opir completion fish > ~/.config/fish/completions/opir.fish"
    )
    parser.add_argument(
        "shell", choices=("bash", "zsh", "fish", "tcsh", "powershell"), help="the shell"
    )


def completion(arguments: argparse.Namespace) -> int:
    """Print the script; raises `PluginError` where shtab is not installed."""
    try:
        shtab = import_module("shtab")
    except ImportError as error:
        raise PluginError(
            f"opir completion needs shtab; {install_command('opir-core', 'completion')}"
        ) from error
    sys.stdout.write(shtab.complete(full_parser(), arguments.shell) + "\n")
    return 0
