"""`opir completion`: scripts that complete commands, options and choices in bash, zsh and fish."""

import os
import re
import shutil
import subprocess
from contextlib import redirect_stdout

import pytest

from opir_core.cli.main import COMMANDS, main

pytestmark = pytest.mark.shells

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
COMP_WORDS=(opir {words}); COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 )); _shtab_opir; printf '%s\\n' "${{COMPREPLY[@]}}"
"""

FISH = "source {script}; complete -C 'opir {words}'"

#: zsh completes only what is typed at a terminal, and `zpty` is one: the tab key is sent once zsh
#: reads a line.
ZSH = """
zmodload zsh/zpty
zpty terminal 'TERM=dumb ZDOTDIR={folder} zsh -d -i'
zpty -r terminal shown '*ready*'
zpty -w -n terminal 'opir {words}'$'\\t'
zpty -r terminal shown '*finished*'
print -r -- "$shown"
"""

#: What that zsh starts with. Each word that a completion adds is printed in brackets too.
ZSHRC = """
autoload -Uz compinit && compinit -u -D
eval "$(<{script})"
compadd() {{ local -a hits; builtin compadd -O hits "$@"; print -rl -- "<"${{^hits}}">" }}
zle-line-init() {{ print -r -- ready }}; zle -N zle-line-init
finish() {{ print -r -- finished; exit }}; comppostfuncs=(finish)
"""


@pytest.fixture(scope="module", params=["bash", "zsh", "fish"])
def script(request, tmp_path_factory):
    """A shell and its script in a file."""
    path = tmp_path_factory.mktemp("completion") / f"opir.{request.param}"
    with path.open("w", encoding="utf-8") as stream, redirect_stdout(stream):
        assert main(["completion", request.param]) == 0
    return request.param, path


def test_every_command_is_in_the_script(script):
    text = script[1].read_text(encoding="utf-8")
    assert all(name in text for name in COMMANDS)


def test_the_shell_accepts_the_script(script):
    shell, path = script
    setup = "autoload -Uz compinit && compinit -u -D; " if shell == "zsh" else ""
    done = run_in(shell, f'{setup}eval "$(cat {path})"', path.parent)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("words", "completed"), TYPED, ids=[" ".join(words) for words, _ in TYPED])
def test_words_are_completed(script, words, completed):
    shell, path = script
    offered = offered_words(shell, path, " ".join(words))
    assert set(completed) <= set(offered)
    assert all(word.startswith(words[-1]) for word in offered)


def offered_words(shell, script, words):
    """Return the words that a shell offers for the last of those typed after `opir`."""
    (script.parent / ".zshrc").write_text(ZSHRC.format(script=script), encoding="utf-8")
    code = {"bash": BASH, "zsh": ZSH, "fish": FISH}[shell].format(
        script=script, folder=script.parent, words=words
    )
    done = run_in(shell, code, script.parent)
    done.check_returncode()
    if shell == "zsh":
        return re.findall("<([^<>\r\n]+)>", done.stdout)
    return [line.partition("\t")[0] for line in done.stdout.splitlines()]


def run_in(shell, code, home):
    """Run code in a shell without the user's settings; without the shell, skip the test unless it
    is required.
    """
    if shutil.which(shell) is None and os.environ.get("OPIR_SHELLS") != "required":
        pytest.skip(f"{shell} is not installed")
    inputs = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("XDG_", "ZDOTDIR"))
    }
    inputs["HOME"] = str(home)
    return subprocess.run(
        [shell, "-c", code], capture_output=True, text=True, check=False, timeout=60, env=inputs
    )
