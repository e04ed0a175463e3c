"""`opir spool` says what of a spool is whole, and makes a new one of what is."""

import json
from pathlib import Path

import pytest
from command_line import main
from spool_transports import filled_spool, ids_of, window

BATCHES = 20
ROWS = 100


@pytest.fixture
def spool(tmp_path: Path) -> Path:
    return filled_spool(tmp_path / "spool", BATCHES, ROWS)


def flip_body(path: Path, *events: int) -> None:
    """Change one byte in the messages of some events."""
    content = bytearray(path.read_bytes())
    for event in events:
        content[content.index(ids_of(window(BATCHES * ROWS))[event].encode())] ^= 1
    path.write_bytes(content)


def test_the_command_checks_and_salvages(spool: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["spool", "check", str(spool)]) == 0
    assert "2000 events in 20 batches are whole" in capsys.readouterr().out
    flip_body(spool, 350, 1500)
    assert main(["spool", "check", str(spool), "--json"]) == 5
    reported = json.loads(capsys.readouterr().out)
    assert (
        reported["whole"],
        reported["damaged"],
        reported["events"],
        reported["lost_events"],
    ) == (
        False,
        [4, 16],
        1800,
        200,
    )
    assert main(["spool", "salvage", str(spool)]) == 0
    assert "1800 events are salvaged" in capsys.readouterr().out
    assert main(["spool", "salvage", str(spool)]) == 0
    assert "nothing was changed" in capsys.readouterr().out
    assert main(["spool", "check", str(spool) + ".no"]) == 5
    assert "there is no spool" in capsys.readouterr().err
    (spool.parent / "text").write_text("text", encoding="utf-8")
    assert main(["spool", "salvage", str(spool.parent / "text")]) == 5
    assert "is not a spool" in capsys.readouterr().err
