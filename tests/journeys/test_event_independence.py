"""Events are the same bytes whatever does not belong to them: windows, hash seeds, neighbours, the
order of plugins.
"""

import json
from collections.abc import Mapping
from typing import Any

import pytest
import yaml
from repository import TEST_SCENES

import opir_core as opir
from opir_core.interfaces.contexts import EncoderContext
from opir_core.output.events.forge import ForgeEncoder
from opir_core.planning.plan import compile_plan
from opir_core.simulation.run import plan_windows

EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"
#: Without a tracker: an estimate depends on all sensors and targets, and events carry it.
SCENE: Mapping[str, Any] = {
    **yaml.safe_load(EXAMPLE.read_text(encoding="utf-8")),
    "tracker": "none",
}


def events(scene, window_s=None):
    """Return a scene's events as lines."""
    plan = compile_plan(opir.scene_from_mapping(dict(scene)))
    encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us))
    return b"".join(encoder.encode(window) for window in plan_windows(plan, window_s))


@pytest.fixture(scope="module")
def total():
    return events(SCENE, 300.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "window_s", [pytest.param(0.2, marks=pytest.mark.slow), 0.77, 1.0, 13.0, 299.999, None]
)
def test_window_sizes_change_no_byte(total, window_s):
    assert events(SCENE, window_s) == total


def test_a_run_repeats_itself(total):
    assert events(SCENE, 300.0) == total


@pytest.mark.slow
@pytest.mark.parametrize("place", [0, 3])
def test_one_more_sensor_changes_no_other_sensors_events(total, place):
    newcomer = {"model": "DSP", "id": "NEW", "orbital_slot_deg": -120.0, "scan_phase": "random"}
    sensors = [*SCENE["sensors"][:place], newcomer, *SCENE["sensors"][place:]]
    lines = events({**SCENE, "sensors": sensors}).splitlines(keepends=True)
    stored = [line for line in lines if json.loads(line)["sensor_id"] != "NEW"]
    assert len(stored) < len(lines)
    assert b"".join(stored) == total


@pytest.mark.slow
@pytest.mark.parametrize("place", [0, 1, 3])
def test_one_more_target_changes_no_other_targets_events(total, place):
    newcomer = {**SCENE["targets"][0], "id": "NEW", "aim": {"lat_deg": 4.0, "lon_deg": 160.0}}
    targets = [*SCENE["targets"][:place], newcomer, *SCENE["targets"][place:]]
    scene = {**SCENE, "targets": targets}
    added = of_target(scene, "NEW")
    stored = [
        line
        for line in events(scene).splitlines(keepends=True)
        if json.loads(line)["detection_id"] not in added
    ]
    assert added
    assert b"".join(stored) == total


def of_target(scene, target_id):
    """Return the ids of the detections of a target, from the truth."""
    from opir_core.random_streams.detection_ids import uuid_text

    run = opir.simulate(opir.scene_from_mapping(dict(scene)))
    rows = run.truth.target == run.target_ids.index(target_id)
    return set(uuid_text(run.detections.detection_id[rows]))


def test_a_longer_scene_begins_with_the_shorter_ones_events():
    short = events({**SCENE, "duration_s": 80.0})
    long = events({**SCENE, "duration_s": 100.0})
    assert long.startswith(short)
    assert len(long) > len(short) > 0


def test_the_order_of_plugins_changes_no_byte(total):
    from importlib import import_module

    names = ["opir_nextgen.plugin", "opir_dsp.plugin", "opir_sbirs.plugin"]
    for order in (names, names[::-1]):
        host = opir.Host.of(*(import_module(name) for name in order))
        plan = compile_plan(opir.scene_from_mapping(dict(SCENE), host=host), host)
        encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us))
        assert b"".join(encoder.encode(window) for window in plan_windows(plan)) == total


def test_streaming_and_whole_runs_agree():
    scene = opir.scene_from_mapping(dict(SCENE))
    run = opir.simulate(scene)
    assert run.manifest["counts"]["detections"] == len(run.detections)
    assert sum(len(window.detections) for window in opir.windows(scene, window_s=7.0)) == len(
        run.detections
    )
