"""A run whose events are Parquet is read back as one of JSON lines is, and scored and reported."""

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import main, run_command
from exported_runs import SCENE
from pyarrow import parquet
from repository import EXAMPLES

import opir_core
from opir_core.errors import SceneError

ENCODED = (
    'jsonl: {path: "%s/lines/events.jsonl", encoder: forge-bands}',
    'parquet: {path: "%s/events.parquet"}',
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a folder with the same run as Parquet and, in `lines`, as JSON lines."""
    root = tmp_path_factory.mktemp("run")
    (root / "lines").mkdir()
    for output in ENCODED:
        words = ("--set", "duration_s=70", "--set", f"outputs=[{{{output % root}}}]", "--quiet")
        assert main(["run", str(SCENE), *words]) == 0
    return root


@pytest.mark.slow
def test_both_files_give_the_same_run(folder: Path) -> None:
    columns = opir_core.load_run(folder)
    lines = opir_core.load_run(folder / "lines")
    from_columns = columns.detections
    from_lines = lines.detections
    assert len(from_columns) == len(from_lines) > 1000
    exact = (
        "time_ns",
        "reported_ns",
        "sensor",
        "detection_id",
        "reported_type",
        "bands",
        "detection_count",
        "track",
    )
    for name in exact:
        assert np.array_equal(getattr(from_columns, name), getattr(from_lines, name)), name
    for name, error in (
        ("line_of_sight_ecef", 1e-10),
        ("sensor_ecef_m", 1e-3),
        ("confidence", 6e-5),
        ("snr", 6e-3),
    ):
        assert np.allclose(
            getattr(from_columns, name),
            getattr(from_lines, name),
            rtol=1e-6,
            atol=error,
            equal_nan=True,
        ), name
    assert from_columns.band_irradiance_w_m2.shape == from_lines.band_irradiance_w_m2.shape
    assert np.allclose(
        from_columns.band_irradiance_w_m2,
        from_lines.band_irradiance_w_m2,
        rtol=1e-4,
        equal_nan=True,
    )
    assert (from_columns.scan >= 0).all()
    assert np.array_equal(columns.truth.target, lines.truth.target)
    assert np.array_equal(columns.tracks.state, lines.tracks.state)
    assert columns.summary["counts"] == lines.summary["counts"]


@pytest.mark.slow
def test_it_is_scored(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cards = []
    for path in (folder / "events.parquet", folder / "lines" / "events.jsonl"):
        run_command("score {} --json", path)
        cards.append(json.loads(capsys.readouterr().out))
    assert cards[0]["purity"] == cards[1]["purity"]
    assert cards[0]["launches_tracked"] == cards[1]["launches_tracked"]


@pytest.mark.slow
def test_a_file_that_is_another_is_refused_with_its_path(folder: Path, tmp_path: Path) -> None:
    for name in ("events.truth.parquet", "events.tracks.jsonl", "events.manifest.json"):
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


@pytest.mark.parametrize("name", ["e.parquet", "E.PARQUET"])
def test_the_command_writes_columns_to_a_path_that_ends_so(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run_command("run {} --set duration_s=20 -q -o {}", EXAMPLES / "first_light.yaml", name)
    stem = name.partition(".")[0]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        [name, f"{stem}.manifest.json", f"{stem}.truth.parquet"]
    )
    rows = parquet.read_table(name).num_rows
    assert (
        rows
        == parquet.read_table(f"{stem}.truth.parquet").num_rows
        == len(opir_core.load_run(name).detections)
        > 10
    )


def test_a_run_over_another_is_read_with_its_own_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = ["run", str(EXAMPLES / "first_light.yaml"), "-q", "--set", "duration_s=20"]
    assert main([*run, "-o", "e.jsonl", "--seed", "3"]) == 0
    assert main([*run, "-o", "e.parquet", "--seed", "4"]) == 0
    assert opir_core.load_run("e.parquet").manifest["scene"]["seed"] == 4
    with pytest.raises(SceneError, match="the files are of different runs"):
        opir_core.load_run("e.jsonl")


def test_a_file_of_columns_under_another_name_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run_command("run {} -q --set duration_s=20 -o e.parquet", EXAMPLES / "first_light.yaml")
    for ending in (".parquet", ".truth.parquet", ".manifest.json"):
        Path(f"e{ending}").rename(f"f{ending}")
    assert len(opir_core.load_run("f.parquet").detections) > 10
