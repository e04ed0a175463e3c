"""Conformance tests of trackers."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache, partial
from itertools import groupby
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, fields, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS, TRACK_ENDS, has_own
from opir_core.plugin import (
    REPORTED_TYPES,
    Component,
    Detections,
    Hypothesis,
    ImpactRegion,
    Tracker,
    TrackerContext,
    TrackerModel,
    Tracks,
)
from opir_core.simulation import without_truth
from opir_testing.bench import planned
from opir_testing.contracts.contract import (
    ConformanceError,
    require,
    require_equal,
    require_independent_rows,
    require_pickling,
)
from opir_testing.contracts.scenes import SceneContract
from opir_testing.doubles import hypothesis_sums
from opir_testing.execution_monitor import python_steps

#: Tolerances of rounding: relative asymmetry, and the least eigenvalue of a correlation matrix.
_SYMMETRY = 1e-9
_LEAST_EIGENVALUE = -1e-9

#: Points of the shortest closed ring: a triangle.
_FEWEST_POINTS = 4


_PROBABILITIES = (
    *("probability_burning", "probability_relights"),
    *("probability_launch", "probability_missile", "probability_orbit"),
)


def validity(tracks: Tracks, hypotheses: Sequence[Hypothesis] = ()) -> Mapping[str, bool]:
    """Return the conditions that estimates must meet, and whether they do; `hypotheses` are those
    of the context.
    """
    rows = len(tracks)
    shapes = {item.name: getattr(Tracks.empty(), item.name).shape[1:] for item in fields(Tracks)}
    if tracks.hypothesis_probability.ndim == 2 and tracks.hypothesis_probability.shape[1]:
        shapes["hypothesis_probability"] = (len(hypotheses),)
    chances = tracks.type_probability
    is_known = ~np.isnan(chances).any(axis=1) if chances.ndim == 2 else np.zeros(0, dtype=bool)
    return {
        **{
            f"{name}: of shape {(rows, *shape)}": getattr(tracks, name).shape == (rows, *shape)
            for name, shape in shapes.items()
        },
        **{
            f"{name}: latitude and longitude": _are_positions(getattr(tracks, name))
            for name in ("launch", "impact")
        },
        f"type_probability: over {', '.join(REPORTED_TYPES)}, summing to 1": bool(
            np.all(chances[is_known] >= 0.0)
            and np.all(np.abs(chances[is_known].sum(axis=1) - 1.0) < 1e-6)
        ),
        **{
            f"{name}: positive and rising": not np.any(
                np.diff(getattr(tracks, name), axis=1, prepend=0.0) <= 0.0
            )
            for name in ("impact_sigmas", "state_sigmas")
        },
        **{
            f"{name}: in [0, 1]": not np.any(
                (getattr(tracks, name) < 0.0) | (getattr(tracks, name) > 1.0)
            )
            for name in _PROBABILITIES
        },
        **_hypothesis_validity(tracks, hypotheses),
        f"end: codes into {TRACK_ENDS}": bool(
            np.all((tracks.end >= 0) & (tracks.end < len(TRACK_ENDS)))
        ),
    }


def _hypothesis_validity(tracks: Tracks, hypotheses: Sequence[Hypothesis]) -> Mapping[str, bool]:
    """Return the conditions of the probabilities of hypotheses, for tracks that have a column for
    each.
    """
    chances = tracks.hypothesis_probability
    if chances.shape != (len(tracks), len(hypotheses)) or not hypotheses:
        return {}
    rows = ~np.isnan(chances).any(axis=1)
    is_known = chances[rows]
    none = chances[:, [group.group == "none" for group in hypotheses]].sum(axis=1)
    sums = hypothesis_sums(chances, hypotheses)
    return {
        "hypothesis_probability: not negative, summing to 1, or nan": bool(
            np.all(is_known >= 0.0) and np.all(np.abs(is_known.sum(axis=1) - 1.0) < 1e-6)
        ),
        **{
            f"{name}: the sum of its hypotheses": np.allclose(
                getattr(tracks, name), total, atol=1e-6, equal_nan=True
            )
            for name, total in sums.items()
            if name != "probability_launch"
        },
        "probability_launch: at least that of the target classes, at most with none of these": bool(
            np.all(tracks.probability_launch[rows] >= sums["probability_launch"][rows] - 1e-6)
            and np.all(
                tracks.probability_launch[rows] <= (sums["probability_launch"] + none)[rows] + 1e-6
            )
        ),
    }


def _are_positions(places: FloatArray) -> bool:
    latitude = np.nan_to_num(places[:, 0])
    longitude = np.nan_to_num(places[:, 1])
    return bool(
        np.all(np.abs(latitude) <= np.pi / 2) and np.all(np.abs(longitude) <= np.pi + 1e-12)
    )


def region_faults(tracks: Tracks) -> Iterator[str]:
    """Yield what is wrong with the impact regions of tracks."""
    rows = {id(row): row for row in tracks.impact_regions.tolist()}
    for conditions in rows.values():
        yield from _condition_faults(conditions)
    for regions in (
        tuple(group)
        for row in rows.values()
        for _, group in groupby(row, lambda region: region.condition)
    ):
        shares = [region.containment for region in regions]
        if shares != sorted(set(shares)) or not set(shares) <= set(TRACK_CONTAINMENTS):
            yield f"of probabilities {shares}, not some of {TRACK_CONTAINMENTS}, each once, in rising order"
        areas = [region.area_km2 for region in regions]
        if not np.all(np.diff(areas, prepend=0.0) >= 0.0) or not np.isfinite(areas).all():
            yield f"of areas {areas} km², not finite and rising with the probability"
        for region in regions:
            rings = [ring for polygon in region.polygons for ring in polygon]
            if not rings or not all(region.polygons):
                yield "without polygons, or with one without rings"
            yield from filter(None, map(_ring_fault, rings))
    with_regions = np.array([bool(row) for row in tracks.impact_regions.tolist()], dtype=bool)
    if np.isnan(tracks.impact[with_regions, :2]).any():
        yield "of a track without an impact point"


def _condition_faults(regions: Sequence[ImpactRegion]) -> Iterator[str]:
    """Yield what is wrong with the conditions of the regions of a track."""
    names = [name for name, _ in groupby(region.condition for region in regions)]
    chances = [region.probability for region in regions]
    if len(set(names)) < len(names) or not set(names) <= set(IMPACT_CONDITIONS):
        yield f"of conditions {names}, not some of {IMPACT_CONDITIONS}, each once"
    if (
        not all(0.0 <= chance <= 1.0 for chance in chances)
        or sorted(chances, reverse=True) != chances
    ):
        yield f"of conditions with probabilities {chances}, not falling and in [0, 1]"


def _ring_fault(ring: FloatArray) -> str:
    if (
        ring.ndim != 2
        or ring.shape[1] != 2
        or len(ring) < _FEWEST_POINTS
        or not np.array_equal(ring[0], ring[-1])
    ):
        return (
            f"with a ring of shape {ring.shape} that is not closed, or has fewer than"
            f" {_FEWEST_POINTS} points"
        )
    is_position = (np.abs(ring[:, 0]) <= np.pi / 2) & (
        np.abs(ring[:, 1]) <= np.pi + 1e-12
    )  # false for nan
    return "" if is_position.all() else "with latitudes beyond pi/2, longitudes beyond pi, or nan"


def require_covariance(what: str, covariance: FloatArray) -> None:
    """Require covariances (n, d, d) that are symmetric and positive definite, or all nan."""
    unknown = np.isnan(covariance).any(axis=(1, 2))
    partly = unknown & ~np.isnan(covariance).all(axis=(1, 2))
    require(
        not partly.any(), f"{what} is partly nan", "Give a whole covariance, or nan in all of it."
    )
    for matrix in covariance[~unknown]:
        deviation = np.sqrt(np.abs(np.diag(matrix)))
        if not np.all(np.diag(matrix) > 0.0):
            raise ConformanceError(
                f"{what} has a variance that is not positive",
                "Use the Joseph form or a square-root filter.",
            )
        correlation = matrix / np.outer(deviation, deviation)
        require(
            np.all(np.abs(correlation - correlation.T) <= _SYMMETRY),
            f"{what} is not symmetric",
            "Compute one triangle and mirror it, or use a square-root filter.",
        )
        least = float(np.linalg.eigvalsh(correlation)[0])
        require(
            least > _LEAST_EIGENVALUE,
            f"{what} has a negative eigenvalue ({least:.1e} of its correlation)",
            "Use the Joseph form or a square-root filter.",
        )


_NS = 1_000_000_000
#: Below the ground, m from the Earth's centre: the polar radius, less the error of a poor estimate.
_LEAST_RADIUS_M = 6.0e6
#: Largest typical distance of positions from the lines of sight, m; a target of the scene moves
#: less in its 90 s.
_NEAR_M = 200e3
#: The limit of the growth of work over that of detections or ticks when both double; quadratic work
#: would be 2.
_GROWTH_LIMIT = 1.5


@frozen(eq=False)
class Tick:
    """A tick: its detections, and the tracker's results."""

    time_s: float
    detections: Detections
    track: IntArray
    tracks: Tracks


class TrackerContract(SceneContract):
    """Conformance tests of a tracker. Track numbers may depend on the order of targets, the
    partition may not.
    """

    kind: ClassVar[type[Component]] = TrackerModel
    key = "tracker"

    @classmethod
    def tracker(cls) -> Tracker:
        """Return a new tracker."""
        return cls.built(Tracker, cls.config(), cls.context())

    @classmethod
    def part(cls) -> Any:
        """Return a new tracker."""
        return cls.tracker()

    @classmethod
    @cache
    def context(cls) -> TrackerContext:
        """Return the context of the tracker, with the sensors of the scene."""
        plan = planned(cls.scene(tracker="none"), cls.host())
        return TrackerContext(
            sensors=plan.sensors,
            epoch_us=plan.scene.epoch_us,
            duration_s=plan.scene.duration_s,
            hypotheses=plan.hypotheses,
        )

    @classmethod
    @cache
    def reported(cls) -> Detections:
        """Return the detections of the scene, as sensors report them."""
        return cls.run_of(cls.scene(tracker="none")).detections.freeze()

    @classmethod
    @cache
    def observed(cls) -> Detections:
        """Return the detections of the scene, as the engine passes them to trackers."""
        return without_truth(cls.reported()).freeze()

    @classmethod
    def ticks(cls, tracker: Tracker, detections: Detections | None = None) -> Iterator[Tick]:
        """Yield the results of a tracker for the detections of the scene, tick by tick."""
        rows = cls.observed() if detections is None else detections
        for tick_ns, batch in _batches(tracker, rows, cls.plan().end_ns):
            track = tracker.associate(batch)
            yield Tick(tick_ns / _NS, batch, track, tracker.step(tick_ns / _NS, batch))

    @classmethod
    @cache
    def results(cls) -> tuple[Tick, ...]:
        """Return the results of a new tracker for the detections of the scene."""
        return tuple(cls.ticks(cls.tracker()))

    def test_targets_in_any_order_give_the_same_events(self) -> None:
        """The order of targets does not change which detections share a track."""
        scene = self.scene()
        reordered = self.run_of({**scene, "targets": scene["targets"][::-1]})
        require_equal(
            _partition(self.run().detections) == _partition(reordered.detections),
            "with the targets in reverse order, other detections share a track",
            "Break ties by measurements (time, sensor, direction), not by the order of rows.",
        )

    def test_results_of_others_do_not_change(self) -> None:
        """The tracker does not change the detections."""
        without = self.reported()
        change = "Change neither detections nor any state outside the tracker."
        names = {"track", "estimate"}
        for column in (item.name for item in fields(Detections) if item.name not in names):
            is_equal = np.array_equal(
                getattr(without, column), getattr(self.run().detections, column), equal_nan=True
            )
            require_equal(is_equal, f"the tracker changes the column {column}", change)

    def test_only_measured_columns_are_used(self) -> None:
        """Results do not depend on counts, confidences and ids of detections, which contain
        truth.
        """
        detections = self.reported()
        rng = np.random.default_rng(0)
        scrambled = evolve(
            detections,
            detection_count=rng.integers(1, 1000, len(detections)).astype(np.int32),
            confidence=rng.uniform(size=len(detections)),
            detection_id=rng.integers(0, 2**63, (len(detections), 2)).astype(np.uint64),
        )
        for tick, copy in zip(self.results(), self.ticks(self.tracker(), scrambled), strict=True):
            require_equal(
                np.array_equal(tick.track, copy.track) and _equal(tick.tracks, copy.tracks),
                f"at {tick.time_s} s results change with counts, confidences and ids",
                "Use times, sensors, scans, directions, bands, irradiances and reported types.",
            )

    def test_cadence_is_a_positive_time_or_none(self) -> None:
        """The time between ticks is positive, or None."""
        cadence_s: Any = self.tracker().cadence_s
        require(
            cadence_s is None
            or (isinstance(cadence_s, int | float) and 0.0 < cadence_s < float("inf")),
            f"cadence_s is {cadence_s!r}",
            "Return a positive number of seconds, or None.",
        )

    def test_associations_are_to_existing_tracks(self) -> None:
        """A detection is associated with a track of the last tick, or with none (-1)."""
        is_known = np.empty(0, dtype=np.int64)
        for tick in self.results():
            require(
                tick.track.dtype == np.int64 and tick.track.shape == (len(tick.detections),),
                f"associate returns {tick.track.dtype} {tick.track.shape} for"
                f" {len(tick.detections)} detections",
                "Return int64, one number for each detection.",
            )
            unknown = tick.track[(tick.track != -1) & ~np.isin(tick.track, is_known)]
            require(
                len(unknown) == 0,
                f"at {tick.time_s} s a detection is associated with track {unknown[:1]}, unknown at"
                f" the last tick",
                "Associate with the tracks that the last step returned.",
            )
            is_known = tick.tracks.track

    def test_associate_has_no_side_effects(self) -> None:
        """Calls of `associate` do not change later results."""
        tracker = self.tracker()
        control = self.tracker()
        for tick_ns, batch in _batches(tracker, self.observed(), self.plan().end_ns):
            numbers = tracker.associate(batch)
            repeated = tracker.associate(batch)
            tracks = tracker.step(tick_ns / _NS, batch)
            expected = control.step(tick_ns / _NS, batch)
            require_equal(
                np.array_equal(numbers, repeated) and _equal(tracks, expected),
                f"at {tick_ns / _NS} s results depend on calls of associate",
                "Change state in step only; the engine may call associate for parts of a batch, or"
                " more than once.",
            )

    def test_unchanged_sensors_change_nothing(self) -> None:
        """A tracker that is given its current sensors returns the same tracks."""
        tracker = self.tracker()
        copy = self.tracker()
        if not has_own(Tracker, tracker, "set_sensors"):
            return
        for tick_ns, batch in _batches(tracker, self.observed(), self.plan().end_ns):
            tracker.set_sensors(self.context().sensors)
            is_equal = _equal(tracker.step(tick_ns / _NS, batch), copy.step(tick_ns / _NS, batch))
            require_equal(
                is_equal,
                f"at {tick_ns / _NS} s set_sensors changes the tracks",
                "Change only the settings of the sensors.",
            )

    def test_associations_are_independent(self) -> None:
        """The track of a detection does not depend on the other detections of the call."""
        tracker = self.tracker()
        batch = self.observed()
        for _ in self.ticks(tracker):
            pass
        require_independent_rows(
            "the track", lambda rows: tracker.associate(batch.take(rows)), len(batch)
        )

    def test_tracks_of_a_tick_are_sorted(self) -> None:
        """A tick has one row per track, sorted by number, with the time of the tick."""
        for tick in self.results():
            number = tick.tracks.track
            require(
                np.all(np.diff(number) > 0)
                and np.all(number >= 0)
                and np.all(tick.tracks.tick_s == tick.time_s),
                f"at {tick.time_s} s the rows are of tracks {number[:6]} at"
                f" {tick.tracks.tick_s[:6]} s",
                "Return one row per track, sorted by track number from 0, with the tick_s of the"
                " call.",
            )

    def test_shapes_and_positions_are_valid(self) -> None:
        """Estimates have the stated shapes; latitudes, longitudes and probabilities are valid or
        nan.
        """
        hypotheses = self.context().hypotheses
        for tick in self.results():
            for condition, holds in validity(tick.tracks, hypotheses).items():
                require(
                    holds,
                    f"at {tick.time_s} s not valid: {condition}",
                    "Return nan for unknown values, angles in radians, longitudes in [-pi, pi],"
                    " times in scene time.",
                )

    def test_positions_are_above_the_ground_and_near_the_lines_of_sight(self) -> None:
        """Known positions lie between the ground and the highest sensor, most within 200 km of a
        measured ray.
        """
        change = "Return positions in ECEF, in metres, or nan while they are unknown."
        observed = self.observed()
        distances_m = []
        highest_m = float(_length(observed.sensor_ecef_m).max(initial=0.0))
        for tick in self.results():
            known_m = tick.tracks.state[np.isfinite(tick.tracks.state[:, :3]).all(axis=1), :3]
            radius_m = _length(known_m)
            outside = radius_m[(radius_m < _LEAST_RADIUS_M) | (radius_m > highest_m)]
            require(
                len(outside) == 0,
                f"at {tick.time_s} s a position is {outside[:1].sum():.0f} m from the Earth's"
                f" centre; the ground is at"
                f" 6.4e6 m, the highest sensor of the scene at {highest_m:.4g} m",
                change,
            )
            rays = observed.take(observed.time_ns <= round(tick.time_s * _NS))
            distances_m += [_nearest_ray_m(place_m, rays) for place_m in known_m]
        typical_m = float(np.median(distances_m)) if distances_m else 0.0
        require(
            typical_m <= _NEAR_M,
            f"half of the positions are over {typical_m / 1000.0:.0f} km from all lines of sight"
            f" measured before",
            change,
        )

    def test_impact_regions_are_nested_and_closed(self) -> None:
        """Impact regions have rising probabilities and areas, and closed rings of latitude and
        longitude.
        """
        for tick in self.results():
            fault = next(region_faults(tick.tracks), None)
            require(
                fault is None,
                f"at {tick.time_s} s there are impact regions {fault}",
                "Return tuples of ImpactRegion with rings in radians, or empty tuples.",
            )

    def test_covariances_are_symmetric_and_positive_definite(self) -> None:
        """Each covariance is symmetric and positive definite, or all nan."""
        for tick in self.results():
            for name in (
                "state_covariance",
                "launch_covariance",
                "impact_covariance",
                "burnout_covariance",
            ):
                require_covariance(f"{name} at {tick.time_s} s", getattr(tick.tracks, name))

    def test_ticks_without_detections_are_accepted(self) -> None:
        """Ticks without detections return no tracks if there was no detection before."""
        tracker = self.tracker()
        none = self.observed().take(slice(0, 0))
        for tick in self.ticks(tracker, none):
            require_equal(
                len(tick.tracks) == 0,
                "there is a track without detections",
                "Return no tracks before the first detection.",
            )

    def test_an_idle_tracker_may_pass_over_ticks(self) -> None:
        """Ticks without detections at which a tracker is idle have no tracks; all but the last may
        be passed over.
        """
        tracker = self.tracker()
        control = self.tracker()
        none = self.observed().take(slice(0, 0))
        passed_ns = None
        for tick_ns, batch in _batches(tracker, self.observed(), self.plan().end_ns):
            expected = control.step(tick_ns / _NS, batch)
            if not len(batch) and tracker.is_idle():
                require_equal(
                    not len(expected),
                    "an idle tracker has tracks",
                    "is_idle is true while nothing is followed.",
                )
                passed_ns = tick_ns
                continue
            if passed_ns is not None:
                tracker.step(passed_ns / _NS, none)
                passed_ns = None
            require_equal(
                _equal(tracker.step(tick_ns / _NS, batch), expected),
                f"at {tick_ns / _NS} s ticks that were passed over while the tracker was idle"
                f" change the tracks",
                "Return False from is_idle while anything is kept that time changes.",
            )

    def test_a_tracker_pickles_between_ticks(self) -> None:
        """A copy pickled between two ticks continues with the same results."""
        tracker = self.tracker()
        batches = list(_batches(tracker, self.observed(), self.plan().end_ns))
        middle = len(batches) // 2
        for tick_ns, batch in batches[:middle]:
            tracker.step(tick_ns / _NS, batch)
        copy = require_pickling(tracker)
        for tick_ns, batch in batches[middle:]:
            is_equal = _equal(tracker.step(tick_ns / _NS, batch), copy.step(tick_ns / _NS, batch))
            require_equal(
                is_equal,
                f"at {tick_ns / _NS} s a pickled copy returns other tracks",
                "Keep all state in the tracker.",
            )

    def test_work_grows_linearly_with_detections(self) -> None:
        """Twice the detections take about twice the steps of Python."""
        observed = self.observed()
        end_ns = self.plan().end_ns
        middle_ns = int(observed.time_ns[len(observed) // 2])
        half = observed.take(observed.time_ns < middle_ns)
        steps = python_steps(partial(self._stepped, observed, end_ns))
        half_steps = python_steps(partial(self._stepped, half, middle_ns))
        growth = steps / half_steps / max(len(observed) / len(half), end_ns / middle_ns)
        require(
            growth < _GROWTH_LIMIT,
            f"twice the detections take {2.0 * growth:.1f} times the steps of Python",
            "Process only the new detections at each tick; keep a summary of earlier ones.",
        )

    def _stepped(self, detections: Detections, end_ns: int) -> None:
        tracker = self.tracker()
        for tick_ns, batch in _batches(tracker, detections, end_ns):
            tracker.step(tick_ns / _NS, batch)


def _batches(
    tracker: Tracker, detections: Detections, end_ns: int
) -> Iterator[tuple[int, Detections]]:
    if tracker.cadence_s is None:
        return
    cadence_ns = max(1, round(tracker.cadence_s * _NS))
    edges = [0, *range(cadence_ns, end_ns, cadence_ns), end_ns]
    cuts = np.searchsorted(detections.time_ns, edges)
    for number, edge in enumerate(edges[1:]):
        yield edge, detections.take(slice(cuts[number], cuts[number + 1])).freeze()


def _nearest_ray_m(place_m: FloatArray, rays: Detections) -> float:
    """Return the distance of a position (3,) from the nearest of the lines of sight, m."""
    offset_m = place_m - rays.sensor_ecef_m
    ray = rays.line_of_sight_ecef
    along_m = np.maximum(np.sum(offset_m * ray, axis=1), 0.0)
    return float(_length(offset_m - along_m[:, None] * ray).min(initial=np.inf))


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt(np.sum(vectors**2, axis=-1))


def _partition(detections: Detections) -> set[frozenset[tuple[int, int]]]:
    """Return the sets of detections, by their ids, that share a track."""
    groups: dict[int, list[tuple[int, int]]] = {}
    for track, words in zip(
        detections.track.tolist(), detections.detection_id.tolist(), strict=True
    ):
        groups.setdefault(track, []).append(tuple(words))
    return {frozenset(members) for members in groups.values()}


def _equal(tracks: Tracks, copy: Tracks) -> bool:
    names = [item.name for item in fields(Tracks)]
    columns = ((getattr(tracks, name), getattr(copy, name)) for name in names)
    return all(
        np.array_equal(column, values, equal_nan=column.dtype.kind == "f")
        for column, values in columns
    )
