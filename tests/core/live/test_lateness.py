"""Lateness under a clock of the test: what the status and the metrics say of it."""

import time

import pytest
from live_scene import mapping
from opir_http.metrics import metrics_text
from opir_http.service import Service
from opir_http.settings import HttpSettings

from opir_core.live import BusyError, LiveRun, LiveSettings
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping

NS = 1_000_000_000
#: Real time that each cycle takes, s, after it was due; a cycle of 0.1 s that takes longer delays
#: the next.
TAKEN_S = [0.004, 0.3, 0.02, 0.0, 0.02]
#: Lateness by hand: due at 0.1, 0.2, 0.3; the second ends at 0.5, so the third (two cycles in one,
#: for it owes 3) is due at 0.5 and ends at 0.52, the fourth is due at 0.6.
LATE_S = [0.004, 0.3, 0.02, 0.0, 0.02]


def test_lateness_is_reported_as_the_clock_has_it(monkeypatch: pytest.MonkeyPatch) -> None:
    host = Host.discover()
    scene = scene_from_mapping(
        mapping(outputs=["null"], sensors=[{"constellation": "DSP"}]), host=host
    )
    clock_ns = [77 * NS]
    taken = iter(TAKEN_S)

    def work(_window: object) -> None:
        clock_ns[0] += round(next(taken) * NS)

    run = LiveRun(scene, host, LiveSettings(cycle_ns=NS // 10), work)
    service = Service(run, HttpSettings())
    monkeypatch.setattr(time, "monotonic_ns", lambda: clock_ns[0])
    run._pace.start()
    run._pace.wait = lambda due_ns, _stopping: (
        not clock_ns.__setitem__(0, max(clock_ns[0], 77 * NS + due_ns))
    )  # type: ignore[method-assign]
    lateness = []
    for _ in TAKEN_S:
        run._cycle()
        lateness.append((run.status().late_s, run.status().latest_s))
    late_s, latest_s = map(list, zip(*lateness, strict=True))
    assert late_s == pytest.approx(LATE_S, abs=1e-9)
    assert latest_s == pytest.approx([0.004, 0.3, 0.3, 0.3, 0.3], abs=1e-9)
    clock = service.status().clock
    assert (clock.late_s, clock.latest_s) == (0.02, 0.3)
    lines = dict(
        line.rsplit(" ", 1)
        for line in metrics_text(service).splitlines()
        if not line.startswith("#")
    )
    buckets = {"0.0025": 1, "0.005": 2, "0.01": 2, "0.025": 4, "0.25": 4, "0.5": 5, "+Inf": 5}
    for edge, count in buckets.items():
        assert float(lines[f'opir_cycle_late_seconds_bucket{{le="{edge}"}}']) == count, edge
    assert float(lines["opir_cycle_late_seconds_sum"]) == pytest.approx(sum(LATE_S), abs=1e-9)
    assert float(lines["opir_cycle_late_seconds_count"]) == 5


def test_a_cycle_later_than_the_scan_period_misses_its_deadline(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    host = Host.discover()
    sensors = [
        {"model": "generic-scanner", "id": "A", "orbital_slot_deg": 0.0, "scan_period_ms": 200.0},
        {"model": "generic-scanner", "id": "B", "orbital_slot_deg": 9.0, "scan_period_ms": 900.0},
    ]
    scene = scene_from_mapping(mapping(outputs=["null"], sensors=sensors), host=host)
    clock_ns = [0]
    taken = iter([0.199, 0.0, 0.0, 0.201, 0.0])

    def work(_window: object) -> None:
        clock_ns[0] += round(next(taken) * NS)

    run = LiveRun(scene, host, LiveSettings(cycle_ns=NS // 10), work)
    monkeypatch.setattr(time, "monotonic_ns", lambda: clock_ns[0])
    run._pace.start()
    run._pace.wait = lambda due_ns, _stopping: not clock_ns.__setitem__(0, max(clock_ns[0], due_ns))  # type: ignore[method-assign]
    missed = []
    for _ in range(5):
        run._cycle()
        missed.append(run.status().late_cycles)
    assert missed == [0, 0, 0, 1, 1]


def run_with(
    settings: LiveSettings, taken_s: list[float], monkeypatch: pytest.MonkeyPatch
) -> tuple[LiveRun, list[int]]:
    """Return a run whose cycles take some real time each, under a clock of the test."""
    host = Host.discover()
    clock_ns = [0]
    scene = scene_from_mapping(
        mapping(outputs=["null"], sensors=[{"constellation": "DSP"}]), host=host
    )

    def work(_window: object) -> None:
        clock_ns[0] += round(taken_s[0] * NS)

    run = LiveRun(scene, host, settings, work)
    monkeypatch.setattr(time, "monotonic_ns", lambda: clock_ns[0])
    run._pace.start()
    run._pace.wait = lambda due_ns, _stopping: (
        not clock_ns.__setitem__(  # type: ignore[method-assign]
            0, clock_ns[0] + max(0, -run._pace.late_ns(due_ns))
        )
    )
    run._state = "running"
    return run, clock_ns


LAUNCH = {
    "type": "SRBM",
    "launch": {"lat_deg": 34.0, "lon_deg": -120.0},
    "aim": {"lat_deg": 34.0, "lon_deg": -115.0},
}


def test_a_late_run_is_unready_and_refuses_launches_and_settings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # A late run does up to 20 cycles at once, so that only 2 s and more for such a step let it fall
    # behind for good.
    run, _ = run_with(LiveSettings(cycle_ns=NS // 10, late_after_s=3.0), [2.5], monkeypatch)
    while run.late_s <= 3.0:
        ready = not run.progress().delays
        assert ready
        run._cycle()
    assert run.progress().delays == (f"the run is {run.late_s:.1f} s late",)
    for refused in (lambda: run.launch(LAUNCH), lambda: run.configure(run.settings_mapping())):
        with pytest.raises(BusyError, match="s late; try again later"):
            refused()
    assert not Service(run, HttpSettings()).health().ready


def test_a_slowed_run_takes_longer_and_stays_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    run, clock_ns = run_with(
        LiveSettings(cycle_ns=NS // 10, late_after_s=3.0, slows=True), [2.5], monkeypatch
    )
    for _ in range(20):
        run._cycle()
        assert run.late_s <= 3.0
        assert not run.progress().delays
    assert clock_ns[0] == pytest.approx(20 * 2.5 * NS, rel=0.01)
    assert run.time_ns < 0.9 * clock_ns[0]


def test_a_launch_that_would_make_the_run_late_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    taken_s = [0.02]
    run, _ = run_with(LiveSettings(cycle_ns=NS // 10), taken_s, monkeypatch)
    for _ in range(60):
        run._cycle()
    assert run.status().targets == 2
    run._require_pace(2)
    taken_s[0] = 0.07
    for _ in range(60):
        run._cycle()
    assert run._pace.load == pytest.approx(0.7, abs=0.04)
    # Of 0.7 the two targets have 0.5; a third would make it 0.95.
    with pytest.raises(
        BusyError,
        match=r"the run takes [67].% of real time with 2 targets: one more would make it late",
    ):
        run.launch(LAUNCH)
    taken_s[0] = 0.06
    for _ in range(60):
        run._cycle()
    run._require_pace(2)


def test_a_load_that_is_there_without_targets_refuses_none(monkeypatch: pytest.MonkeyPatch) -> None:
    run, _ = run_with(LiveSettings(cycle_ns=NS // 10), [0.08], monkeypatch)
    for _ in range(120):
        run._cycle()
    run._require_pace(2)
