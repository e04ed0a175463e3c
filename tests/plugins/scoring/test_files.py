"""Files that are not of one run, are cut off or spoilt are refused, with the file, the place and
what to do.
"""

import json
import shutil

import numpy as np
import pytest
from opir_scoring import evidence_of_files
from scored_scene import SCENE

from opir_core.cli.main import main
from opir_core.errors import SceneError

REGION = {
    "containment": 0.5,
    "area_km2": 1.0,
    "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]},
}
PARTS = (".jsonl", ".truth.jsonl", ".tracks.jsonl", ".manifest.json")
DIFFERENT = "the files are of different runs, or one of them is cut off"


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return a folder with the files of two runs, of seeds 7 and 8, and a third whose launch lies
    elsewhere.
    """
    folder = tmp_path_factory.mktemp("runs")
    scene = folder / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 40.0}))
    for name, words in (
        ("one", []),
        ("two", ["--seed", "8"]),
        ("away", ["--set", "targets[0].launch.lat_deg=35.0"]),
    ):
        assert (
            main(["run", str(scene), "--quiet", "--out", str(folder / f"{name}.jsonl"), *words])
            == 0
        )
    return folder


@pytest.fixture
def copied(runs, tmp_path):
    for part in PARTS:
        shutil.copy(runs / f"one{part}", tmp_path / f"one{part}")
    return tmp_path / "one.jsonl"


def lines_of(path):
    return path.read_text().splitlines(keepends=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "message"),
    [
        (".jsonl", "is not in the truth"),
        (".truth.jsonl", "is not in the truth"),
        (".tracks.jsonl", "not the tracks of the manifest's run"),
        (".manifest.json", "not the tracks of the manifest's run"),
    ],
)
def test_a_file_of_another_run_is_refused(runs, copied, part, message):
    shutil.copy(runs / f"two{part}", copied.with_suffix(part))
    with pytest.raises(SceneError, match=f"{message}.*{DIFFERENT}"):
        evidence_of_files(copied)


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS[:3])
def test_a_file_that_ends_early_is_refused(copied, part):
    path = copied.with_suffix(part)
    path.write_text("".join(lines_of(path)[:-5]))
    with pytest.raises(SceneError, match=DIFFERENT):
        evidence_of_files(copied)
    path.write_text("")
    with pytest.raises(SceneError, match=DIFFERENT):
        evidence_of_files(copied)


def test_events_that_are_reported_twice_are_refused(copied):
    copied.write_text("".join(lines_of(copied) + lines_of(copied)[:3]))
    with pytest.raises(SceneError, match="3 detections appear twice"):
        evidence_of_files(copied)


def test_a_truth_of_another_launch_is_refused(runs, copied):
    reported = lines_of(copied.with_suffix(".truth.jsonl"))
    reported[0] = lines_of(runs / "away.truth.jsonl")[0]
    copied.with_suffix(".truth.jsonl").write_text("".join(reported))
    with pytest.raises(SceneError, match="T1 has another trajectory in the manifest's scene"):
        evidence_of_files(copied)
    reported[0] = reported[0].replace('"target_id":"T1"', '"target_id":"T9"')
    copied.with_suffix(".truth.jsonl").write_text("".join(reported))
    with pytest.raises(SceneError, match="the manifest's scene has no target T9"):
        evidence_of_files(copied)


@pytest.mark.slow
def test_external_tracks_are_scored_on_request(runs, copied, tmp_path):
    rows = lines_of(runs / "one.tracks.jsonl")
    # Rows in any order, but each region before the rows that refer to it.
    rows.sort(key=lambda row: '"impact_regions":' not in row)
    (tmp_path / "mine.jsonl").write_text("".join(rows))
    result = evidence_of_files(copied, tracks=tmp_path / "mine.jsonl").tracks
    assert np.array_equal(result.state, evidence_of_files(runs / "one.jsonl").tracks.state)


def test_a_track_reported_twice_at_a_tick_is_refused(runs, copied, tmp_path):
    rows = lines_of(runs / "one.tracks.jsonl")
    (tmp_path / "mine.jsonl").write_text("".join([*rows, rows[3]]))
    tick_s = json.loads(rows[3])["time_s"]
    with pytest.raises(
        SceneError,
        match=rf"line {len(rows) + 1}: track 0 has two rows at {tick_s:g} s; give one row",
    ):
        evidence_of_files(copied, tracks=tmp_path / "mine.jsonl")


def test_tracks_from_elsewhere_are_reported_by_their_file(runs, copied, tmp_path, capsys):
    (tmp_path / "mine.jsonl").write_text("".join(lines_of(runs / "one.tracks.jsonl")))
    assert main(["score", str(copied), "--tracks", str(tmp_path / "mine.jsonl")]) == 0
    text = capsys.readouterr().out
    assert "mine.jsonl" in text
    assert "imm" not in text


def test_files_may_lie_anywhere(runs, tmp_path, capsys):
    places = {name: tmp_path / f"{name}.x" for name in ("truth", "tracks", "manifest")}
    shutil.copy(runs / "one.jsonl", tmp_path / "events.jsonl")
    words = []
    for (name, path), part in zip(places.items(), PARTS[1:], strict=True):
        shutil.copy(runs / f"one{part}", path)
        words += [f"--{name}", str(path)]
    assert main(["score", str(tmp_path / "events.jsonl"), *words]) == 0
    assert "launches tracked" in capsys.readouterr().out


@pytest.mark.slow
def test_a_truth_that_burns_otherwise_is_refused(copied):
    """Launch and aim are the scene's; what lies between is the target model's, which may have
    changed since.
    """
    path = copied.with_suffix(".truth.jsonl")
    first, *remainder = lines_of(path)
    reported = json.loads(first)
    changed = (
        {"burnout_s": reported["burnout_s"] + 1.0},
        {"burnout": {**reported["burnout"], "lat_deg": 35.0}},
    )
    for change in changed:
        path.write_text("".join([json.dumps({**reported, **change}) + "\n", *remainder]))
        with pytest.raises(
            SceneError, match="T1 has another trajectory in the manifest's scene, with the plugins"
        ):
            evidence_of_files(copied)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (
            "manifest_version",
            "1",
            "manifest_version: of manifest version 1, where 2.x is read: run the scene anew",
        ),
        ("manifest_version", None, "manifest_version: None is no version, such as 2.1"),
        ("counts", 3, "counts: not what opir writes: counts must be a block"),
    ],
)
def test_a_manifest_of_another_shape_is_reported(copied, key, value, message):
    path = copied.with_suffix(".manifest.json")
    path.write_text(json.dumps({**json.loads(path.read_text()), key: value}))
    with pytest.raises(SceneError, match=message):
        evidence_of_files(copied)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("track_id", 1.5, "line 3: track_id: not what opir writes: expected `int`, got `float`"),
        ("track_id", None, "line 3: track_id: not what opir writes: expected `int`, got `null`"),
        ("time_s", None, "line 3: time_s: not what opir writes: expected `float`, got `null`"),
        (
            "position_ecef_m",
            [1.0, 2.0],
            "line 3: position_ecef_m: not what opir writes: expected `array` of length 3",
        ),
        (
            "position_ecef_m",
            ["far"] * 3,
            r"line 3: position_ecef_m\[0\]: not what opir writes: expected `float`",
        ),
        (
            "launch",
            {"lat_deg": 91.0, "lon_deg": 0.0},
            "line 3: launch.lat_deg: not what opir writes: expected `float` <=",
        ),
        (
            "impact",
            {"lat_deg": 1.0, "lon_deg": 0.0, "method": "x"},
            "line 3: impact.method: not what opir writes: inv",
        ),
        (
            "impact_regions",
            [{}],
            "line 3: impact_regions: not what opir writes: it has no 'geometry'",
        ),
        (
            "impact_regions",
            [REGION | {"geometry": {"type": "Point"}}],
            "line 3: impact_regions: .* a Point is no region",
        ),
        (
            "impact_regions",
            [REGION],
            "line 3: impact_regions: .* a ring is a list of at least four",
        ),
    ],
)
def test_a_spoilt_track_is_reported_with_its_line(copied, name, value, message):
    path = copied.with_suffix(".tracks.jsonl")
    rows = [json.loads(line) for line in lines_of(path)]
    rows[2][name] = value
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    with pytest.raises(SceneError, match=message):
        evidence_of_files(copied, tracks=path)


def test_lines_of_other_shapes_are_reported_with_what_is_due(copied):
    events = copied.read_text()
    copied.write_text('{"id": 3}\n')
    with pytest.raises(SceneError, match="line 1: is not an event of the encoder forge"):
        evidence_of_files(copied)
    copied.write_text(events)
    copied.with_suffix(".tracks.jsonl").write_text("{}\n")
    with pytest.raises(
        SceneError, match="line 1: not what opir writes: object missing required field `time_s`"
    ):
        evidence_of_files(copied, tracks=copied.with_suffix(".tracks.jsonl"))
