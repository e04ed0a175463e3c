"""What a tick costs, in counts: calls of Python and of C functions, whatever the machine.

A budget of a lone target is the count of the tracker's present steps for this flight, plus at most
3 % for other versions of NumPy: it holds still what a change may only lower. Other draws take other
steps: up to 2 500 with two slices, while a stage may have begun. That steps are columns over tracks
is a law: more targets take few more calls.
"""

import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from attrs import evolve

import opir_core as opir
from opir_core.arrays import IntArray
from opir_core.interfaces.records import Detections, Tracks
from opir_core.simulation.run import run_of_plan

SCENE = {
    "scene": "budget",
    "epoch": "2026-04-01T12:00:00Z",
    "seed": 100,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -150.0},
        {"model": "SBIRS-GEO", "id": "EAST", "orbital_slot_deg": -90.0},
    ],
}
LAUNCH = {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 2.0}


def calls_of(work: Callable[[], Any]) -> tuple[Any, int]:
    """Return what some work returns, and how many functions it called."""
    count = 0

    def counted(_frame: Any, event: str, _function: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(counted)
    try:
        answer = work()
    finally:
        sys.setprofile(None)
    return answer, count


class Counting:
    """A tracker whose calls are counted, tick by tick."""

    def __init__(self, tracker: Any) -> None:
        self._tracker = tracker
        self.cadence_s = tracker.cadence_s
        self.calls: list[int] = []
        self._since = 0

    def associate(self, detections: Detections) -> IntArray:
        answer, count = calls_of(lambda: self._tracker.associate(detections))
        self._since += count
        found: IntArray = answer
        return found

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        answer, count = calls_of(lambda: self._tracker.step(tick_s, detections))
        self.calls.append(self._since + count)
        self._since = 0
        reported: Tracks = answer
        return reported


def counted(tracker: dict[str, Any], kind: str, duration_s: float, targets: int = 1) -> Counting:
    """Return the counts of a scene whose targets stand 2 degrees apart, so that none is near
    another's gate.
    """
    lat_deg, lon_deg = {"ICBM": (9.0, 167.7), "SRBM": (37.0, -122.5)}[kind]
    launched = [
        {
            "id": f"T{number or ''}",
            "type": kind,
            "launch": {**LAUNCH, "lat_deg": LAUNCH["lat_deg"] + 2.0 * number},
            "aim": {"lat_deg": lat_deg + 2.0 * number, "lon_deg": lon_deg},
        }
        for number in range(targets)
    ]
    scene = {**SCENE, "duration_s": duration_s, "targets": launched, "tracker": tracker}
    plan = opir.compile_plan(opir.scene_from_mapping(scene))
    counting = Counting(plan.make_tracker())
    run_of_plan(evolve(plan, make_tracker=lambda: counting))
    return counting


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "most"),
    [({}, 2380), ({"slice_s": 0.5}, 2665), ({"forecast": "none"}, 1245)],
    ids=["one slice a tick", "two", "states alone"],
)
def test_a_lone_burning_target_takes_few_calls_a_tick(settings: dict[str, Any], most: int) -> None:
    """A burn has two parts, as a stage may begin at any time: each is predicted, updated and
    matched.

    What it is was decided before: of that only the table of hypotheses is composed.
    """
    calls = counted({"model": "imm", **settings}, "ICBM", 30.0).calls
    # Half of the ten ticks have new impact regions or compare sensors. The rest sum lines of a launch
    # that is asked again after 60 s, and judge the noise of each sensor.
    assert sorted(calls[20:])[4] <= most


@pytest.mark.slow
def test_more_targets_take_few_more_calls_a_tick() -> None:
    """A loop over tracks would take three times as many for twelve as for four, in ticks without
    new regions.

    Sensors are compared every tick if there are more than three tracks.
    """
    few, many = (min(counted({"model": "imm"}, "ICBM", 30.0, each).calls[20:]) for each in (4, 12))
    assert many < 1.5 * few


@pytest.mark.slow
def test_a_young_target_and_a_silent_one_take_few_calls_a_tick() -> None:
    """The silent one may still burn, so both parts of its burn are predicted; what the young one is
    is weighed anew.
    """
    calls = counted({"model": "imm"}, "SRBM", 85.0).calls
    # One tick of the first is one with new impact regions. In the others sensors are compared, as
    # long as they are new.
    assert sorted(calls[3:12])[-2] <= 3570
    assert np.median(calls[75:]) <= 525


@pytest.mark.slow
def test_new_impact_regions_take_few_calls() -> None:
    """They are due once the burn is older by a fifth. Particles are columns, not rows of a loop:
    256 would take more.

    The numbers of burns and families vary with the flight, and from a tick to the next.
    """
    calls = np.array(counted({"model": "imm"}, "ICBM", 40.0).calls[17:])
    renewed = calls[calls > 5000]
    assert len(renewed) == 4
    assert max(renewed) <= 8960


@pytest.mark.slow
def test_a_tracker_of_states_alone_computes_nothing_of_a_forecast() -> None:
    with_regions, alone = (
        np.array(counted({"model": "imm", "forecast": name}, "ICBM", 40.0).calls[17:])
        for name in ("regions", "none")
    )
    # Between renewals: stages are followed, and the latest forecast is reported.
    assert np.median(with_regions - alone) <= 30
    assert max(alone) <= 2765
