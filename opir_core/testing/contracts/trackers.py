"""The contract of trackers: detections to tracks, on ticks of scene time.

What a tracker's estimates must be: of the shapes stated, on the Earth, chances, and covariances.
"""

from collections.abc import Iterator, Mapping
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, fields, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.optional import ReconfigurableTracker
from opir_core.interfaces.protocols import Tracker
from opir_core.interfaces.records import Detections, Tracks
from opir_core.plugin.components import Component, TrackerModel
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.simulation.tracker_clock import without_truth
from opir_core.testing.bench import bench_scene, planned
from opir_core.testing.contracts.comparisons import insist_pickles, insist_rows_stand_alone
from opir_core.testing.contracts.contract import Broken, insist
from opir_core.testing.contracts.scenes import SceneContract
from opir_core.testing.steps import python_steps

#: Relative tolerance of symmetry, and how far below zero rounding may take the least eigenvalue of a correlation.
_SYMMETRY = 1e-9
_LEAST_EIGENVALUE = -1e-9


def lawful(tracks: Tracks) -> Mapping[str, bool]:
    """Return what estimates must keep to, in words, and whether they do."""
    rows = len(tracks)
    shapes = {name: getattr(Tracks.empty(), name).shape[1:] for name in (item.name for item in fields(Tracks))}
    chances = tracks.type_probability
    known = ~np.isnan(chances).any(axis=1) if chances.ndim == 2 else np.zeros(0, dtype=bool)
    return {
        **{
            f"{name}: of shape {(rows, *shape)}": _shape(tracks, name) == (rows, *shape)
            for name, shape in shapes.items()
        },
        **{f"{name}: latitude and longitude": _are_places(getattr(tracks, name)) for name in ("launch", "impact")},
        f"type_probability: over {', '.join(REPORTED_TYPES)}, summing to 1": bool(
            np.all(chances[known] >= 0.0) and np.all(np.abs(chances[known].sum(axis=1) - 1.0) < 1e-6)
        ),
        **{
            f"{name}: positive and rising": _are_radii(getattr(tracks, name))
            for name in ("impact_sigmas", "state_sigmas")
        },
    }


def _are_radii(sigmas: FloatArray) -> bool:
    steps = np.diff(sigmas, axis=1, prepend=0.0)
    return not np.any(steps <= 0.0)


def _shape(tracks: Tracks, name: str) -> tuple[int, ...]:
    shape: tuple[int, ...] = getattr(tracks, name).shape
    return shape


def _are_places(places: FloatArray) -> bool:
    latitude, longitude = np.nan_to_num(places[:, 0]), np.nan_to_num(places[:, 1])
    return bool(np.all(np.abs(latitude) <= np.pi / 2) and np.all(np.abs(longitude) <= np.pi + 1e-12))


def insist_covariance(what: str, covariance: FloatArray) -> None:
    """Refuse covariances (n, d, d) that are not symmetric or not positive, or known in part."""
    unknown = np.isnan(covariance).any(axis=(1, 2))
    partly = unknown & ~np.isnan(covariance).all(axis=(1, 2))
    insist(not partly.any(), f"{what} is partly nan", "Give a whole covariance, or nan in all of it.")
    for matrix in covariance[~unknown]:
        deviation = np.sqrt(np.abs(np.diag(matrix)))
        if not np.all(np.diag(matrix) > 0.0):
            raise Broken(f"{what} has a variance that is not positive", "Use Joseph's or a square-root form.")
        correlation = matrix / np.outer(deviation, deviation)
        insist(
            bool(np.all(np.abs(correlation - correlation.T) <= _SYMMETRY)),
            f"{what} is not symmetric",
            "Compute one triangle and mirror it, or use a square-root form.",
        )
        least = float(np.linalg.eigvalsh(correlation)[0])
        insist(
            least > _LEAST_EIGENVALUE,
            f"{what} has a negative eigenvalue ({least:.1e} of its correlation)",
            "Use Joseph's or a square-root form.",
        )


_NS = 1_000_000_000
#: How much faster than detections, or than ticks, the work may grow when both double; squares would be 2.
_GROWTH_LIMIT = 1.5


@frozen(eq=False)
class Tick:
    """What a tracker is fed at a tick, and what it answers."""

    time_s: float
    detections: Detections
    track: IntArray
    tracks: Tracks


class TrackerContract(SceneContract):
    """What a tracker promises. Its name for a track may depend on the order of targets; which is which may not."""

    kind: ClassVar[type[Component]] = TrackerModel

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the tracker."""
        return bench_scene(**{"tracker": {"model": cls.name, **cls.block()}, **changes})

    @classmethod
    def tracker(cls) -> Tracker:
        """Return the tracker, newly built."""
        made: Tracker = cls.component().build(cls.config(), cls.context())
        return made

    @classmethod
    @cache
    def context(cls) -> TrackerContext:
        """Return what it is built with: the scene's sensors, though the scene with the tracker may not be had."""
        plan = planned(cls.scene(tracker="none"), cls.host())
        return TrackerContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us, duration_s=plan.scene.duration_s)

    @classmethod
    @cache
    def fed(cls) -> Detections:
        """Return the scene's detections, as sensors report them."""
        return cls.run_of(cls.scene(tracker="none")).detections.freeze()

    @classmethod
    @cache
    def seen(cls) -> Detections:
        """Return the scene's detections, as the engine shows them to trackers."""
        return without_truth(cls.fed()).freeze()

    @classmethod
    def ticks(cls, tracker: Tracker, detections: Detections | None = None) -> Iterator[Tick]:
        """Yield what a tracker answers to the scene's detections, tick by tick."""
        fed = cls.seen() if detections is None else detections
        for tick_ns, batch in _batches(tracker, fed, cls.plan().end_ns):
            track = tracker.associate(batch)
            yield Tick(tick_ns / _NS, batch, track, tracker.step(tick_ns / _NS, batch))

    def test_targets_in_any_order_give_the_same_events(self) -> None:
        """The order of targets in the scene changes no detection, and not which of them belong together."""
        scene, ours = self.scene(), self.run()
        others = self.run_of({**scene, "targets": scene["targets"][::-1]})
        mine, theirs = _partition(ours.detections), _partition(others.detections)
        insist(
            mine == theirs,
            "with the targets in reverse, detections are grouped into other tracks",
            "Break ties by what was measured (time, sensor, direction), not by the order of rows.",
        )

    def test_draws_of_others_are_left_alone(self) -> None:
        """The tracker changes nothing of what sensors report."""
        without = self.fed()
        change = "A tracker reads detections; it changes neither them nor anything outside itself."
        names = {"track", "estimate"}
        for column in (item.name for item in fields(Detections) if item.name not in names):
            same = np.array_equal(getattr(without, column), getattr(self.run().detections, column), equal_nan=True)
            insist(same, f"{column} of detections is another with the tracker", change)

    def test_only_what_is_measured_is_read(self) -> None:
        """Counts, confidences and ids of detections, which know their targets, change no answer."""
        fed, rng = self.fed(), np.random.default_rng(0)
        told = evolve(
            fed,
            detection_count=rng.integers(1, 1000, len(fed)).astype(np.int32),
            confidence=rng.uniform(size=len(fed)),
            detection_id=rng.integers(0, 2**63, (len(fed), 2)).astype(np.uint64),
        )
        for tick, other in zip(self.ticks(self.tracker()), self.ticks(self.tracker(), told), strict=True):
            insist(
                np.array_equal(tick.track, other.track) and _equal(tick.tracks, other.tracks),
                f"at {tick.time_s} s the answer is another with other counts, confidences and ids",
                "Read what is measured: times, sensors, scans, directions, bands and irradiances, reported types.",
            )

    def test_cadence_is_a_positive_time_or_none(self) -> None:
        """The time between ticks is positive, or None for a tracker that never steps."""
        cadence_s: Any = self.tracker().cadence_s
        insist(
            cadence_s is None or (isinstance(cadence_s, int | float) and 0.0 < cadence_s < float("inf")),
            f"cadence_s is {cadence_s!r}",
            "Return a positive number of seconds, or None.",
        )

    def test_association_names_known_tracks(self) -> None:
        """A detection belongs to a track that the last tick told of, or to none (-1)."""
        known = np.empty(0, dtype=np.int64)
        for tick in self.ticks(self.tracker()):
            insist(
                tick.track.dtype == np.int64 and tick.track.shape == (len(tick.detections),),
                f"associate gives {tick.track.dtype} {tick.track.shape} for {len(tick.detections)} detections",
                "Return int64, one number for each detection.",
            )
            strangers = tick.track[(tick.track != -1) & ~np.isin(tick.track, known)]
            insist(
                len(strangers) == 0,
                f"at {tick.time_s} s a detection is given to track {strangers[:1]}, unknown to the last tick",
                "Associate with the tracks that the last step returned; a track exists from its first row on.",
            )
            known = tick.tracks.track

    def test_association_changes_nothing(self) -> None:
        """Asking which track detections belong to changes no later answer."""
        asked, silent = self.tracker(), self.tracker()
        for tick_ns, batch in _batches(asked, self.seen(), self.plan().end_ns):
            first = asked.associate(batch)
            again = asked.associate(batch)
            told, untold = asked.step(tick_ns / _NS, batch), silent.step(tick_ns / _NS, batch)
            insist(
                np.array_equal(first, again) and _equal(told, untold),
                f"at {tick_ns / _NS} s the answer is another after associate was asked",
                "Change state in step alone; the engine may ask associate in pieces, or more than once.",
            )

    def test_unchanged_sensors_change_nothing(self) -> None:
        """A `ReconfigurableTracker` that gets the sensors it has continues as before."""
        tracker, other = self.tracker(), self.tracker()
        if not isinstance(tracker, ReconfigurableTracker):
            return
        for tick_ns, batch in _batches(tracker, self.seen(), self.plan().end_ns):
            tracker.set_sensors(self.context().sensors)
            same = _equal(tracker.step(tick_ns / _NS, batch), other.step(tick_ns / _NS, batch))
            insist(same, f"at {tick_ns / _NS} s set_sensors changes the tracks", "Change the sensors' settings alone.")

    def test_each_detection_is_associated_on_its_own(self) -> None:
        """The track of a detection does not depend on which detections are asked about with it."""
        tracker, batch = self.tracker(), self.seen()
        for _ in self.ticks(tracker):
            pass
        insist_rows_stand_alone("the track", lambda rows: tracker.associate(batch.take(rows)), len(batch))

    def test_rows_of_a_tick_are_in_order(self) -> None:
        """A tick has one row for each track, sorted by number, with the time of the tick."""
        for tick in self.ticks(self.tracker()):
            number = tick.tracks.track
            insist(
                bool(np.all(np.diff(number) > 0) and np.all(number >= 0) and np.all(tick.tracks.tick_s == tick.time_s)),
                f"at {tick.time_s} s the rows are of tracks {number[:6]} at {tick.tracks.tick_s[:6]} s",
                "Return one row a track, sorted by track, numbers from 0 on, tick_s the time that step was given.",
            )

    def test_shapes_and_places_are_lawful(self) -> None:
        """Estimates have their shapes; latitudes, longitudes and probabilities lie where they must, or are nan."""
        for tick in self.ticks(self.tracker()):
            for promise, kept in lawful(tick.tracks).items():
                insist(
                    kept,
                    f"at {tick.time_s} s {promise} is not so",
                    "What is unknown is nan; angles are in radians, longitudes in [-pi, pi], times in scene time.",
                )

    def test_covariances_are_symmetric_and_positive_definite(self) -> None:
        """Every covariance is symmetric and positive definite, or nan altogether."""
        for tick in self.ticks(self.tracker()):
            for name in ("state_covariance", "launch_covariance", "impact_covariance", "burnout_covariance"):
                insist_covariance(f"{name} at {tick.time_s} s", getattr(tick.tracks, name))

    def test_ticks_without_detections_are_no_error(self) -> None:
        """Ticks with nothing to see, also before the first detection, are taken."""
        tracker, none = self.tracker(), self.seen().take(slice(0, 0))
        for tick in self.ticks(tracker, none):
            insist(len(tick.tracks) == 0, "there is a track and nothing was detected", "Invent nothing.")

    def test_a_tracker_pickles_in_mid_run(self) -> None:
        """A tracker pickled between two ticks goes on as the original does."""
        tracker = self.tracker()
        batches = list(_batches(tracker, self.seen(), self.plan().end_ns))
        middle = len(batches) // 2
        for tick_ns, batch in batches[:middle]:
            tracker.step(tick_ns / _NS, batch)
        copy = insist_pickles(tracker)
        for tick_ns, batch in batches[middle:]:
            same = _equal(tracker.step(tick_ns / _NS, batch), copy.step(tick_ns / _NS, batch))
            insist(same, f"at {tick_ns / _NS} s a pickled copy gives other tracks", "Keep all state in the tracker.")

    def test_work_grows_with_the_detections(self) -> None:
        """Twice as many detections take about twice the steps of Python, not four times."""
        whole, end_ns = self.seen(), self.plan().end_ns
        middle_ns = int(whole.time_ns[len(whole) // 2])
        half = whole.take(whole.time_ns < middle_ns)
        steps = [python_steps(partial(self._worked, *fed)) for fed in ((half, middle_ns), (whole, end_ns))]
        growth = steps[1] / steps[0] / max(len(whole) / len(half), end_ns / middle_ns)
        insist(
            growth < _GROWTH_LIMIT,
            f"twice the detections take {2.0 * growth:.1f} times the steps of Python",
            "Keep what has been seen as a summary: each tick works on its new detections, not on all before.",
        )

    def _worked(self, detections: Detections, end_ns: int) -> None:
        tracker = self.tracker()
        for tick_ns, batch in _batches(tracker, detections, end_ns):
            tracker.step(tick_ns / _NS, batch)


def _batches(tracker: Tracker, detections: Detections, end_ns: int) -> Iterator[tuple[int, Detections]]:
    if tracker.cadence_s is None:
        return
    cadence_ns = max(1, round(tracker.cadence_s * _NS))
    edges = [0, *range(cadence_ns, end_ns, cadence_ns), end_ns]
    cuts = np.searchsorted(detections.time_ns, edges)
    for number, edge in enumerate(edges[1:]):
        yield edge, detections.take(slice(cuts[number], cuts[number + 1])).freeze()


def _partition(detections: Detections) -> set[frozenset[tuple[int, int]]]:
    """Return which detections, by their ids, share a track."""
    groups: dict[int, list[tuple[int, int]]] = {}
    for track, words in zip(detections.track.tolist(), detections.detection_id.tolist(), strict=True):
        groups.setdefault(track, []).append(tuple(words))
    return {frozenset(members) for members in groups.values()}


def _equal(one: Tracks, other: Tracks) -> bool:
    names = (item.name for item in fields(Tracks))
    return all(np.array_equal(getattr(one, name), getattr(other, name), equal_nan=True) for name in names)
