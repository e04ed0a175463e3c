"""Systems without the locks of POSIX, as Windows: one message that says where opir runs, or a run in memory."""

import subprocess
import sys

import pytest
from repository import EXAMPLES

from opir_core import SinkError

WITHOUT_LOCKS = "import sys\nsys.modules['fcntl'] = None\n"
SCENE = str(EXAMPLES / "first_light.yaml")


def done(code, folder):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_LOCKS + code],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [["run", SCENE], ["sweep", SCENE, "--vary", "seed=1,2"], ["export", "events.jsonl"]]
)
def test_commands_that_write_files_say_where_they_run(words, tmp_path):
    process = done(f"from opir_core.cli.main import main\nsys.exit(main({words!r}))", tmp_path)
    assert process.returncode == SinkError.exit_code
    assert process.stderr.count("\n") == 1
    assert "Linux and macOS only" in process.stderr
    assert "in WSL" in process.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_run_in_memory_needs_no_locks(tmp_path):
    code = "import opir_core\nprint(len(opir_core.simulate(opir_core.example('first')).detections))"
    process = done(code, tmp_path)
    assert (process.returncode, process.stdout) == (0, "750\n")
