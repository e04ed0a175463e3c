"""Sensors that fail during a scene, against what each fault says."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.reading import scene_hash, scene_mapping
from opir_core.simulation.explanation import explained
from opir_core.simulation.undetected import undetected_text

WEST, EAST = 0, 1


def scene(*faults: dict[str, Any], **changes: Any) -> opir.Scene:
    settings = {"duration_s": 90.0, **({"faults": list(faults)} if faults else {}), **changes}
    return opir.scene_from_mapping(two_sensor_scene(**settings))


def fault(name: str, at_s: float = 40.0, until_s: float | None = 70.0, **settings: Any) -> Any:
    end: dict[str, Any] = {} if until_s is None else {"until_s": until_s}
    return {"sensor": "WEST", "fault": name, "at_s": at_s, **end, **settings}


def rows(run: opir.Run, sensor: int) -> Any:
    return np.flatnonzero(run.detections.sensor == sensor)


def directions(run: opir.Run, sensor: int) -> tuple[Any, Any]:
    """Return times, s, and lines of sight of a sensor."""
    at = rows(run, sensor)
    return run.detections.time_ns[at] * 1e-9, run.detections.line_of_sight_ecef[at]


@pytest.mark.parametrize("name", ["down", "blind"])
def test_a_sensor_that_does_not_see_detects_nothing_and_the_rest_is_the_same(name: str) -> None:
    whole, part = opir.simulate(scene()), opir.simulate(scene(fault(name)))
    for sensor in (WEST, EAST):
        time_s, sights = directions(whole, sensor)
        stays = (sensor == EAST) | (time_s < 40.0) | (time_s >= 70.0)
        part_s, part_sights = directions(part, sensor)
        assert part_s.tolist() == time_s[stays].tolist()
        np.testing.assert_array_equal(part_sights, sights[stays])


def test_only_of_a_sensor_that_is_down_it_is_known_that_it_does_not_look() -> None:
    spans = [[0.0, 40.0], [70.0, 90.0]]
    assert opir.simulate(scene(fault("down"))).manifest["watched_s"]["WEST"] == spans
    assert opir.simulate(scene(fault("blind"))).manifest["watched_s"]["WEST"] == [[0.0, 90.0]]
    watched = scene(fault("down"), watched_s={"WEST": [[10.0, 50.0], [60.0, 90.0]]})
    assert opir.simulate(watched).manifest["watched_s"]["WEST"] == [[10.0, 40.0], [70.0, 90.0]]


def test_a_sensor_that_is_down_throughout_never_looks_however_often_it_fails() -> None:
    for more in ((), (fault("down"),)):
        run = opir.simulate(scene(fault("down", 0.0, None), *more))
        assert run.manifest["watched_s"] == {"WEST": [], "EAST": [[0.0, 90.0]]}
        assert not len(rows(run, WEST))


@pytest.mark.parametrize("name", ["down", "blind"])
def test_what_no_sensor_looked_at_is_said_to_be_unobserved(name: str) -> None:
    plan = opir.compile_plan(
        scene(*(fault(name, 0.0, None, sensor=id_) for id_ in ("WEST", "EAST")))
    )
    assert undetected_text(plan, 0) == (
        "not looked at while it shone: EAST, WEST did not look, or failed"
    )
    assert "P_d at most" in undetected_text(opir.compile_plan(scene()), 0)


def test_noise_multiplies_the_errors_and_states_the_same_sigma() -> None:
    whole, noisy = opir.simulate(scene()), opir.simulate(scene(fault("noise", factor=3.0)))
    exact = opir.simulate(scene(fault("noise", 0.0, None, factor=1e-4)))
    assert noisy.detections.line_of_sight_sigma_rad.tolist() == (
        whole.detections.line_of_sight_sigma_rad.tolist()
    )
    time_s, sights = directions(whole, WEST)
    _, noisy_sights = directions(noisy, WEST)
    _, true_sights = directions(exact, WEST)
    errors, noisy_errors = (
        np.linalg.norm(of - true_sights, axis=1) for of in (sights, noisy_sights)
    )
    is_late = (time_s >= 40.0) & (time_s < 70.0)
    np.testing.assert_allclose(noisy_errors[is_late] / errors[is_late], 3.0, rtol=1e-3, atol=0.0)
    np.testing.assert_array_equal(noisy_sights[~is_late], sights[~is_late])


def test_a_bias_moves_nadir_by_its_angles() -> None:
    whole = opir.simulate(scene())
    biased = opir.simulate(scene(fault("bias", east_urad=50.0, north_urad=-20.0)))
    time_s, sights = directions(whole, WEST)
    _, biased_sights = directions(biased, WEST)
    moved = np.linalg.norm(biased_sights - sights, axis=1)
    is_late = (time_s >= 40.0) & (time_s < 70.0)
    # Lines of sight lie within nine degrees of nadir.
    np.testing.assert_allclose(moved[is_late], np.hypot(50e-6, 20e-6), rtol=0.02)
    assert not moved[~is_late].any()
    position = whole.detections.sensor_ecef_m[rows(whole, WEST)[0]]
    east = np.cross([0.0, 0.0, 1.0], position)
    towards_east = (biased_sights - sights)[is_late] @ (east / np.linalg.norm(east))
    np.testing.assert_allclose(towards_east, 50e-6, rtol=0.02)


@pytest.mark.parametrize("offset_s", [0.5, -0.5])
def test_a_clock_that_is_off_states_what_is_seen_at_other_times(offset_s: float) -> None:
    exact = {"at_s": 0.0, "until_s": None}
    whole = opir.simulate(scene(fault("noise", factor=1e-4, **exact)))
    off = opir.simulate(
        scene(fault("noise", factor=1e-4, **exact), fault("clock", offset_s=offset_s))
    )
    time_s, sights = directions(whole, WEST)
    off_s, off_sights = directions(off, WEST)
    within = (off_s >= 40.0) & (off_s < 70.0) & (off_s < time_s[-1])
    assert within.sum() > 20
    wanted = np.stack(
        [np.interp(off_s[within] - offset_s, time_s, sights[:, axis]) for axis in range(3)], axis=1
    )
    np.testing.assert_allclose(off_sights[within], wanted, rtol=0.0, atol=3e-6)
    moved = np.linalg.norm(off_sights[within] - wanted, axis=1)
    still = np.stack(
        [np.interp(off_s[within], time_s, sights[:, axis]) for axis in range(3)], axis=1
    )
    assert np.median(moved) < 0.1 * np.median(np.linalg.norm(off_sights[within] - still, axis=1))


def test_windows_and_workers_do_not_change_a_faulty_run() -> None:
    faulty = scene(
        fault("noise", factor=3.0), fault("clock", offset_s=0.5), fault("blind", 50.0, 55.0)
    )
    whole = opir.simulate(faulty).detections
    for settings in ({"window_s": 3.7}, {"workers": 2}):
        sliced = opir.simulate(faulty, **settings).detections
        np.testing.assert_array_equal(sliced.line_of_sight_ecef, whole.line_of_sight_ecef)
        np.testing.assert_array_equal(sliced.time_ns, whole.time_ns)


def test_faults_are_in_the_scene_and_its_hash_only_where_they_are_set() -> None:
    plain, faulty = scene(), scene(fault("noise", factor=3.0))
    assert "faults" not in scene_mapping(plain)
    assert scene_mapping(faulty)["faults"] == [fault("noise", factor=3.0)]
    assert opir.scene_from_mapping(scene_mapping(faulty)) == faulty
    assert scene_hash(plain) != scene_hash(faulty)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sensor": "WST"}, "faults[0].sensor: there is no sensor 'WST'; did you mean WEST?"),
        ({"fault": "dead"}, "'dead' is not one of down, blind, noise, bias, clock"),
        ({"until_s": 40.0}, "the repair at 40 s is not after 40 s"),
        ({"factor": None}, "noise needs factor"),
        ({"offset_s": 1.0}, "noise has no offset_s"),
        ({"at_s": -1.0}, "faults[0].at_s: -1"),
    ],
)
def test_faults_that_are_wrong_are_refused(changes: dict[str, Any], words: str) -> None:
    settings = {**fault("noise", factor=3.0), **changes}
    with pytest.raises(opir.SceneError) as refused:
        scene({key: value for key, value in settings.items() if value is not None})
    assert words in str(refused.value)


def test_explain_says_which_sensors_fail() -> None:
    plan = opir.compile_plan(scene(fault("noise", 60.0, None, factor=3.0), fault("down")))
    assert explained(plan)["faults"] == [
        "WEST: noise (factor 3) from 60 s on",
        "WEST: down from 40 s to 70 s",
    ]


def test_faults_at_random_follow_the_seed_and_their_means() -> None:
    rated = fault("down", 5.0, None, mtbf_s=8.0, mttr_s=3.0)
    plan = opir.compile_plan(scene(rated, seed=4))
    spans = plan.sensors[WEST].watched_s
    assert spans == opir.compile_plan(scene(rated, seed=4)).sensors[WEST].watched_s
    assert spans != opir.compile_plan(scene(rated, seed=5)).sensors[WEST].watched_s
    reseeded = opir.reseeded(plan, 5)
    assert reseeded.sensors[WEST].watched_s == (
        opir.compile_plan(scene(rated, seed=5)).sensors[WEST].watched_s
    )
    assert spans is not None
    assert spans[0][0] == 0.0
    assert spans[0][1] > 5.0
    down = [(span[1], following[0]) for span, following in pairwise(spans)]
    time_s, _ = directions(opir.simulate(scene(rated, seed=4)), WEST)
    assert len(time_s) > 100
    assert not any(((time_s > start) & (time_s < end)).any() for start, end in down)


def test_faults_at_random_last_and_come_as_often_as_their_means_say() -> None:
    mtbf_s, mttr_s = 300.0, 20.0
    settings = {"mtbf_s": mtbf_s, "mttr_s": mttr_s}
    long = scene(fault("blind", 0.0, None, **settings), duration_s=6e5, targets=[], sources=[])
    drawn = opir.compile_plan(long).faults
    assert drawn is not None
    spans = np.array([(drawn_fault.at_s, drawn_fault.end_s) for _, drawn_fault in drawn.faults])
    repairs_s = spans[:, 1] - spans[:, 0]
    gaps_s = spans[1:, 0] - spans[:-1, 1]
    for lengths, mean_s in ((repairs_s, mttr_s), (gaps_s, mtbf_s)):
        assert lengths.mean() == pytest.approx(mean_s, abs=3.0 * mean_s / np.sqrt(len(lengths)))
        share = np.mean(lengths > mean_s)
        assert share == pytest.approx(np.exp(-1.0), abs=3.0 * 0.49 / np.sqrt(len(lengths)))


def test_a_rate_needs_both_of_its_times() -> None:
    with pytest.raises(opir.SceneError, match="mtbf_s and mttr_s belong together"):
        scene(fault("down", mtbf_s=10.0))
    with pytest.raises(opir.SceneError, match="outside \\[1, inf"):
        scene(fault("down", mtbf_s=1e-9, mttr_s=1.0))
    text = str(scene(fault("down", 5.0, None, mtbf_s=8.0, mttr_s=3.0)).faults[0])
    assert text == "WEST: down from 5 s on at random, 3 s every 8 s"
