"""The tutorial's transcript, line by line, as somebody else would type it."""

import re
import subprocess

import pytest
from repository import ROOT

PAGE = ROOT / "docs" / "tutorials" / "ten-minutes.md"
BLOCK = re.compile(r"^```shell-session\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\$ (.*)$", re.MULTILINE)

#: pip installs from this computer alone. No bytecode: Python takes it for current if a source of
#: the same size was changed within the same second, as it is here.
SETTINGS = {
    "PYTHONDONTWRITEBYTECODE": "1",
    "PIP_NO_INDEX": "1",
    "PIP_NO_DEPS": "1",
    "PIP_NO_BUILD_ISOLATION": "0",
    "PIP_DISABLE_PIP_VERSION_CHECK": "1",
}


def reported(outsider, command, folder):
    """Return what a command prints in somebody else's environment, both streams, without what never
    repeats.
    """
    done = subprocess.run(
        command,
        shell=True,
        cwd=folder,
        env={**outsider.variables(), **SETTINGS, "COLUMNS": "80"},
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        check=False,
    )
    return re.sub(
        r" in \d+\.\d+s\b",
        " in 0.00s",
        "\n".join(map(str.rstrip, done.stdout.strip().splitlines())),
    )


@pytest.mark.slow
def test_every_line_of_the_ten_minutes_is_real(outsider, tmp_path):
    commands = 0
    for block in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        words = COMMAND.split(block)
        for command, shown in zip(words[1::2], words[2::2], strict=True):
            assert reported(outsider, command, tmp_path) == shown.strip(), command
            commands += 1
    assert commands >= 10
