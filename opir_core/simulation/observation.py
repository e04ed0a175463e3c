"""The state of a window between the stages of the engine."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from attrs import define, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray, WordArray
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.detection_models import Measured
from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
from opir_core.planning.looks import Looks
from opir_core.random_streams.pair_streams import WindowNumbers

if TYPE_CHECKING:
    from opir_core.simulation.false_alarms import FalseAlarms
    from opir_core.simulation.interpolation import WindowInterpolant


@frozen(eq=False, repr=False)
class Hits(Columns):
    """Looks of a window that detect: row among the looks, pair, scan, time, detection count so far,
    P_d.

    `direction_words` are the raw random words of the line-of-sight error; further normal numbers
    are derived from them.
    """

    row: IntArray
    pair: IntArray
    scan: IntArray
    time_ns: IntArray
    count: IndexArray
    probability: FloatArray
    direction_words: WordArray


@define(eq=False, repr=False, kw_only=True)
class Observation:
    """The observations of [start, end) of scene time; each attribute is given by one stage and
    taken by later ones.
    """

    start_ns: int
    end_ns: int
    #: Entered while the state that windows pass on is used and changed.
    turn: AbstractContextManager[None]
    #: The looks (l,), pair by pair, and the random numbers of their pairs.
    looks: Looks = field(init=False)
    numbers: WindowNumbers = field(init=False)
    #: The looks in the modes in force, of sensors that have modes; None for all.
    made: int | None = None
    #: P_d of the looks (l,); the active pairs that have looks with P_d between 0 and 1, None for
    #: all.
    probability: FloatArray = field(init=False)
    undecided: BoolArray | None = None
    #: Signals and noise between knots, of scenes with interpolated P_d.
    interpolant: "WindowInterpolant | None" = None
    #: The looks that detect (n,), by row, pair and scan, and their numbers among the detections of
    #: the pair.
    row: IntArray = field(init=False)
    pair: IntArray = field(init=False)
    scan: IntArray = field(init=False)
    count: IndexArray = field(init=False)
    #: The same looks as a record, and their measurements where these do not wait for `detections`.
    hits: Hits = field(init=False)
    measured: Measured | None = None
    #: The rows of the hits by time, with any row at the places of the false alarms.
    order: IntArray = field(init=False)
    false_alarms: "FalseAlarms | None" = None
    places: IntArray = field(init=False)
    #: The detections by time, and their truth.
    detections: Detections = field(init=False)
    truth: DetectionTruth = field(init=False)

    def window(self) -> Window:
        """Return the finished window, without tracks."""
        return Window(
            start_s=self.start_ns * 1e-9,
            end_s=self.end_ns * 1e-9,
            looks=len(self.looks.pair) if self.made is None else self.made,
            detections=self.detections.freeze(),
            truth=self.truth.freeze(),
            tracks=Tracks.empty(),
            estimates=Tracks.empty(),
        )


#: A step of the engine; it takes some attributes of an observation and gives others.
Stage: TypeAlias = Callable[[Observation], None]


def joined_detections(windows: Iterable[Window]) -> Detections:
    """Return the detections of windows, with `estimate` as rows of all their estimates."""
    shifted = []
    rows = 0
    for window in windows:
        shifted.append(window.detections if rows == 0 else _shifted(window.detections, rows))
        rows += len(window.estimates)
    return Detections.concatenate(shifted)


def _shifted(detections: Detections, rows: int) -> Detections:
    estimate: IntArray = detections.estimate + rows * (detections.estimate >= 0)
    return detections.replaced(estimate=estimate)


def joined_windows(windows: Sequence[Window]) -> Window:
    """Return windows that follow each other as one."""
    first = windows[0]
    last = windows[-1]
    return Window(
        start_s=first.start_s,
        end_s=last.end_s,
        looks=sum(window.looks for window in windows),
        detections=joined_detections(windows).freeze(),
        truth=DetectionTruth.concatenate(window.truth for window in windows).freeze(),
        tracks=Tracks.concatenate(window.tracks for window in windows),
        estimates=Tracks.concatenate(window.estimates for window in windows),
        health=last.health,
        commands=tuple(record for window in windows for record in window.commands),
        lost=_joined_lost([window.lost for window in windows if window.lost is not None]),
    )


def _joined_lost(lost: Sequence[IntArray]) -> IntArray | None:
    total: IntArray = np.sum(lost, axis=0)
    return total if lost else None
