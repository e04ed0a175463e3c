"""The work of a plan, reckoned before it runs: against the looks of the engine, counted by hand."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from live_scene import mapping

import opir_core as opir
from opir_core import compile_plan
from opir_core.planning import Looks
from opir_core.planning.looks import look_times_ns
from opir_core.planning.sightlines import Pairs
from opir_core.planning.work import EVENT_BYTES, Work, most_looks
from opir_core.reading import scene_from_mapping, scene_mapping

NS = 1_000_000_000


def scene(**changes: Any) -> opir.Scene:
    return scene_from_mapping(mapping(**changes))


def pairs_of(rows: list[tuple[int, int, int, int]]) -> Pairs:
    """Return pairs with period, phase, first and last scan."""
    period, phase, first_scan, last_scan = (
        np.array(column, dtype=np.int64) for column in zip(*rows, strict=True)
    )
    zeros = np.zeros(len(rows), dtype=np.int32)
    none = np.zeros(len(rows), dtype=np.bool_)
    return Pairs(
        zeros,
        zeros,
        period,
        phase,
        first_scan,
        last_scan,
        none,
        period * 0,
        period * 1.0,
        period,
        period,
    )


PAIRS = st.lists(
    st.tuples(st.integers(1, 40), st.integers(0, 39), st.integers(0, 30), st.integers(-1, 40)),
    min_size=1,
    max_size=5,
)


@settings(deadline=None)
@given(PAIRS, st.integers(1, 200))
def test_no_interval_has_more_looks_and_one_has_nearly_as_many(
    rows: list[tuple[int, int, int, int]], duration: int
) -> None:
    times = np.array(
        sorted(
            phase + scan * period
            for period, phase, first_scan, last_scan in rows
            for scan in range(first_scan, last_scan + 1)
        )
    )
    real = max(
        (np.searchsorted(times, time + duration) - place for place, time in enumerate(times)),
        default=0,
    )
    bound = most_looks(pairs_of(rows), duration)
    assert real <= bound <= len(times)
    if len(rows) == 1:
        assert bound <= real + 1


def test_the_work_of_a_run_is_the_looks_that_the_engine_makes() -> None:
    plan = compile_plan(scene())
    run = opir.simulate(scene())
    assert plan.workload.of_run() == Work(
        run.summary["counts"]["looks"], run.summary["counts"]["looks"]
    )
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    times_ns = np.sort(look_times_ns(plan.pairs, looks.pair, looks.scan))
    for duration_ns in (NS // 20, NS, 10 * NS):
        real = int(
            np.max(np.searchsorted(times_ns, times_ns + duration_ns) - np.arange(len(times_ns)))
        )
        assert real <= plan.workload.of_cycle(duration_ns).looks <= real + len(plan.pairs)


@pytest.mark.slow
def test_false_alarms_are_events() -> None:
    sensor = {
        "model": "generic-scanner",
        "id": "A",
        "orbital_slot_deg": -135.0,
        "false_alarm_probability": 1e-4,
    }
    noisy = scene(sensors=[sensor], detection="snr", background="none")
    plan = compile_plan(noisy)
    work = plan.workload.of_run()
    expected = float(plan.detection.rate_per_scan[0]) * 100.0 / 0.5  # type: ignore[attr-defined]
    assert work.events - work.looks == pytest.approx(expected)
    assert expected > 10.0
    drawn = int(np.count_nonzero(opir.simulate(noisy).truth.target < 0))
    assert abs(drawn - expected) < 5.0 * np.sqrt(expected)


def test_too_much_work_is_rejected_with_figure_and_remedy() -> None:
    dense = scene(sensors=[{"constellation": "DSP", "scan_period_ms": 1e-6}])
    with pytest.raises(
        opir.SceneError, match=r"looks_per_run: the scene has [0-9.]+e\+1\d looks"
    ) as refused:
        compile_plan(dense)
    assert "lengthen scan_period_ms of DSP-1" in str(refused.value)
    assert "or raise the limit" in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["looks_per_run", "events_per_run", "bytes_per_run"])
def test_every_limit_of_a_run_is_a_setting(name: str) -> None:
    looks = float(compile_plan(scene()).pairs.looks.sum())
    enough = looks * (EVENT_BYTES if name == "bytes_per_run" else 1)
    limited = scene(limits={name: enough})
    assert compile_plan(limited)
    assert scene_from_mapping(scene_mapping(limited)) == limited
    with pytest.raises(opir.SceneError, match=rf"limits\.{name}"):
        compile_plan(scene(limits={name: enough - 1}))


@pytest.mark.slow
def test_event_bytes_bound_every_encoder() -> None:
    from opir_core import plan_windows
    from opir_core.output import ForgeEncoder
    from opir_core.plugin import EncoderContext

    plan = compile_plan(opir.load_scene("tests/scenes/pacific_test_range.yaml"))
    encoder = ForgeEncoder(
        EncoderContext(sensors=plan.sensors, epoch_us=0, reported_types=plan.reported_types)
    )
    lines = [line for window in plan_windows(plan) for line in encoder.encode(window).splitlines()]
    assert np.mean(list(map(len, lines))) <= EVENT_BYTES
