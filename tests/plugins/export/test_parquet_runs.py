"""A run whose events are Parquet is read back as one of JSON lines is, and scored and reported."""

import json
from pathlib import Path

import numpy as np
import pytest
from exported_runs import SCENE
from pyarrow import parquet

import opir_core
from opir_core.cli.main import main
from opir_core.errors import SceneError

ENCODED = ('jsonl: {path: "%s/lines/events.jsonl", encoder: forge-bands}', 'parquet: {path: "%s/events.parquet"}')


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with the same run as Parquet and, in `lines`, as JSON lines."""
    made = tmp_path_factory.mktemp("run")
    (made / "lines").mkdir()
    for output in ENCODED:
        words = ("--set", "duration_s=70", "--set", f"outputs=[{{{output % made}}}]", "--quiet")
        assert main(["run", str(SCENE), *words]) == 0
    return made


@pytest.mark.slow
def test_both_files_give_the_same_run(folder: Path) -> None:
    columns, lines = opir_core.load_run(folder), opir_core.load_run(folder / "lines")
    mine, theirs = columns.detections, lines.detections
    assert len(mine) == len(theirs) > 1000
    exact = ("time_ns", "reported_ns", "sensor", "detection_id", "reported_type", "bands", "detection_count", "track")
    for name in exact:
        assert np.array_equal(getattr(mine, name), getattr(theirs, name)), name
    for name, error in (("line_of_sight_ecef", 1e-10), ("sensor_ecef_m", 1e-3), ("confidence", 1e-6), ("snr", 1e-3)):
        assert np.allclose(getattr(mine, name), getattr(theirs, name), rtol=1e-6, atol=error, equal_nan=True), name
    assert mine.band_irradiance_w_m2.shape == theirs.band_irradiance_w_m2.shape
    assert np.allclose(mine.band_irradiance_w_m2, theirs.band_irradiance_w_m2, rtol=1e-4, equal_nan=True)
    assert (mine.scan >= 0).all()
    assert np.array_equal(columns.truth.target, lines.truth.target)
    assert np.array_equal(columns.tracks.state, lines.tracks.state)
    assert columns.summary["counts"] == lines.summary["counts"]


@pytest.mark.slow
def test_it_is_scored(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cards = []
    for path in (folder / "events.parquet", folder / "lines" / "events.jsonl"):
        assert main(["score", str(path), "--json"]) == 0
        cards.append(json.loads(capsys.readouterr().out))
    assert cards[0]["purity"] == cards[1]["purity"]
    assert cards[0]["launches_tracked"] == cards[1]["launches_tracked"]


@pytest.mark.slow
def test_a_file_that_is_another_is_refused_with_its_path(folder: Path, tmp_path: Path) -> None:
    for name in ("events.truth.jsonl", "events.tracks.jsonl", "events.manifest.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "events.parquet").write_bytes(b"PAR1 is not enough PAR1")
    with pytest.raises(SceneError, match=r"events.parquet.*\n.*cannot be read: "):
        opir_core.load_run(tmp_path)
    table = parquet.read_table(folder / "events.parquet")
    parquet.write_table(table.drop_columns(["snr"]), tmp_path / "events.parquet")
    with pytest.raises(SceneError, match="it lacks the column snr"):
        opir_core.load_run(tmp_path)
    parquet.write_table(table.slice(0, table.num_rows - 1), tmp_path / "events.parquet")
    with pytest.raises(SceneError, match="is not among the events"):
        opir_core.load_run(tmp_path)
