"""What trackers answer, checked: an answer that the engine cannot build on is told with whose it is."""

from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import fields

from opir_core.arrays import IntArray
from opir_core.errors import ModelError, OpirError
from opir_core.interfaces.protocols import Sensor, Tracker
from opir_core.interfaces.records import Detections, Tracks
from opir_core.plugin.validation import described_error

_OWED = "associate owes whole numbers, a track's for each detection, -1 for none"


class CheckedTracker:
    """A tracker whose answers have the shapes and the order that the engine takes for granted.

    Raises `ModelError` where they have not, or where the tracker raises anything but opir's own errors. `whose()` says
    which tracker it is, `way_out` what to do. What estimates are worth is not looked at.
    """

    def __init__(self, tracker: Tracker, whose: Callable[[], str], way_out: str) -> None:
        self._tracker, self._whose, self._way_out = tracker, whose, way_out

    @property
    def cadence_s(self) -> float | None:
        """Time between ticks, s."""
        return self._tracker.cadence_s

    def associate(self, detections: Detections) -> IntArray:
        """Return the track numbers (n,) of detections."""
        try:
            track = self._tracker.associate(detections)
        except OpirError:
            raise
        except Exception as error:
            raise self._raised("associate", error) from error
        if not _are_whole(track, len(detections)):
            raise self._wrong(f"associate returned {_outline(track)} for {len(detections)} detections; {_OWED}")
        if len(track) and track.min() < -1:
            raise self._wrong(f"associate returned the track {track.min()}; {_OWED}")
        return track

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at a tick."""
        try:
            told = self._tracker.step(tick_s, detections)
        except OpirError:
            raise
        except Exception as error:
            raise self._raised(f"step at {tick_s:g} s", error) from error
        fault = _fault(told, tick_s)
        if fault:
            raise self._wrong(f"step at {tick_s:g} s {fault}")
        return told

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Tell the tracker, where it cares, that the sensors are these from here on: as many, with other settings."""
        told = getattr(self._tracker, "set_sensors", None)
        if told is None:
            return
        try:
            told(sensors)
        except OpirError:
            raise
        except Exception as error:
            raise self._raised("set_sensors", error) from error

    def _raised(self, method: str, error: Exception) -> ModelError:
        return self._wrong(f"{method} raised {described_error(error)}")

    def _wrong(self, words: str) -> ModelError:
        return ModelError(f"{self._whose()}: {words}; {self._way_out}")


def _are_whole(numbers: Any, count: int) -> bool:
    return isinstance(numbers, np.ndarray) and numbers.dtype.kind in "iu" and numbers.shape == (count,)


def _outline(answer: Any) -> str:
    """Return what an answer is: `float64 (3,)`, `None`, `a list`."""
    if isinstance(answer, np.ndarray):
        return f"{answer.dtype} {answer.shape}"
    return "None" if answer is None else f"a {type(answer).__name__}"


def _fault(told: Any, tick_s: float) -> str:
    """Return what is wrong with the estimates of a tick, or ""."""
    if not isinstance(told, Tracks):
        return f"returned {_outline(told)}, no opir_core.interfaces.records.Tracks"
    times: Any = told.tick_s
    rows = times.size if isinstance(times, np.ndarray) else 0
    for name, shape in _SHAPES.items():
        column = getattr(told, name)
        if not isinstance(column, np.ndarray) or column.dtype.kind not in "fiu" or column.shape != (rows, *shape):
            shapes = f"{rows} rows of shape {shape}" if shape else f"{rows} numbers"
            return f"told {name} as {_outline(column)}, not {shapes}"
    if not rows:
        return ""
    if not _are_whole(told.track, rows) or told.track[0] < 0 or np.count_nonzero(told.track[1:] <= told.track[:-1]):
        return f"told tracks numbered {told.track[:6].tolist()}, not one row a track, whole numbers from 0 up in order"
    wrong = told.tick_s[told.tick_s != tick_s]
    return f"told tick_s {wrong[0]:g}, not that of the step" if len(wrong) else ""


#: The shape of a row of each column.
_SHAPES = {item.name: getattr(Tracks.empty(), item.name).shape[1:] for item in fields(Tracks)}
