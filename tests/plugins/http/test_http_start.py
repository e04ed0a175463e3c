"""The start of a service: its messages, and the arguments that it refuses."""

import argparse
import json
import socket
from pathlib import Path

import pytest
from opir_http.arguments import add_arguments
from opir_http.serving import service_of, start_text, token_of

from opir_core.cli.main import main

SCENE = {
    "scene": "start",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 5.0,
    "sensors": [{"constellation": "SBIRS-GEO"}],
    "targets": [],
}


@pytest.fixture
def scene(tmp_path: Path) -> str:
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps(SCENE))
    return str(path)


@pytest.fixture
def token_file(tmp_path: Path) -> Path:
    path = tmp_path / "token"
    path.write_text("from-a-file-of-ours\n")
    return path


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "detection: constant, since the scene describes no light"),
        ({"background": "earth"}, "detection: snr, since the scene describes light: background"),
    ],
    ids=str,
)
def test_the_service_says_which_detection_was_chosen(
    changes: dict[str, str], line: str, tmp_path: Path
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps({**SCENE, **changes}))
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    service = service_of(parser.parse_args([str(path)]))
    text = start_text("localhost", 80, service.run.plan.scene.automatic)
    assert text.startswith("opir: http://localhost:80\n")
    assert text.endswith(f"\nopir: {line}\n")


@pytest.mark.parametrize(
    ("words", "token", "message"),
    [
        (["--host", "0.0.0.0"], None, "give a bearer token"),
        (["--host", "0.0.0.0"], "short", "at least 16 printable ASCII characters"),
        (["--token-file", "/dev/zero"], None, "more than 4096 bytes"),
        (["--host", "203.0.113.7"], "x" * 16, "cannot be bound"),
    ],
)
def test_invalid_arguments_are_refused(
    words: list[str],
    token: str | None,
    message: str,
    scene: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delenv("OPIR_HTTP_TOKEN", raising=False)
    if token is not None:
        monkeypatch.setenv("OPIR_HTTP_TOKEN", token)
    assert main(["serve", scene, *words]) == 2
    assert message in capsys.readouterr().err


def test_a_token_file_that_others_can_read_is_refused(
    scene: str, token_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    token_file.chmod(0o640)
    assert main(["serve", scene, "--token-file", str(token_file)]) == 2
    assert "mode 640); chmod 600" in capsys.readouterr().err


def test_a_token_is_read_from_its_file(token_file: Path) -> None:
    token_file.chmod(0o600)
    arguments = argparse.Namespace(host="0.0.0.0", token_file=str(token_file))
    assert token_of(arguments) == "from-a-file-of-ours"


def test_an_address_in_use_has_an_exit_code_of_its_own(
    scene: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = str(listener.getsockname()[1])
        assert main(["serve", scene, "--port", port]) == 6
    assert "in use" in capsys.readouterr().err
