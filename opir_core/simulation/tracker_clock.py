"""Steps a tracker at ticks of scene time, independent of the windows, and checks its output."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from attrs import evolve, fields, frozen

from opir_core.arrays import ByteArray, FloatArray, IntArray
from opir_core.errors import ModelError, OpirError
from opir_core.host.boundary import blamed_call, check_hint, error_of_part, owner_text
from opir_core.interfaces.records import IMPACT_METHODS, TRACK_ENDS, Detections, Tracks
from opir_core.interfaces.sensor_health import SensorHealth
from opir_core.interfaces.sensors import Sensor
from opir_core.interfaces.trackers import Tracker
from opir_core.planning.plan import Plan
from opir_core.simulation.output_checks import outline

_REQUIRED = "associate must return whole numbers, one track number per detection, -1 for none"


@frozen(eq=False, repr=False)
class Tracked:
    """A window's detections with their tracks, the estimates of its ticks, and those the detections
    refer to.
    """

    detections: Detections
    tracks: Tracks
    estimates: Tracks
    health: SensorHealth | None = None


class ScheduledTracker:
    """Steps a tracker at whole multiples of its cadence and at the scene's end; associates the
    detections between.

    While nothing is tracked or seen, an idle tracker is not stepped. Detections come in the order
    of observation, whenever they are reported: estimates are available as soon as all reports of
    earlier looks are there. Without a tracker nothing is associated. `paper_codes` gives the codes
    into `REPORTED_TYPES` of reported types that are others.
    """

    def __init__(
        self, tracker: Tracker | None, end_ns: int, paper_codes: ByteArray | None = None
    ) -> None:
        self._tracker = tracker
        self._end_ns = end_ns
        self._paper_codes = paper_codes
        cadence_s = None if tracker is None else tracker.cadence_s
        self._cadence_ns = None if cadence_s is None else max(1, round(cadence_s * 1e9))
        self._pending: list[Detections] = []
        self._in_force = Tracks.empty()
        self._latest_report_ns = 0

    @property
    def _tracker_in_use(self) -> Tracker:
        assert self._tracker is not None
        return self._tracker

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Pass the sensors' new settings to a tracker that uses them."""
        if self._cadence_ns is not None:
            self._tracker_in_use.set_sensors(sensors)

    def has_tick(self, after_ns: int, end_ns: int) -> bool:
        """Return whether the tracker is stepped after a time, at an end or before it."""
        cadence_ns = self._cadence_ns
        return cadence_ns is not None and end_ns // cadence_ns > after_ns // cadence_ns

    def absorb(self, detections: Detections, start_ns: int, end_ns: int) -> Tracked:
        """Process the detections of [start, end), sorted by time."""
        if self._cadence_ns is None:
            return Tracked(detections, Tracks.empty(), Tracks.empty())
        detections = detections.computed()
        associated = []
        estimates = []
        in_force = []
        start = 0
        rows = 0
        now_ns = start_ns
        while now_ns < end_ns:
            now_ns = self._next_edge_ns(now_ns, end_ns, detections.time_ns[start:])
            end = (
                int(np.searchsorted(detections.time_ns, now_ns))
                if now_ns < end_ns
                else len(detections)
            )
            associated.append(self._associated(detections.take(slice(start, end)), rows))
            in_force.append(self._in_force)
            start = end
            rows = rows + len(self._in_force)
            estimates += self._stepped(now_ns)
        columns = Tracks.concatenate(estimates), Tracks.concatenate(in_force)
        return Tracked(
            Detections.concatenate(associated), *columns, self._tracker_in_use.sensor_health()
        )

    def _next_edge_ns(self, now_ns: int, end_ns: int, times_ns: IntArray) -> int:
        """Return the next tick, or the window's end; for an idle tracker the last one before the
        next detection.
        """
        assert self._cadence_ns is not None
        tick_ns = (now_ns // self._cadence_ns + 1) * self._cadence_ns
        if not self._pending and self._tracker_in_use.is_idle():
            if not len(times_ns):
                return end_ns
            tick_ns = max(tick_ns, int(times_ns[0]) // self._cadence_ns * self._cadence_ns)
        return min(tick_ns, end_ns)

    def _associated(self, detections: Detections, offset: int) -> Detections:
        visible = self._visible(detections)
        track = (
            self._tracker_in_use.associate(visible)
            if len(detections)
            else np.empty(0, dtype=np.int64)
        )
        self._pending.append(visible.replaced(track=track))
        return detections.replaced(
            track=track, estimate=rows_of(self._in_force.track, track, offset)
        )

    def _visible(self, detections: Detections) -> Detections:
        """Return detections as the tracker sees them: without truth, with the types of the
        paper.
        """
        visible = without_truth(detections)
        if self._paper_codes is None:
            return visible
        return visible.replaced(reported_type=self._paper_codes.take(visible.reported_type))

    def _stepped(self, edge_ns: int) -> list[Tracks]:
        assert self._cadence_ns is not None
        if edge_ns % self._cadence_ns and edge_ns < self._end_ns:
            return []
        # A single piece is passed on as it is: trackers may recognise the arrays of `associate`.
        since = (
            self._pending[0] if len(self._pending) == 1 else Detections.concatenate(self._pending)
        )
        if since.is_delayed:
            self._latest_report_ns = max(self._latest_report_ns, int(since.reported_ns.max()))
        tracks = self._tracker_in_use.step(edge_ns / 1_000_000_000, since)
        self._pending = []
        if self._latest_report_ns > edge_ns:
            tracks = evolve(
                tracks, available_s=np.full(len(tracks), self._latest_report_ns / 1_000_000_000)
            )
        self._in_force = tracks
        return [tracks]


def checked_tracker(plan: Plan) -> Tracker:
    """Return a new tracker of a plan, with checked output if it steps; it ends at an error if the
    plan says so.
    """
    tracker = plan.make_tracker()
    choice = plan.scene.tracker
    if tracker.cadence_s is None:
        return tracker
    owner = partial(owner_text, plan.host, choice)
    checked = CheckedTracker(
        Tracker.adopt(tracker, owner),
        owner,
        check_hint(choice.name),
        len(plan.hypotheses),
        partial(error_of_part, plan.host, choice),
    )
    return (
        checked if plan.on_tracker_error is None else EndingTracker(checked, plan.on_tracker_error)
    )


def without_truth(detections: Detections) -> Detections:
    """Return detections without the columns that depend on the true association: counts are 0,
    confidences nan.
    """
    count = len(detections)
    return detections.replaced(
        detection_count=np.zeros(count, dtype=np.int32), confidence=np.full(count, np.nan)
    )


def rows_of(numbers: IntArray, track: IntArray, offset: int) -> IntArray:
    """Return the rows of tracks in sorted track `numbers`, plus `offset`; -1 for those not among
    them.
    """
    if not len(numbers):
        return np.full(len(track), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(numbers, track), len(numbers) - 1)
    return np.where(numbers[place] == track, place + offset, -1)


class CheckedTracker(Tracker):
    """A tracker with checked output: shapes, track numbers and times, not the quality of estimates.

    Raises `ModelError` for wrong output, and if the tracker raises anything but opir's own errors.
    `owner()` returns the beginning of the message, `hint` is its end, `hypotheses` the number of
    the scene's hypotheses. `of_part(error)` returns the error of the part of the tracker that
    raised, None for the tracker itself.
    """

    def __init__(
        self,
        tracker: Tracker,
        owner: Callable[[], str],
        hint: str,
        hypotheses: int,
        of_part: Callable[[BaseException], ModelError | None] = lambda _error: None,
    ) -> None:
        self._tracker = tracker
        self._owner = owner
        self._hint = hint
        self._of_part = of_part
        self._hypotheses = hypotheses
        self._width: int | None = None

    @property
    def cadence_s(self) -> float | None:
        """Time between ticks, s."""
        return self._tracker.cadence_s

    def associate(self, detections: Detections) -> IntArray:
        """Return the track numbers (n,) of detections."""
        track = self._called("associate", lambda: self._tracker.associate(detections))
        if not _are_whole(track, len(detections)):
            raise self._error(
                f"associate returned {outline(track)} for {len(detections)} detections; {_REQUIRED}"
            )
        if len(track) and track.min() < -1:
            raise self._error(f"associate returned the track {track.min()}; {_REQUIRED}")
        return track

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at a tick."""
        estimates = self._called(
            f"step at {tick_s:g} s", lambda: self._tracker.step(tick_s, detections)
        )
        fault = _fault(estimates, tick_s, self._hypotheses) or self._fault_in_width(estimates)
        if fault:
            raise self._error(f"step at {tick_s:g} s {fault}")
        return estimates

    def _fault_in_width(self, estimates: Tracks) -> str:
        """Return the error of columns of hypotheses that come or go from tick to tick, or ""."""
        width = estimates.hypothesis_probability.shape[1] if len(estimates) else self._width
        former_width = self._width
        self._width = width
        return (
            ""
            if former_width in (None, width)
            else f"returned {width} hypotheses, after {former_width} at earlier ticks"
        )

    def is_idle(self) -> bool:
        """Return whether steps without detections would change nothing."""
        return bool(self._called("is_idle", self._tracker.is_idle))

    def sensor_health(self) -> SensorHealth | None:
        """Return the tracker's estimates of the sensors' errors."""
        health = self._called("sensor_health", self._tracker.sensor_health)
        if health is not None and not isinstance(health, SensorHealth):
            raise self._error(
                f"sensor_health returned {outline(health)}, not a SensorHealth or None"
            )
        return health

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Pass the sensors' new settings to a tracker that uses them."""
        self._called("set_sensors", lambda: self._tracker.set_sensors(sensors))

    def _called(self, method: str, call: Callable[[], Any]) -> Any:
        return blamed_call(self._owner, self._hint, method, partial(self._tried, call))

    def _tried(self, call: Callable[[], Any]) -> Any:
        """Return what a call returns; raises the error of the part that raised in it."""
        try:
            return call()
        except Exception as error:
            of_part = None if isinstance(error, OpirError) else self._of_part(error)
            if of_part is None:
                raise
            raise of_part from error

    def _error(self, words: str) -> ModelError:
        return ModelError(f"{self._owner()}: {words}; {self._hint}")


class EndingTracker(Tracker):
    """A tracker that ends at its first error, which is reported to `on_error`; then nothing is
    associated any more.
    """

    def __init__(self, tracker: Tracker, on_error: Callable[[str], None]) -> None:
        self._tracker: Tracker | None = tracker
        self._on_error = on_error
        self._cadence_s = tracker.cadence_s

    @property
    def cadence_s(self) -> float | None:
        """Time between ticks, s."""
        return self._cadence_s

    def associate(self, detections: Detections) -> IntArray:
        """Return the track numbers (n,) of detections."""
        none = np.full(len(detections), -1, dtype=np.int64)
        return self._result(lambda tracker: tracker.associate(detections), none)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at a tick."""
        return self._result(lambda tracker: tracker.step(tick_s, detections), Tracks.empty())

    def is_idle(self) -> bool:
        """Return whether steps without detections would change nothing."""
        return self._result(lambda tracker: tracker.is_idle(), True)

    def sensor_health(self) -> SensorHealth | None:
        """Return the tracker's estimates of the sensors' errors."""
        return self._result(lambda tracker: tracker.sensor_health(), None)

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Pass the sensors' new settings to a tracker that uses them."""
        self._result(lambda tracker: tracker.set_sensors(sensors), None)

    def _result(self, call: Callable[[Tracker], Any], after_the_end: Any) -> Any:
        if self._tracker is not None:
            try:
                return call(self._tracker)
            except OpirError as error:
                self._tracker = None
                self._on_error(str(error))
        return after_the_end


def _are_whole(numbers: Any, count: int) -> bool:
    return (
        isinstance(numbers, np.ndarray) and numbers.dtype.kind in "iu" and numbers.shape == (count,)
    )


def _fault(estimates: Any, tick_s: float, hypotheses: int) -> str:
    """Return the first error in the estimates of a tick, or ""."""
    if not isinstance(estimates, Tracks):
        return f"returned {outline(estimates)}, no opir_core.interfaces.records.Tracks"
    times: Any = estimates.tick_s
    rows = times.size if isinstance(times, np.ndarray) else 0
    for name, shape in _SHAPES.items():
        column = getattr(estimates, name)
        kinds = _KINDS.get(name, "fiu")
        # A tracker weighs all hypotheses, or none.
        shapes = [shape, (hypotheses,)] if name == "hypothesis_probability" else [shape]
        is_array = isinstance(column, np.ndarray) and column.dtype.kind in kinds
        if not is_array or column.shape not in [(rows, *row_shape) for row_shape in shapes]:
            contents = f"rows of shape {shapes[-1]}" if shape else _CONTENTS.get(name, "numbers")
            return f"returned {name} as {outline(column)}, not {rows} {contents}"
    if not rows:
        return ""
    if not _are_regions(estimates.impact_regions.tolist()):
        return f"returned impact_regions that are not {_CONTENTS['impact_regions']}"
    for name, texts in (("impact_method", IMPACT_METHODS), ("end", TRACK_ENDS)):
        codes = getattr(estimates, name)
        if codes.min() < 0 or codes.max() >= len(texts):
            return f"returned {name} {codes[:6].tolist()}, not codes into {texts}"
    track = estimates.track
    if not _are_whole(track, rows) or track[0] < 0 or np.count_nonzero(track[1:] <= track[:-1]):
        return (
            f"returned tracks numbered {track[:6].tolist()}, not one row per track, whole numbers"
            f" from 0 up in order"
        )
    wrong = estimates.tick_s[estimates.tick_s != tick_s]
    return (
        f"returned tick_s {wrong[0]:g}, not that of the step"
        if len(wrong)
        else _fault_in_values(estimates)
    )


def _fault_in_values(estimates: Tracks) -> str:
    """Return the first error in the values of estimates, or ""; nan stands for unknown values."""
    for name in ("state", "launch", "impact", "burnout"):
        if np.isinf(getattr(estimates, name)).any():
            return f"returned {name} with infinite values"
    for name in ("launch", "impact"):
        lat_rad, lon_rad = np.abs(getattr(estimates, name)[:, :2]).T
        if np.any(lat_rad > 0.5 * np.pi + _ROUNDING) or np.any(lon_rad > 2.0 * np.pi + _ROUNDING):
            return f"returned {name} with a latitude or longitude outside the range of radians"
    for name in _PROBABILITIES:
        values = getattr(estimates, name)
        if np.any((values < -_ROUNDING) | (values > 1.0 + _ROUNDING)):
            return f"returned {name} outside [0, 1]"
    for name in ("type_probability", "hypothesis_probability"):
        chances = getattr(estimates, name)
        if chances.shape[1] and np.any(np.abs(chances.sum(axis=1) - 1.0) > _SUM_ROUNDING):
            return f"returned {name} that sums to {chances.sum(axis=1)[:4].tolist()}, not to 1"
    return next(
        (
            fault
            for name in _COVARIANCES
            if (fault := _fault_in_covariance(name, getattr(estimates, name)))
        ),
        "",
    )


def _fault_in_covariance(name: str, covariance: FloatArray) -> str:
    """Return the first error of covariances (n, k, k), or ""; they are symmetric and positive
    semidefinite.
    """
    complete = covariance[~np.isnan(covariance).any(axis=(1, 2))]
    if not len(complete):
        return ""
    spread = np.sqrt(np.maximum(np.diagonal(complete, axis1=1, axis2=2), 0.0))
    scale = spread[:, :, None] * spread[:, None, :]
    scaled = np.divide(complete, scale, out=np.zeros_like(complete), where=scale > 0.0)
    if not np.isfinite(complete).all() or np.any(np.abs(scaled - scaled.mT) > _SYMMETRY):
        return f"returned {name} that is not symmetric and finite"
    if (
        np.any(np.diagonal(complete, axis1=1, axis2=2) < 0.0)
        or np.linalg.eigvalsh(scaled).min() < -_NEGATIVE
    ):
        return f"returned {name} that is not positive definite"
    return ""


def _are_regions(rows: list[Any]) -> bool:
    if not all(isinstance(row, tuple) for row in rows):
        return False
    if not any(rows):
        return True
    from opir_core.interfaces.impact_regions import (
        ImpactRegion,
    )  # a run without regions does not load it

    return all(isinstance(region, ImpactRegion) for row in rows for region in row)


#: Rounding of angles and probabilities, of sums of probabilities, and of covariances scaled to
#: correlations: the asymmetry and the most negative eigenvalue that rounding explains.
_ROUNDING = 1e-9
_SUM_ROUNDING = 1e-6
_SYMMETRY = 1e-6
_NEGATIVE = 1e-6
_PROBABILITIES = (
    *(
        "probability_burning",
        "probability_relights",
        "probability_launch",
        "probability_missile",
        "probability_orbit",
    ),
    *("type_probability", "hypothesis_probability"),
)
_COVARIANCES = ("state_covariance", "launch_covariance", "impact_covariance", "burnout_covariance")

#: Kinds of the columns that are not of any numbers, and what a row of them is.
_KINDS = {"impact_regions": "O", "impact_method": "iu", "end": "iu", "is_brief": "b"}
_CONTENTS = dict.fromkeys(_KINDS, "whole numbers") | {
    "impact_regions": "tuples of opir_core.ImpactRegion",
    "is_brief": "truth values",
}
#: The shape of a row of each column.
_SHAPES = {item.name: getattr(Tracks.empty(), item.name).shape[1:] for item in fields(Tracks)}
