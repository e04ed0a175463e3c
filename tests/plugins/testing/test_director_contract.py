"""The contract of directors finds one that says it reads no detections, and reads them."""

from collections.abc import Sequence

import pytest
from opir_testing import ConformanceError, DirectorContract

from opir_core.plugin import Command, Director, Situation


class Counting(Director):
    """Its reason says how many detections it has got."""

    needs_detections: bool = False

    @property
    def interval_s(self) -> float:
        return 1.0

    def commands(self, situation: Situation) -> Sequence[Command]:
        reason = f"{len(situation.detections)} detections"
        return [Command(sensor=situation.sensors[0].id, reason=reason)]


class OfCounting(DirectorContract):
    """The tests of the contract, of which one fails."""

    name = "cue"

    @classmethod
    def part(cls) -> Counting:
        return Counting()


def test_detections_that_are_read_in_secret_are_found() -> None:
    with pytest.raises(ConformanceError, match="needs_detections is False, but detections are"):
        OfCounting().test_detections_are_declared_if_they_are_read()
