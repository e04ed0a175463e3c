"""Rays of detections, worked out once: a tracker's labels and its estimates ask for the same."""

from collections.abc import Callable
from operator import attrgetter
from typing import Any

from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.interfaces.records import Detections

#: What makes detections rays.
_seen = attrgetter("time_ns", "sensor", "scan", "line_of_sight_ecef", "sensor_ecef_m", "line_of_sight_sigma_rad")


class LineOfSightCache:
    """The rays that some way makes of detections; those asked for last are kept."""

    def __init__(self, way: Callable[[Detections], LinesOfSight]) -> None:
        self._way = way
        self._met: tuple[Detections, LinesOfSight] | None = None

    def of(self, detections: Detections) -> LinesOfSight:
        """Return the rays of detections: the same record for the same rays."""
        if self._met is None or not _alike(self._met[0], detections):
            self._met = detections, self._way(detections)
        elif self._met[0] is not detections:
            self._met = detections, self._met[1]
        return self._met[1]


def _alike(one: Detections, other: Detections) -> bool:
    """Return whether the rays of two records are the same, to the last bit."""
    if one is other:
        return True
    if len(one.time_ns) != len(other.time_ns):
        return False
    return all(map(_same, _seen(one), _seen(other)))


def _same(one: Any, other: Any) -> bool:
    return one is other or one.tobytes() == other.tobytes()
