"""Commands whose standard streams are closed, are not UTF-8, or are handed text that would act on a
terminal.
"""

import os
import subprocess
import sys

import pytest
from repository import EXAMPLES

pytestmark = pytest.mark.slow

SCENE = str(EXAMPLES / "first_light.yaml")


def opir(folder, *words, closed="", **environment):
    """Return a finished command; `closed` are redirections of the shell."""
    line = f'exec "$0" -m opir_core "$@" {closed}'
    return subprocess.run(
        ["sh", "-c", line, sys.executable, *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        check=False,
    )


@pytest.mark.parametrize("closed", ["2>&-", ">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_a_run_whose_streams_are_closed_is_a_run(tmp_path, closed):
    assert opir(tmp_path, "run", SCENE, closed=closed).returncode == 0
    total = (tmp_path / "events.jsonl").read_bytes()
    (tmp_path / "again").mkdir()
    assert opir(tmp_path / "again", "run", SCENE).returncode == 0
    assert total == (tmp_path / "again" / "events.jsonl").read_bytes()


def test_an_error_has_its_exit_code_where_nobody_reads_it(tmp_path):
    assert opir(tmp_path, "validate", "none.yaml", closed="2>&-").returncode == 2
    assert opir(tmp_path, "run", SCENE, "--nonsense", closed="2>&-").returncode == 2


def test_events_for_a_closed_standard_output_are_not_lost_in_silence(tmp_path):
    done = opir(tmp_path, "run", SCENE, "-o", "-", closed=">&-")
    assert done.returncode == 5
    assert b"standard output: bad file descriptor" in done.stderr


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "latin-1", "cp437"])
@pytest.mark.parametrize("words", [("run", SCENE), ("explain", SCENE), ("describe", "DSP")])
def test_a_console_that_is_not_utf_8_is_no_error(tmp_path, encoding, words):
    done = opir(tmp_path, *words, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode(encoding)


def test_what_a_console_cannot_show_is_written_out(tmp_path):
    assert opir(tmp_path, "validate", "σ.yaml", PYTHONIOENCODING="ascii").stderr.startswith(
        b"opir: \\u03c3.yaml: "
    )
    assert opir(tmp_path, "validate", "σ.yaml", PYTHONIOENCODING="utf-8").stderr.startswith(
        "opir: σ.yaml: ".encode()
    )


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("red\x1b[31m.yaml", "red\\x1b[31m.yaml"),
        ("c1\x9b31m.yaml", "c1\\x9b31m.yaml"),
        ("bell\x07.yaml", "bell\\x07.yaml"),
        ("lmay\u202e.yaml", "lmay\\u202e.yaml"),
        ("\u2066iso\u2069.yaml", "\\u2066iso\\u2069.yaml"),
        ("line\u2028.yaml", "line\\u2028.yaml"),
    ],
)
def test_names_do_not_act_on_the_terminal(tmp_path, name, shown):
    reported = opir(tmp_path, "validate", name, PYTHONIOENCODING="utf-8").stderr.decode()
    assert reported == f"opir: {shown}: 1 problem\n  there is no such file\n"


def test_the_name_of_a_scene_does_not_act_on_the_terminal(tmp_path):
    done = opir(tmp_path, "run", SCENE, "--set", 'scene="abc\u202edef"', PYTHONIOENCODING="utf-8")
    assert done.stdout.decode().startswith("abc\\u202edef: ")


def test_links_to_nowhere_are_reported_as_links(tmp_path):
    (tmp_path / "scene.yaml").symlink_to("gone.yaml")
    (tmp_path / "events.jsonl").symlink_to("gone/events.jsonl")
    assert (
        b"is a link to 'gone.yaml', which is not there"
        in opir(tmp_path, "validate", "scene.yaml").stderr
    )
    reported = opir(tmp_path, "run", SCENE, "-o", "events.jsonl").stderr
    assert (
        b"it is a link to 'gone/events.jsonl', whose folder is not there; remove it or give another path"
        in reported
    )
    (tmp_path / "events.jsonl").unlink()
    (tmp_path / "events.jsonl").symlink_to("real.jsonl")
    assert opir(tmp_path, "run", SCENE, "-o", "events.jsonl").returncode == 0
    assert (tmp_path / "real.jsonl").stat().st_size > 0
