"""`opir doctor` names what would stop a run: each case is made, and the finding is read."""

import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from repository import EXAMPLES

from opir_core.cli.main import main


def findings(
    capsys: pytest.CaptureFixture[str], *words: str
) -> tuple[int, dict[str, list[tuple[str, str]]]]:
    """Return the exit code, and state and text of the findings by area."""
    code = main(["doctor", "--json", *words])
    areas: dict[str, list[tuple[str, str]]] = {}
    for row in json.loads(capsys.readouterr().out):
        areas.setdefault(row["area"], []).append((row["state"], row["text"]))
    return code, areas


def under(limits: str, *words: str) -> str:
    """Return what the command prints under limits of the shell."""
    command = f"{limits}; exec {sys.executable} -m opir_core doctor {' '.join(words)}"
    return subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=False
    ).stdout


def test_a_sound_machine_has_no_failure(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, areas = findings(capsys, str(EXAMPLES / "first_light.yaml"))
    assert code == 0
    assert areas["scene"] == [("ok", "first-light: 1 outputs")]
    assert "numpy" in areas["versions"][0][1]
    assert {state for rows in areas.values() for state, _ in rows} <= {"ok", "warn"}


def test_the_table_ends_with_the_counts(capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor"])
    assert capsys.readouterr().out.splitlines()[-1].endswith(" fail")


@pytest.mark.slow
def test_small_limits_are_reported_with_the_remedy() -> None:
    text = under("ulimit -n 200; ulimit -f 100")
    assert "at most 200; a service with many viewers needs more: ulimit -n 4096" in text
    assert "at most 102400 bytes; events and spools end there: ulimit -f unlimited" in text


def test_a_port_in_use_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        _, areas = findings(capsys, "--port", str(listener.getsockname()[1]))
    ((state, text),) = areas["port"]
    assert state == "warn"
    assert "is in use: opir serve --port 0" in text


def test_an_invalid_scene_and_a_missing_folder_fail(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    scene = tmp_path / "scene.yaml"
    text = (EXAMPLES / "first_light.yaml").read_text()
    scene.write_text(text.replace("path: events.jsonl", f"path: {tmp_path}/no/events.jsonl"))
    code, areas = findings(capsys, str(scene))
    assert (code, areas["outputs[0] (jsonl)"][0][0]) == (5, "fail")
    scene.write_text(text.replace("seed", "sed"))
    code, areas = findings(capsys, str(scene))
    assert code == 5
    assert "did you mean seed?" in areas["scene"][0][1]


def test_a_full_spool_is_reported(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    pytest.importorskip("opir_kafka")
    spool = tmp_path / "events.spool"
    spool.write_bytes(bytes(2 << 20))
    scene = tmp_path / "scene.yaml"
    outputs = f"  - kafka: {{spool: {{path: {spool}, max_bytes: 1048576, when_full: wait}}}}"
    text = (EXAMPLES / "first_light.yaml").read_text()
    scene.write_text(text.replace("  - jsonl: {path: events.jsonl}", outputs))
    _, areas = findings(capsys, str(scene))
    assert ("warn", f"{spool}: 2.0 MiB full: when_full is wait") in areas[
        "outputs[0] (kafka) spool"
    ]


def test_a_plugin_that_is_missing_is_reported(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPIR_PLUGINS", "dsp,http,no-such-plugin")
    _, areas = findings(capsys)
    assert any(state == "warn" and "no-such-plugin" in text for state, text in areas["plugins"])


def test_the_losses_of_an_output_without_a_spool_are_reported(
    capsys: pytest.CaptureFixture[str],
) -> None:
    _, areas = findings(capsys, str(EXAMPLES / "first_light.yaml"))
    ((state, text),) = areas["outputs[0] (jsonl) spool"]
    assert state == "ok"
    assert "is lost with the process" in text
    assert "spool: {path: FILE}" in text
