"""The truth of a run as columns: what is in memory, in row groups, with the records of sensors and
targets.
"""

import json
from pathlib import Path
from typing import Any
from uuid import UUID

import numpy as np
import pyarrow as pa
import pytest
from command_line import main, run_command
from exported_runs import SCENE
from json_lines import json_lines
from opir_export.parquet_truth import read_truth
from pyarrow import parquet

import opir_core
from opir_core.errors import install_command
from opir_core.output import FILES_KEY
from opir_core.output.run_files import truth_records


def texts(ids: Any) -> list[str]:
    """Return the 16 bytes of ids as texts, as the standard library has them."""
    return [str(UUID(bytes=identity)) for identity in ids.to_pylist()]


def test_truth_is_that_of_the_run(tmp_path: Path) -> None:
    path = tmp_path / "events.truth.parquet"
    scene = opir_core.load_scene(SCENE, overrides=["duration_s=70", "tracker=none"])
    settings = [
        "--set",
        "duration_s=70",
        "--set",
        "tracker=none",
        "--out",
        str(tmp_path / "events.jsonl"),
    ]
    assert main(["run", str(SCENE), "--quiet", "--truth", str(path), *settings]) == 0
    run = opir_core.simulate(scene)
    read = parquet.read_table(path)
    expected = run.tables()["truth"]
    assert read.column_names == expected.column_names
    assert len(read) == len(expected) > 1000
    for name in expected.column_names:
        values = texts(read[name]) if name == "detection_id" else read[name].to_pylist()
        assert values == expected[name].to_pylist(), name
    assert read.schema.field("detection_id").type == pa.binary(16)
    ids = [row["detection_id"] for row in read_truth(path) if row["record"] == "detection"]
    assert ids == expected["detection_id"].to_pylist()
    assert json.loads(read.schema.metadata[b"opir_truth"]) == json.loads(
        json.dumps(truth_records(run.plan))
    )


@pytest.mark.slow
def test_a_run_with_columns_of_truth_is_read_back(tmp_path: Path) -> None:
    settings = ["--set", "duration_s=70", "--set", "tracker=none", "--quiet"]
    for name, ending in (("lines", "jsonl"), ("columns", "parquet")):
        folder = tmp_path / name
        folder.mkdir()
        files = [
            "--out",
            str(folder / "events.jsonl"),
            "--truth",
            str(folder / f"events.truth.{ending}"),
        ]
        assert main(["run", str(SCENE), *files, *settings]) == 0
    lines, columns = (opir_core.load_run(tmp_path / name) for name in ("lines", "columns"))
    assert len(columns.truth) == len(lines.truth) > 1000
    assert np.array_equal(columns.truth.target, lines.truth.target)
    for name in ("emission_time_s", "range_m", "target_elevation_rad", "probability"):
        assert np.allclose(
            getattr(columns.truth, name),
            getattr(lines.truth, name),
            rtol=0.0,
            atol=1e-3,
            equal_nan=True,
        )
    assert (
        opir_core.load_run(tmp_path / "columns" / "events.truth.parquet").summary == columns.summary
    )


@pytest.mark.slow
def test_files_with_ids_as_texts_are_read_as_those_with_bytes(tmp_path: Path) -> None:
    """As opir wrote them before: the same columns, but texts of 36 characters, compressed."""
    files = [tmp_path / "new" / name for name in ("events.parquet", "events.truth.parquet")]
    older = tmp_path / "old"
    for folder in (files[0].parent, older):
        folder.mkdir()
    words = ["--quiet", "--set", "duration_s=70", "--set", "tracker=none"]
    assert main(["run", str(SCENE), *words, "--out", str(files[0]), "--truth", str(files[1])]) == 0
    manifest = json.loads((files[0].parent / "events.manifest.json").read_text(encoding="utf-8"))
    del manifest[FILES_KEY]  # digests of the files that are written anew here
    (older / "events.manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    for path in files:
        table = parquet.read_table(path)
        column = table.column_names.index("detection_id")
        table = table.set_column(column, "detection_id", pa.array(texts(table["detection_id"])))
        parquet.write_table(table, older / path.name, compression="zstd")
    new, old = (
        opir_core.load_run(folder / "events.parquet") for folder in (files[0].parent, older)
    )
    assert len(new.detections) == len(old.detections) > 1000
    assert np.array_equal(new.detections.detection_id, old.detections.detection_id)
    for name in ("target", "range_m"):
        assert np.array_equal(getattr(new.truth, name), getattr(old.truth, name))
    assert old.summary == new.summary


def test_a_file_that_is_no_truth_is_refused_with_its_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "events.truth.parquet"
    outputs = f"outputs=[{{parquet: {{path: {tmp_path / 'events.parquet'}}}}}]"
    words = [
        "run",
        str(SCENE),
        "--quiet",
        "--set",
        "duration_s=70",
        "--set",
        "tracker=none",
        "--set",
        outputs,
    ]
    assert main([*words, "--truth", str(path)]) == 0
    for content in (b"", (tmp_path / "events.parquet").read_bytes()):
        path.write_bytes(content)
        capsys.readouterr()
        run_command("score {}", tmp_path / "events.parquet", code=2)
        reported = capsys.readouterr().err
        assert "events.truth.parquet" in reported
        assert "cannot be read" in reported
        assert "Traceback" not in reported


@pytest.mark.slow
def test_ids_and_bands_are_those_of_the_events(tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    outputs = (
        f"outputs=[{{jsonl: {{path: {events}}}}}, {{parquet: {{path:"
        f" {tmp_path / 'events.parquet'}}}}}]"
    )
    settings = ["--set", "duration_s=70", "--set", "tracker=none", "--set", outputs]
    assert main(["run", str(SCENE), "--quiet", *settings]) == 0
    lines = json_lines(events)
    read = parquet.read_table(tmp_path / "events.parquet")
    assert read.schema.field("detection_id").type == pa.binary(16)
    assert texts(read["detection_id"]) == [line["detection_id"] for line in lines]
    assert read["bands"].to_pylist() == ["+".join(line["bands"]) for line in lines]
    assert np.allclose(read["azimuth_deg"], [line["azimuth_deg"] for line in lines], atol=1e-9)


def test_without_opir_export_the_message_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("OPIR_PLUGINS", "dsp,sbirs,nextgen,forecast,trackers")
    path = tmp_path / "truth.parquet"
    run_command(
        "run {} --quiet --truth {} --out {}", SCENE, path, tmp_path / "events.jsonl", code=3
    )
    reported = capsys.readouterr().err
    assert "a truth file with the ending .parquet: no sink is named 'parquet'" in reported
    assert f"opir-export provides it; {install_command('opir-export')}" in reported
    assert not list(tmp_path.iterdir())
