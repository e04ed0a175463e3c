"""`opir run --workers` to Parquet: the same bytes, and a sink that fails fails alone, with its
counts.
"""

from pathlib import Path

import pytest
from exported_runs import SCENE
from opir_export.parquet_sink import ParquetSink

import opir_core
from opir_core.errors import SinkError
from opir_core.output import RunOutcome, deliver
from opir_core.simulation import run


def delivered(folder: Path, workers: int) -> RunOutcome:
    """Run a short scene into events and truth as columns, with row groups that windows do not
    fill.
    """
    output = f"outputs=[{{parquet: {{path: {folder / 'events.parquet'}, row_group_rows: 700}}}}]"
    scene = opir_core.load_scene(SCENE, overrides=[output, "duration_s=75", "tracker=none"])
    return deliver(
        opir_core.compile_plan(scene), truth_path=folder / "events.truth.parquet", workers=workers
    )


@pytest.fixture(autouse=True)
def many_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "LOOKS_PER_WINDOW", 900)


def test_one_two_and_three_workers_write_the_same_bytes(tmp_path: Path) -> None:
    written = []
    for workers in (1, 2, 3):
        folder = tmp_path / str(workers)
        folder.mkdir()
        delivered(folder, workers).raise_for_failures()
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert sorted(written[0]) == ["events.parquet", "events.truth.parquet"]
    assert written[0] == written[1] == written[2]


def full(*_: object) -> None:
    raise SinkError("the disk is full")


@pytest.mark.parametrize("method", ["write", "close"])
def test_a_failing_sink_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    monkeypatch.setattr(ParquetSink, method, full)
    outcome = delivered(tmp_path, 2)
    report = outcome.report.sinks[0]
    assert "the disk is full" in str(report.error)
    assert report.dropped == outcome.summary["counts"]["detections"] > 0
    assert not (tmp_path / "events.parquet").exists()
