"""The engine: a plan in, windows of detections and tracks out.

All data of a window are columns over its looks. Each look is drawn against its P_d with the random numbers of its pair;
detections are measured, classified, and get a confidence and an id. Nothing depends on the windows' edges.
"""

from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import evolve
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces.columns import Filling
from opir_core.interfaces.protocols import Measured
from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
from opir_core.planning.looks import LookGeometry, Looks, blocks, look_times_ns
from opir_core.planning.plan import Plan
from opir_core.planning.sightlines import Pairs
from opir_core.plugin.boundary import PluginErrors
from opir_core.random_streams.detection_ids import stream_key_words
from opir_core.random_streams.pair_streams import PairStreams, WindowNumbers
from opir_core.random_streams.philox import uniforms_of
from opir_core.scene.scene import BY_REPORT
from opir_core.simulation.confirmation import Confirmation
from opir_core.simulation.measurement import DetectionBuilder, Hits, with_tracks
from opir_core.simulation.output_checks import (
    checked_confirmation,
    checked_measured,
    checked_probability,
    checked_types,
)
from opir_core.simulation.tracker_clock import ScheduledTracker, checked_tracker

if TYPE_CHECKING:
    from opir_core.simulation.false_alarms import FalseAlarmGenerator, FalseAlarms
    from opir_core.simulation.interpolation import ProbabilityInterpolant, WindowInterpolant
    from opir_core.simulation.reporting import ReportingDelays

#: numpy sorts whole numbers of 16 bits by radix, several times faster than longer ones.
_RADIX_LIMIT = 1 << 16


class Engine:
    """Runs a plan, window by window; scene time only increases."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.time_ns = 0
        #: Entered while `carried` is used and changed: another engine's may be put there, and taken from there.
        self.turn: AbstractContextManager[None] = nullcontext()
        self._plugin_errors = PluginErrors(plan.host, plan.scene)
        with self._plugin_errors:
            self._prepare(plan)

    def _prepare(self, plan: Plan) -> None:
        self._names = plan.pair_names()
        self._geometry = plan.look_geometry()
        self._streams = PairStreams(plan.scene.seed, self._names, plan.scan_names())
        scene = plan.scene
        self._builder = DetectionBuilder(
            geometry=self._geometry,
            detection=plan.detection,
            classifier=plan.classifier,
            confidence=plan.confidence,
            pair_type=_pair_types(plan, self._streams),
            types=len(plan.reported_types),
            id_keys=stream_key_words(scene.seed, scene.name, scene.epoch_us, plan.scan_names()),
            band_totals=np.array([len(sensor.bands) for sensor in plan.sensors], dtype=np.int64),
        )
        self._tick_ns = _tick_ns(plan.pairs)
        self._counts = np.zeros(len(plan.pairs), dtype=np.int32)
        #: Made at the first window: an engine that takes over continues with another's tracker.
        self._scheduled: ScheduledTracker | None = None
        self._confirmation = _confirmation(plan)
        self._interpolant = _interpolant(plan, self._geometry)
        self._false_alarms = _false_alarms(plan, self._geometry)
        self._delays = _delays(plan)

    def take_over(self, former: "Engine") -> None:
        """Continue the run of another engine with the same sensors: its time, tracker, counts and last detections."""
        self.time_ns, self._scheduled = former.time_ns, former._tracker
        if self.plan.sensors is not former.plan.sensors:
            self._tracker.set_sensors(self.plan.tracker_sensors())
        counts = dict(zip(former._names, former._counts.tolist(), strict=True))
        self._counts = np.array([counts.get(name, 0) for name in self._names], dtype=np.int32)
        if self._confirmation is not None and former._confirmation is not None:
            rows = {name: row for row, name in enumerate(former._names)}
            both = [(row, rows[name]) for row, name in enumerate(self._names) if name in rows]
            own_row, former_row = np.array(both, dtype=np.int64).reshape(-1, 2).T
            self._confirmation.take_over(former._confirmation, own_row, former_row)

    @property
    def _tracker(self) -> ScheduledTracker:
        """The tracker of this run; none of its own in the order of report, in which `ReportOrder` steps it."""
        if self._scheduled is None:
            is_here = self.plan.scene.tracking_order != BY_REPORT
            self._scheduled = ScheduledTracker(
                checked_tracker(self.plan) if is_here else None, self.plan.end_ns, self.plan.paper_codes()
            )
        return self._scheduled

    def advance(self, end_ns: int) -> Window:
        """Return the window of observations from the end of the last one to `end_ns`, whenever they are reported.

        Raises `ModelError` for what a component raises or returns wrongly.
        """
        with self._plugin_errors:
            return self._advanced(end_ns)

    def _advanced(self, end_ns: int) -> Window:
        start_ns, self.time_ns = self.time_ns, end_ns
        return self._with_tracks(self._observed(start_ns, end_ns), start_ns, end_ns)

    def observe(self, start_ns: int, end_ns: int) -> Window:
        """Return the window of observations in [start, end), without tracks; raises as `advance` does."""
        with self._plugin_errors:
            return self._observed(start_ns, end_ns)

    def track(self, window: Window, end_ns: int) -> Window:
        """Return a window of observations up to `end_ns` with its tracks; windows follow each other."""
        start_ns, self.time_ns = self.time_ns, end_ns
        with self._plugin_errors:
            return self._with_tracks(window, start_ns, end_ns)

    @property
    def carried(self) -> Sequence[IntArray]:
        """What a window passes on to the next one: each pair's count and last detections; changed in place."""
        recent = () if self._confirmation is None else (self._confirmation.recent,)
        return self._counts, *recent

    def _observed(self, start_ns: int, end_ns: int) -> Window:
        looks = Looks.between(self.plan.pairs, start_ns, end_ns)
        numbers = WindowNumbers(self._streams, looks.active, looks.first_scan, looks.scans)
        false_alarms = None if self._false_alarms is None else self._false_alarms.between(start_ns, end_ns)
        detections, truth = self._detected(looks, numbers, false_alarms)
        if self._delays is not None:
            detections = self._delays.reported(detections)
        self._streams.forget(looks.active[self.plan.pairs.is_over(end_ns)[looks.active]])
        return Window(
            start_s=start_ns * 1e-9,
            end_s=end_ns * 1e-9,
            looks=len(looks.pair),
            detections=detections.freeze(),
            truth=truth.freeze(),
            tracks=Tracks.empty(),
            estimates=Tracks.empty(),
        )

    def _with_tracks(self, window: Window, start_ns: int, end_ns: int) -> Window:
        """Return a window of observations with the tracks of its ticks, and what these change in its detections."""
        tracked = self._tracker.absorb(window.detections, start_ns, end_ns)
        detections = with_tracks(self.plan.classifier, self.plan.confidence, tracked.detections, tracked.estimates)
        if detections is window.detections:
            return window
        return evolve(window, detections=detections.freeze(), tracks=tracked.tracks, estimates=tracked.estimates)

    def _detected(
        self, looks: Looks, numbers: WindowNumbers, false_alarms: "FalseAlarms | None"
    ) -> tuple[Detections, DetectionTruth]:
        interpolant = None if self._interpolant is None else self._interpolant.over(looks)
        hits = self._hits(looks, numbers, interpolant)
        measured = None if interpolant is None else self._measured(hits, numbers, interpolant)
        order = self._order(hits.time_ns, hits.pair)
        if false_alarms is None:
            return self._built(numbers, hits, measured, order)
        if not len(order):
            return false_alarms.alone()
        places = false_alarms.places(hits.time_ns, self.plan.pairs.sensor[hits.pair], order)
        # The rows at `places` are overwritten below: any row fills them.
        longer = np.insert(order, np.sort(places) - np.arange(len(places)), order[0])
        detections, truth = self._built(numbers, hits, measured, longer)
        detections.overwrite(places, false_alarms.detections)
        truth.overwrite(places, false_alarms.truth)
        return detections, truth

    def _built(
        self, numbers: WindowNumbers, hits: Hits, measured: Measured | None, order: IntArray
    ) -> tuple[Detections, DetectionTruth]:
        """Return the detections of hits in an order, and their truth."""
        # Column by column: gathering rows of all columns at once touches more pages than the processor caches.
        hits, measured = hits.take(order), None if measured is None else measured.take(order)
        none = np.full(len(hits), -1, dtype=np.int64)
        times = {"time_ns": hits.time_ns, "reported_ns": hits.time_ns}
        columns = {**times, "scan": hits.scan, "detection_count": hits.count, "track": none, "estimate": none}
        given = columns | ({} if measured is None else _measured_columns(measured))
        detections = Filling(Detections, len(hits), given)
        truth = Filling(DetectionTruth, len(hits), {"probability": hits.probability})
        for rows in blocks(len(hits)):
            of_rows = None if measured is None else measured.take(rows)
            block, block_truth = self._builder.block(hits.take(rows), numbers, of_rows)
            detections.put(block)
            truth.put(block_truth)
        return detections.record(), truth.record()

    def _hits(self, looks: Looks, numbers: WindowNumbers, interpolant: "WindowInterpolant | None") -> Hits:
        """Return the looks whose detections are reported, sorted by sensor, then target, then time."""
        probability = self._probability(looks, interpolant)
        # Looks with a P_d of 0 or 1 need no random number: 0 will do.
        drawn = numbers.words("detection", None if interpolant is None else interpolant.undecided())
        row = np.flatnonzero(uniforms_of(drawn) < probability)
        pair, scan = looks.pair.take(row), looks.scan.take(row)
        with self.turn:
            count, reported = self._counted(pair, scan)
        if reported is not None:
            row, pair = row.take(reported), pair.take(reported)
            scan, count = scan.take(reported), count.take(reported)
        words = numbers.of_rows("line-of-sight", 1, row, pair)[:, 0]
        time_ns = look_times_ns(self.plan.pairs, pair, scan)
        return Hits(row, pair, scan, time_ns, count, probability.take(row), words)

    def _counted(self, pair: IntArray, scan: IntArray) -> tuple[IndexArray, IntArray | None]:
        """Return the numbers (n,) of detections of pairs so far, and the rows that are reported, None for all.

        Detections, given by pairs (n,) and scans (n,), are counted pair by pair, each included; they come in runs of a
        pair in order of time.
        """
        start = np.flatnonzero(np.diff(pair, prepend=-1))
        distinct, times = pair[start], np.diff(start, append=len(pair))
        place = np.arange(len(pair)) - np.repeat(start, times)
        count: IndexArray = (self._counts[pair] + place + 1).astype(np.int32)
        self._counts[distinct] += times.astype(np.int32)
        confirmation = self._confirmation
        return count, None if confirmation is None else np.flatnonzero(confirmation.confirmed(pair, scan))

    def _measured(self, hits: Hits, numbers: WindowNumbers, interpolant: "WindowInterpolant") -> Measured | None:
        """Return the measurements of hits, which are sorted by sensor."""
        if not len(hits):
            return None
        dice = numbers.of(hits.row, hits.pair, hits.direction_words)
        measured = checked_measured(
            interpolant.measured(hits.row, self.plan.pairs.sensor[hits.pair], dice, hits.probability),
            len(hits),
            int(self._builder.band_totals.max()),
            "measure_response",
        )
        return measured if self._builder.classifies_measurements else evolve(measured, band_noise_w_m2=None)

    def _order(self, time_ns: IntArray, pair: IntArray) -> IntArray:
        """Return the order by time, then pair, of rows sorted by pair, then time."""
        if not len(time_ns):
            return np.empty(0, dtype=np.int64)
        ticks = (time_ns - time_ns.min()) // self._tick_ns
        if ticks.max() < _RADIX_LIMIT:
            return np.argsort(ticks.astype(np.uint16), kind="stable")
        return np.lexsort((pair, time_ns))

    def _probability(self, looks: Looks, interpolant: "WindowInterpolant | None") -> FloatArray:
        """Return each look's probability of detection; 0 if the target is not visible."""
        pairs, model = self.plan.pairs, self.plan.detection
        of_pair = model.pair_probability(pairs.sensor[looks.active], pairs.target[looks.active])
        if interpolant is not None:
            probability = checked_probability(interpolant.probability(), len(looks.pair), "response")
        elif of_pair is not None:
            of_pair = checked_probability(of_pair, len(looks.active), "pair_probability")
            probability = np.repeat(of_pair, looks.scans)
        else:
            parts = [self._varying(looks, rows) for rows in blocks(len(looks.pair))]
            probability = np.concatenate([*parts, np.empty(0)])
        unchecked = np.flatnonzero(pairs.is_checked[looks.pair])
        for rows in blocks(len(unchecked)):
            part = unchecked[rows]
            probability[part] *= self._geometry.visible(looks.pair[part], looks.scan[part])
        return probability

    def _varying(self, looks: Looks, rows: slice) -> FloatArray:
        model = self.plan.detection
        exposed = self._geometry.exposures(looks.pair[rows], looks.scan[rows], with_geometry=model.needs_geometry)
        return checked_probability(model.probability(exposed), len(exposed))


def _pair_types(plan: Plan, streams: PairStreams) -> NDArray[np.uint8] | None:
    """Return the reported types (pairs,) of a classifier that goes by pairs, else None."""
    pairs = plan.pairs
    codes = plan.classifier.pair_type(pairs.sensor, pairs.target, streams.of_pairs())
    return None if codes is None else checked_types(codes, len(pairs), len(plan.reported_types), "pair_type")


def _interpolant(plan: Plan, geometry: LookGeometry) -> "ProbabilityInterpolant | None":
    """Return the interpolated P_d of a plan, if its detection model allows interpolation."""
    model = plan.detection
    if model.probability_tolerance is None:
        return None
    from opir_core.simulation.interpolation import ProbabilityInterpolant

    return ProbabilityInterpolant.of(geometry, model, model.probability_tolerance)


def _confirmation(plan: Plan) -> Confirmation | None:
    """Return the confirmation over scans, if the detection model has one and it needs more than one detection."""
    if plan.detection.confirmation is None:
        return None
    confirmation = checked_confirmation(plan.detection.confirmation, len(plan.sensors))
    if not np.any(confirmation[:, 0] > 1):
        return None
    needed, scans = confirmation[plan.pairs.sensor].T
    return Confirmation(needed, scans)


def _false_alarms(plan: Plan, geometry: LookGeometry) -> "FalseAlarmGenerator | None":
    """Return the generator of false alarms, if the detection model has any."""
    model, scene, names = plan.detection, plan.scene, plan.sensor_names()
    if model.rate_per_scan is None:
        return None
    from opir_core.simulation.false_alarms import FalseAlarmGenerator

    return FalseAlarmGenerator(
        model,
        classifier=plan.classifier,
        confidence=plan.confidence,
        states=geometry.states,
        seed=scene.seed,
        names=names,
        id_keys=stream_key_words(scene.seed, scene.name, scene.epoch_us, [(name, "\x1fnoise") for name in names]),
        exclusions=geometry.exclusions,
        types=len(plan.reported_types),
    )


def _delays(plan: Plan) -> "ReportingDelays | None":
    """Return the reporting latencies of a plan, if any sensor has some."""
    if not any(sensor.reporting for sensor in plan.sensors):
        return None
    from opir_core.simulation.reporting import ReportingDelays

    return ReportingDelays(plan.scene.seed, plan.sensors, plan.sensor_names())


def _tick_ns(pairs: Pairs) -> int:
    """Return the longest step, ns, of which all look times are whole multiples."""
    return int(np.gcd.reduce(np.concatenate([pairs.period_ns, pairs.phase_ns]), initial=0)) or 1


def _measured_columns(measured: Measured) -> dict[str, Any]:
    """Return the columns of detections that are those of their measurements."""
    columns = {
        "bands": measured.bands,
        "snr": measured.snr,
        "line_of_sight_sigma_rad": measured.line_of_sight_sigma_rad,
        "band_irradiance_w_m2": measured.band_irradiance_w_m2,
    }
    return {name: column for name, column in columns.items() if column is not None}
