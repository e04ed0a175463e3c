"""A study or a run is made again from its folder, on another machine and in shards, with the same
bytes.
"""

import json
import shutil

import pytest
from attrs import evolve
from opir_studies import Shard, Study, merged, read_study, rerun, sweep, sweep_shard
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main
from opir_core.errors import SceneError

FILES = (
    "results.parquet",
    "results.csv",
    "runs.parquet",
    "launches.parquet",
    "shares.parquet",
    "shares.csv",
)
STUDY = f"""\
study: again
scene: scene.yaml
overrides: {{duration_s: 4}}
vary: {{"{PERIOD}": [1000, 3000]}}
conditions: {{epoch: {{named: {{day: "2026-04-01T20:00:00Z", night: "{SCENE["epoch"]}"}}}}}}
runs: 8
metrics: [latency]
requirements: ["detected within 2 s in 60 % of launches, in every condition"]
executor: serial
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("written")
    (folder / "scene.yaml").write_text(json.dumps(SCENE), encoding="utf-8")
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    return read_study(folder / "study.yaml")


@pytest.fixture(scope="module")
def whole(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "study"
    sweep(study, folder)
    return folder


def contents(folder):
    return [(folder / name).read_bytes() for name in FILES]


def test_a_study_is_made_again_from_its_folder_alone(whole, tmp_path):
    moved = tmp_path / "moved"
    moved.mkdir()
    shutil.copy(whole / "study.json", moved)
    result = rerun(moved, tmp_path / "again", workers=1)
    assert (set(result.same), result.different) == (set(FILES), ())
    assert contents(tmp_path / "again") == contents(whole)
    assert json.loads((tmp_path / "again" / "study.json").read_text()) == json.loads(
        (whole / "study.json").read_text()
    )


def test_what_differs_is_said_with_the_reason(whole, tmp_path, capsys):
    definition = json.loads((whole / "study.json").read_text())
    definition["versions"]["numpy"] = "1.0"
    definition["made_of"]["runs"] = 7
    (tmp_path / "study.json").write_text(json.dumps(definition))
    code = main(["rerun", str(tmp_path), "-o", str(tmp_path / "again"), "--workers", "1"])
    printed = capsys.readouterr().out
    assert code == 4
    assert "0 of 6 files have the same bytes" in printed
    assert "because: numpy was 1.0, and is" in printed


def test_a_run_is_made_again_from_its_manifest(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(json.dumps(SCENE), encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "events.jsonl", "--set", "tracker=imm", "-q"]) == 0
    assert main(["rerun", "events.manifest.json"]) == 0
    assert "3 of 3 files have the same bytes" in capsys.readouterr().out
    # A manifest is a scene: every command that reads scenes reads it.
    assert main(["run", "events.manifest.json", "-o", "other.jsonl", "-q"]) == 0
    assert (tmp_path / "other.jsonl").read_bytes() == (tmp_path / "events.jsonl").read_bytes()


def test_commands_to_sensors_are_made_again_too(tmp_path, monkeypatch, capsys):
    spot = {"model": "generic-pointed", "id": "SPOT", "orbital_slot_deg": -120.0}
    director = {"model": "round-robin", "places_deg": [[34.7, -120.6]], "dwell_s": 2.0}
    scene = {**SCENE, "sensors": [{**spot, "modes": {"fast": {"scan_period_ms": 50.0}}}]}
    scene["director"] = {**director, "mode": "fast"}
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.yaml").write_text(json.dumps(scene), encoding="utf-8")
    assert main(["run", "scene.yaml", "-o", "events.jsonl", "-q"]) == 0
    assert main(["rerun", "events.manifest.json"]) == 0
    assert "3 of 3 files have the same bytes" in capsys.readouterr().out


@pytest.mark.parametrize("count", [1, 3, 7])
def test_shards_are_the_whole_in_any_order(study, whole, tmp_path, count):
    folders = [tmp_path / f"shard{place}" for place in range(count)]
    numbers = [
        sweep_shard(study, folder, Shard(place, count)) for place, folder in enumerate(folders)
    ]
    assert sum(numbers) == 2 * 2 * 8
    merged(folders[::-1], tmp_path / "all")
    assert contents(tmp_path / "all") == contents(whole)


def test_a_shard_that_was_killed_makes_only_what_it_lacks(study, tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(
        "opir_studies.sweeping.SweepState._keep",
        lambda _state, _place, result: made.extend(result.records),
    )
    sweep_shard(study, tmp_path, Shard(0, 2))
    monkeypatch.undo()
    assert len(made) == 2 * 2 * 4
    assert sweep_shard(study, tmp_path, Shard(0, 2)) == 16
    again = []
    monkeypatch.setattr("opir_studies.sweeping.result_of", again.append)
    assert sweep_shard(study, tmp_path, Shard(0, 2)) == 16
    assert again == []


def test_shards_of_different_studies_are_refused(study, tmp_path):
    sweep_shard(study, tmp_path / "a", Shard(0, 2))
    sweep_shard(evolve(study, runs=9), tmp_path / "b", Shard(1, 2))
    with pytest.raises(SceneError, match="a shard of another study"):
        merged([tmp_path / "a", tmp_path / "b"], tmp_path / "all")
    with pytest.raises(SceneError, match="is no shard of a study"):
        merged([tmp_path / "a", tmp_path], tmp_path / "all")


@pytest.mark.parametrize("text", ["0/3", "4/3", "1", "a/b", "-1/2"])
def test_a_shard_is_one_of_a_number(text):
    with pytest.raises(SceneError, match="is not I/N"):
        Shard.of(text)


def test_a_study_that_stops_early_has_no_shards(study, tmp_path):
    with pytest.raises(SceneError, match="does not know when"):
        sweep_shard(evolve(study, until="latency_s:1%"), tmp_path, Shard(0, 2))


@pytest.mark.parametrize("name", ["nothing", "empty"])
def test_a_folder_without_study_or_run_is_refused(tmp_path, name):
    (tmp_path / "empty").mkdir()
    with pytest.raises(SceneError, match="no study"):
        rerun(tmp_path / name, tmp_path / "again")


def test_a_study_of_python_is_made_again_too(tmp_path):
    study = Study(scene=SCENE, study="s", vary={PERIOD: (400, 800)}, runs=2, executor="serial")
    sweep(study, tmp_path / "a")
    assert rerun(tmp_path / "a", tmp_path / "b", workers=1).different == ()
