"""The key `spool` of an output: read like any setting, kept in the manifest, an option of every
sink.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from repository import EXAMPLES

from opir_core import compile_plan
from opir_core.cli.main import main
from opir_core.errors import PluginError, SceneError, SinkError
from opir_core.output import deliver
from opir_core.output.spool import Journal
from opir_core.plugin import Host, SinkModel, hookimpl, text
from opir_core.reading import load_scene, scene_from_mapping, scene_hash, scene_mapping

SCENE = str(EXAMPLES / "first_light.yaml")


def run(*words: str) -> int:
    return main(["run", SCENE, "--quiet", *words])


def spool_setting(tmp_path: Path, **settings: Any) -> str:
    return json.dumps({"path": str(tmp_path / "spool"), **settings})


@pytest.mark.parametrize("sink", ["jsonl", "memory", "null"])
def test_every_sink_can_have_a_spool(tmp_path: Path, sink: str) -> None:
    out = f"outputs[0].jsonl.path={tmp_path / 'events.jsonl'}"
    more = ["--set", out] if sink == "jsonl" else []
    assert (
        run("--sink", sink, *more, "--set", f"outputs[0].{sink}.spool={spool_setting(tmp_path)}")
        == 0
    )
    journal = Journal(str(tmp_path / "spool"), 1 << 20)
    assert journal.waiting == 0
    journal.close()


def test_with_a_spool_the_same_lines_arrive(tmp_path: Path) -> None:
    plain = tmp_path / "plain.jsonl"
    selected = tmp_path / "kept.jsonl"
    assert run("--out", str(plain)) == 0
    for _ in range(2):
        spool = f"outputs[0].jsonl.spool={spool_setting(tmp_path)}"
        assert run("--out", str(selected), "--set", spool) == 0
    assert selected.read_bytes() == 2 * plain.read_bytes()


def test_a_scene_with_a_spool_is_written_out_and_read_back(tmp_path: Path) -> None:
    setting = f'outputs=[{{"null": {{"spool": {spool_setting(tmp_path, max_bytes=5_000_000)}}}}}]'
    scene = load_scene(SCENE, overrides=[setting])
    reported = scene_mapping(scene)["outputs"][0]["null"]["spool"]
    assert (reported["max_bytes"], reported["when_full"]) == (5_000_000, "refuse")
    assert scene_from_mapping(scene_mapping(scene)) == scene
    assert scene_hash(scene) != scene_hash(load_scene(SCENE, overrides=['outputs=["null"]']))


@pytest.mark.parametrize(
    ("spool", "message"),
    [
        ("{}", "outputs[0].null.spool.path: is missing"),
        ("7", "outputs[0].null.spool: 7 is a number; a block of path, max_bytes"),
        (
            "{path: a, when_full: explode}",
            "'explode' is not one of refuse, wait, drop-oldest, drop-newest",
        ),
        ("{path: a, max_bytes: 5}", "outputs[0].null.spool.max_bytes: 5 is outside [1048576,"),
        ("{path: ''}", "the spool's path is empty"),
        ("{path: a, sise: 5}", "unknown key"),
    ],
)
def test_what_is_wrong_with_a_spool_is_reported_with_its_place(spool: str, message: str) -> None:
    with pytest.raises(SceneError) as caught:
        load_scene(SCENE, overrides=["outputs=[{'null': {}}]", f"outputs[0].null.spool={spool}"])
    assert message in str(caught.value)


def test_a_misspelt_spool_is_reported() -> None:
    with pytest.raises(SceneError, match="did you mean spool"):
        load_scene(SCENE, overrides=["outputs=[{'null': {spol: {path: a}}}]"])


def test_a_spool_that_cannot_be_opened_leaves_no_sink_open(tmp_path: Path) -> None:
    (tmp_path / "spool").write_text("something else, and long enough to be read as a page" * 100)
    scene = load_scene(
        SCENE,
        overrides=[
            f"outputs=[null: {{spool: {spool_setting(tmp_path)}}}]".replace("null", "'null'")
        ],
    )
    with pytest.raises(SinkError, match="is not a spool, or damaged"):
        deliver(compile_plan(scene))


def test_a_sink_may_not_have_a_setting_named_spool() -> None:
    from attrs import frozen

    @frozen
    class Config:
        spool: str = text(help="a key reserved by scenes", default="")

    class Plugin:
        @hookimpl
        def opir_sinks(self) -> list[SinkModel]:
            return [SinkModel(name="own", summary="its own", config=Config, build=lambda *_: None)]

    with pytest.raises(PluginError, match="has the field spool, a key reserved by scenes"):
        load_scene(SCENE, overrides=["outputs=[own]"], host=Host.of(Plugin()))
