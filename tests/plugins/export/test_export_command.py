"""`opir export`: formats, paths, settings, and errors with place and remedy."""

from pathlib import Path

import polars as pl
import pytest
from command_line import main, run_command
from repository import EXAMPLES


@pytest.fixture(scope="module")
def events(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("run") / "events.jsonl"
    run_command("run {} --set duration_s=40 --out {} --quiet", EXAMPLES / "first_light.yaml", path)
    return path


def test_a_run_is_written_beside_it_by_default(
    events: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_command("export {} --to parquet", events)
    listed = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert listed[0] == events.parent / "first-light-parquet" / "detections.parquet"
    assert pl.read_parquet(listed[0]).height == len(events.read_text().splitlines()) > 0
    assert not [path for path in listed[0].parent.iterdir() if path not in listed]


def test_a_folder_is_a_run_and_a_path_and_settings_are_taken(events: Path, tmp_path: Path) -> None:
    out = tmp_path / "tables"
    run_command("export {} --to csv --out {} --set tables=targets", events.parent, out)
    assert [path.name for path in out.iterdir()] == ["targets.csv"]


def test_formats_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    run_command("export --list")
    lines = capsys.readouterr().out.splitlines()
    assert {"arrow", "csv", "parquet"} <= {line.split()[0] for line in lines[1:]}


@pytest.mark.parametrize(
    ("words", "code", "shown"),
    [
        ([], 2, ["RUN: is missing", "--to: is missing; give a format", "opir export --list"]),
        (["scene.yaml", "--to", "csv"], 2, ["is a scene: run it first, `opir run scene.yaml`"]),
        (["missing.jsonl", "--to", "csv"], 2, ["missing.manifest.json", "opir run"]),
        (["EVENTS", "--to", "prquet"], 3, ["no exporter is named 'prquet'", "nearest: parquet"]),
        (["EVENTS", "--to", "csv", "--set", "colour=red"], 2, ["colour: unknown key", "delimiter"]),
        (
            ["EVENTS", "--to", "csv", "--set", "tables=track"],
            2,
            ["tables", "no table is named 'track'", "tracks"],
        ),
        (
            ["EVENTS", "--to", "csv", "--out", "no/where/x"],
            5,
            ["no/where/x cannot be written", "create the folder"],
        ),
        (["EVENTS", "--to", "csv", "--out", "EVENTS"], 5, ["is a file; give the path of a folder"]),
    ],
)
def test_errors_name_the_place_and_the_remedy(
    events: Path, words: list[str], code: int, shown: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    command = [str(events) if word == "EVENTS" else word for word in words]
    assert main(["export", *command]) == code
    message = capsys.readouterr().err
    assert message.startswith("opir: ")
    assert all(text in message for text in shown), message
    assert "Traceback" not in message
