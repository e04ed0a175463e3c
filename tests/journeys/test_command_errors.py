"""What a user may type by mistake, and files that something else wrote: one clear message each, and
nothing lost.
"""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from repository import EXAMPLES

from opir_core.cli.error_report import report
from opir_core.cli.main import main
from opir_core.errors import (
    ModelError,
    OpirError,
    PluginError,
    SceneError,
    SinkError,
    install_command,
)
from opir_core.host import discovery

EXAMPLE = EXAMPLES / "first_light.yaml"


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    """Return the folder of a run with tracks."""
    folder = tmp_path_factory.mktemp("run")
    short = ["--set", "duration_s=20", "--tracker", "kepler-arc", "--quiet"]
    assert main(["run", str(EXAMPLE), *short, "--out", str(folder / "run.jsonl")]) == 0
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch, scored):
    """Return a working folder with a scene, the files of its run, and a folder."""
    shutil.copytree(scored, tmp_path, dirs_exist_ok=True)
    shutil.copy(EXAMPLE, tmp_path / "scene.yaml")
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    return tmp_path


def reported(capsys, *words, code):
    assert main(list(words)) == code
    message = capsys.readouterr().err
    assert message.startswith("opir: ")
    return message


RUN = ("run", "scene.yaml", "--quiet", "--set", "duration_s=20")
TRACKED = (*RUN, "--tracker", "kepler-arc")

WRITING = [
    (("--out", ""), 5, "the path is empty; give the path of a file"),
    (("--out", "/"), 5, "is a directory; give the path of a file in it"),
    (
        ("--out", "scene.yaml"),
        2,
        "the events would overwrite scene.yaml, the path of the scene; give another path",
    ),
    (("--out", "x", "--truth", "./x"), 2, "the truth would overwrite x, the path of the events"),
    (
        ("--out", "x", "--truth", "y", "--manifest", "y"),
        2,
        "the manifest would overwrite y, the path of the truth",
    ),
    (
        ("--out", "x", "--tracks", "y"),
        2,
        "--tracks: the tracker none makes no tracks; omit this option",
    ),
    (
        ("--out", "x", "--truth", "no/y"),
        5,
        "the truth file no/y cannot be written: no such file or directory; create",
    ),
    (
        ("--out", "x", "--truth", "folder"),
        5,
        "the truth file folder cannot be written: is a directory; give",
    ),
    (
        ("--out", "x", "--truth", "/dev/full"),
        5,
        "the truth file /dev/full cannot be written: no space left",
    ),
    (
        ("--out", "x", "--manifest", "no/y"),
        5,
        "the manifest no/y cannot be written: no such file or directory; create",
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize(("words", "code", "message"), WRITING)
def test_files_that_cannot_be_written_are_reported(
    folder,
    capsys,
    words,
    code,
    message,
):
    assert message in reported(capsys, *RUN, *words, code=code)
    assert (folder / "scene.yaml").read_bytes() == EXAMPLE.read_bytes()


@pytest.mark.parametrize("path", ["/dev/full", "no/y", "folder"])
def test_tracks_that_cannot_be_written_are_reported(folder, capsys, path):
    message = reported(capsys, *TRACKED, "--out", "x", "--tracks", path, code=5)
    assert f"the tracks file {path} cannot be written: " in message


def test_what_keeps_nothing_may_take_several(folder):
    assert (
        main([*RUN, "--out", "/dev/null", "--truth", "/dev/null", "--manifest", "/dev/null"]) == 0
    )


TRACKS = "run.tracks.jsonl"
TRUTH = "run.truth.jsonl"
EVENTS = "run.jsonl"
MANIFEST = "run.manifest.json"

BROKEN = [
    (
        TRACKS,
        r'"time_s":[0-9.]+',
        '"time_s":"x"',
        "line 1: time_s: not what opir writes: expected `float`",
    ),
    (
        TRACKS,
        r'"track_id":[0-9]+',
        '"track_id":null',
        "line 1: track_id: not what opir writes: expected `int`",
    ),
    (
        TRACKS,
        r'"track_id":[0-9]+',
        '"track_id":1e300',
        "line 1: track_id: not what opir writes: expected `int`",
    ),
    (
        TRACKS,
        r'"track_id":[0-9]+',
        '"track_id":99999999999999999999',
        "line 1: track_id: not what opir writes: ",
    ),
    (TRACKS, r'\A([^\n]*?"time_s":)[0-9.]+', r"\g<1>0.5", "line 2: since_s: no line has track 0"),
    (TRACKS, r'"time_s":[0-9.]+', '"time_s":7.5', "line 2: since_s: no line has track 0"),
    (
        TRACKS,
        r'(_ecef_m":)\[[^]]*\]',
        r"\1[1]",
        "line 1: position_ecef_m: not what opir writes: expected `array` of length",
    ),
    (TRUTH, r'"target_id":"T1"', '"target_id":[]', "line 1: is not a line of opir's truth"),
    (TRUTH, r'"detection_id"', '"x"', "is not in the truth: the files are of different runs"),
    (EVENTS, r'"timestamp":"[^"]*"', '"timestamp":"x"', "timestamp: is not a timestamp of opir"),
    (
        EVENTS,
        r'"sensor_id":"[^"]*"',
        '"sensor_id":"X"',
        "has no sensor X: the files are of different runs",
    ),
    (MANIFEST, r"(?s)\A.*", "[]", "not what opir writes: a manifest has a block scene"),
    (MANIFEST, r"(?s)\A.*", "{}", "not what opir writes: a manifest has a block scene"),
    (MANIFEST, r"(?s)\A.*", "{", "not what opir writes: "),
]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "pattern", "other", "message"), BROKEN)
def test_a_run_s_files_that_something_else_wrote_are_reported(
    folder,
    capsys,
    name,
    pattern,
    other,
    message,
):
    written = (folder / name).read_text()
    broken = re.sub(pattern, other, written)
    assert broken != written
    (folder / name).write_text(broken)
    assert re.search(
        rf"opir: run\.\S+: 1 problem\n.*{re.escape(message)}",
        reported(capsys, "score", EVENTS, code=2),
    )


def test_scores_of_what_is_no_run_are_refused(folder, capsys):
    assert "is not a file of events" in reported(capsys, "score", "", code=2)
    (folder / TRACKS).unlink()
    assert "there is no tracks file" in reported(capsys, "score", EVENTS, code=2)


TABLE = "time_s,x_ecef_m,y_ecef_m,z_ecef_m\n0,{x},0,0\n10,7e6,1,0\n"


def test_tables_that_are_none_are_reported(folder, capsys):
    for x in ("1e300", "7e12"):
        (folder / "far.csv").write_text(TABLE.format(x=x))
        assert "beyond the Moon; check its units" in _reported_of_table(capsys, "far.csv")
    assert "targets[0].file: the path is empty" in _reported_of_table(capsys, "")


def test_sources_that_are_none_are_reported(folder, capsys):
    (folder / "fires.csv").write_bytes(b"lat_deg,lon_deg\n\xff,0\n")
    for path, words in (
        ("fires.csv", "fires.csv, line 2: is not UTF-8 text"),
        ("", "the path is empty"),
    ):
        sources = json.dumps([{"id": "F", "model": "fires", "csv": path}])
        message = reported(
            capsys, *RUN, "--set", f"sources={sources}", "--set", "detection=snr", code=2
        )
        assert "sources[0].csv: " in message
        assert words in message


def _reported_of_table(capsys, file):
    target = json.dumps([{"id": "A", "model": "table", "type": "ICBM", "file": file}])
    return reported(capsys, *RUN, "--set", f"targets={target}", code=2)


def test_a_command_that_is_none_is_reported_all_that_are(
    capsys,
):
    with pytest.raises(SystemExit) as exit_info:
        main(["srve"])
    assert exit_info.value.code == 2
    assert "'serve'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "package"),
    [
        (("serve", "scene.yaml"), "opir-http"),
        (("doctor",), "opir-http"),
        (("spool", "check", "events.spool"), "opir-kafka"),
        (("score", "events.jsonl"), "opir-scoring"),
        ((*RUN, "--sink", "kafka"), "opir-kafka"),
        ((*RUN, "--sink", "cot"), "opir-displays"),
        ((*RUN, "--tracker", "imm"), "opir-trackers"),
        (("describe", "SBIRS-GEO"), "opir-sbirs"),
    ],
)
def test_a_missing_package_of_this_project_is_named(
    folder,
    capsys,
    monkeypatch,
    words,
    package,
):
    monkeypatch.setattr(discovery, "distributions_with", lambda groups: [])
    message = reported(capsys, *words, code=3)
    assert f"{package} provides it; {install_command(package)}" in message


@pytest.mark.parametrize(
    ("words", "usage", "error"),
    [
        (
            (*RUN, "--seeds", "4"),
            "usage: opir run ",
            "opir run: error: unrecognized arguments: --seeds 4; the nearest is '--seed'",
        ),
        (
            (*RUN, "--trackr=imm"),
            "usage: opir run ",
            "opir run: error: unrecognized arguments: --trackr=imm; the nearest is '--tracker'",
        ),
        ((*RUN, "-z"), "usage: opir run ", "opir run: error: unrecognized arguments: -z"),
        (
            ("validate", "scene.yaml", "more"),
            "usage: opir validate ",
            "opir validate: error: unrecognized arguments: more",
        ),
        (
            ("plugins", "--lenght-12345678"),
            "usage: opir plugins ",
            "opir plugins: error: unrecognized arguments: --lenght-12345678",
        ),
    ],
)
def test_an_unknown_option_is_refused_with_the_usage_of_its_command(
    folder, capsys, words, usage, error
):
    with pytest.raises(SystemExit) as exit_info:
        main(list(words))
    message = capsys.readouterr().err
    assert exit_info.value.code == 2
    assert message.startswith(usage)
    assert message.endswith(f"\n{error}\n")


@pytest.mark.parametrize(
    "words", [("-q", "-o", "short.jsonl"), ("--quiet", "--out", "short.jsonl")]
)
def test_common_options_have_letters(folder, capsys, words):
    assert main(["run", "scene.yaml", "--set", "duration_s=12", *words]) == 0
    assert capsys.readouterr() == ("", "")
    assert Path("short.jsonl").is_file()


def test_the_help_lists_the_exit_codes(capsys):
    with pytest.raises(SystemExit):
        main(["--help"])
    listed = set(re.findall(r"^  (\d+)  +\w", capsys.readouterr().out, re.MULTILINE))
    errors = (OpirError, SceneError, PluginError, ModelError, SinkError)
    assert listed == {"0", "6", "130", "141", *(str(error.exit_code) for error in errors)}


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
@pytest.mark.parametrize("words", [("plugins",), ("explain", str(EXAMPLE)), ("run", str(EXAMPLE))])
def test_a_full_standard_output_is_an_output_that_failed(words, tmp_path):
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        command = [sys.executable, "-m", "opir_core", *words]
        done = subprocess.run(
            command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert (done.returncode, done.stderr) == (
        5,
        "opir: stdout cannot be written: no space left on device\n",
    )


@pytest.mark.parametrize("cause", [None, MemoryError("Unable to allocate 3.2 GiB")])
def test_a_lack_of_memory_is_told_with_the_way_out(
    cause: MemoryError | None, capsys: pytest.CaptureFixture[str]
) -> None:
    error: Exception = MemoryError("Unable to allocate 3.2 GiB")
    if cause is not None:
        error = ModelError("detection: snr: build raised MemoryError")
        error.__cause__ = cause
    assert report(error) == SceneError.exit_code
    words = capsys.readouterr().err
    assert words.startswith("opir: not enough memory: MemoryError: Unable to allocate 3.2 GiB")
    assert "shorter duration_s" in words
    assert "--debug" not in words
