"""What directors cost: looks wait for a decision that reads them, and nothing is asked twice."""

from collections.abc import Sequence
from typing import Any

import pytest
from directed_spot import ELSEWHERE_M, LAUNCH_M, Decide, Script, columns, run

import opir_core as opir
from opir_core import Engine
from opir_core.plugin import Command, Situation

SECONDS = 4
DECISIONS = 10 * SECONDS


def fast_run(
    monkeypatch: pytest.MonkeyPatch, decide: Decide, *, needs: bool, **changes: Any
) -> opir.Run:
    """Return a run of ten decisions a second whose director reads detections or does not."""
    monkeypatch.setattr(Script, "interval_s", 0.1)
    monkeypatch.setattr(Script, "needs_detections", needs, raising=False)
    return run(decide, duration_s=float(SECONDS), **changes)


def counted(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> list[int]:
    """Return a list that grows with each call of a function."""
    calls: list[int] = []
    function = getattr(owner, name)

    def call(*arguments: Any, **options: Any) -> Any:
        calls.append(len(calls))
        return function(*arguments, **options)

    monkeypatch.setattr(owner, name, call)
    return calls


def follow(situation: Situation) -> Sequence[Command]:
    """Ask for all places at once, and point at one after the other, many a second."""
    places_m = [LAUNCH_M, LAUNCH_M + 3e4, ELSEWHERE_M]
    situation.in_reach("SPOT", places_m)
    step = round(10.0 * situation.time_s)
    return [Command(sensor="SPOT", position_ecef_m=places_m[step % 7 % 2], reason="test")]


@pytest.mark.parametrize(("needs", "observations"), [(False, SECONDS), (True, DECISIONS)])
def test_looks_wait_for_a_tick_unless_decisions_read_detections(
    monkeypatch: pytest.MonkeyPatch, needs: bool, observations: int
) -> None:
    calls = counted(monkeypatch, Engine, "observe")
    read = []

    def decide(situation: Situation) -> Sequence[Command]:
        read.append(len(situation.detections))
        return []

    fast_run(monkeypatch, decide, needs=needs, tracker="imm")
    assert len(calls) == observations
    assert len(read) == DECISIONS
    assert (sum(read) > 0) == needs


def test_looks_that_wait_are_those_of_the_fields_of_their_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A field that turns several times a second: each look is made where it then pointed."""
    quick = {"half_angle_deg": 0.02, "slew_deg_s": 30.0, "settle_s": 0.0, "delay_s": 0.0}
    waiting, at_once = (
        fast_run(monkeypatch, follow, needs=needs, tracker="imm", spot={"pointing": quick})
        for needs in (False, True)
    )
    assert 5 < len(waiting.detections.sensor.nonzero()[0]) < 10 * SECONDS - 5
    for column, other in zip(columns(waiting), columns(at_once), strict=True):
        assert column.tobytes() == other.tobytes()
    assert list(map(str, waiting.commands)) == list(map(str, at_once.commands))


def test_a_command_to_a_place_that_was_asked_of_is_not_tested_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from opir_core.simulation import directing

    calls = counted(monkeypatch, directing, "visible_now")
    pointed = fast_run(monkeypatch, follow, needs=False)
    assert len(calls) == len(pointed.commands) == DECISIONS
    assert not any(record.refusal for record in pointed.commands)


def test_places_out_of_reach_may_be_asked_of_in_a_list() -> None:
    reached = []

    def decide(situation: Situation) -> Sequence[Command]:
        reached.append(situation.in_reach("SPOT", [-LAUNCH_M, LAUNCH_M]).tolist())
        return []

    run(decide, duration_s=1.0)
    assert reached == [[False, True]]
