"""`opir completion`: scripts that complete commands, options and choices in bash, zsh and fish."""

import shutil
import subprocess
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from opir_core.cli.main import COMMANDS, main

#: Words typed so far, and what completes the last of them.
TYPED = [
    (["ru"], ["run"]),
    (["val"], ["validate"]),
    (["run", "--tra"], ["--tracks", "--tracker"]),
    (["check", "weighted", "--kind", "sensor-"], ["sensor-model"]),
    (["completion", "f"], ["fish"]),
    (["physics", "min-intensity", "--un"], ["--unit"]),
]

BASH = """
source {script}
COMP_WORDS=(opir {words}); COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 )); _opir; printf '%s\\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture(scope="module", params=["bash", "zsh", "fish"])
def script(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """A shell and its script in a file."""
    path = tmp_path_factory.mktemp("completion") / f"opir.{request.param}"
    with path.open("w", encoding="utf-8") as stream, redirect_stdout(stream):
        assert main(["completion", request.param]) == 0
    return request.param, path


def test_every_command_is_in_the_script(script: tuple[str, Path]) -> None:
    text = script[1].read_text(encoding="utf-8")
    assert all(f" {name}" in text for name in COMMANDS)


def test_the_shell_accepts_the_script(script: tuple[str, Path]) -> None:
    shell, path = script
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    setup = "autoload -Uz compinit && compinit -u; " if shell == "zsh" else ""
    done = subprocess.run([shell, "-c", f"{setup}source {path}"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("words", "completed"), TYPED, ids=[" ".join(words) for words, _ in TYPED])
def test_words_are_completed(script: tuple[str, Path], words: list[str], completed: list[str]) -> None:
    shell, path = script
    if shell == "zsh" or shutil.which(shell) is None:
        pytest.skip(f"{shell} cannot be asked without a terminal, or is not installed")
    if shell == "bash":
        code = BASH.format(script=path, words=" ".join(words))
    else:
        code = f"source {path}; complete -C 'opir {' '.join(words)}'"
    done = subprocess.run([shell, "-c", code], capture_output=True, text=True, check=True)
    lines = [line.partition("\t")[0] for line in done.stdout.splitlines()]
    assert set(completed) <= set(lines)
    assert all(line.startswith(words[-1]) for line in lines)
