"""Components that hang: each command ends within its limit, names the part, and has the exit code
for it.
"""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[1] / "support" / "rogue_service.py"
SCENE: dict[str, Any] = {
    "scene": "stuck",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "sensors": [{"constellation": "DSP"}],
    "targets": [
        {
            "id": "a",
            "type": "ICBM",
            "launch": {"lat_deg": 39, "lon_deg": 127, "time_s": 0},
            "aim": {"lat_deg": 38, "lon_deg": -77},
        }
    ],
}
TRACKER = ("opir_trackers", "kepler-arc")


def ended(folder, component, *words, **changes):
    """Run a command whose component `rogue` hangs; it may take a minute at most."""
    (folder / "scene.yaml").write_text(yaml.safe_dump({**SCENE, **changes}), encoding="utf-8")
    command = [sys.executable, str(SCRIPT), *component, "hang", *words]
    return subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=60.0, check=False
    )


@pytest.mark.parametrize("workers", ["1", "2"])
@pytest.mark.parametrize(
    ("part", "changes", "reported"),
    [
        ((*TRACKER, "step"), {"tracker": "rogue"}, "tracker: the tracker 'rogue'"),
        (
            ("opir_classifiers", "paper", "pair_type"),
            {"classification": "rogue"},
            "a component of the scene stuck",
        ),
    ],
)
def test_a_run(tmp_path, workers, part, changes, reported):
    done = ended(
        tmp_path, part, "run", "scene.yaml", "--dead-after", "2", "--workers", workers, **changes
    )
    assert done.returncode == 6, done.stderr
    assert f"opir: {reported}" in done.stderr
    assert "has not returned for 2." in done.stderr
    assert not (tmp_path / "events.jsonl").exists()


def test_the_start_of_a_service(tmp_path):
    target = {**SCENE["targets"][0], "model": "rogue"}
    component = ("opir_target_models", "ballistic", "build")
    done = ended(
        tmp_path,
        component,
        "serve",
        "scene.yaml",
        "--port",
        "0",
        "--dead-after",
        "2",
        targets=[target],
    )
    assert done.returncode == 6
    assert "opir: targets[0]: the target model 'rogue' of " in done.stderr
    assert "build has not returned for 2." in done.stderr


@pytest.mark.parametrize(
    ("method", "words", "limit_s"),
    [("write", ("--dead-after", "3"), 3), ("close", ("--dead-after", "36"), 36), ("close", (), 30)],
)
def test_a_sink_that_fails_ends_no_other(tmp_path, method, words, limit_s):
    outputs = [{"jsonl": {"path": "other.jsonl"}}, "rogue"]
    done = ended(
        tmp_path, ("opir_sinks", "null", method), "run", "scene.yaml", "-q", *words, outputs=outputs
    )
    assert done.returncode == 5
    assert "outputs[1]: the sink 'rogue' of plugin rogue" in done.stderr
    assert f"{method} has not returned for {limit_s} s" in done.stderr
    assert len((tmp_path / "other.jsonl").read_text(encoding="utf-8").splitlines()) > 100


def test_a_study_in_this_process(tmp_path):
    words = ("sweep", "scene.yaml", "--runs", "2", "--executor", "serial", "--dead-after", "2")
    done = ended(tmp_path, (*TRACKER, "step"), *words, tracker="rogue")
    assert done.returncode == 6, done.stderr
    assert "tracker: the tracker 'rogue'" in done.stderr
