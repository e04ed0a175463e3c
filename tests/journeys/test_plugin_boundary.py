"""What a component of a plugin raises, returns wrongly or prints: one message with its owner,
method and remedy.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from live_scene import mapping
from rogue_components import raising, rogue_host

import opir_core as opir
from opir_core.errors import ModelError
from opir_core.host.host import Host
from opir_core.output.delivery import deliver
from opir_core.planning.plan import compile_plan
from opir_core.plugin import Delivery, NoConfig, TrackerModel, hookimpl, number
from opir_core.reading import scene_from_mapping

SNR = {"detection": "snr", "background": "none"}

#: The hook, a sound component, the method that misbehaves, how a scene chooses it.
MODEL = ("opir_detection_models", "constant", "pair_probability", {"detection": "rogue"})
MEASURE = ("opir_detection_models", "constant", "measure", {"detection": "rogue"})
TYPES = ("opir_classifiers", "paper", "pair_type", {"classification": "rogue"})
POSTERIOR = ("opir_classifiers", "spectral", "log_posterior", {"classification": "rogue", **SNR})
CONFIDENCE = ("opir_confidence_models", "weighted", "confidence", {"confidence": "rogue"})
TRACKER = ("opir_trackers", "kepler-arc", "step", {"tracker": "rogue"})
SENSOR = (
    "opir_sensor_models",
    "generic-scanner",
    "build",
    {"sensors": [{"model": "rogue", "id": "A", "orbital_slot_deg": -135.0}]},
)

AIR = ("opir_atmosphere_models", "clear", "transmittance", {**SNR, "atmosphere": "rogue"})
ALL_AIR = ("opir_atmosphere_models", "lowtran", "transmittances", {**SNR, "atmosphere": "rogue"})
SKY = ("opir_background_models", "none", "radiance_w_m2_sr", {**SNR, "background": "rogue"})
CLUTTER = ("opir_background_models", "none", "clutter_w_m2_sr", {**SNR, "background": "rogue"})

PARTS = {
    "model": MODEL,
    "measure": MEASURE,
    "types": TYPES,
    "posterior": POSTERIOR,
    "confidence": CONFIDENCE,
    "tracker": TRACKER,
    "sensor": SENSOR,
}


def error_of(component, deed):
    """Return the message of a run with a component that misbehaves."""
    hook, sound, method, changes = component
    host = rogue_host(hook, sound, method, deed)
    with pytest.raises(ModelError) as refused:
        # Types are computed when they are read.
        len(
            opir.simulate(
                scene_from_mapping(mapping(**changes), host=host), host
            ).detections.confidence
        )
    return str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [ZeroDivisionError("x\x1b[31m"), SystemExit(0), GeneratorExit(), RecursionError()]
)
@pytest.mark.parametrize("part", PARTS)
def test_an_exception_names_the_plugin_the_method_the_line_and_the_remedy(part, error):
    reported = error_of(PARTS[part], raising(error))
    assert "'rogue' of plugin rogue (registered by this program)" in reported
    assert f"raised {type(error).__name__}" in reported
    assert "rogue_components.py, line" in reported
    assert reported.endswith("`opir check rogue` shows what is required")
    assert "\x1b" not in reported


WRONG = {
    "shape": (MODEL, lambda chance: chance[:-1], "pair_probability returned float64 "),
    "range": (MODEL, lambda chance: chance + 1.0, "is required"),
    "nan": (MODEL, lambda chance: chance * np.nan, "returned nan in row 0; [0, 1] is required"),
    "list": (MODEL, lambda chance: chance.tolist(), "returned a list; floats of shape"),
    "measured": (MEASURE, lambda _measured: None, "measure returned None"),
    "bands": (
        MEASURE,
        lambda measured: evolve(measured, bands=measured.bands * 1.0),
        "measure().bands returned float64",
    ),
    "degrees": (
        MEASURE,
        lambda measured: evolve(
            measured, line_of_sight_sigma_rad=np.full(len(measured.bands), 5.0)
        ),
        "returned 5 in row 0; [0, 0.5] rad is required",
    ),
    "codes": (TYPES, lambda codes: codes + np.uint8(9), "codes are 0 to 3"),
    "types": (TYPES, lambda codes: codes * 1.0, "pair_type returned float64"),
    "posterior": (POSTERIOR, lambda log_p: log_p + 1.0, "returned probabilities that sum to 2.718"),
    "confidence": (CONFIDENCE, lambda chance: chance - 2.0, "confidence returned -"),
    "covariance": (
        TRACKER,
        lambda tracks: evolve(tracks, state_covariance=-tracks.state_covariance),
        "step at ",
    ),
    "asymmetric": (
        TRACKER,
        lambda tracks: evolve(
            tracks, state_covariance=tracks.state_covariance + np.triu(np.full((6, 6), 1e9), 1)
        ),
        "state_covariance that is not symmetric",
    ),
    "unnormalised": (
        TRACKER,
        lambda tracks: evolve(tracks, type_probability=np.full((len(tracks), 4), 0.5)),
        "type_probability that sums to",
    ),
    "launch in degrees": (
        TRACKER,
        lambda tracks: evolve(tracks, launch=tracks.launch * [57.3, 57.3, 1.0]),
        "launch with a latitude or longitude outside the range of radians",
    ),
    "percent": (
        AIR,
        lambda through: 100.0 * through,
        "transmittance returned 100 in row 0; [0, 1] is required",
    ),
    "air of another length": (
        AIR,
        lambda through: through[:-1],
        "transmittance returned float64 (",
    ),
    "air of whole numbers": (
        AIR,
        lambda through: through.astype(int),
        "transmittance returned int64 (",
    ),
    "nan air": (ALL_AIR, lambda through: through * np.nan, "transmittance returned nan in row 0"),
    "dark sky": (
        SKY,
        lambda radiance: radiance - 1.0,
        "radiance_w_m2_sr returned -1 in row 0; [0, inf) W/(m2 sr)",
    ),
    "endless clutter": (
        CLUTTER,
        lambda clutter: clutter + np.inf,
        "clutter_w_m2_sr returned inf in row 0",
    ),
    "angle in degrees": (
        SENSOR,
        lambda sensor: evolve(sensor, field_of_regard_half_angle_rad=10.0),
        "[0, 3.142]",
    ),
    "sigma": (
        SENSOR,
        lambda sensor: evolve(sensor, line_of_sight_sigma_rad=float("nan")),
        "sigma_rad nan; [0, 0.5]",
    ),
    "confusion": (
        SENSOR,
        lambda sensor: evolve(sensor, confusion={"ICBM": {"ICBM": 0.5}}),
        "sums to 0.5, not to 1",
    ),
    "no sensor": (SENSOR, lambda _sensor: 3, "build made an int, no opir_core.plugin.Sensor"),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_result_names_the_plugin_the_method_and_the_remedy(case):
    component, deed, words = WRONG[case]
    reported = error_of(component, deed)
    assert "'rogue' of plugin rogue" in reported
    assert words in reported, reported
    assert reported.endswith("`opir check rogue` shows what is required")


@pytest.mark.parametrize("method", ["write", "close"])
@pytest.mark.parametrize("deed", [raising(SystemExit(0)), raising(KeyError("x"))])
def test_a_sink_that_fails_is_named_and_the_others_go_on(tmp_path, method, deed):
    host = rogue_host("opir_sinks", "memory", method, deed)
    outputs = [{"rogue": {}}, {"jsonl": {"path": str(tmp_path / "events.jsonl")}}]
    outcome = deliver(compile_plan(scene_from_mapping(mapping(outputs=outputs), host=host), host))
    failed, sound = outcome.report.sinks
    assert "the sink 'rogue' of plugin rogue" in (failed.error or "")
    assert f"{method} raised" in (failed.error or "")
    assert (sound.error, sound.delivered) == (None, outcome.report.events)


def test_a_sink_whose_counts_are_none_is_named(tmp_path):
    host = rogue_host("opir_sinks", "memory", "close", lambda delivery: delivery.delivered)
    outcome = deliver(
        compile_plan(scene_from_mapping(mapping(outputs=[{"rogue": {}}]), host=host), host)
    )
    assert "close returned an int, no opir_core.plugin.Delivery" in (
        outcome.report.sinks[0].error or ""
    )
    assert Delivery(delivered=1).delivered == 1


ENCODED = {
    "no bytes": (lambda messages: messages.decode(), "encode returned a str; bytes are required"),
    "a line lost": (lambda messages: messages.partition(b"\n")[2], "lines for"),
    "no end": (lambda messages: messages[:-1], "lines for"),
    "raises": (raising(SystemExit(0)), "encode raised SystemExit"),
}


@pytest.mark.parametrize("case", ENCODED)
def test_an_encoder_that_is_wrong_is_named(tmp_path, case):
    deed, words = ENCODED[case]
    host = rogue_host("opir_event_encoders", "forge", "encode", deed)
    outputs = [{"jsonl": {"path": str(tmp_path / "events.jsonl"), "encoder": "rogue"}}]
    outcome = deliver(compile_plan(scene_from_mapping(mapping(outputs=outputs), host=host), host))
    error = outcome.report.sinks[0].error or ""
    assert "the event encoder 'rogue' of plugin rogue" in error
    assert words in error, error


def test_a_default_that_is_out_of_range_is_blamed_on_its_plugin():
    from attrs import frozen

    @frozen(kw_only=True)
    class Config(NoConfig):
        gate: float = number(help="gate", minimum=0.0, maximum=1.0, default=5.0)

    class Plugin:
        @hookimpl
        def opir_trackers(self):
            yield TrackerModel(name="odd", summary="odd", config=Config, build=lambda *_: None)

    host = Host.of(Plugin())
    sensors = [{"model": "generic-scanner", "id": "A", "orbital_slot_deg": -135.0}]
    words = r"Plugin .*: the default of its setting gate is invalid: 5\.0 is outside"
    with pytest.raises(opir.PluginError, match=words):
        scene_from_mapping(mapping(sensors=sensors, tracker="odd"), host=host)


PRINTING = """
import os, sys
from rogue_components import rogue_host
from opir_core.cli.main import main
from opir_core.host.host import Host

def loud(answer):
    print("noise of a plugin")
    sys.stdout.buffer.write(b"noise in bytes\\n")
    os.write(1, b"noise of a library\\n")
    return answer

host = rogue_host("opir_trackers", "kepler-arc", "step", loud)
Host.discover = classmethod(lambda _cls, *_given: host)
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_what_a_plugin_prints_does_not_reach_the_events(tmp_path):
    import json

    support = Path(__file__).parents[1] / "support"
    (tmp_path / "scene.yaml").write_text(json.dumps(mapping(tracker="rogue")), encoding="utf-8")
    command = [sys.executable, "-c", PRINTING, "run", "scene.yaml", "--out", "-"]
    done = subprocess.run(
        command,
        capture_output=True,
        cwd=tmp_path,
        timeout=60.0,
        check=True,
        env={"PYTHONPATH": str(support)},
    )
    lines = done.stdout.splitlines()
    assert len(lines) > 100
    assert all(json.loads(line)["detection_id"] for line in lines)
    assert b"noise of a plugin" in done.stderr
    assert b"noise in bytes" in done.stderr
    assert b"noise of a library" in done.stderr
