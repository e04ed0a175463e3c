"""Parts of trackers: chosen in a scene, swapped by plugins, refused where they do not fit."""

import ast
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from opir_estimation import MotionModel
from opir_testing.doubles import stub_sensor
from opir_trackers import Association, Associator
from opir_trackers.configs import ImmConfig
from opir_trackers.track_priors import filter_of
from public_names import is_public
from repository import ROOT
from scored_scene import SCENE as SCORED

import opir_core as opir
from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.plugin import Host, TrackerContext, TrackerPart, hookimpl
from opir_core.simulation.run import run_of_plan

OUTSIDE = ROOT / "tests" / "support" / "outside_parts"

SCENE = {**SCORED, "scene": "parts", "duration_s": 40.0, "seed": 61}


def scene_of(**tracker: Any) -> dict[str, Any]:
    return {**SCENE, "tracker": {"model": "imm", **tracker}}


def installed(folder: Path, module: str, component: str) -> None:
    """Install a plugin of one module into a folder, as pip does."""
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.3\nName: {module}\nVersion: 1.0\n\n")
    points = f"[opir]\n{module} = {module}\n[opir.components]\n{component} = {module}\n"
    (info / "entry_points.txt").write_text(points)
    (folder / f"{module}.py").write_text((OUTSIDE / f"{module}.py").read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("module", "role", "name"),
    [
        ("nearest_part", "association", "nearest"),
        ("straight_part", "motion", "straight"),
        ("even_part", "forecast", "even"),
    ],
)
def test_an_installed_plugin_swaps_a_part(
    module: str, role: str, name: str, tmp_path: Path
) -> None:
    """The plugin is one file of at most 40 lines, which imports public names only; the target is
    followed to within kilometres of the usual estimate, and the manifest names the plugin.
    """
    source = (OUTSIDE / f"{module}.py").read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 40
    imports = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    for node in imports:
        if str(node.module).startswith("opir"):
            assert all(is_public(node.module, alias.name) for alias in node.names)
    installed(tmp_path, module, f"tracker_parts.{name}")
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps(scene_of(**{role: name})), encoding="utf-8")
    path = f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    command = [sys.executable, "-m", "opir_core", "run", "scene.json", "--out", "events.jsonl"]
    environment = {**os.environ, "PYTHONPATH": path}
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, capture_output=True)
    manifest = json.loads((tmp_path / "events.manifest.json").read_text(encoding="utf-8"))
    used = [row for row in manifest["components"] if row["name"] == name]
    assert [row["distribution"] for row in used] == [module]
    assert manifest["scene"]["tracker"][role]["model"] == name
    lines = (tmp_path / "events.tracks.jsonl").read_text(encoding="utf-8").splitlines()
    last = json.loads(lines[-1])
    usual_run = run_of_plan(opir.compile_plan(opir.scene_from_mapping(scene_of())))
    usual = usual_run.estimates.state[-1, :3]
    error_m = np.subtract(last["position_ecef_m"], usual)
    assert np.linalg.norm(error_m) < 10e3


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (
            {"association": "jpd"},
            r"tracker\.association.*'jpd'.*nearest is 'jpda'; there are",
        ),
        ({"association": "thrust"}, r"thrust is a part for motion, not for association; there are"),
        ({"motion": "cartesian"}, r"cartesian has 6 states, imm needs 10; there are .*thrust"),
        ({"pruning": "elsewhere"}, r"elsewhere is a part of other, not of imm; there are"),
        ({"motion": {"model": "thrust", "tilt": 3.0}}, r"tracker\.motion\.tilt: unknown key"),
    ],
)
def test_a_part_that_does_not_fit_is_refused_with_those_that_do(
    settings: Mapping[str, Any], words: str
) -> None:
    host = Host.discover()
    host.register(Parts())
    with pytest.raises(opir.SceneError, match=words):
        opir.scene_from_mapping(scene_of(**settings), host=host)


class Failing(Associator):
    def associate(self, problem: Any) -> Association:
        raise ZeroDivisionError("no such line")


class Short(Associator):
    def associate(self, problem: Any) -> Association:
        return Association(lines=problem.lines, owner=np.zeros(1), pairs=problem.pairs)


class Parts:
    """Parts that do not fit, and broken ones."""

    @hookimpl
    def opir_tracker_parts(self) -> Any:
        association = {"role": "association", "reads": (), "summary": "broken"}
        yield TrackerPart(name="short", build=lambda _config, _context: Short(), **association)
        yield TrackerPart(name="empty", build=lambda _config, _context: object(), **association)
        yield TrackerPart(name="failing", build=lambda _config, _context: Failing(), **association)
        yield TrackerPart(
            name="cartesian", summary="x", role="motion", state_size=6, build=print, reads=()
        )
        yield TrackerPart(
            name="elsewhere", summary="x", role="pruning", trackers=("other",), build=print
        )


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("short", r"tracker part 'short' of plugin .*: Short must return track rows of \d+ lines"),
        (
            "empty",
            r"tracker part 'empty' of plugin .*without associate; derive its class from opir_trackers.Associator",
        ),
        ("failing", r"tracker part 'failing' of plugin .*: associate raised ZeroDivisionError"),
    ],
)
def test_a_broken_part_is_named_with_its_owner(name: str, words: str) -> None:
    host = Host.discover()
    host.register(Parts())
    scene = opir.scene_from_mapping(scene_of(association=name), host=host)
    with pytest.raises(ModelError, match=words):
        run_of_plan(opir.compile_plan(scene, host))


def test_what_a_motion_model_derives_is_what_thrust_states() -> None:
    """Steps, transition, derivatives and their roots of the base class, by differences, against the
    closed forms.
    """
    context = TrackerContext(sensors=(stub_sensor("A", 0.0),), epoch_us=0, duration_s=60.0)
    thrust = filter_of(ImmConfig(), context).boost
    derived_model = Derived(thrust)
    rng = np.random.default_rng(62)
    state = np.zeros((5, 10))
    state[:, :3] = [6.5e6, 1e5, -2e5] + rng.normal(size=(5, 3)) * 1e4
    state[:, 3:6] = rng.normal(size=(5, 3)) * 1500.0
    state[:, 6:9] = rng.normal(size=(5, 3)) * 20.0
    state[:, 9] = rng.uniform(0.0, 0.02, 5)
    step_s = np.array([1.0, 0.3, 2.0, -2.0, 1.0])
    side = rng.normal(size=(5, 10, 10))
    pairs = [
        (derived_model.propagated(state, step_s), thrust.propagated(state, step_s)),
        (derived_model.transition(state, step_s), thrust.transition(state, step_s)),
        (derived_model.taylor(state), thrust.taylor(state)),
        (derived_model.derivative_roots(state, side), thrust.derivative_roots(state, side)),
    ]
    for derived, stated in pairs:
        np.testing.assert_allclose(derived, stated, rtol=1e-4, atol=2e-5 * np.abs(stated).max())


class Derived(MotionModel):
    """The rate of the force and the process noise of another model, and nothing else of it."""

    def __init__(self, model: Any) -> None:
        super().__init__(model.forces)
        self._model = model

    def force_rate(self, state: FloatArray) -> FloatArray:
        return self._model.force_rate(state)

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        return self._model.noise_root(step_s, state)
