"""`opir serve` writes what becomes of a director's commands, as `opir run` does."""

import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from waiting import until, within

pytest.importorskip("opir_http")

SCENE = """
scene: commanded
epoch: "2026-04-01T12:00:00Z"
duration_s: 100
seed: 5
sensors:
  - {model: generic-pointed, id: SPOT, orbital_slot_deg: -100.0, modes: {stare: {settle_s: 4.0}}}
targets: []
director: {model: round-robin, places_deg: [[34.73, -120.57], [10.0, 80.0]], mode: stare}
outputs: [{jsonl: {path: e.jsonl}}]
"""
OPIR = [sys.executable, "-m", "opir_core"]
BESIDE = "e.commands.jsonl"


@pytest.fixture
def written(tmp_path: Path) -> bytes:
    """Return what `opir run` writes of the commands."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    subprocess.run([*OPIR, "run", "scene.yaml", "-q"], cwd=tmp_path, check=True)
    (tmp_path / BESIDE).rename(tmp_path / "run.jsonl")
    return (tmp_path / "run.jsonl").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "name"),
    [([], BESIDE), (["--commands", "c.jsonl"], "c.jsonl"), (["--commands", ""], "")],
)
def test_the_commands_are_those_of_a_run(
    tmp_path: Path, written: bytes, options: Sequence[str], name: str
) -> None:
    words = [*OPIR, "serve", "scene.yaml", "--port", "0", "--speed", "max", *options]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        within(60.0, service.stdout.readline)
        if name:
            until(lambda: (tmp_path / name).read_bytes() == written)
        service.send_signal(signal.SIGTERM)
        service.wait(60.0)
    assert written.count(b"\n") == 5
    names = {path.name for path in tmp_path.iterdir()}
    assert names & {BESIDE, "c.jsonl"} == ({name} if name else set())


@pytest.mark.slow
def test_commands_of_a_scene_without_a_director_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(SCENE)
    words = ["scene.yaml", "--port", "0", "--set", "director=none", "--commands", "c.jsonl"]
    ended = subprocess.run(
        [*OPIR, "serve", *words], cwd=tmp_path, capture_output=True, text=True, timeout=60.0
    )
    assert ended.returncode != 0
    assert "--commands: the scene has no director" in ended.stderr
    assert not (tmp_path / "c.jsonl").exists()
