"""Modes of sensors that a director names: what they change, how long that takes, what is refused."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from directed_spot import (
    ELSEWHERE_M,
    LAUNCH_M,
    Decide,
    SpotConfig,
    columns,
    host_of,
    point_at,
    run,
    scene,
    spot_times_s,
)

import opir_core as opir
from opir_core.builtin.director_models import CueConfig
from opir_core.builtin.directors import Cue
from opir_core.live import LiveRun, LiveSettings, SensorTask
from opir_core.output.run_files import read_commands
from opir_core.planning.sensor_modes import SensorModes
from opir_core.plugin import (
    Command,
    CommandRecord,
    Detections,
    SensorModel,
    Situation,
    Tracks,
    hookimpl,
    scanning_model,
)
from opir_core.reading import scene_mapping
from opir_core.scene.plausibility import implausible_values
from opir_core.simulation.merging import MergeModes
from opir_core.simulation.observation import Observation

NS = 1_000_000_000
MODES: Mapping[str, Any] = {
    "sector": {
        "half_angle_deg": 2.0,
        "scan_period_ms": 1000.0,
        "slew_deg_s": 0.5,
        "settle_s": 5.0,
    },
    "dim": {"detection_probability": {"ICBM": 0.3}},
    "own": {},
}


def in_modes(of: Mapping[float, Mapping[str, Any]]) -> Decide:
    """Return what gives commands at times."""

    def decide(situation: Situation) -> Sequence[Command]:
        settings = of.get(situation.time_s)
        return [] if settings is None else [Command(sensor="SPOT", **settings)]

    return decide


TOUR = in_modes(
    {
        0.0: {"position_ecef_m": LAUNCH_M},
        30.0: {"mode": "sector"},
        60.0: {"mode": "dim"},
        90.0: {"mode": "own"},
    }
)


def spot(**settings: Any) -> dict[str, Any]:
    return {"modes": MODES, **settings}


def times_between_s(of: opir.Run, start_s: float, end_s: float) -> Any:
    times_s = spot_times_s(of)
    return times_s[(times_s >= start_s) & (times_s < end_s)]


def test_a_change_takes_the_turn_at_the_rate_of_the_mode_and_its_settling() -> None:
    decide = in_modes({0.0: {"position_ecef_m": LAUNCH_M, "mode": "sector"}})
    of = run(decide, spot=spot())
    (record,) = of.commands
    (sensor_m,) = of.sensors[1].orbit.position_ecef_m(np.zeros(1))
    towards = LAUNCH_M - sensor_m
    cosine = towards @ -sensor_m / np.linalg.norm(towards) / np.linalg.norm(sensor_m)
    assert record.mode == "sector"
    assert record.start_s == 2.0
    turn_s = np.degrees(np.arccos(cosine)) / 0.5 + 5.0
    assert record.from_s == pytest.approx(record.start_s + turn_s, abs=1e-9)
    assert record.from_s <= spot_times_s(of)[0] < record.from_s + 1.0


def test_a_mode_changes_scan_field_and_probability_and_is_left_again() -> None:
    of = run(TOUR, spot=spot())
    assert [record.from_s - record.start_s for record in of.commands[1:]] == [5.0, 3.0, 3.0]
    np.testing.assert_allclose(np.diff(times_between_s(of, 37.0, 62.0)), 1.0)
    assert len(times_between_s(of, 32.0, 37.0)) == len(times_between_s(of, 62.0, 65.0)) == 0
    # 270 looks: 81 detections, and 7.5 is their standard deviation.
    dim = len(times_between_s(of, 65.0, 92.0))
    assert 81 - 38 < dim < 81 + 38
    assert len(times_between_s(of, 95.0, 120.0)) == 250


SECTOR: Mapping[str, Any] = {"mode": "sector"}
TO_LAUNCH: Mapping[str, Any] = {"position_ecef_m": LAUNCH_M}


@pytest.mark.parametrize("settings", [(SECTOR, TO_LAUNCH), (TO_LAUNCH, SECTOR)])
def test_a_direction_and_a_mode_given_during_a_turn_both_count(
    settings: Sequence[Mapping[str, Any]],
) -> None:
    """The turn to the first place goes on until 25 s."""
    pointing = {"half_angle_deg": 0.5, "slew_deg_s": 0.3, "settle_s": 3.0, "delay_s": 2.0}
    elsewhere = {"position_ecef_m": ELSEWHERE_M}
    decide = in_modes(dict(zip((0.0, 10.0, 20.0), (elsewhere, *settings), strict=True)))
    of = run(decide, spot=spot(pointing=pointing))
    assert of.commands[-1].start_s == of.commands[0].from_s > 22.0
    np.testing.assert_allclose(np.diff(spot_times_s(of)), 1.0)
    assert len(spot_times_s(of)) > 10


def test_detections_of_all_modes_are_those_of_the_sensor() -> None:
    of = run(TOUR, spot=spot())
    detections = of.detections.take(np.flatnonzero(of.detections.sensor == 1))
    assert set(of.detections.sensor.tolist()) == {0, 1}
    assert detections.detection_count.tolist() == list(range(1, len(detections) + 1))
    assert len(np.unique(detections.detection_id, axis=0)) == len(detections)
    assert np.all(np.diff(of.detections.time_ns) >= 0)
    looks = of.plan.pairs.looks
    # 30 s with one look a second in place of ten.
    assert of.summary["counts"]["looks"] == pytest.approx(looks.sum() - 30 * 9, abs=2)
    assert [row["looks"] is None for row in of.summary["sensors"]] == [False, True]


@pytest.mark.parametrize("window_s", [0.7, 33.0])
def test_windows_change_no_byte(window_s: float) -> None:
    of_scene = scene(TOUR, spot=spot())
    host = host_of(TOUR)
    whole, sliced = opir.simulate(of_scene, host), opir.simulate(of_scene, host, window_s=window_s)
    for one, other in zip(columns(whole), columns(sliced), strict=True):
        np.testing.assert_array_equal(one, other)
    names = "sensor", "detection_id", "detection_count", "reported_type"
    for name in names:
        np.testing.assert_array_equal(
            getattr(whole.detections, name), getattr(sliced.detections, name)
        )
    assert whole.commands == sliced.commands
    assert whole.summary["counts"] == sliced.summary["counts"]


def test_modes_that_no_command_names_change_nothing() -> None:
    decide = point_at(LAUNCH_M)
    plain, with_modes = run(decide), run(decide, spot=spot())
    for one, other in zip(columns(plain), columns(with_modes), strict=True):
        np.testing.assert_array_equal(one, other)
    assert plain.commands == with_modes.commands
    assert plain.summary["counts"] == with_modes.summary["counts"]
    np.testing.assert_array_equal(plain.detections.detection_id, with_modes.detections.detection_id)


def test_modes_not_in_force_have_no_looks_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    computed = []
    merge = MergeModes.__call__

    def counting(self: MergeModes, window: Observation) -> None:
        computed.append(len(window.looks.pair))
        merge(self, window)

    monkeypatch.setattr(MergeModes, "__call__", counting)
    of = run(point_at(LAUNCH_M), spot=spot())
    assert sum(computed) == of.summary["counts"]["looks"]


def test_modes_share_the_orbit_of_their_sensor() -> None:
    plan = opir.compile_plan(scene(TOUR, spot=spot()), host_of(TOUR))
    modes = SensorModes.of(plan)
    assert {sensor.orbit for sensor in modes.plan.sensors} == {
        sensor.orbit for sensor in plan.sensors
    }


def test_an_unknown_mode_is_refused_counted_told_and_written(tmp_path: Path) -> None:
    told: list[CommandRecord] = []

    def decide(situation: Situation) -> Sequence[Command]:
        told.extend(situation.refused)
        return in_modes({0.0: {"position_ecef_m": LAUNCH_M}, 40.0: {"mode": "sectr"}})(situation)

    of = run(decide, spot=spot())
    words = "SPOT has no mode 'sectr'; the nearest: sector"
    assert [record.refusal for record in of.commands] == ["", words]
    assert [record.refusal for record in told] == [words]
    counts = of.summary["counts"]
    assert (counts["commands"], counts["refused_commands"]) == (2, 1)
    plain = run(point_at(LAUNCH_M), spot=spot())
    assert spot_times_s(of).tolist() == spot_times_s(plain).tolist()
    of.save(tmp_path / "events.jsonl")
    (_, written) = read_commands(tmp_path / "events.commands.jsonl")
    assert (written.refusal, written.mode) == (words, "sectr")
    first, second = (tmp_path / "events.commands.jsonl").read_text().splitlines()
    assert "mode" not in first
    assert second.endswith('"mode":"sectr"}')


def test_a_sensor_without_modes_refuses_any() -> None:
    (record,) = run(in_modes({0.0: {"mode": "sector"}})).commands
    assert record.refusal == "SPOT has no mode 'sector'; the nearest: none"


def test_faults_and_spans_hold_in_every_mode() -> None:
    blind = {"sensor": "SPOT", "fault": "blind", "at_s": 40.0, "until_s": 50.0}
    of = run(TOUR, spot=spot(), faults=[blind], watched_s={"SPOT": [[0.0, 55.0], [100.0, 120.0]]})
    assert not len(times_between_s(of, 40.0, 50.0))
    assert len(times_between_s(of, 50.0, 55.0)) == 5
    assert not len(times_between_s(of, 55.0, 100.0))
    assert len(times_between_s(of, 100.0, 120.0)) == 200


def test_a_bias_is_the_same_in_every_mode() -> None:
    settings = {"line_of_sight_sigma_urad": 0.0, "line_of_sight_bias_sigma_urad": 100.0}
    of = run(TOUR, spot=spot(**settings))
    rows = np.flatnonzero(of.detections.sensor == 1)
    times_s = of.detections.time_ns[rows] * 1e-9
    emission_s = of.truth.emission_time_s[rows]
    target_m = of.plan.targets.position_ecef_m(np.zeros(len(rows), dtype=np.int32), emission_s)
    towards = target_m - of.detections.sensor_ecef_m[rows]
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    error = of.detections.line_of_sight_ecef[rows] - towards
    own, sector = (error[(times_s > since) & (times_s < since + 8.0)] for since in (22.0, 50.0))
    assert np.linalg.norm(own.mean(axis=0)) > 1e-6
    np.testing.assert_allclose(own.mean(axis=0), sector.mean(axis=0), atol=2e-6)


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ({"a": {"scan_period_ms": -1.0}}, "modes.a.scan_period_ms"),
        ({"a": {"half_angle": 2.0}}, "did you mean half_angle_deg?"),
        ({"a": {"scan_period_ms": 1e-7 + 1.0}}, "modes.a: scan_period_ms"),
        ({"": {}}, "a mode without a name"),
        ({"a": {"detection_probability": {"ICBM": 2.0}}}, "modes.a.detection_probability"),
    ],
)
def test_modes_that_a_sensor_cannot_have_are_refused(modes: Any, words: str) -> None:
    with pytest.raises(opir.SceneError) as refused:
        scene(TOUR, spot={"modes": modes})
    assert words in str(refused.value)


def test_an_implausible_value_of_a_mode_is_named_with_its_mode() -> None:
    of_scene = scene(TOUR, spot={"modes": {"a": {"scan_period_ms": 0.5}}}, allow_implausible=True)
    (problem,) = implausible_values(of_scene)
    assert problem.path == "sensors[1].modes.a.scan_period_ms"


def test_a_mode_of_the_focal_plane_needs_a_focal_plane() -> None:
    settings = {"focal_plane": None, "nei_w_m2": 1e-12, "modes": {"a": {"subframes": 64}}}
    with pytest.raises(
        opir.SceneError, match=r"modes\.a: subframes: the sensor has no focal_plane"
    ):
        scene(TOUR, spot=settings)


def test_a_mode_has_its_sensor_s_probabilities_of_the_types_that_it_does_not_name() -> None:
    chances = {"ICBM": 0.9, "SRBM": 0.2}
    modes = {"dim": {"detection_probability": {"ICBM": 0.3}}}
    settings = {"detection_probability": chances, "modes": modes}
    sensor = opir.compile_plan(scene(TOUR, spot=settings), host_of(TOUR)).sensors[1]
    assert sensor.modes["dim"].detection_probability == {**chances, "ICBM": 0.3}


def test_a_threshold_of_a_mode_replaces_the_probability_of_its_sensor() -> None:
    settings = {"false_alarm_probability": 1e-6, "modes": {"keen": {"threshold_sigma": 3.0}}}
    sensor = opir.compile_plan(scene(TOUR, spot=settings), host_of(TOUR)).sensors[1]
    thresholds = [
        each.radiometer.threshold for each in (sensor, sensor.modes["keen"]) if each.radiometer
    ]
    assert thresholds == pytest.approx([4.753424, 3.0])


def test_a_scene_with_modes_is_read_back() -> None:
    given = scene(TOUR, spot=spot())
    assert opir.scene_from_mapping(scene_mapping(given), host=host_of(TOUR)) == given


ROUND_ROBIN = {"model": "round-robin", "places_deg": [[34.0, -120.0]], "dwell_s": 60.0}


def test_shipped_directors_name_the_modes_of_a_scene() -> None:
    of = run(TOUR, spot=spot(), director={**ROUND_ROBIN, "mode": "sector"})
    assert [record.mode for record in of.commands] == ["sector", "sector"]
    for director in ({**ROUND_ROBIN, "mode": "sektor"}, {"model": "cue", "search_mode": "sektor"}):
        with pytest.raises(opir.OpirError, match="no sensor has the mode 'sektor'; the nearest is"):
            run(TOUR, spot=spot(), director=director)


def test_cue_has_a_sensor_search_once_until_it_has_a_track() -> None:
    plan = opir.compile_plan(scene(TOUR, spot=spot()), host_of(TOUR))
    cue = Cue(CueConfig(search_mode="sector"))
    situation = Situation(
        time_s=0.0,
        detections=Detections.empty(),
        tracks=Tracks.empty(),
        sensors=plan.sensors[1:],
        refused=(),
        in_reach=lambda *_: np.ones(0, dtype=np.bool_),
    )
    (search,) = cue.commands(situation)
    assert (search.sensor, search.mode, search.position_ecef_m) == ("SPOT", "sector", None)
    assert not cue.commands(situation)


def test_cue_has_a_sensor_search_again_that_an_operator_gives_back() -> None:
    changes: dict[str, Any] = {
        "spot": spot(),
        "targets": [],
        "director": {"model": "cue", "search_mode": "sector"},
    }
    engine = opir.Engine(opir.compile_plan(scene(TOUR, **changes), host_of(TOUR)))
    (searching,) = engine.advance(4 * NS).commands
    engine.task(SensorTask(sensor="SPOT", mode="dim"))
    engine.advance(8 * NS)
    engine.task(SensorTask(sensor="SPOT"))
    *_, repeated = engine.advance(20 * NS).commands
    assert searching.mode == repeated.mode == "sector"
    assert repeated.time_s >= 8.0


def test_a_live_run_warns_once_of_each_sensor_that_refuses(
    caplog: pytest.LogCaptureFixture,
) -> None:
    def decide(situation: Situation) -> Sequence[Command]:
        return [Command(sensor=name, mode="sectr") for name in ("SPOT", "SPOTT")]

    live = LiveRun(scene(decide, spot=spot()), host_of(decide), LiveSettings(speed=None))
    live.start()
    live.stop()
    assert [record.getMessage() for record in caplog.records] == [
        "director: a command to SPOT is refused: SPOT has no mode 'sectr'; the nearest: sector",
        "director: a command to SPOTT is refused: SPOTT is no sensor with a narrow field",
    ]


@pytest.mark.parametrize("changes", [{"pointing": None}, {"id": "SPOT"}, None])
def test_a_mode_that_is_no_sensor_of_its_own_is_refused(changes: Any) -> None:
    model = scanning_model("SPOTTY", "a spot in modes", SpotConfig)

    def build(config: Any, context: Any) -> Any:
        sensor = model.build(config, context)
        mode = changes and evolve(sensor.modes["own"], **changes)
        return evolve(sensor, modes={"own": mode})

    class Models:
        @hookimpl
        def opir_sensor_models(self) -> list[SensorModel]:
            return [evolve(model, build=build)]

    host = host_of(TOUR)
    host.register(Models())
    of_scene = scene(TOUR, spot=spot())
    mapping = scene_mapping(of_scene)
    mapping["sensors"][1]["model"] = "SPOTTY"
    with pytest.raises(opir.OpirError, match="a sensor whose mode 'own' is not, like itself, an"):
        opir.simulate(opir.scene_from_mapping(mapping, host=host), host)
