"""Target classes in scenes: their names are checked everywhere, plugins add some, and values fall
back.
"""

import math

import numpy as np
import opir_photons.radiometry.plugin as light
import pytest
from attrs import evolve
from opir_photons.environment import make_environment
from opir_testing import TargetClassContract
from opir_testing.bench import bench_scene

from opir_core import compile_plan, simulate
from opir_core.errors import PluginError, SceneError
from opir_core.plugin import REPORTED_TYPES, BoostProfile, Host, Plume, TargetClass, hookimpl
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene import core_target_class, core_target_classes

PROFILE = BoostProfile("PROBE", 100.0, 8.0, 1.3, 0.6, 3158.4, math.radians(40.0), 1.3e6, 1e6, 3e6)
PLUME = Plume({"SWIR": 8e4, "MWIR": 8e4, "LWIR": 5e3})
PROBE = TargetClass(
    name="PROBE",
    summary="a test class",
    reported_type="IRBM",
    profiles=(PROFILE,),
    plumes={"PROBE": PLUME},
)
FLIGHT = {
    "launch": {"lat_deg": 34.7, "lon_deg": -120.6, "time_s": 2.0},
    "aim": {"lat_deg": 32.0, "lon_deg": -141.0},
}


class Probes:
    """A plugin of target classes."""

    def __init__(self, *classes):
        self.classes = classes

    @hookimpl
    def opir_target_classes(self):
        return self.classes


def scene_of(kind, host=None, **changes):
    flight = {"launch": FLIGHT["launch"], "azimuth_deg": 90.0} if kind == "SLV" else FLIGHT
    mapping = bench_scene(targets=[{"id": "T", "type": kind, **flight}], **changes)
    return scene_from_mapping(mapping, host=host or Host.of())


def problems(**changes):
    with pytest.raises(SceneError) as caught:
        scene_from_mapping(bench_scene(**changes), host=Host.of())
    return [str(problem) for problem in caught.value.problems]


def test_an_unknown_type_is_refused_with_the_nearest():
    (problem,) = problems(targets=[{"id": "T", "type": "IRMB", **FLIGHT}])
    assert problem.startswith(
        "targets[0].type: no target class is named 'IRMB'; the nearest is 'IRBM'; there are "
    )
    assert all(name in problem for name in core_target_classes())


@pytest.mark.parametrize(
    ("settings", "path"),
    [
        ({"detection_probability": {"ICBN": 0.2}}, "sensors[0].detection_probability.ICBN"),
        ({"detection_probability": {"UNKNOWN": 0.2}}, "sensors[0].detection_probability.UNKNOWN"),
        ({"confusion": {"UNKNOWN": {"ICBM": 1.0}}}, "sensors[0].confusion.UNKNOWN"),
    ],
)
def test_sensors_name_classes_that_there_are(settings, path):
    sensor = {"model": "generic-scanner", "id": "S", "orbital_slot_deg": -100.0, **settings}
    (problem,) = problems(sensors=[sensor])
    assert problem.startswith(f"{path}: no target class is named")


def test_matrices_name_classes_that_there_are():
    matrices = {"generic-scanner": {"ICMB": {"ICBM": 1.0}}}
    (problem,) = problems(classification={"model": "paper", "matrices": matrices})
    assert problem.startswith(
        "classification.matrices.generic-scanner.ICMB: no target class is named 'ICMB'"
    )


@pytest.mark.parametrize("kind", sorted(core_target_classes()))
def test_every_class_reads_back_from_its_canonical_form(kind):
    host = Host.of()
    scene = scene_of(kind, host)
    assert scene_from_mapping(scene_mapping(scene), host=host) == scene


def test_a_plugins_class_flies_and_is_in_truth_and_summary():
    host = Host.of(Probes(PROBE))
    run = simulate(scene_of("PROBE", host, classification="always"), host)
    (row,) = run.summary["targets"]
    assert (row["target_type"], row["reported_type"]) == ("PROBE", "IRBM")
    assert row["burnout_s"] - row["ignition_s"] == PROFILE.burn_time_s


def test_the_manifest_names_the_plugin_of_each_class():
    host = Host.of(Probes(PROBE))
    components = simulate(scene_of("PROBE", host), host).manifest["components"]
    (row,) = [row for row in components if row["kind"] == "target_classes"]
    assert (row["name"], row["plugin"]) == ("PROBE", "Probes")


def test_the_conformance_tests_find_a_class_of_a_plugin():
    class OfProbes(TargetClassContract):
        name = "PROBE"

        @classmethod
        def host(cls):
            return Host.of(Probes(PROBE))

    assert OfProbes.targets().class_names == ["PROBE"] * 3


def test_a_class_like_another_makes_the_same_detections():
    """MRBM has the profile that IRBM flies over this range, and no sensor names it."""
    actual, expected = (simulate(scene_of(kind), Host.of()) for kind in ("MRBM", "IRBM"))
    assert len(actual.detections) > 100
    for column in ("time_ns", "reported_type", "line_of_sight_ecef", "confidence"):
        assert (
            getattr(actual.detections, column).tobytes()
            == getattr(expected.detections, column).tobytes()
        )


def test_a_sensor_that_names_a_class_has_that_probability():
    sensor = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": -100.0,
        "detection_probability": {"MRBM": 1.0},
    }
    run = simulate(scene_of("MRBM", sensors=[sensor]), Host.of())
    assert set(run.truth.probability.tolist()) == {1.0}
    assert set(
        simulate(scene_of("IRBM", sensors=[sensor]), Host.of()).truth.probability.tolist()
    ) == {0.6}


def test_a_confusion_row_of_a_class_is_used():
    sensor = {
        "model": "generic-scanner",
        "id": "S",
        "orbital_slot_deg": -100.0,
        "confusion": {"MRBM": {"SRBM": 1.0}},
    }
    reported = simulate(scene_of("MRBM", sensors=[sensor]), Host.of()).detections.reported_type
    assert set(reported.tolist()) == {REPORTED_TYPES.index("SRBM")}


def test_a_class_other_than_missiles_is_right_as_unknown():
    kind = evolve(PROBE, reported_type="UNKNOWN", resembles="SRBM")
    host = Host.of(Probes(kind))
    right = simulate(scene_of("PROBE", host, classification="always"), host)
    assert set(right.detections.reported_type.tolist()) == {REPORTED_TYPES.index("UNKNOWN")}
    assert set(right.truth.probability.tolist()) == {0.4}


def test_the_default_plume_of_a_class_is_its_own():
    plume = Plume(
        {name: 10.0 * peak for name, peak in PLUME.peak_w_sr.items()},
        stages=2,
        body_temperature_k=600.0,
    )
    built = []
    for kind in (PROBE, evolve(PROBE, plumes={"PROBE": plume})):
        host = Host.of(Probes(kind), light)
        scene = scene_of("PROBE", host)
        plan = compile_plan(scene, host)
        built.append(make_environment(plan).signatures[0])
    np.testing.assert_allclose(built[1].peak_w_sr, 10.0 * built[0].peak_w_sr, rtol=1e-12)
    assert (built[0].stages.tolist(), built[1].stages.tolist()) == ([1], [2])
    assert (built[1].body_w_sr > built[0].body_w_sr).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "flare"}, "the name of a type that is no target's"),
        ({"reported_type": "MRBM", "resembles": "IRBM"}, "with the reported type 'MRBM'"),
        (
            {"reported_type": "UNKNOWN", "resembles": "UNKNOWN"},
            "that resembles 'UNKNOWN', not ICBM or IRBM or SRBM",
        ),
        ({"profiles": ()}, "without profiles"),
        ({"profiles": (PROFILE, PROFILE)}, "with two profiles of one name"),
        ({"plumes": {}}, "without a plume for the profile PROBE"),
        ({"after_burnout": "glide"}, "with 'glide' after burnout"),
        (
            {"profiles": (evolve(PROFILE, pitch_start_s=100.0),)},
            "a profile PROBE whose times, shape, burnout or ranges",
        ),
        ({"plumes": {"PROBE": Plume({"SWIR": 1.0})}}, "one peak for each of SWIR, MWIR, LWIR"),
        ({"summary": "two\nlines"}, "a summary that is not one line of text"),
    ],
)
def test_a_class_that_cannot_be_is_a_fault_of_its_plugin(changes, words):
    with pytest.raises(PluginError, match=words):
        Host.of(Probes(evolve(PROBE, **changes)))


def test_a_class_of_a_plugin_cannot_take_a_name_of_the_core():
    host = Host.of(Probes(evolve(PROBE, name="MRBM")))
    with pytest.raises(PluginError, match="two plugins offer the target class 'MRBM'"):
        scene_of("MRBM", host)


def test_own_values_precede_those_of_the_resembled_type():
    slbm = core_target_class("SLBM")
    assert slbm.own({"SLBM": 1.0, "ICBM": 0.5}) == 1.0
    assert slbm.own({"ICBM": 0.5, "IRBM": 0.25}) == 0.5
    assert slbm.own({"IRBM": 0.25}) is None
