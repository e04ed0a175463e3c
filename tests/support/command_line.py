"""The command `opir`, in this process."""

from opir_core.cli.main import main

__all__ = ["main", "run_command"]


def run_command(command: str, *values: object, code: int = 0) -> None:
    """Run a command, whose words `{}` are values, and require its exit code."""
    remaining = iter(values)
    words = [str(next(remaining)) if word == "{}" else word for word in command.split()]
    assert not list(remaining), "more values than {}"
    assert main(words) == code
