"""Events in the order of report: none lost, none early; and a tracker that gets only what has been
reported.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve, fields
from late_scene import CONSTANT, NS, UNEVEN, late_scene
from opir_testing import stub_estimates
from opir_testing.bench import encoder_of

import opir_core as opir
from opir_core import Engine, Plan, Run, compile_plan, plan_windows, run_of_plan
from opir_core.arrays import IntArray
from opir_core.plugin import Detections, Tracks

MIXED = (UNEVEN, CONSTANT, "paper-ground-chain", "none")


def lines(plan: Plan, window_s: float | None = None, encoder: str = "forge-tracks") -> bytes:
    product = encoder_of(plan, encoder)
    return b"".join(product.encode(window) for window in plan_windows(plan, window_s))


def differing(actual: Any, expected: Any) -> set[str]:
    """Return the columns in which two records differ."""
    names = (attribute.name for attribute in fields(type(actual)))
    return {name for name in names if not _equal(getattr(actual, name), getattr(expected, name))}


def _equal(first_run: Any, second_run: Any) -> bool:
    return bool(np.array_equal(first_run, second_run, equal_nan=first_run.dtype.kind == "f"))


def test_events_come_in_the_order_of_report_and_none_is_lost() -> None:
    plan = compile_plan(late_scene(*MIXED))
    observed = Engine(plan).advance(plan.end_ns).detections
    run = run_of_plan(plan)
    order = np.argsort(observed.reported_ns, kind="stable")
    assert not np.array_equal(order, np.arange(len(order)))
    assert differing(run.detections, observed.take(order)) == set()
    assert observed.reported_ns.max() > plan.end_ns
    assert np.all(observed.reported_ns >= observed.time_ns)
    # The truth goes along: of each event it is that of its id.
    alone = run_of_plan(compile_plan(late_scene(*["none"] * 4)))
    target = dict(
        zip(
            map(tuple, alone.detections.detection_id.tolist()),
            alone.truth.target.tolist(),
            strict=True,
        )
    )
    assert [
        target[tuple(item)] for item in run.detections.detection_id.tolist()
    ] == run.truth.target.tolist()


@pytest.mark.slow
def test_a_window_has_what_is_reported_in_it() -> None:
    plan = compile_plan(late_scene(*MIXED, tracker="imm"))
    windows = list(plan_windows(plan, 3.0))
    assert len(windows) == 21
    assert windows[-1].start_s == pytest.approx(60.0)
    for window in windows:
        reported_s = window.detections.reported_ns * 1e-9
        assert np.all((reported_s >= window.start_s - 1e-9) & (reported_s < window.end_s + 1e-9))
        assert np.all(window.detections.estimate < len(window.estimates))
        assert not window.detections.reported_ns.flags.writeable
    assert sum(window.looks for window in windows) == plan.pairs.looks.sum()
    assert windows[-1].looks == 0
    assert len(windows[-1].detections) > 10


@pytest.mark.slow
@pytest.mark.parametrize("order", ["observation", "report"])
@pytest.mark.parametrize("tracker", ["none", "imm"])
def test_bytes_do_not_depend_on_the_windows(tracker: str, order: str) -> None:
    plan = compile_plan(late_scene(*MIXED, tracker=tracker, tracking_order=order))
    complete = lines(plan)
    assert complete.count(b"\n") > 500
    for window_s in (0.31, 7.0, 25.0):
        assert lines(plan, window_s) == complete
    repeat = opir.simulate(plan.scene, window_s=5.0)
    assert differing(repeat.tracks, run_of_plan(plan).tracks) == set()


@pytest.mark.slow
def test_without_latency_windows_pass_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    built = []
    advance = Engine.advance

    def kept(engine: Engine, end_ns: int) -> Any:
        built.append(advance(engine, end_ns))
        return built[-1]

    monkeypatch.setattr(Engine, "advance", kept)
    windows = list(plan_windows(compile_plan(late_scene("none", tracker="kepler-arc")), 10.0))
    assert all(actual is expected for actual, expected in zip(windows, built, strict=True))


class CountedTracker:
    """A tracker of one track whose state counts; keeps what it is asked and given, and when."""

    cadence_s = 2.5

    def __init__(self) -> None:
        self.given: list[tuple[float, Detections]] = []
        self.asked: list[tuple[float, Detections]] = []

    def associate(self, detections: Detections) -> IntArray:
        self.asked.append((self.given[-1][0] if self.given else 0.0, detections))
        return np.full(len(detections), 0 if self.given else -1, dtype=np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        self.given.append((tick_s, detections))
        return stub_estimates(1, tick_s=tick_s, state=np.full(6, tick_s))


def tracked(
    lag_s: float | None = None, *, window_s: float | None = None, **changes: Any
) -> tuple[CountedTracker, Run]:
    """Return the record of a tracker in the order of report, and the run."""
    scene = late_scene(*MIXED, tracking_order="report", tracking_lag_s=lag_s, **changes)
    spy = CountedTracker()
    return spy, run_of_plan(evolve(compile_plan(scene), make_tracker=lambda: spy), window_s)


@pytest.mark.slow
@pytest.mark.parametrize("lag_s", [0.0, 4.0, 9.3, None])
@pytest.mark.parametrize("duration_s", [60.0, 58.9])
def test_a_tick_gets_the_detections_reported_before_it(
    lag_s: float | None, duration_s: float
) -> None:
    """Against a plain loop over ticks and detections."""
    spy, run = tracked(lag_s, duration_s=duration_s, window_s=3.3)
    ticks_ns = [
        *range(2_500_000_000, round(duration_s * NS), 2_500_000_000),
        round(duration_s * NS),
    ]
    lag_ns = round(run.tracks.available_s[0] * NS) - round(run.tracks.tick_s[0] * NS)
    assert [round(tick_s * NS) for tick_s, _ in spy.given] == ticks_ns
    assert lag_s is None or lag_ns == round(lag_s * NS)
    rows = sorted(
        zip(
            run.detections.time_ns.tolist(),
            run.detections.sensor.tolist(),
            run.detections.reported_ns.tolist(),
            map(tuple, run.detections.detection_id.tolist()),
            strict=True,
        )
    )
    before_ns = 0
    delayed = 0
    for tick_ns, (_, inputs) in zip(ticks_ns, spy.given, strict=True):
        piece = [row for row in rows if before_ns <= row[0] < tick_ns]
        expected = [row for row in piece if row[2] < tick_ns + lag_ns]
        delayed += len(piece) - len(expected)
        reported = zip(
            inputs.time_ns.tolist(),
            inputs.sensor.tolist(),
            map(tuple, inputs.detection_id.tolist()),
            strict=True,
        )
        assert sorted(reported) == sorted((row[0], row[1], row[3]) for row in expected)
        assert np.all(np.diff(inputs.time_ns) >= 0)
        before_ns = tick_ns
    assert (delayed > 0) == (lag_s is not None)
    assert delayed < len(rows)


def test_an_event_has_the_estimate_available_at_its_report() -> None:
    for lag_s in (0.0, 4.0, 9.3):
        spy, run = tracked(lag_s)
        results = run.estimates
        detections_read = run.detections
        ticks_ns = np.array([round(tick_s * NS) for tick_s, _ in spy.given])
        steps = np.searchsorted(
            ticks_ns + round(lag_s * NS), detections_read.reported_ns, side="right"
        )
        in_time = detections_read.time_ns >= np.concatenate([[0], ticks_ns])[steps]
        has = detections_read.estimate >= 0
        # The tracker has a track from its first step on.
        assert np.array_equal(has, in_time & (steps > 0))
        assert np.array_equal(has, detections_read.track == 0)
        assert np.array_equal(
            np.rint(results.tick_s[detections_read.estimate[has]] * NS), ticks_ns[steps[has] - 1]
        )
        assert np.all(
            results.available_s[detections_read.estimate[has]]
            <= detections_read.reported_ns[has] * 1e-9 + 1e-9
        )
        # It is asked by the tracks of that step, and of nothing that is late.
        calls = sorted(
            (last_s, time_ns) for last_s, piece in spy.asked for time_ns in piece.time_ns.tolist()
        )
        expected = zip(
            np.concatenate([[0], ticks_ns])[steps[in_time]] / NS,
            detections_read.time_ns[in_time].tolist(),
            strict=True,
        )
        assert calls == sorted(expected)


def test_what_a_tracker_gets_does_not_depend_on_the_windows() -> None:
    spies = [tracked(4.0, window_s=window_s)[0] for window_s in (None, 0.7, 11.0)]
    for spy in spies[1:]:
        assert [tick_s for tick_s, _ in spy.given] == [tick_s for tick_s, _ in spies[0].given]
        for (_, actual), (_, expected) in zip(spy.given, spies[0].given, strict=True):
            assert differing(actual, expected) == set()


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["imm", "kepler-arc"])
def test_constant_latency_gives_the_tracks_without_latency(
    tracker: str,
) -> None:
    """The lag is then the latency: the tracker does the same, that much later."""
    prompt, observed, reported = (
        opir.simulate(late_scene(*latency, tracker=tracker, tracking_order=order))
        for latency, order in (
            (("none", "none"), "observation"),
            ((CONSTANT, CONSTANT), "observation"),
            ((CONSTANT, CONSTANT), "report"),
        )
    )
    assert len(prompt.tracks) > 20
    for run in (observed, reported):
        assert differing(run.detections, prompt.detections) - {"estimate"} == {"reported_ns"}
        assert np.all(run.detections.reported_ns - run.detections.time_ns == 7_250_000_000)
        assert differing(run.tracks, prompt.tracks) == {"available_s"}
        has = run.detections.estimate >= 0
        assert np.array_equal(has, prompt.detections.estimate >= 0)
        actual, expected = (
            item.estimates.take(item.detections.estimate[has]) for item in (run, prompt)
        )
        assert differing(actual, expected) == {"available_s"}
    assert np.allclose(
        reported.tracks.available_s, reported.tracks.tick_s + 7.25, rtol=0.0, atol=1e-9
    )
    equal_run = opir.simulate(late_scene("none", "none", tracker=tracker, tracking_order="report"))
    assert differing(equal_run.detections, prompt.detections) == set()
    assert differing(equal_run.tracks, prompt.tracks) == set()


@pytest.mark.slow
def test_estimates_wait_for_all_earlier_reports() -> None:
    run = opir.simulate(late_scene(*MIXED, tracker="imm"))
    for tick_s, available_s in {
        *zip(run.tracks.tick_s.tolist(), run.tracks.available_s.tolist(), strict=True)
    }:
        earlier = run.detections.time_ns < round(tick_s * NS)
        latest_s = run.detections.reported_ns[earlier].max(initial=0) * 1e-9
        assert available_s == pytest.approx(max(tick_s, latest_s), abs=1e-9)


@pytest.mark.slow
def test_late_reports_are_events_and_are_not_tracked() -> None:
    run = opir.simulate(
        late_scene(
            "paper-ground-chain", tracker="imm", tracking_order="report", tracking_lag_s=30.0
        )
    )
    alone = opir.simulate(late_scene("paper-ground-chain"))
    assert len(run.detections) == len(alone.detections)
    delay_s = (run.detections.reported_ns - run.detections.time_ns) * 1e-9
    # The step that a report misses is at most one cadence after its look.
    assert np.all(run.detections.track[delay_s > 30.0 + 1.0] == -1)
    assert np.any(run.detections.track >= 0)
    assert np.count_nonzero(delay_s > 31.0) > 50


@pytest.mark.slow
def test_scores_of_a_run_are_those_of_its_files(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    from opir_scoring import evidence_of_files, evidence_of_run

    from opir_core.output import deliver

    monkeypatch.chdir(tmp_path)
    plan = compile_plan(
        late_scene(UNEVEN, CONSTANT, tracker="imm", outputs=[{"jsonl": {"path": "e.jsonl"}}])
    )
    beside = {f"{name}_path": tmp_path / f"e.{name}.jsonl" for name in ("truth", "tracks")}
    deliver(plan, **beside, manifest_path=tmp_path / "e.manifest.json")
    files = evidence_of_files(tmp_path / "e.jsonl")
    memory = evidence_of_run(run_of_plan(plan), plan)
    assert np.allclose(files.time_s, memory.time_s, rtol=0.0, atol=1e-6)
    assert np.all(np.diff(memory.time_s) >= 0.0)
    for name in ("sensor", "track", "target"):
        assert np.array_equal(getattr(files, name), getattr(memory, name)), name
    rounded = {"launch", "impact", "launch_covariance", "impact_covariance", "impact_regions"}
    assert differing(files.tracks, memory.tracks) <= rounded
    for name in ("launch", "impact"):
        require_same_points(files.tracks, memory.tracks, name)
    rows = zip(files.tracks.impact_regions, memory.tracks.impact_regions, strict=True)
    for regions, expected in rows:
        assert [region.containment for region in regions] == [
            region.containment for region in expected
        ]
        assert [region.area_km2 for region in regions] == pytest.approx(
            [region.area_km2 for region in expected], abs=1e-3
        )


def require_same_points(tracks: Any, expected: Any, name: str) -> None:
    """Points are degrees and back; the covariance with time is written once."""
    points = getattr(tracks, name), getattr(expected, name)
    assert np.allclose(*points, rtol=4e-16, atol=0.0, equal_nan=True)
    covariance, expected_covariance = (
        getattr(table, f"{name}_covariance") for table in (tracks, expected)
    )
    sigma = np.sqrt(np.diagonal(expected_covariance, axis1=1, axis2=2))
    difference = np.abs(covariance - expected_covariance)
    assert not np.any(difference > 1e-14 * sigma[:, :, None] * sigma[:, None, :])
    assert np.array_equal(np.isnan(covariance), np.isnan(expected_covariance))


@pytest.mark.slow
def test_tracks_files_have_valid_and_available_times(
    tmp_path: Any,
) -> None:
    from opir_core.output import TracksFile, read_tracks

    run = opir.simulate(late_scene(CONSTANT, CONSTANT, tracker="imm", tracking_order="report"))
    tracks = run.tracks
    with TracksFile(tmp_path / "t.jsonl", run.plan.hypothesis_names) as file:
        file.write(tracks)
    read_back = read_tracks(tmp_path / "t.jsonl")
    assert np.array_equal(read_back.available_s, tracks.available_s)
    assert np.all(read_back.available_s > read_back.tick_s)
