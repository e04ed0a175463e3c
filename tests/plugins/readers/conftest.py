"""What tests of readers share: `opir import` in a folder of its own."""

from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import main


@pytest.fixture
def imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Return a function that runs `opir import` there: its output, or with an exit code its
    errors.
    """
    monkeypatch.chdir(tmp_path)

    def run(*words: object, code: int = 0) -> str:
        assert main(["import", *map(str, words)]) == code
        answer = capsys.readouterr()
        return answer.err if code else answer.out

    return run
