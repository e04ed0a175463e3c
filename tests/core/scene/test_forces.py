"""The scene's forces: read, written, reported, and handed to targets and trackers."""

from typing import Any

import numpy as np
import pytest
from fake_components import fake_host, good_mapping
from opir_testing import SilentTracker
from repository import EXAMPLES, TEST_SCENES

from opir_core import compile_plan, simulate
from opir_core.flight import Drag, Forces
from opir_core.flight.forces import ExponentialAtmosphere
from opir_core.plugin import Host, NoConfig, TrackerContext, TrackerModel, hookimpl
from opir_core.reading import load_scene, scene_from_mapping, scene_hash, scene_mapping
from opir_core.scene.scene import ExponentialAir, SceneDrag, SceneForces
from opir_core.simulation.explanation import explained

ONE_TARGET = EXAMPLES / "first_light.yaml"
THREE_TARGETS = TEST_SCENES / "pacific_test_range.yaml"
AIR = {"density_kg_m3": 1.2, "scale_height_m": 7000.0}


def scene_with(forces: Any):
    return scene_from_mapping({**good_mapping(), "forces": forces}, host=fake_host())


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("kepler", SceneForces()),
        (["j2"], SceneForces(("j2",))),
        (["j4", "j2", "j3"], SceneForces(("j2", "j3", "j4"))),
        (["drag", "j2"], SceneForces(("j2",), SceneDrag())),
        ([{"drag": None}], SceneForces((), SceneDrag())),
        (
            ["j2", {"drag": {"ballistic_coefficient_kg_m2": 90}}],
            SceneForces(("j2",), SceneDrag(ballistic_coefficient_kg_m2=90.0)),
        ),
        (
            [{"drag": {"exponential": AIR}}],
            SceneForces((), SceneDrag(exponential=ExponentialAir(**AIR))),
        ),
    ],
)
def test_forces_are_read_and_written(written, read):
    scene = scene_with(written)
    assert scene.forces == read
    assert scene_with(scene_mapping(scene)["forces"]) == scene


def test_the_default_force_is_the_point_mass():
    mapping = {key: value for key, value in good_mapping().items() if key != "forces"}
    assert scene_from_mapping(mapping, host=fake_host()) == scene_with("kepler")


def test_the_hash_tells_forces_apart_and_not_their_order():
    different = [
        scene_hash(scene_with(forces)) for forces in ("kepler", ["j2"], ["drag"], ["drag", "j2"])
    ]
    assert len(set(different)) == 4
    assert scene_hash(scene_with(["j2", {"drag": {}}])) == different[3]


def test_an_override_sets_them():
    scene = load_scene(
        ONE_TARGET, overrides=["forces=[j2, drag: {ballistic_coefficient_kg_m2: 700}]"]
    )
    assert scene.forces.names == ("j2", "drag")
    assert load_scene(ONE_TARGET, overrides=["forces=kepler"]) == load_scene(ONE_TARGET)


class Watcher:
    """A plugin whose tracker keeps what it was built with."""

    def __init__(self) -> None:
        self.seen: list[TrackerContext] = []

    @hookimpl
    def opir_trackers(self):
        yield TrackerModel(name="watcher", summary="watches", config=NoConfig, build=self.build)

    def build(self, _config: NoConfig, context: TrackerContext) -> SilentTracker:
        self.seen.append(context)
        return SilentTracker()


def watched(forces: str) -> Any:
    watcher = Watcher()
    host = Host.discover(["dsp", "sbirs", "nextgen"])
    host.register(watcher)
    compile_plan(
        load_scene(ONE_TARGET, overrides=["tracker=watcher", f"forces={forces}"], host=host), host
    )
    return watcher.seen[0].forces


def test_trackers_are_reported():
    assert watched("kepler") == "kepler"
    assert watched("[j3, j2]") == Forces(zonal=("j2", "j3"))
    assert watched("[drag: {ballistic_coefficient_kg_m2: 700}]") == Forces(
        zonal=(), drag=Drag(700.0)
    )
    air = ExponentialAtmosphere(1.2, 7000.0)
    assert watched(f"[drag: {{exponential: {AIR}}}]".replace("'", "")) == Forces(
        zonal=(), drag=Drag(5000.0, air)
    )


def test_explain_and_the_manifest_tell_them():
    scene = load_scene(ONE_TARGET, overrides=["forces=[j2, drag]", "outputs=[]"])
    reported = explained(compile_plan(scene))
    assert reported["forces"] == ["j2", "drag"]
    assert not any("numerical" in line for line in reported["not_computed"])
    plain = explained(compile_plan(load_scene(ONE_TARGET)))
    assert plain["forces"] == ["kepler"]
    assert any("numerical" in line for line in plain["not_computed"])
    settings = {"ballistic_coefficient_kg_m2": 5000.0, "exponential": None}
    assert simulate(scene).manifest["scene"]["forces"] == ["j2", {"drag": settings}]


@pytest.mark.slow
def test_a_target_may_bring_its_own_ballistic_coefficient():
    """Only its own flight changes, and the slower the heavier: what the air takes has to be brought
    along.
    """
    burnouts = []
    for coefficient in ("null", "300"):
        overrides = ["forces=[j2, drag]", f"targets[1].ballistic_coefficient_kg_m2={coefficient}"]
        truth = compile_plan(load_scene(THREE_TARGETS, overrides=overrides)).targets.truth()
        assert max(target["miss_m"] for target in truth) <= 0.01
        burnouts.append([target["burnout"]["velocity_ecef_m_s"] for target in truth])
    usual, light = burnouts
    assert usual[0] == light[0]
    assert usual[2] == light[2]
    assert np.linalg.norm(light[1]) > np.linalg.norm(usual[1]) + 1.0
