"""Whatever a component does in `opir run`, the command ends with one message and a code that is not
success.
"""

import subprocess
import sys

import pytest
from http_service import SCENE
from repository import ROOT

RUN = ROOT / "tests" / "support" / "rogue_service.py"
TRACKER = ("opir_trackers", "kepler-arc", "step", "tracker: rogue\n")
MODEL = ("opir_detection_models", "constant", "pair_probability", "detection: rogue\n")
SINK = ("opir_sinks", "memory", "write", "")


def ran(folder, part, deed, *words):
    """Run a scene with a component that misbehaves."""
    hook, sound, method, more = part
    outputs = (
        '[{"rogue": {}}]'
        if part is SINK
        else f'[{{"jsonl": {{"path": "{folder / "events.jsonl"}"}}}}]'
    )
    scene = SCENE.replace('outputs: ["null"]', f"outputs: {outputs}") + more
    (folder / "scene.yaml").write_text(scene, encoding="utf-8")
    command = [
        sys.executable,
        str(RUN),
        hook,
        sound,
        method,
        deed,
        "run",
        str(folder / "scene.yaml"),
        *words,
    ]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, cwd=folder
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "deed", ["SystemExit", "GeneratorExit", "KeyboardInterrupt", "ZeroDivisionError"]
)
@pytest.mark.parametrize("part", [TRACKER, MODEL, SINK], ids=["tracker", "model", "sink"])
def test_a_run_that_a_component_ends_is_no_success(tmp_path, part, deed):
    done = ran(tmp_path, part, deed, "--quiet")
    assert done.returncode not in (0, None)
    assert "Traceback" not in done.stderr
    if deed != "KeyboardInterrupt":
        assert deed in done.stderr
        assert "rogue_components.py, line" in done.stderr


@pytest.mark.slow
def test_the_traceback_is_printed_on_request(tmp_path):
    assert "Traceback" in ran(tmp_path, MODEL, "ZeroDivisionError", "--debug").stderr
