"""What `cue` and `information` decide in situations made by hand."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

import opir_core as opir
from opir_core.builtin.director_models import CueConfig, InformationConfig
from opir_core.builtin.directors import Cue
from opir_core.builtin.information import Information
from opir_core.plugin import Command, Detections, Director, Sensor, Situation, Tracks

PLACES_M = np.array([[-2.6e6, -4.6e6, 3.6e6], [-2.0e6, -5.6e6, 2.4e6], [-1.2e6, -4.4e6, 4.4e6]])


def spot(name: str, slot_deg: float, **settings: Any) -> dict[str, Any]:
    return {"model": "generic-pointed", "id": name, "orbital_slot_deg": slot_deg, **settings}


def sensors_of(rows: Sequence[Mapping[str, Any]]) -> Sequence[Sensor]:
    scene: dict[str, Any] = {
        "scene": "situations",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "seed": 1,
        "sensors": rows,
        "targets": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene)).sensors


@pytest.fixture(scope="module")
def sensors() -> Sequence[Sensor]:
    return sensors_of([spot("A", -120.0), spot("B", -100.0)])


def tracks_of(time_s: float, sigmas_m: Sequence[float], **columns: Any) -> Tracks:
    count = len(sigmas_m)
    unknown = np.full((count, 3), np.nan)
    covariance = [np.diag([sigma_m**2] * 3 + [1e4] * 3) for sigma_m in sigmas_m]
    return Tracks(
        track=np.arange(count),
        tick_s=np.full(count, time_s),
        state=np.hstack([PLACES_M[:count], np.zeros((count, 3))]),
        state_covariance=np.array(covariance),
        launch=unknown,
        launch_covariance=np.full((count, 3, 3), np.nan),
        impact=unknown,
        impact_covariance=np.full((count, 3, 3), np.nan),
        type_probability=np.full((count, 1), np.nan),
        **columns,
    )


def commands_of(
    director: Director,
    sensors: Sequence[Sensor],
    time_s: float,
    sigmas_m: Sequence[float],
    until_s: Mapping[str, float] | None = None,
    **columns: Any,
) -> Mapping[str, Command]:
    """Return the command to each sensor; sensors see everything until a time."""
    ends_s = until_s or {}

    def in_reach(sensor: str, position_m: Any, after_s: float = 0.0) -> Any:
        return np.full(len(position_m), time_s + after_s <= ends_s.get(sensor, np.inf))

    situation = Situation(
        time_s=time_s,
        detections=Detections.empty(),
        tracks=tracks_of(time_s, sigmas_m, **columns),
        sensors=tuple(sensors),
        refused=(),
        in_reach=in_reach,
    )
    return {command.sensor: command for command in director.commands(situation)}


def sent(director: Director, *arguments: Any, **columns: Any) -> Mapping[str, int]:
    """Return the track of each sensor, of the commands of these arguments."""
    commands = commands_of(director, *arguments, **columns)
    return {sensor: command.track for sensor, command in commands.items()}


def test_cue_hands_a_track_over_before_its_sensor_loses_it(sensors: Sequence[Sensor]) -> None:
    cue = Cue(CueConfig(hand_over_s=30.0, dwell_s=10.0))
    ends_s = {"A": 100.0}
    sigmas_m = [1e3, 2e3]
    first = sent(cue, sensors, 0.0, sigmas_m, ends_s)
    assert first == {"A": 1, "B": 0}
    assert sent(cue, sensors, 60.0, sigmas_m, ends_s) == first
    # At 72 s the sensor A has lost its track in 30 s: B goes to it, and A stays to its end.
    assert sent(cue, sensors, 72.0, sigmas_m, ends_s) == {"A": 1, "B": 1}
    assert sent(cue, sensors, 99.0, sigmas_m, ends_s)["A"] == 1
    assert "A" not in sent(cue, sensors, 101.0, sigmas_m, ends_s)


def test_cue_sends_no_sensor_to_a_track_that_it_loses_at_once(sensors: Sequence[Sensor]) -> None:
    cue = Cue(CueConfig(hand_over_s=30.0))
    assert sent(cue, sensors, 0.0, [1e3], {"A": 20.0}) == {"B": 0}
    lenient = Cue(CueConfig(hand_over_s=0.0))
    assert sent(lenient, sensors, 0.0, [1e3], {"A": 20.0}) == {"A": 0, "B": 0}


SLOTS_DEG = {"A": -120.0, "B": -100.0, "C": -110.0}
NARROW = [spot(name, slot_deg) for name, slot_deg in SLOTS_DEG.items()]
WIDE = [{**each, "model": "SBIRS-GEO", "modes": "notional"} for each in NARROW]
SPREAD: Mapping[str, Any] = {"mode": "sector", "search_mode": "survey"}


@pytest.mark.parametrize(("rows", "settings"), [(NARROW, {}), (WIDE, SPREAD)])
def test_cue_spreads_three_sensors_over_three_tracks(
    rows: Sequence[Mapping[str, Any]], settings: Mapping[str, Any]
) -> None:
    free = sensors_of(rows)
    at_once = sent(Cue(CueConfig(**settings)), free, 0.0, [1e3, 2e3, 3e3])
    assert at_once == {"A": 2, "B": 1, "C": 0}
    # Of the sensors that go to the first track, those that double it leave for the others.
    cue = Cue(CueConfig(**settings, dwell_s=20.0))
    sent(cue, free, 0.0, [1e3])
    later = sent(cue, free, 2.0, [1e3, 2e3, 3e3])
    assert sorted(later.values()) == [0, 1, 2]
    assert sent(cue, free, 4.0, [1e3, 2e3, 3e3]) == later


def test_cue_takes_no_more_sensors_from_a_track_than_others_need() -> None:
    cue = Cue(CueConfig(dwell_s=20.0))
    free = sensors_of(NARROW)
    assert sent(cue, free, 0.0, [1e3]) == {"A": 0, "B": 0, "C": 0}
    assert sorted(sent(cue, free, 2.0, [1e3, 2e3]).values()) == [0, 0, 1]


def test_cue_leaves_wide_fields_in_survey_that_would_double_others() -> None:
    cue = Cue(CueConfig(**SPREAD, dwell_s=20.0))
    wide = sensors_of(WIDE)
    first = commands_of(cue, wide, 0.0, [1e3])
    assert {name: command.mode for name, command in first.items()} == {
        "A": "sector",
        "B": "survey",
        "C": "survey",
    }
    # A narrow field without a track goes first; the wide one that followed surveys again.
    mixed = [*wide, *sensors_of([spot("D", -105.0)])]
    assert sent(cue, mixed, 2.0, [1e3]) == {"A": 0, "D": 0}
    last = commands_of(cue, mixed, 24.0, [1e3])
    assert {name: command.track for name, command in last.items()} == {"A": -1, "D": 0}
    assert last["A"].mode == "survey"
    assert sent(Cue(CueConfig(**SPREAD)), mixed, 0.0, [1e3])["D"] == 0


def test_information_goes_to_what_is_least_known(sensors: Sequence[Sensor]) -> None:
    for sigmas_m, track in (([10.0, 1e4], 1), ([1e4, 10.0], 0)):
        assert sent(Information(InformationConfig()), sensors[:1], 0.0, sigmas_m) == {"A": track}


def test_information_shares_out_tracks_that_are_equally_known(sensors: Sequence[Sensor]) -> None:
    tracks = sent(Information(InformationConfig()), sensors, 0.0, [3e3, 3e3])
    assert set(tracks.values()) == {0, 1}


def test_information_weighs_the_probability_of_a_launch(sensors: Sequence[Sensor]) -> None:
    chances = np.array([0.95, 0.05])
    director = Information(InformationConfig(least_probability_launch=0.0))
    assert sent(director, sensors, 0.0, [3e3, 3e3], probability_launch=chances) == {"A": 0, "B": 0}
    strict = Information(InformationConfig(least_probability_launch=0.5))
    assert 1 not in sent(strict, sensors, 0.0, [10.0, 1e5], probability_launch=chances).values()


def test_information_turns_only_for_more_than_the_turn_costs(sensors: Sequence[Sensor]) -> None:
    director = Information(InformationConfig(horizon_s=6.0))
    assert sent(director, sensors[:1], 0.0, [3e3, 2e3]) == {"A": 0}
    # Equally known, the turn to the other track costs looks; a far less known one is worth them.
    assert sent(director, sensors[:1], 5.0, [2e3, 2e3]) == {"A": 0}
    assert sent(director, sensors[:1], 10.0, [1.0, 5e4]) == {"A": 1}


def test_a_track_of_unknown_covariance_is_worth_a_look(sensors: Sequence[Sensor]) -> None:
    assert sent(Information(InformationConfig()), sensors[:1], 0.0, [1.0, np.nan]) == {"A": 1}


#: Of "brief", slow to settle, each look tells as much as ten of "long", ready at once.
MODES: Mapping[str, Any] = {
    "brief": {"scan_period_ms": 100.0, "settle_s": 20.0},
    "long": {"scan_period_ms": 1000.0, "settle_s": 0.0},
    "blurred": {"scan_period_ms": 100.0, "line_of_sight_sigma_urad": 1000.0, "settle_s": 0.0},
    "dim": {
        "scan_period_ms": 100.0,
        "detection_probability": dict.fromkeys(("SRBM", "MRBM", "IRBM", "ICBM"), 1e-3),
        "settle_s": 0.0,
    },
}


def moded(*names: str) -> Sequence[Sensor]:
    """Return a sensor that has these modes."""
    return sensors_of([spot("A", -120.0, modes={name: MODES[name] for name in names})])


def mode_of(sensors: Sequence[Sensor], modes: Sequence[str], horizon_s: float) -> str:
    director = Information(InformationConfig(modes=tuple(modes), horizon_s=horizon_s))
    (command,) = commands_of(director, sensors, 0.0, [3e3]).values()
    return command.mode


def test_information_chooses_the_mode_whose_looks_tell_most() -> None:
    sensors = moded(*MODES)
    assert mode_of(sensors, ["brief", "long"], horizon_s=300.0) == "brief"
    assert mode_of(sensors, ["blurred", "long"], horizon_s=300.0) == "long"
    assert mode_of(sensors, ["dim", "long"], horizon_s=300.0) == "long"
    assert mode_of(sensors, ["blurred"], horizon_s=300.0) == "blurred"


def test_information_weighs_what_a_change_of_mode_costs() -> None:
    assert mode_of(moded(*MODES), ["brief", "long"], horizon_s=21.0) == "long"
    for name in ("brief", "long"):
        # It looks at the track in that mode already: the other one costs a change.
        director = Information(InformationConfig(modes=("brief", "long"), horizon_s=21.0))
        assert commands_of(director, moded(name), 0.0, [3e3])["A"].mode == name
        assert commands_of(director, moded(*MODES), 5.0, [3e3])["A"].mode == name


def test_information_gives_one_command_to_a_sensor_with_modes() -> None:
    plain = spot("B", -100.0)
    sensors = sensors_of([spot("A", -120.0, modes=MODES), plain])
    director = Information(InformationConfig(modes=("brief", "long"), horizon_s=300.0))
    commands = commands_of(director, sensors, 0.0, [3e3, 3e3])
    assert {sensor: command.mode for sensor, command in commands.items()} == {
        "A": "brief",
        "B": "",
    }
    assert {command.track for command in commands.values()} == {0, 1}
