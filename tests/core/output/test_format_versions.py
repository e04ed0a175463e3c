"""The promise of the formats: files of each version are read; of a greater minor version what is
known is read, with one warning; a greater major version is refused by name.

`tests/data/formats` has files as each version was written. They are never renewed.
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from json_lines import json_lines
from opir_readers.detections.events import event_rows
from opir_studies import load_study
from opir_testing import stub_sensor, stub_window
from repository import DATA

from opir_core.errors import SceneError
from opir_core.output import (
    ForgeEncoder,
    Heartbeats,
    detection_schema,
    heartbeat_schema,
    read_run,
    read_tracks,
    schema,
)
from opir_core.plugin import BadFileError, EncoderContext
from opir_core.reading import load_scene
from opir_core.reading.format_versions import (
    COMMAND_FORMAT,
    EVENT_FORMAT,
    FORMATS,
    HEARTBEAT_FORMAT,
    MANIFEST_FORMAT,
    STUDY_FORMAT,
    TRACK_FORMAT,
    TRUTH_FORMAT,
    Format,
)

GOLDEN = DATA / "formats"
RUNS = ("run-1", "run-2")
COUNTS = {"run-1": (16, 4), "run-2": (16, 4)}
ALL = pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)


def greater(kind: Format, by: tuple[int, int]) -> str:
    major, minor = map(int, kind.version.split("."))
    return f"{major + by[0]}.{minor + by[1] if by[0] == 0 else 0}"


def changed_lines(path: Path, change: dict[str, Any]) -> None:
    lines = json_lines(path)
    path.write_text(
        "".join(f"{json.dumps({**line, **change})}\n" for line in lines), encoding="utf-8"
    )


def changed_document(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    document.pop("written_files", None)  # digests are another test's
    change(document)
    path.write_text(json.dumps(document), encoding="utf-8")


def of_version(folder: Path, kind: Format, version: str) -> Path:
    """Return a copy of the files in which those of a format state a version, with a field that no
    version has.
    """
    name = "study-3" if kind is STUDY_FORMAT else "run-2"
    copy = Path(shutil.copytree(GOLDEN / name, folder / name))
    if kind is STUDY_FORMAT:
        changed_document(
            copy / "study.json", lambda study: study.update(study_version=version, later=[1])
        )
        return copy
    manifest = copy / "events.manifest.json"
    changed_document(manifest, lambda _: None)
    later = {"later_field": {"a": [1]}}
    if kind is MANIFEST_FORMAT:
        changed_document(
            manifest, lambda content: content.update(manifest_version=version, **later)
        )
    elif kind in (TRUTH_FORMAT, COMMAND_FORMAT):
        changed_lines(copy / f"events.{kind.name}.jsonl", later)
        changed_document(manifest, lambda content: content["formats"].update({kind.name: version}))
    else:
        path = copy / ("events.jsonl" if kind is EVENT_FORMAT else "events.tracks.jsonl")
        stated = f"tracks-{version}" if kind is TRACK_FORMAT else version
        changed_lines(path, {"schema_version": stated, **later})
    return copy


def read(folder: Path, kind: Format) -> Any:
    return load_study(folder) if kind is STUDY_FORMAT else read_run(folder / "events.jsonl")


@pytest.mark.parametrize("name", RUNS)
def test_runs_of_each_version_are_read(name: str, caplog: pytest.LogCaptureFixture) -> None:
    run = read_run(GOLDEN / name / "events.jsonl")
    assert (len(run.detections), len(run.tracks)) == COUNTS[name]
    assert set(run.truth.target.tolist()) == {0}
    assert run.tracks.impact_regions[-1]
    assert not caplog.records


def test_commands_are_read_with_their_run() -> None:
    commands = read_run(GOLDEN / "run-2" / "events.jsonl").commands
    assert [record.sensor for record in commands[:2]] == ["LEO-NARROW-02", "LEO-NARROW-05"]
    assert commands[0].from_s == 55.46371442464538
    assert commands[0].position_ecef_m is None
    assert read_run(GOLDEN / "run-1" / "events.jsonl").commands == ()


def test_the_versions_of_the_golden_files_are_those_that_they_are_named_for() -> None:
    stated = {
        name: json.loads((GOLDEN / name / "events.jsonl").read_text().splitlines()[0])
        for name in RUNS
    }
    assert [stated[name]["schema_version"] for name in RUNS] == ["1.0", "2.0"]
    track = json.loads((GOLDEN / "run-2" / "events.tracks.jsonl").read_text().splitlines()[0])
    assert track["schema_version"] == "tracks-2.0"


def test_a_study_of_each_version_is_read() -> None:
    assert load_study(GOLDEN / "study-3").runs.num_rows == 4


@ALL
def test_a_greater_minor_version_is_read_with_one_warning(
    kind: Format, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    version = greater(kind, (0, 7))
    folder = of_version(tmp_path, kind, version)
    result = read(folder, kind)
    (record,) = caplog.records
    assert f"{version}; this opir knows {kind.version}, and ignores" in record.getMessage()
    original = read(GOLDEN / folder.name, kind)
    if kind is STUDY_FORMAT:
        assert result.table.equals(original.table)
    else:
        assert result.detections.time_ns.tolist() == original.detections.time_ns.tolist()
        assert result.tracks.state.tobytes() == original.tracks.state.tobytes()
        assert result.commands == original.commands


@ALL
def test_a_greater_major_version_is_refused_by_name(kind: Format, tmp_path: Path) -> None:
    folder = of_version(tmp_path, kind, greater(kind, (1, 0)))
    with pytest.raises(SceneError) as refused:
        read(folder, kind)
    text = str(refused.value)
    assert f"{kind.name} version " in text
    assert f"{kind.version[0]}.x is read: run the scene anew, or read it with an opir as" in text


def test_a_later_event_is_named_whatever_it_lacks(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(GOLDEN / "run-2", tmp_path / "run"))
    events = folder / "events.jsonl"
    events.write_text('{"schema_version":"3.0","id":7}\n')
    with pytest.raises(SceneError, match=r"line 1: schema_version: of events version 3\.0, where"):
        read_run(events)


@pytest.mark.parametrize("version", ["", "two", "2.", "-1", True, [2], "9999999"])
def test_what_is_no_version_is_refused(version: object, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(GOLDEN / "run-2", tmp_path / "run"))
    changed_document(
        folder / "events.manifest.json", lambda content: content.update(manifest_version=version)
    )
    with pytest.raises(SceneError, match=r"manifest_version: .*is no version, such as 2\.1"):
        read_run(folder / "events.jsonl")


def test_a_scene_is_not_taken_from_a_later_manifest(tmp_path: Path) -> None:
    path = of_version(tmp_path, MANIFEST_FORMAT, "3.0") / "events.manifest.json"
    with pytest.raises(SceneError, match=r"manifest_version: of manifest version 3\.0, where 2\.x"):
        load_scene(path)
    assert load_scene(GOLDEN / "run-1" / "events.manifest.json").name == "golden"


def test_tracks_without_a_version_are_read(tmp_path: Path) -> None:
    path = tmp_path / "t.jsonl"
    path.write_text('{"time_s": 1.0, "track_id": 2}\n')
    assert read_tracks(path).track.tolist() == [2]


@pytest.mark.parametrize(("name", "golden"), [("detection", "2.0"), ("track", "1.0")])
def test_schemas_are_open_and_closed_ones_are_not(name: str, golden: str) -> None:
    file = "events.jsonl" if name == "detection" else None
    frozen = json.loads((GOLDEN / f"{name}-{golden}.schema.json").read_text(encoding="utf-8"))
    sample = (
        json.loads((GOLDEN / "run-2" / file).read_text().splitlines()[0])
        if file
        else {"schema_version": "tracks-1.0"}
    )
    later = {**sample, "later_field": 1, "schema_version": sample["schema_version"][:-1] + "7"}
    fields = frozen["required"] if file is None else []
    for text in (frozen, schema(name)):
        words = [error.message for error in _errors(text, later)]
        assert all("is a required property" in word for word in words)
        assert len(words) == max(0, len(fields) - 1)
    assert any(
        "later_field" in error.message for error in _errors(schema(name, is_closed=True), later)
    )


def _errors(document: dict[str, Any], value: object) -> list[Any]:
    return list(jsonschema.Draft202012Validator(document).iter_errors(value))


def test_what_is_written_follows_the_schemas_of_each_minor_version_before() -> None:
    """A reader that validates by the schema of 2.0 reads what this opir writes."""
    encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))
    event = json.loads(encoder.encode(stub_window(1)))
    frozen = json.loads((GOLDEN / "detection-2.0.schema.json").read_text(encoding="utf-8"))
    assert not _errors(frozen, event)
    assert set(frozen["required"]) <= set(detection_schema()["required"])
    for name, field in frozen["properties"].items():
        if name != "schema_version":
            assert _rules(detection_schema()["properties"][name]) == _rules(field)


def _rules(field: dict[str, Any]) -> dict[str, Any]:
    """Return what a field of a schema asks for, without the words that say what it means."""
    return {key: value for key, value in field.items() if key != "description"}


def test_other_programs_events_of_a_later_version_are_named() -> None:
    line = '{"schema_version":"%s","time_s":1.0,"sensor_id":"A","azimuth_deg":1,"elevation_deg":2}'
    with pytest.raises(BadFileError, match=r"line 1: schema_version: of events version 3\.1"):
        event_rows(line % "3.1")
    (row,) = event_rows(line % "2.4")
    assert row["notes"] == [EVENT_FORMAT.note("2.4")]


HEARTBEATS = GOLDEN / "heartbeat-1" / "events.jsonl"


def test_heartbeats_of_each_version_are_read() -> None:
    row = event_rows(HEARTBEATS.read_text())[0]
    assert [beat["sensor_id"] for beat in row["heartbeats"]] == ["WEST", "EAST", "WEST"]
    assert "notes" not in row


def test_heartbeats_of_later_versions_are_named() -> None:
    text = HEARTBEATS.read_text()
    later = '"schema_version":"%s","later_field":1,"record"'
    stated = '"schema_version":"1.0","record"'
    assert text.count(stated) == 3
    with pytest.raises(BadFileError, match=r"line 3: schema_version: of heartbeat version 2\.0"):
        event_rows(text.replace(stated, later % "2.0"))
    row = event_rows(text.replace(stated, later % "1.4"))[0]
    assert row["notes"] == [HEARTBEAT_FORMAT.note("1.4")]
    assert len(row["heartbeats"]) == 3


def test_the_schema_of_heartbeats_is_open_and_keeps_what_it_asked_for() -> None:
    frozen = json.loads((GOLDEN / "heartbeat-1.0.schema.json").read_text(encoding="utf-8"))
    (beat, *_) = [line for line in json_lines(HEARTBEATS) if line.get("record") == "heartbeat"]
    written = json.loads(Heartbeats((stub_sensor(),), 0, 1.0).until(1.0))
    for document in (frozen, heartbeat_schema()):
        assert not _errors(document, {**beat, "later_field": 1, "schema_version": "1.7"})
        assert not _errors(document, written)
        assert _errors(document, {"record": "heartbeat"})
