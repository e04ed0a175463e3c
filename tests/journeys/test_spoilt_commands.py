"""Spoilt files through the command line: each is read or refused, without an internal error, soon
and in little memory.

`OPIR_SPOILT_CASES=10000 OPIR_SPOILT_SEED=7 pytest -m slow tests/journeys/test_spoilt_commands.py`
runs 10 000 other cases in all.
"""

import os
from pathlib import Path

import pytest

pytest.importorskip("pyarrow")
import spoilt_commands

pytestmark = pytest.mark.slow

CASES = int(os.environ.get("OPIR_SPOILT_CASES", "2000"))
SEED = int(os.environ.get("OPIR_SPOILT_SEED", "1"))
PARTS = 15


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("originals")
    spoilt_commands.write_originals(root)
    return root


@pytest.mark.timeout(0 if "OPIR_SPOILT_CASES" in os.environ else 600)
@pytest.mark.parametrize("part", range(PARTS))
def test_spoilt_files_are_read_or_refused(part: int, originals: Path, tmp_path: Path) -> None:
    faults = []
    for number in range(part, CASES, PARTS):
        case = spoilt_commands.case_of(SEED * 1_000_000 + number, originals)
        answer = spoilt_commands.answer_of(case, originals, tmp_path / "case")
        if answer.fault is not None:
            faults.append((answer.fault, number, case.kind.command, case.file, answer.text[-300:]))
    assert not faults


def test_every_command_takes_its_originals(originals: Path, tmp_path: Path) -> None:
    """Otherwise the spoilt ones would be refused for another reason."""
    refused = {"merge one two -o out -q"}  # the originals are of another folder
    for kind in spoilt_commands.KINDS:
        if not kind.files or kind.share < 3:
            continue
        name = kind.files[0]
        path = next((originals / kind.folder).glob(name))
        file = str(path.relative_to(originals / kind.folder))
        values = (file,) * kind.command.count("{}")
        case = spoilt_commands.Case(kind, file, path.read_bytes(), values)
        answer = spoilt_commands.answer_of(case, originals, tmp_path / "case")
        assert answer.code == 0 or kind.command in refused, (kind, answer.text)


@pytest.mark.parametrize(
    ("text", "code", "fault"),
    [
        ("fine", 0, None),
        ("opir: internal error: KeyError: 'a'", 1, "exit code 1"),
        ("a part raised TypeError: no number", 4, "TypeError"),
        ("", 2, "no words"),
    ],
)
def test_broken_promises_are_found(text: str, code: int, fault: str | None) -> None:
    assert spoilt_commands.Answer(code, text, 0.1, 10**8).fault == fault
