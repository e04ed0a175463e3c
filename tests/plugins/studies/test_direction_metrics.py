"""Metrics of directed sensors, against the detections, tracks and commands of runs taken apart here."""

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import pytest
from attrs import evolve
from directed_spot import LAUNCH_M, host_of, scene
from opir_testing import MetricContract
from study_metrics import figures_of
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.planning import whole_flights
from opir_core.plugin import Command, Situation

pytest.importorskip("opir_trackers")


class TestCustody(MetricContract):
    name = "custody"


class TestCueDelay(MetricContract):
    name = "cue_delay"


class TestHandOverGap(MetricContract):
    name = "hand_over_gap"


class TestLooksUsed(MetricContract):
    name = "looks_used"


def spot(name: str, slot_deg: float, **pointing: Any) -> dict[str, Any]:
    return {
        "model": "generic-pointed",
        "id": name,
        "orbital_slot_deg": slot_deg,
        "pointing": pointing,
    }


SCENE: dict[str, Any] = {
    "sensors": [
        {"model": "generic-scanner", "id": "WEST", "orbital_slot_deg": -150.0},
        {"model": "generic-scanner", "id": "EAST", "orbital_slot_deg": -90.0},
        spot("A", -100.0),
        spot("B", -130.0),
    ],
    "tracker": {"model": "imm", "cadence_s": 2.0},
    "director": {"model": "cue", "least_probability_launch": 0.0},
    "duration_s": 120.0,
}


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return opir.simulate(opir.scene_from_mapping(two_sensor_scene(**SCENE)))


class TestOfACuedRun:
    within_km: ClassVar[float] = 0.3

    def test_custody_counts_the_ticks_near_the_truth(self, run: opir.Run) -> None:
        flights = whole_flights(run.plan)
        ticks_s = np.arange(2.0, 121.0, 2.0)
        held = 0
        for tick_s in ticks_s:
            rows = np.flatnonzero(run.tracks.tick_s == tick_s)
            true_m = flights.position_ecef_m(np.zeros(1, np.int32), np.array([tick_s]))[0]
            errors_m = np.sqrt(((run.tracks.state[rows, :3] - true_m) ** 2).sum(axis=1))
            held += bool((errors_m <= 1e3 * self.within_km).any())
        custody = figures_of("custody", run, within_km=self.within_km)["custody"]
        assert 0 < held < len(ticks_s)
        assert custody == pytest.approx(2.0 * held / (120.0 - flights.ignition_s[0]))
        assert figures_of("custody", run, within_km=None)["custody"] > custody

    def test_the_cue_comes_from_the_first_track_to_the_first_narrow_detection(
        self, run: opir.Run
    ) -> None:
        is_narrow = run.detections.sensor >= 2
        expected_s = run.detections.time_s[is_narrow].min() - run.tracks.available_s.min()
        figures = figures_of("cue_delay", run)
        assert expected_s > 0.0
        assert figures["cue_delay_s"] == pytest.approx(expected_s)
        assert figures["cued"] == 1.0

    def test_looks_used_are_the_scans_with_a_detection(self, run: opir.Run) -> None:
        rows = np.flatnonzero((run.detections.sensor >= 2) & (run.truth.target == 0))
        pairs = set(zip(run.detections.sensor[rows], run.detections.scan[rows], strict=True))
        looks = 2 * 120e9 / run.sensors[2].scan.period_ns
        figures = figures_of("looks_used", run)
        assert figures["looks_used"] == pytest.approx(len(pairs) / looks)
        turned_s = sum(each.from_s - each.start_s for each in run.commands if not each.refusal)
        assert figures["turning"] == pytest.approx(turned_s / 240.0)


def in_two_modes(situation: Situation) -> Sequence[Command]:
    """Return commands: at the launch at once, twice as many looks from 30 to 60 s, half as many
    after 90 s.
    """
    modes = {0.0: "own", 30.0: "twice", 60.0: "own", 90.0: "half"}
    mode = modes.get(situation.time_s)
    named = {"sensor": "SPOT", "position_ecef_m": LAUNCH_M, "mode": mode}
    return [] if mode is None else [Command(**named)]


def test_looks_of_modes_are_counted_at_the_rate_of_each() -> None:
    modes = {"own": {}, "twice": {"scan_period_ms": 50.0}, "half": {"scan_period_ms": 200.0}}
    narrow = {"modes": modes, "detection_probability": {"ICBM": 0.5}}
    of = opir.simulate(scene(in_two_modes, spot=narrow), host_of(in_two_modes))
    is_of_launch = (of.detections.sensor == 1) & (of.truth.target == 0)
    times_ns = np.unique(of.detections.time_ns[is_of_launch])
    # The change begins 2 s after the command: 32 s of own, 30 of twice, 30 of own, 28 of half.
    looks = 32.0 / 0.1 + 30.0 / 0.05 + 30.0 / 0.1 + 28.0 / 0.2
    scans = of.detections.scan[is_of_launch]
    assert len(np.unique(scans)) < len(times_ns), "no scan number of one mode is that of another"
    figures = figures_of("looks_used", of)
    assert figures["looks_used"] == pytest.approx(len(times_ns) / looks)
    # Each change settles for 3 s; the first one turns before.
    turned_s = of.commands[0].from_s - of.commands[0].start_s + 3 * 3.0
    assert figures["turning"] == pytest.approx(turned_s / 120.0)


def seen_by(run: opir.Run, spans: list[tuple[int, float, float]]) -> opir.Run:
    """Return a run whose narrow fields detect the launch every second of some spans alone."""
    times_s = [np.arange(start_s, end_s + 0.5) for _, start_s, end_s in spans]
    sensor = np.repeat([number for number, _, _ in spans], list(map(len, times_s)))
    time_ns = (np.concatenate(times_s) * 1e9).astype(np.int64)
    order = np.argsort(time_ns, kind="stable")
    rows = np.zeros(len(order), dtype=np.int64)
    detections = evolve(
        run.detections.take(rows), time_ns=time_ns[order], sensor=sensor[order].astype(np.int32)
    )
    truth = evolve(run.truth.take(rows), target=np.zeros(len(rows), dtype=np.int32))
    return evolve(run, detections=detections, truth=truth)


@pytest.mark.parametrize(
    ("spans", "longest_s", "count"),
    [
        ([(2, 10.0, 40.0), (3, 47.0, 60.0)], 7.0, 1),
        ([(2, 10.0, 40.0), (3, 30.0, 60.0)], 0.0, 1),
        ([(2, 10.0, 40.0), (3, 42.0, 60.0), (2, 71.0, 80.0)], 11.0, 2),
        ([(2, 10.0, 40.0), (3, 20.0, 30.0)], np.nan, 0),
        ([(2, 10.0, 40.0), (2, 60.0, 80.0)], np.nan, 0),
    ],
)
def test_a_hand_over_is_from_one_field_to_another(
    run: opir.Run, spans: list[tuple[int, float, float]], longest_s: float, count: int
) -> None:
    figures = figures_of("hand_over_gap", seen_by(run, spans))
    assert figures["hand_over_gap_s"] == pytest.approx(longest_s, nan_ok=True)
    assert figures["hand_overs"] == count
    assert figures["handed_over"] == float(count > 0)


def test_a_run_without_narrow_fields_has_custody_and_no_cue() -> None:
    plain = {**SCENE, "sensors": SCENE["sensors"][:2], "director": "none"}
    wide = opir.simulate(opir.scene_from_mapping(two_sensor_scene(**plain)))
    assert figures_of("custody", wide)["custody"] > 0.5
    assert figures_of("cue_delay", wide)["cued"] == 0.0
    assert np.isnan(figures_of("looks_used", wide)["looks_used"])
