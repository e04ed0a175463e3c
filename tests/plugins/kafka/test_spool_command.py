"""`opir spool` says what of a spool is whole, and makes a new one of what is."""

import json
from pathlib import Path

import pytest
from command_line import run_command
from spool_transports import filled_spool, flip_body

BATCHES = 20
ROWS = 100


@pytest.fixture
def spool(tmp_path: Path) -> Path:
    return filled_spool(tmp_path / "spool", BATCHES, ROWS)


def test_the_command_checks_and_salvages(spool: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_command("spool check {}", spool)
    assert "2000 events in 20 batches are whole" in capsys.readouterr().out
    flip_body(spool, 350, 1500)
    run_command("spool check {} --json", spool, code=5)
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
    run_command("spool salvage {}", spool)
    assert "1800 events are salvaged" in capsys.readouterr().out
    run_command("spool salvage {}", spool)
    assert "nothing was changed" in capsys.readouterr().out
    run_command("spool check {}", str(spool) + ".no", code=5)
    assert "there is no spool" in capsys.readouterr().err
    (spool.parent / "text").write_text("text", encoding="utf-8")
    run_command("spool salvage {}", spool.parent / "text", code=5)
    assert "is not a spool" in capsys.readouterr().err
