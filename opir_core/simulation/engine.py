"""The engine: a plan in, windows of detections and tracks out.

Everything in a window is columns over looks: which pairs look when, with what probability of detection, drawn against
the pair's own dice; what is detected is measured, classified, given a confidence and an id. Nothing depends on where
windows begin and end.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.interfaces.columns import Filling
from opir_core.interfaces.protocols import Measured, Tracker
from opir_core.interfaces.records import Detections, DetectionTruth, Window
from opir_core.planning.looks import Looks, blocks, exposures, look_times_ns, pair_names, scan_names, seen
from opir_core.planning.plan import Plan, tracker_of_run
from opir_core.planning.sensor_states import SensorStates
from opir_core.planning.visibility import Pairs
from opir_core.random_streams.pair_streams import PairStreams, WindowNumbers
from opir_core.random_streams.philox import uniforms_of
from opir_core.simulation.measurement import DetectionBuilder, Hits, with_tracks
from opir_core.simulation.tracker_clock import ScheduledTracker

if TYPE_CHECKING:
    from opir_core.simulation.false_alarms import FalseAlarmGenerator, FalseAlarms
    from opir_core.simulation.interpolation.probability import ProbabilityInterpolant, WindowInterpolant

#: numpy sorts whole numbers of 16 bits by radix, several times faster than longer ones.
_RADIX_LIMIT = 1 << 16


class Engine:
    """Runs a plan, window by window; scene time only goes forward."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.time_ns = 0
        self._names = pair_names(plan)
        by_scan = scan_names(plan)
        self._sites = SensorStates.of(plan.sensors, plan.bias)
        self._streams = PairStreams(plan.scene.seed, self._names, by_scan)
        self._assembly = DetectionBuilder(plan, self._sites, self._streams, by_scan)
        self._tick_ns = _tick_ns(plan.pairs)
        self._counts = np.zeros(len(plan.pairs), dtype=np.int32)
        #: Made at the first window: an engine that takes over goes on with another's.
        self._ticked: ScheduledTracker | None = None
        self._knots = _knots(plan, self._sites)
        self._noise = _noise(plan, self._sites)

    def take_over(self, former: "Engine") -> None:
        """Go on where another engine stopped, whose plan has the same sensors: its moment, its tracker, its counts."""
        self.time_ns, self._ticked = former.time_ns, former._tracker
        if self.plan.sensors is not former.plan.sensors:
            self._tracker.set_sensors(self.plan.sensors)
        counts = dict(zip(former._names, former._counts.tolist(), strict=True))
        self._counts = np.array([counts.get(name, 0) for name in self._names], dtype=np.int32)

    @property
    def _tracker(self) -> ScheduledTracker:
        """The tracker of this run."""
        if self._ticked is None:
            self._ticked = ScheduledTracker(_checked_tracker(self.plan), self.plan.end_ns)
        return self._ticked

    def advance(self, end_ns: int) -> Window:
        """Return the window from where the last one ended to `end_ns`."""
        start_ns, self.time_ns = self.time_ns, end_ns
        looks = Looks.between(self.plan.pairs, start_ns, end_ns)
        numbers = WindowNumbers(self._streams, looks.active, looks.first_scan, looks.scans)
        noise = None if self._noise is None else self._noise.between(start_ns, end_ns)
        detections, truth = self._detected(looks, numbers, noise)
        tracked = self._tracker.absorb(detections, start_ns, end_ns)
        self._streams.forget(looks.active[self.plan.pairs.is_over(end_ns)[looks.active]])
        return Window(
            start_s=start_ns * 1e-9,
            end_s=end_ns * 1e-9,
            looks=len(looks.pair),
            detections=with_tracks(self.plan.classifier, tracked.detections, tracked.estimates).freeze(),
            truth=truth.freeze(),
            tracks=tracked.tracks,
            estimates=tracked.estimates,
        )

    def _detected(
        self, looks: Looks, numbers: WindowNumbers, noise: "FalseAlarms | None"
    ) -> tuple[Detections, DetectionTruth]:
        spans = None if self._knots is None else self._knots.over(looks)
        hits = self._hits(looks, numbers, spans)
        measured = None if spans is None else self._measured(hits, numbers, spans)
        order = self._order(hits.time_ns, hits.pair)
        if noise is None:
            return self._assembled(numbers, hits, measured, order)
        if not len(order):
            return noise.alone()
        places = noise.places(hits.time_ns, self.plan.pairs.sensor[hits.pair], order)
        detections, truth = self._assembled(numbers, hits, measured, _with_gaps(order, places))
        detections.overwrite(places, noise.detections)
        truth.overwrite(places, noise.truth)
        return detections, truth

    def _assembled(
        self, numbers: WindowNumbers, hits: Hits, measured: Measured | None, order: IntArray
    ) -> tuple[Detections, DetectionTruth]:
        """Return the detections of hits in an order, and their truth."""
        # Gathered column by column: rows of all pairs in all columns at once are more pages than a processor knows.
        hits, measured = hits.take(order), None if measured is None else measured.take(order)
        given = _known(hits) | ({} if measured is None else _measurements(measured))
        detections = Filling(Detections, len(hits), given)
        truth = Filling(DetectionTruth, len(hits), {"probability": hits.probability})
        for rows in blocks(len(hits)):
            of_rows = None if measured is None else measured.take(rows)
            found, true = self._assembly.block(hits.take(rows), numbers, of_rows)
            detections.put(found)
            truth.put(true)
        return detections.record(), truth.record()

    def _hits(self, looks: Looks, numbers: WindowNumbers, spans: "WindowInterpolant | None") -> Hits:
        """Return the looks that detect, sorted by sensor, then target, then time."""
        probability = self._probability(looks, spans)
        # Looks that detect for certain, or never, need no die: 0 will do.
        cast = numbers.words("detection", None if spans is None else spans.undecided())
        row = np.flatnonzero(uniforms_of(cast) < probability)
        pair, scan = looks.pair.take(row), looks.scan.take(row)
        words = numbers.of_rows("line-of-sight", 1, row, pair)[:, 0]
        time_ns = look_times_ns(self.plan.pairs, pair, scan)
        return Hits(row, pair, scan, time_ns, self._counted(pair), probability.take(row), words)

    def _measured(self, hits: Hits, numbers: WindowNumbers, spans: "WindowInterpolant") -> Measured | None:
        """Return what hits measure, which come sorted by sensor: each one's are next to one another."""
        if not len(hits):
            return None
        dice = numbers.of(hits.row, hits.pair, hits.direction_words)
        measured = spans.measured(hits.row, self.plan.pairs.sensor[hits.pair], dice, hits.probability)
        return measured if self._assembly.judges else evolve(measured, band_noise_w_m2=None)

    def _order(self, time_ns: IntArray, pair: IntArray) -> IntArray:
        """Return the order by time, then pair, of rows that come sorted by pair, then time."""
        if not len(time_ns):
            return np.empty(0, dtype=np.int64)
        ticks = (time_ns - time_ns.min()) // self._tick_ns
        if ticks.max() < _RADIX_LIMIT:
            return np.argsort(ticks.astype(np.uint16), kind="stable")
        return np.lexsort((pair, time_ns))

    def _counted(self, pair: IntArray) -> IndexArray:
        """Return how often each pair has detected, this time included; `pair` comes in runs, each in order of time."""
        start = np.flatnonzero(np.diff(pair, prepend=-1))
        found, times = pair[start], np.diff(start, append=len(pair))
        place = np.arange(len(pair)) - np.repeat(start, times)
        count: IndexArray = (self._counts[pair] + place + 1).astype(np.int32)
        self._counts[found] += times.astype(np.int32)
        return count

    def _probability(self, looks: Looks, spans: "WindowInterpolant | None") -> FloatArray:
        """Return each look's probability of detection; 0 where the target is not seen."""
        pairs, model = self.plan.pairs, self.plan.detection
        of_pair = model.pair_probability(pairs.sensor[looks.active], pairs.target[looks.active])
        if spans is not None:
            probability = spans.probability()
        elif of_pair is not None:
            probability = np.repeat(checked_probability(of_pair, len(looks.active)), looks.scans)
        else:
            parts = [self._varying(looks, rows) for rows in blocks(len(looks.pair))]
            probability = np.concatenate([*parts, np.empty(0)])
        unsure = np.flatnonzero(pairs.is_checked[looks.pair])
        for rows in blocks(len(unsure)):
            part = unsure[rows]
            probability[part] *= seen(self.plan, self._sites, looks.pair[part], looks.scan[part])
        return probability

    def _varying(self, looks: Looks, rows: slice) -> FloatArray:
        model = self.plan.detection
        exposed = exposures(self.plan, self._sites, looks.pair[rows], looks.scan[rows], geometry=model.needs_geometry)
        return checked_probability(model.probability(exposed), len(exposed))


def _knots(plan: Plan, sites: SensorStates) -> "ProbabilityInterpolant | None":
    """Return the knots of a plan whose detection model lets looks share them."""
    tolerance = getattr(plan.detection, "probability_tolerance", None)
    if tolerance is None:
        return None
    from opir_core.simulation.interpolation.probability import ProbabilityInterpolant

    return ProbabilityInterpolant.of(plan, sites, tolerance)


def _checked_tracker(plan: Plan) -> Tracker:
    """Return the tracker of a run of a plan, its answers checked where it steps."""
    tracker = tracker_of_run(plan)
    if tracker.cadence_s is None:
        return tracker
    from opir_core.planning.build_errors import owner_text, to_check
    from opir_core.simulation.tracker_checks import CheckedTracker

    choice = plan.scene.tracker
    return CheckedTracker(tracker, lambda: owner_text(plan.host, choice), to_check(choice.name))


def _noise(plan: Plan, sites: SensorStates) -> "FalseAlarmGenerator | None":
    """Return what makes exceedances of noise, where the detection model knows how often they come."""
    if not hasattr(plan.detection, "rate_per_scan"):
        return None
    from opir_core.simulation.false_alarms import FalseAlarmGenerator

    return FalseAlarmGenerator(plan, sites)


def _tick_ns(pairs: Pairs) -> int:
    """Return the longest step that all look times are whole multiples of, ns."""
    return int(np.gcd.reduce(np.concatenate([pairs.period_ns, pairs.phase_ns]), initial=0)) or 1


def _with_gaps(order: IntArray, places: IntArray) -> IntArray:
    """Return an order (n,) of rows with a place at each of these (m,) of the result: the first row stands there."""
    longer = np.empty(len(order) + len(places), dtype=np.int64)
    is_own = np.ones(len(longer), dtype=np.bool_)
    is_own[places] = False
    longer[is_own] = order
    longer[places] = order[0]
    return longer


def _known(hits: Hits) -> dict[str, Any]:
    """Return the columns of detections that their hits have, and those that a tracker is still to fill."""
    nobody = np.full(len(hits), -1, dtype=np.int64)
    columns = {"time_ns": hits.time_ns, "scan": hits.scan, "detection_count": hits.count}
    return {**columns, "track": nobody, "estimate": nobody}


def _measurements(measured: Measured) -> dict[str, Any]:
    """Return the columns of detections that their measurements are."""
    columns = {
        "bands": measured.bands,
        "snr": measured.snr,
        "line_of_sight_sigma_rad": measured.line_of_sight_sigma_rad,
        "band_irradiance_w_m2": measured.band_irradiance_w_m2,
    }
    return {name: column for name, column in columns.items() if column is not None}


def checked_probability(probability: FloatArray, rows: int) -> FloatArray:
    """Return the probabilities if they are what a detection model owes, else raise `ModelError`."""
    if np.shape(probability) != (rows,):
        raise ModelError(f"the detection model returned shape {np.shape(probability)} for {rows} rows")
    if not np.all((probability >= 0.0) & (probability <= 1.0)):
        raise ModelError("the detection model returned a probability that is not in [0, 1]")
    return probability
