"""Broken trackers."""

import math
import operator

import numpy as np
from attrs import evolve
from opir_testing.doubles import hypothesis_sums, stub_regions
from opir_trackers import Association, Associator

from broken_components.offers import mutant
from opir_core.interfaces.records import Tracks
from opir_core.plugin import TrackerModel, TrackerPart


class OneTrack:
    """One track a sensor, where its last line of sight meets a sphere: lawful, if of little use."""

    def __init__(self, cadence_s=5.0):
        self.cadence_s = cadence_s
        self.seen = set()
        self.count = 0
        self.places = {}

    def associate(self, detections):
        sensors = np.array(sorted(self.seen), dtype=np.int64)
        return np.where(np.isin(detections.sensor, sensors), detections.sensor, -1).astype(np.int64)

    def step(self, tick_s, detections):
        self.seen |= set(detections.sensor.tolist())
        self.count += len(detections)
        rows = zip(
            detections.time_ns.tolist(),
            detections.sensor.tolist(),
            detections.sensor_ecef_m.tolist(),
            detections.line_of_sight_ecef.tolist(),
            strict=True,
        )
        for _, sensor, position, ray in sorted(rows):
            self.places[sensor] = met(position, ray)
        return self.tracks(tick_s, np.array(sorted(self.seen), dtype=np.int64))

    def state_of(self, track):
        x, y, z = self.places.get(track, (6.5e6, 0.0, 0.0))
        return [x, y + self.count, z, 0.0, 0.0, 0.0]

    def tracks(self, tick_s, number):
        count = len(number)
        return Tracks(
            tick_s=np.full(count, tick_s),
            track=number,
            state=np.array([self.state_of(track) for track in number.tolist()]).reshape(count, 6),
            state_covariance=np.tile(np.diag([1e6, 1e6, 1e6, 1e2, 1e2, 1e2]), (count, 1, 1)),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
            impact=np.full((count, 3), np.nan),
            impact_covariance=np.full((count, 3, 3), np.nan),
            type_probability=np.full((count, 4), 0.25),
        )


def met(position, ray):
    """Return where a line of sight meets a sphere of 6 500 km, m, or comes nearest to the Earth's
    centre.
    """
    along = -sum(map(operator.mul, position, ray))
    depth = along * along - sum(map(operator.mul, position, position)) + 6.5e6**2
    along -= math.sqrt(max(depth, 0.0))
    return tuple(place + along * component for place, component in zip(position, ray, strict=True))


def tracker_mutant(name, caught_by):
    """Offer a tracker of a class of its own."""

    def offered(tracker):
        mutant(TrackerModel, name, caught_by)(lambda _config, _context: tracker())
        return tracker

    return offered


tracker_mutant("sound-tracker", "")(OneTrack)


@tracker_mutant("foresees", "test_associations_are_to_existing_tracks")
class Foresees(OneTrack):
    def associate(self, detections):
        return detections.sensor.astype(np.int64)


@tracker_mutant("learns-while-asked", "test_associate_has_no_side_effects")
class LearnsWhileAsked(OneTrack):
    def associate(self, detections):
        answer = super().associate(detections)
        self.seen |= set(detections.sensor.tolist())
        return answer


@tracker_mutant("first-come", "test_associations_are_independent")
class FirstCome(OneTrack):
    def associate(self, detections):
        answer = super().associate(detections)
        answer[1:] = -1
        return answer


@tracker_mutant("reads-counts", "test_only_measured_columns_are_used")
class ReadsCounts(OneTrack):
    def step(self, tick_s, detections):
        self.count += int(detections.detection_count.sum())
        return super().step(tick_s, detections)


@tracker_mutant("unsorted", "test_tracks_of_a_tick_are_sorted")
class Unsorted(OneTrack):
    def step(self, tick_s, detections):
        return super().step(tick_s, detections).take(slice(None, None, -1))


@tracker_mutant("lopsided", "test_covariances_are_symmetric_and_positive_definite")
class Lopsided(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.state_covariance[:, 0, 1] = 1e3
        return tracks


@tracker_mutant("overconfident", "test_covariances_are_symmetric_and_positive_definite")
class Overconfident(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.state_covariance[:, 0, 1] = 1.1e6
        tracks.state_covariance[:, 1, 0] = 1.1e6
        return tracks


@tracker_mutant("in-degrees", "test_shapes_and_positions_are_valid")
class InDegrees(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.launch[:] = [34.7, -120.6, 0.0]
        return tracks


@tracker_mutant("sure-of-all", "test_shapes_and_positions_are_valid")
class SureOfAll(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.type_probability[:] = 1.0
        return tracks


@tracker_mutant("holds-less-farther-out", "test_shapes_and_positions_are_valid")
class HoldsLessFartherOut(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.state_sigmas[:] = [2.3, 3.6, 3.3]
        return tracks


@tracker_mutant("burns-for-sure", "test_shapes_and_positions_are_valid")
class BurnsForSure(OneTrack):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.probability_burning[:] = 1.5
        return tracks


class WithRegions(OneTrack):
    """One track with valid regions, which `changed` spoils."""

    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.impact[:] = [0.1, 0.2, 900.0]
        for row in range(len(tracks)):
            tracks.impact_regions[row] = self.changed(list(stub_regions(5.7, 11.5)))
        return tracks

    def changed(self, regions):
        return tuple(regions)


tracker_mutant("sound-regions", "")(WithRegions)


@tracker_mutant("regions-shrink", "test_impact_regions_are_nested_and_closed")
class RegionsShrink(WithRegions):
    def changed(self, regions):
        return evolve(regions[0], area_km2=1e6), *regions[1:]


@tracker_mutant("regions-twice", "test_impact_regions_are_nested_and_closed")
class RegionsTwice(WithRegions):
    def changed(self, regions):
        return regions[0], *regions


@tracker_mutant("regions-open", "test_impact_regions_are_nested_and_closed")
class RegionsOpen(WithRegions):
    def changed(self, regions):
        return (evolve(regions[0], polygons=((regions[0].polygons[0][0][:-1],),)),)


@tracker_mutant("regions-in-degrees", "test_impact_regions_are_nested_and_closed")
class RegionsInDegrees(WithRegions):
    def changed(self, regions):
        return (evolve(regions[0], polygons=((np.degrees(regions[0].polygons[0][0]),),)),)


@tracker_mutant("regions-without-impact", "test_impact_regions_are_nested_and_closed")
class RegionsWithoutImpact(WithRegions):
    def tracks(self, tick_s, number):
        tracks = super().tracks(tick_s, number)
        tracks.impact[:] = np.nan
        return tracks


@tracker_mutant("regions-without-rings", "test_impact_regions_are_nested_and_closed")
class RegionsWithoutRings(WithRegions):
    def changed(self, regions):
        return (evolve(regions[0], polygons=()),)


@tracker_mutant("regions-least-likely-first", "test_impact_regions_are_nested_and_closed")
class RegionsLeastLikelyFirst(WithRegions):
    def changed(self, regions):
        over, repeat = (
            [evolve(region, condition=name) for region in regions]
            for name in ("burn over", "relights")
        )
        return *(evolve(region, probability=0.1) for region in over), *(
            evolve(region, probability=0.8) for region in repeat
        )


@tracker_mutant("regions-of-no-condition", "test_impact_regions_are_nested_and_closed")
class RegionsOfNoCondition(WithRegions):
    def changed(self, regions):
        return tuple(evolve(region, condition="soon") for region in regions)


class WithConditions(WithRegions):
    """Regions of two conditions, the most probable first."""

    def changed(self, regions):
        over = (evolve(region, condition="burn over", probability=0.8) for region in regions)
        return *over, *(evolve(region, condition="relights", probability=0.1) for region in regions)


tracker_mutant("sound-conditions", "")(WithConditions)


class WithHypotheses(OneTrack):
    """One track with valid probabilities of hypotheses, which `changed` spoils."""

    def __init__(self, hypotheses):
        super().__init__()
        self.hypotheses = hypotheses

    def tracks(self, tick_s, number):
        chances = np.full((len(number), len(self.hypotheses)), 1.0 / len(self.hypotheses))
        weighed = {"hypothesis_probability": chances, **hypothesis_sums(chances, self.hypotheses)}
        return evolve(super().tracks(tick_s, number), **self.changed(weighed))

    def changed(self, weighed):
        return weighed


def weighing_mutant(name, caught_by):
    """Offer a tracker of a class of its own that is built of the context's hypotheses."""

    def offered(tracker):
        mutant(TrackerModel, name, caught_by)(lambda _config, context: tracker(context.hypotheses))
        return tracker

    return offered


weighing_mutant("sound-hypotheses", "")(WithHypotheses)


@weighing_mutant("more-than-everything", "test_shapes_and_positions_are_valid")
class MoreThanEverything(WithHypotheses):
    def changed(self, weighed):
        return {name: 1.1 * column for name, column in weighed.items()}


@weighing_mutant("forgets-none-of-these", "test_shapes_and_positions_are_valid")
class ForgetsNoneOfThese(WithHypotheses):
    def changed(self, weighed):
        chances = weighed["hypothesis_probability"][:, :-1]
        return weighed | {"hypothesis_probability": chances / chances.sum(axis=1, keepdims=True)}


@weighing_mutant("launches-without-orbits", "test_shapes_and_positions_are_valid")
class LaunchesWithoutOrbits(WithHypotheses):
    def changed(self, weighed):
        return weighed | {"probability_launch": weighed["probability_missile"]}


@tracker_mutant("remembers-all", "test_work_grows_linearly_with_detections")
class RemembersAll(OneTrack):
    def __init__(self):
        super().__init__(1.0)
        self.times = []

    def step(self, tick_s, detections):
        self.times += detections.time_ns.tolist()
        [abs(time_ns - other_ns) for time_ns in self.times for other_ns in self.times[-4:]]
        return super().step(tick_s, detections)


@tracker_mutant("shared-memory", "test_the_same_seed_gives_the_same_bytes")
class SharedMemory(OneTrack):
    everywhere: set[int] = set()  # noqa: RUF012 - the fault

    def __init__(self):
        super().__init__(5.0)
        self.seen = SharedMemory.everywhere


@tracker_mutant("sees-ghosts", "test_ticks_without_detections_are_accepted")
class SeesGhosts(OneTrack):
    def step(self, tick_s, detections):
        self.seen.add(0)
        return super().step(tick_s, detections)


@tracker_mutant("stands-still", "test_cadence_is_a_positive_time_or_none")
class StandsStill(OneTrack):
    def __init__(self):
        super().__init__(-1.0)


@tracker_mutant("loses-its-state", "test_a_tracker_pickles_between_ticks")
class LosesItsState(OneTrack):
    def __reduce__(self):
        return (LosesItsState, ())


@tracker_mutant("meddles", "test_associate_has_no_side_effects")
class Meddles(OneTrack):
    def associate(self, detections):
        self.seen ^= {0}
        return super().associate(detections)


@tracker_mutant("starts-over", "test_unchanged_sensors_change_nothing")
class StartsOver(OneTrack):
    def set_sensors(self, _sensors):
        self.count = 0


@tracker_mutant("in-km", "test_positions_are_above_the_ground_and_near_the_lines_of_sight")
class InKm(OneTrack):
    def state_of(self, track):
        return [value / 1000.0 for value in super().state_of(track)]


@tracker_mutant("other-axes", "test_positions_are_above_the_ground_and_near_the_lines_of_sight")
class OtherAxes(OneTrack):
    def state_of(self, track):
        x, y, z, *velocity = super().state_of(track)
        return [y, x, z, *velocity]


@tracker_mutant("without-step", "test_build_returns_a_complete_part")
class WithoutStep:
    cadence_s = 1.0

    def associate(self, detections):
        return np.full(len(detections), -1)


class BlindAssociator(Associator):
    """Gives no line to any track."""

    def associate(self, problem):
        nobody = np.full(len(problem.lines), -1)
        none = problem.pairs.take(np.empty(0, dtype=np.int64))
        return Association(lines=problem.lines, owner=nobody, pairs=none)


@mutant(TrackerPart, "blind-associator", "test_targets_are_followed", role="association")
def blind_associator(_config, _context):
    return BlindAssociator()


class ForgetfulAssociator(BlindAssociator):
    """Gives each line to the first track, but for every third call."""

    def __init__(self):
        self.calls = 0

    def associate(self, problem):
        self.calls += 1
        if self.calls % 3 == 0:
            return super().associate(problem)
        pairs = problem.pairs.take(np.unique(problem.pairs.line, return_index=True)[1])
        owner = np.full(len(problem.lines), -1)
        owner[pairs.line] = pairs.track
        return Association(lines=problem.lines, owner=owner, pairs=pairs)


@mutant(
    TrackerPart,
    "forgetful-associator",
    "test_associate_has_no_side_effects",
    role="association",
)
def forgetful_associator(_config, _context):
    return ForgetfulAssociator()
