"""Broken components, each with one fault that the contract of its kind is to find."""

import datetime
import json
import os
import random
import socket
import time
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_core.builtin.classification import ConfusionClassifier, confusion_classifier, weighted_confidence
from opir_core.builtin.configs import BallisticConfig, ConfusionConfig, WeightedConfig
from opir_core.builtin.detection import ConstantDetection, always_detection
from opir_core.builtin.scanner import ScannerConfig
from opir_core.builtin.targets import ballistic_targets
from opir_core.interfaces.optional import Response
from opir_core.interfaces.protocols import Band, Delivery, Measured, RandomDraws
from opir_core.interfaces.records import ClassifierInputs, Detections, Exposures, Tracks, Window
from opir_core.output.events.forge import ForgeEncoder
from opir_core.plugin import (
    ClassifierModel,
    ConfidenceModel,
    DetectionModel,
    EventEncoder,
    SensorModel,
    SinkModel,
    TargetModel,
    TrackerModel,
    hookimpl,
    scanning_sensor,
)
from opir_core.testing.doubles import stub_regions

#: The contract test that is to find each mutant: (kind, name) to the test's name.
CAUGHT_BY: dict[tuple[str, str], str] = {}
_MADE: dict[str, list[Any]] = {}


def mutant(kind: type[Any], name: str, caught_by: str, config: type | None = None) -> Callable[[Any], Any]:
    """Offer what is decorated as `build` of a component, which a test is to catch."""

    def offered(build: Any) -> Any:
        CAUGHT_BY[kind.hook, name] = caught_by
        settings = {} if config is None else {"config": config}
        _MADE.setdefault(kind.hook, []).append(kind(name=name, summary=f"mutant: {name}", build=build, **settings))
        return build

    return offered


# Sensors.


def sensor_mutant(name: str, caught_by: str, config: type = ScannerConfig) -> Callable[[Any], Any]:
    """Offer a sensor made of the bench's by a change to it."""

    def offered(change: Callable[[Any], Any]) -> Any:
        def build(settings: Any, context: Any) -> Any:
            return change(scanning_sensor(settings, context, type="MUTANT"))

        return mutant(SensorModel, name, caught_by, config)(build)

    return offered


@frozen
class OwnScan:
    """The bench's scan with another phase."""

    scan: Any
    change: Callable[[Any, int], Any]

    @property
    def period_ns(self) -> int:
        return int(self.scan.period_ns)

    def phase_ns(self, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, uniform: float) -> Any:
        return self.change(self.scan.phase_ns(sensor_ecef_m, target_ecef_m, uniform), self.scan.period_ns)


def beyond(phase: Any, period_ns: int) -> Any:
    return phase + period_ns


def by_rank(phase: Any, period_ns: int) -> Any:
    return (phase + np.arange(len(phase))) % period_ns


@sensor_mutant("phase-beyond-period", "test_phases_lie_in_the_period")
def _phase_beyond(sensor: Any) -> Any:
    return evolve(sensor, scan=OwnScan(sensor.scan, beyond))


@sensor_mutant("phase-by-rank", "test_phases_are_independent")
def _phase_by_rank(sensor: Any) -> Any:
    return evolve(sensor, scan=OwnScan(sensor.scan, by_rank))


@frozen
class FractionalScan:
    """A period that is no whole number."""

    scan: Any
    period_ns: float = 5e8

    def phase_ns(self, *where: Any) -> Any:
        return self.scan.phase_ns(*where)


@sensor_mutant("period-of-fractions", "test_looks_are_whole_periods_apart")
def _period_of_fractions(sensor: Any) -> Any:
    return evolve(sensor, scan=FractionalScan(sensor.scan))


@frozen
class OwnOrbit:
    """An orbit made of another by a change to its positions."""

    orbit: Any
    change: Callable[[FloatArray, FloatArray], FloatArray]
    is_stationary: bool

    def position_ecef_m(self, time_s: FloatArray) -> FloatArray:
        return self.change(self.orbit.position_ecef_m(time_s), time_s)


def in_km(place: FloatArray, _time_s: FloatArray) -> FloatArray:
    return place / 1000.0


def drifting(place: FloatArray, time_s: FloatArray) -> FloatArray:
    return place + time_s[:, None]


def centred(place: FloatArray, time_s: FloatArray) -> FloatArray:
    return place + (time_s - np.sum(time_s) / max(len(time_s), 1))[:, None]


@sensor_mutant("orbit-in-km", "test_orbit_is_above_the_ground_and_smooth")
def _orbit_in_km(sensor: Any) -> Any:
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, in_km, True))


@sensor_mutant("stationary-that-drifts", "test_a_stationary_orbit_does_not_move")
def _stationary_that_drifts(sensor: Any) -> Any:
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, drifting, True))


@sensor_mutant("orbit-by-batch", "test_positions_are_independent")
def _orbit_by_batch(sensor: Any) -> Any:
    return evolve(sensor, orbit=OwnOrbit(sensor.orbit, centred, False))


@sensor_mutant("bands-upside-down", "test_fields_are_valid")
def _bands_upside_down(sensor: Any) -> Any:
    return evolve(sensor, bands=(Band("SWIR", 2.9, 2.5),))


@sensor_mutant("settings-of-arrays", "test_settings_are_plain_values")
def _settings_of_arrays(sensor: Any) -> Any:
    return evolve(sensor, settings={"edges": np.zeros(2)})


@sensor_mutant("sensor-of-lambdas", "test_a_built_sensor_pickles")
def _sensor_of_lambdas(sensor: Any) -> Any:
    return evolve(sensor, scan=OwnScan(sensor.scan, lambda phase, period_ns: phase))


@frozen(kw_only=True)
class MuteConfig(ScannerConfig):
    """A configuration with a field that says nothing of itself."""

    gain: float = 1.0


@sensor_mutant("mute-setting", "test_every_setting_is_documented", MuteConfig)
def _mute_setting(sensor: Any) -> Any:
    return sensor


# Detection models.


class Changed(ConstantDetection):
    """P_d 0.5 for all."""

    def pair_probability(self, sensor: Any, target: Any) -> Any:
        return None

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.full(len(exposures), 0.5)


def detection_mutant(name: str, caught_by: str) -> Callable[[type[Changed]], Any]:
    """Offer a detection model of a class of its own."""

    def offered(made: type[Changed]) -> Any:
        def build(config: Any, context: Any) -> Any:
            like = always_detection(config, context)
            return made(like.probability_table, like.class_number, like.band_count, 1.0, needs_geometry=True)

        mutant(DetectionModel, name, caught_by)(build)
        return made

    return offered


@detection_mutant("moody", "test_the_same_seed_gives_the_same_bytes")
class Moody(Changed):
    """Less likely each time it is asked, throughout the process."""

    asked = 0

    def probability(self, exposures: Exposures) -> FloatArray:
        Moody.asked += 1
        return np.full(len(exposures), 0.9 / (1.0 + 0.05 * Moody.asked))


@detection_mutant("hashed", "test_another_process_and_hash_seed_give_the_same_bytes")
class Hashed(Changed):
    """Depends on how this process hashes text."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.full(len(exposures), 0.2 + 0.6 * (hash("hashed") % 1009) / 1009.0)


@detection_mutant("by-window", "test_windows_of_any_size_give_the_same_bytes")
class ByWindow(Changed):
    """Depends on the first look of the call."""

    def probability(self, exposures: Exposures) -> FloatArray:
        first = float(exposures.time_s.min()) if len(exposures) else 0.0
        return np.full(len(exposures), 0.3 + 0.6 * (first % 7.0) / 7.0)


@detection_mutant("by-mean", "test_probabilities_are_independent")
class ByMean(Changed):
    """Looks are compared with the mean of those asked about with them."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.where(exposures.range_m < np.mean(exposures.range_m), 0.7, 0.3)


@detection_mutant("by-number", "test_targets_in_any_order_give_the_same_events")
class ByNumber(Changed):
    """Targets are told apart by their place in the scene."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return 0.2 + 0.15 * exposures.target


@detection_mutant("by-crowd", "test_results_of_others_do_not_change")
class ByCrowd(Changed):
    """Less likely the more targets there are."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.full(len(exposures), 1.0 / len(self.class_number))


@detection_mutant("beyond-certain", "test_probabilities_lie_in_the_unit_interval")
class BeyondCertain(Changed):
    """Rounding takes it over 1."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.full(len(exposures), 1.0 + 1e-9)


@detection_mutant("two-minds", "test_pairs_and_looks_agree")
class TwoMinds(Changed):
    """Says one thing of pairs and another of looks."""

    def pair_probability(self, sensor: Any, target: Any) -> Any:
        return np.full(len(sensor), 0.4)


@detection_mutant("needs-what-it-denies", "test_geometry_is_declared_if_it_is_used")
class NeedsWhatItDenies(Changed):
    """Reads geometry and says it needs none."""

    @property
    def needs_geometry(self) -> bool:
        return False

    @needs_geometry.setter
    def needs_geometry(self, _value: bool) -> None:
        pass

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.clip(1.0 - exposures.range_m / 1e9, 0.0, 1.0)


@detection_mutant("bandless", "test_confirming_bands_are_the_sensors_bands")
class Bandless(Changed):
    """No band confirms."""

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        return Measured(np.zeros(len(exposures), dtype=np.uint8), np.full(len(exposures), np.nan))


@detection_mutant("snr-by-rank", "test_measurements_are_independent")
class SnrByRank(Changed):
    """The SNR is the place in the call."""

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        return Measured(np.ones(len(exposures), dtype=np.uint8), np.arange(len(exposures), dtype=np.float64))


@detection_mutant("draws-again", "test_reserved_random_streams_are_not_used")
class DrawsAgain(Changed):
    """The SNR is drawn from the numbers that decided the detection."""

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        return Measured(np.ones(len(exposures), dtype=np.uint8), dice.uniforms("detection")[:, 0])


@detection_mutant("tired", "test_detections_occur_at_the_stated_rate")
class Tired(Changed):
    """Every second call is answered with half of what the others are."""

    rested = False

    def probability(self, exposures: Exposures) -> FloatArray:
        Tired.rested = not Tired.rested
        return np.full(len(exposures), 0.5 if Tired.rested else 0.25)


@detection_mutant("promises-noise", "test_optional_abilities_are_complete")
class PromisesNoise(Changed):
    """States a rate of false alarms and has no measurements of them."""

    @property
    def rate_per_scan(self) -> FloatArray:
        return np.full(len(self.band_count), 0.1)


@detection_mutant("noise-of-targets", "test_false_alarms_occur_at_the_stated_rate")
class NoiseOfTargets(Changed):
    """Its rate of false alarms depends on the number of targets."""

    words = 1

    @property
    def rate_per_scan(self) -> FloatArray:
        return np.full(len(self.band_count), 0.1 * len(self.class_number))

    def measure_noise(self, sensor: Any, uniforms: FloatArray) -> Measured:
        return Measured(np.ones(len(sensor), dtype=np.uint8), np.full(len(sensor), 5.0))


@detection_mutant("other-response", "test_expected_measurements_agree_with_probabilities")
class OtherResponse(Changed):
    """Its quantiles are not those of its probabilities."""

    probability_tolerance = None

    def response(self, exposures: Exposures, *, slack: float = 0.0) -> Response:
        ones = np.ones((len(exposures), 1))
        return Response(ones[:, 0], ones, ones)

    def measure_response(self, response: Response, sensor: Any, dice: RandomDraws, probability: Any = None) -> Measured:
        return Measured(np.ones(len(sensor), dtype=np.uint8), response.snr[:, 0])


@detection_mutant("look-by-look", "test_looks_are_computed_as_arrays")
class LookByLook(Changed):
    """A loop over looks."""

    def probability(self, exposures: Exposures) -> FloatArray:
        return np.array([0.5 if range_m > 0.0 else 0.0 for range_m in exposures.range_m.tolist()])


@detection_mutant("clock-watcher", "test_clock_network_and_global_random_state_are_not_used")
class ClockWatcher(Changed):
    """Looks at the clock, and makes nothing of it."""

    def probability(self, exposures: Exposures) -> FloatArray:
        time.time()
        return super().probability(exposures)


@detection_mutant("date-watcher", "test_clock_network_and_global_random_state_are_not_used")
class DateWatcher(Changed):
    """Looks at the date."""

    def probability(self, exposures: Exposures) -> FloatArray:
        datetime.datetime.now(tz=datetime.UTC)
        return super().probability(exposures)


@detection_mutant("global-dice", "test_clock_network_and_global_random_state_are_not_used")
class GlobalDice(Changed):
    """Draws from numpy's global generator."""

    def probability(self, exposures: Exposures) -> FloatArray:
        np.random.random()  # noqa: NPY002 - the fault
        return super().probability(exposures)


@detection_mutant("seeds-the-world", "test_clock_network_and_global_random_state_are_not_used")
class SeedsTheWorld(Changed):
    """Seeds Python's global generator."""

    def probability(self, exposures: Exposures) -> FloatArray:
        random.seed(1)
        return super().probability(exposures)


@detection_mutant("entropy", "test_clock_network_and_global_random_state_are_not_used")
class Entropy(Changed):
    """Asks for entropy."""

    def probability(self, exposures: Exposures) -> FloatArray:
        os.urandom(1)
        return super().probability(exposures)


@detection_mutant("phones-home", "test_clock_network_and_global_random_state_are_not_used")
class PhonesHome(Changed):
    """Opens a socket."""

    def probability(self, exposures: Exposures) -> FloatArray:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.getsockname()
        return super().probability(exposures)


@detection_mutant("afraid-of-the-empty", "test_a_scene_without_targets_runs")
class AfraidOfTheEmpty(Changed):
    """Fails where there is nothing to see."""

    def pair_probability(self, sensor: Any, target: Any) -> Any:
        int(np.min(np.asarray(self.type_code)))


@detection_mutant("infinitely-clear", "test_columns_are_valid_at_pole_antimeridian_and_far_side")
class InfinitelyClear(Changed):
    """An infinite SNR, over the pole."""

    def measure(self, exposures: Exposures, dice: RandomDraws) -> Measured:
        over = np.abs(exposures.target_ecef_m[:, 2]) > 6.3e6
        return Measured(np.ones(len(exposures), dtype=np.uint8), np.where(over, np.inf, 5.0))


@detection_mutant("keeps-a-lock", "test_a_built_model_pickles")
class KeepsALock(Changed):
    """Holds what cannot be pickled."""

    def __reduce__(self) -> Any:
        raise TypeError("cannot pickle a lock")


# Confidence models and classifiers.


@frozen
class OwnConfidence:
    """The built-in confidence, changed."""

    change: Callable[[FloatArray, ClassifierInputs], FloatArray]
    model: Any

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        return self.change(self.model.confidence(sightings), sightings)


def confidence_mutant(name: str, caught_by: str) -> Callable[[Any], Any]:
    """Offer a confidence model made of the built-in one."""

    def offered(change: Any) -> Any:
        def build(config: Any, context: Any) -> Any:
            return OwnConfidence(change, weighted_confidence(config, context))

        mutant(ConfidenceModel, name, caught_by, WeightedConfig)(build)
        return change

    return offered


@confidence_mutant("certain-by-rank", "test_confidences_are_independent")
def certain_by_rank(confidence: FloatArray, _sightings: ClassifierInputs) -> FloatArray:
    return np.linspace(0.0, 1.0, len(confidence))


@confidence_mutant("snr-for-granted", "test_confidences_lie_in_the_unit_interval")
def snr_for_granted(confidence: FloatArray, sightings: ClassifierInputs) -> FloatArray:
    return np.clip(confidence * sightings.snr, 0.0, 1.0)


@confidence_mutant("one-by-one", "test_detections_are_computed_as_arrays")
def one_by_one(confidence: FloatArray, _sightings: ClassifierInputs) -> FloatArray:
    return np.array([min(value, 1.0) for value in confidence.tolist()])


@confidence_mutant("writes-to-its-input", "test_confidences_lie_in_the_unit_interval")
def writes_to_its_input(confidence: FloatArray, sightings: ClassifierInputs) -> FloatArray:
    sightings.snr[:] = 0.0
    return confidence


class UnknownCodes(ConfusionClassifier):
    """Codes of types that do not exist."""

    def pair_type(self, sensor: Any, target: Any, dice: RandomDraws) -> Any:
        return np.full(len(sensor), 9, dtype=np.uint8)


class ThreeStates(ConfusionClassifier):
    """One type for the pair, another for the detection."""

    def reported_type(self, sightings: ClassifierInputs, dice: RandomDraws) -> Any:
        return (super().reported_type(sightings, dice) + 1) % 4


def classifier_build(made: type[ConfusionClassifier]) -> Callable[..., Any]:
    def build(config: Any, context: Any) -> Any:
        like: Any = confusion_classifier(config, context)
        return made(like.thresholds, like.class_number, like.classes)

    return build


mutant(ClassifierModel, "unknown-codes", "test_codes_are_reported_types", ConfusionConfig)(
    classifier_build(UnknownCodes)
)
mutant(ClassifierModel, "three-states", "test_pairs_and_detections_agree", ConfusionConfig)(
    classifier_build(ThreeStates)
)


class SureOfAll(ConfusionClassifier):
    """Type probabilities that sum to 4."""

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        return np.zeros((len(sightings), 4))

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        return log_posterior

    def reported(self, log_posterior: FloatArray) -> Any:
        return np.zeros(len(log_posterior), dtype=np.uint8)


mutant(ClassifierModel, "sure-of-all-types", "test_type_probabilities_agree_with_types", ConfusionConfig)(
    classifier_build(SureOfAll)
)


class HalfPosterior(ConfusionClassifier):
    """Has posteriors, and nothing that reports them."""

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        return np.full((len(sightings), 4), np.log(0.25))


mutant(ClassifierModel, "half-posterior", "test_optional_abilities_are_complete", ConfusionConfig)(
    classifier_build(HalfPosterior)
)


# Trackers.


class OneTrack:
    """One track a sensor, at a fixed place: lawful, if of little use."""

    def __init__(self, cadence_s: float | None = 5.0) -> None:
        self.cadence_s = cadence_s
        self.seen: set[int] = set()
        self.count = 0

    def associate(self, detections: Detections) -> Any:
        known = np.array(sorted(self.seen), dtype=np.int64)
        return np.where(np.isin(detections.sensor, known), detections.sensor, -1).astype(np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        self.seen |= set(detections.sensor.tolist())
        self.count += len(detections)
        return self.tracks(tick_s, np.array(sorted(self.seen), dtype=np.int64))

    def tracks(self, tick_s: float, number: Any) -> Tracks:
        count = len(number)
        return Tracks(
            tick_s=np.full(count, tick_s),
            track=number,
            state=np.tile([6.5e6, float(self.count), 0.0, 0.0, 0.0, 0.0], (count, 1)),
            state_covariance=np.tile(np.diag([1e6, 1e6, 1e6, 1e2, 1e2, 1e2]), (count, 1, 1)),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
            impact=np.full((count, 3), np.nan),
            impact_covariance=np.full((count, 3, 3), np.nan),
            type_probability=np.full((count, 4), 0.25),
        )


def tracker_mutant(name: str, caught_by: str) -> Callable[[Any], Any]:
    """Offer a tracker of a class of its own."""

    def offered(made: Any) -> Any:
        mutant(TrackerModel, name, caught_by)(lambda _config, _context: made())
        return made

    return offered


#: What the mutants of trackers and detection models are made of; nothing is to be found in these.
SOUND = {("opir_trackers", "sound-tracker"), ("opir_detection_models", "sound-detection")}

tracker_mutant("sound-tracker", "")(OneTrack)
detection_mutant("sound-detection", "")(Changed)


@tracker_mutant("foresees", "test_associations_are_to_existing_tracks")
class Foresees(OneTrack):
    def associate(self, detections: Detections) -> Any:
        return detections.sensor.astype(np.int64)


@tracker_mutant("learns-while-asked", "test_associate_has_no_side_effects")
class LearnsWhileAsked(OneTrack):
    def associate(self, detections: Detections) -> Any:
        answer = super().associate(detections)
        self.seen |= set(detections.sensor.tolist())
        return answer


@tracker_mutant("first-come", "test_associations_are_independent")
class FirstCome(OneTrack):
    def associate(self, detections: Detections) -> Any:
        answer = super().associate(detections)
        answer[1:] = -1
        return answer


@tracker_mutant("reads-counts", "test_only_measured_columns_are_used")
class ReadsCounts(OneTrack):
    def step(self, tick_s: float, detections: Detections) -> Tracks:
        self.count += int(detections.detection_count.sum())
        return super().step(tick_s, detections)


@tracker_mutant("unsorted", "test_tracks_of_a_tick_are_sorted")
class Unsorted(OneTrack):
    def step(self, tick_s: float, detections: Detections) -> Tracks:
        return super().step(tick_s, detections).take(slice(None, None, -1))


@tracker_mutant("lopsided", "test_covariances_are_symmetric_and_positive_definite")
class Lopsided(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.state_covariance[:, 0, 1] = 1e3
        return tracks


@tracker_mutant("overconfident", "test_covariances_are_symmetric_and_positive_definite")
class Overconfident(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.state_covariance[:, 0, 1] = tracks.state_covariance[:, 1, 0] = 1.1e6
        return tracks


@tracker_mutant("in-degrees", "test_shapes_and_positions_are_valid")
class InDegrees(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.launch[:] = [34.7, -120.6, 0.0]
        return tracks


@tracker_mutant("sure-of-all", "test_shapes_and_positions_are_valid")
class SureOfAll(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.type_probability[:] = 1.0
        return tracks


@tracker_mutant("holds-less-farther-out", "test_shapes_and_positions_are_valid")
class HoldsLessFartherOut(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.state_sigmas[:] = [2.3, 3.6, 3.3]
        return tracks


@tracker_mutant("burns-for-sure", "test_shapes_and_positions_are_valid")
class BurnsForSure(OneTrack):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.probability_burning[:] = 1.5
        return tracks


class WithRegions(OneTrack):
    """One track with valid regions, which `changed` spoils."""

    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.impact[:] = [0.1, 0.2, 900.0]
        for row in range(len(tracks)):
            tracks.impact_regions[row] = self.changed(list(stub_regions(5.7, 11.5)))
        return tracks

    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return tuple(regions)


tracker_mutant("sound-regions", "")(WithRegions)
SOUND.add(("opir_trackers", "sound-regions"))


@tracker_mutant("regions-shrink", "test_impact_regions_are_nested_and_closed")
class RegionsShrink(WithRegions):
    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return evolve(regions[0], area_km2=1e6), *regions[1:]


@tracker_mutant("regions-twice", "test_impact_regions_are_nested_and_closed")
class RegionsTwice(WithRegions):
    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return regions[0], *regions


@tracker_mutant("regions-open", "test_impact_regions_are_nested_and_closed")
class RegionsOpen(WithRegions):
    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return (evolve(regions[0], polygons=((regions[0].polygons[0][0][:-1],),)),)


@tracker_mutant("regions-in-degrees", "test_impact_regions_are_nested_and_closed")
class RegionsInDegrees(WithRegions):
    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return (evolve(regions[0], polygons=((np.degrees(regions[0].polygons[0][0]),),)),)


@tracker_mutant("regions-without-impact", "test_impact_regions_are_nested_and_closed")
class RegionsWithoutImpact(WithRegions):
    def tracks(self, tick_s: float, number: Any) -> Tracks:
        tracks = super().tracks(tick_s, number)
        tracks.impact[:] = np.nan
        return tracks


@tracker_mutant("regions-without-rings", "test_impact_regions_are_nested_and_closed")
class RegionsWithoutRings(WithRegions):
    def changed(self, regions: list[Any]) -> tuple[Any, ...]:
        return (evolve(regions[0], polygons=()),)


@tracker_mutant("remembers-all", "test_work_grows_linearly_with_detections")
class RemembersAll(OneTrack):
    def __init__(self) -> None:
        super().__init__(1.0)
        self.times: list[int] = []

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        self.times += detections.time_ns.tolist()
        [abs(time_ns - other_ns) for time_ns in self.times for other_ns in self.times[-4:]]
        return super().step(tick_s, detections)


@tracker_mutant("shared-memory", "test_the_same_seed_gives_the_same_bytes")
class SharedMemory(OneTrack):
    everywhere: set[int] = set()  # noqa: RUF012 - the fault

    def __init__(self) -> None:
        super().__init__(5.0)
        self.seen = SharedMemory.everywhere


@tracker_mutant("sees-ghosts", "test_ticks_without_detections_are_accepted")
class SeesGhosts(OneTrack):
    def step(self, tick_s: float, detections: Detections) -> Tracks:
        self.seen.add(0)
        return super().step(tick_s, detections)


@tracker_mutant("stands-still", "test_cadence_is_a_positive_time_or_none")
class StandsStill(OneTrack):
    def __init__(self) -> None:
        super().__init__(-1.0)


@tracker_mutant("loses-its-state", "test_a_tracker_pickles_between_ticks")
class LosesItsState(OneTrack):
    def __reduce__(self) -> Any:
        return (LosesItsState, ())


@tracker_mutant("meddles", "test_associate_has_no_side_effects")
class Meddles(OneTrack):
    def associate(self, detections: Detections) -> Any:
        self.seen ^= {0}
        return super().associate(detections)


@tracker_mutant("starts-over", "test_unchanged_sensors_change_nothing")
class StartsOver(OneTrack):
    def set_sensors(self, _sensors: Any) -> None:
        self.count = 0


# Targets.


@frozen(eq=False)
class OwnTargets:
    """The built-in targets with other positions."""

    made: Any
    change: Callable[[Any, FloatArray, Any, FloatArray], FloatArray]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__getattribute__("made"), name)

    def __reduce__(self) -> Any:
        return (OwnTargets, (self.made, self.change))

    def position_ecef_m(self, target: Any, time_s: FloatArray) -> FloatArray:
        return self.change(self.made, self.made.position_ecef_m(target, time_s), target, time_s)

    def truth(self) -> Any:
        return self.made.truth()


def target_mutant(name: str, caught_by: str) -> Callable[[Any], Any]:
    """Offer a target model made of the built-in one."""

    def offered(change: Any) -> Any:
        def build(configs: Any, context: Any) -> Any:
            return OwnTargets(ballistic_targets(configs, context), change)

        mutant(TargetModel, name, caught_by, BallisticConfig)(build)
        return change

    return offered


@target_mutant("burns-for-ever", "test_positions_are_finite_during_the_burn_only")
def burns_for_ever(made: Any, _place: Any, target: Any, time_s: FloatArray) -> FloatArray:
    return made.position_ecef_m(target, np.clip(time_s, made.ignition_s[target], made.burnout_s[target]))


@target_mutant("jumps", "test_paths_are_above_the_ground_and_smooth")
def jumps(made: Any, place: Any, target: Any, time_s: FloatArray) -> FloatArray:
    return place + np.where(time_s - made.ignition_s[target] > 30.0, 5e4, 0.0)[:, None]


@target_mutant("led-astray", "test_free_flight_extends_to_end_s_and_burns_do_not_change")
def led_astray(made: Any, place: Any, _target: Any, _time_s: FloatArray) -> FloatArray:
    return place if made.coast is None else place + 1.0


@target_mutant("swarm", "test_positions_are_independent")
def swarm(_made: Any, place: Any, _target: Any, _time_s: FloatArray) -> FloatArray:
    return place + 1e-3 * (place - np.nanmean(place, axis=0)) if len(place) else place


@target_mutant("flies-by-number", "test_targets_are_independent")
def flies_by_number(_made: Any, place: Any, target: Any, _time_s: FloatArray) -> FloatArray:
    return place + 10.0 * target[:, None]


@frozen(eq=False)
class BurnsTwice(OwnTargets):
    """Targets with a second burn that ends after burnout."""

    @property
    def burns_s(self) -> FloatArray:
        one = np.stack([self.ignition_s, self.burnout_s], axis=-1)
        return np.stack([one, one + 1e3], axis=1)


@mutant(TargetModel, "burns-twice", "test_burns_are_in_order_from_ignition_to_burnout", BallisticConfig)
def burns_twice(configs: Any, context: Any) -> Any:
    return BurnsTwice(ballistic_targets(configs, context), lambda _made, place, _target, _time_s: place)


# Encoders and sinks.


class OwnEncoder(ForgeEncoder):
    """The built-in encoder, changed."""


def encoder_mutant(name: str, caught_by: str) -> Callable[[Any], Any]:
    """Offer an encoder of a class of its own."""

    def offered(made: Any) -> Any:
        mutant(EventEncoder, name, caught_by)(lambda _config, context: made(context))
        return made

    return offered


@encoder_mutant("forgets-the-last", "test_each_detection_is_one_line")
class ForgetsTheLast(OwnEncoder):
    def encode(self, window: Window) -> bytes:
        return b"\n".join(super().encode(window).splitlines()[:-1])


@encoder_mutant("numbers-lines", "test_windows_encode_alone_as_together")
class NumbersLines(OwnEncoder):
    content_type = "text/plain"

    def encode(self, window: Window) -> bytes:
        return b"".join(b"%d\n" % number for number in range(len(window.detections)))


@encoder_mutant("tells-the-truth", "test_no_truth_is_written")
class TellsTheTruth(OwnEncoder):
    content_type = "text/plain"

    def encode(self, window: Window) -> bytes:
        return b"".join(b"%r\n" % range_m for range_m in window.truth.range_m.tolist())


@encoder_mutant("nan-in-json", "test_json_follows_the_schema")
class NanInJson(OwnEncoder):
    def encode(self, window: Window) -> bytes:
        return b"".join(json.dumps({"snr": snr}).encode() + b"\n" for snr in window.detections.snr.tolist())


@encoder_mutant("unsaid", "test_media_type_and_schema_version_are_stated")
class Unsaid(OwnEncoder):
    content_type = ""


@encoder_mutant("stamps", "test_clock_network_and_global_random_state_are_not_used")
class Stamps(OwnEncoder):
    def encode(self, window: Window) -> bytes:
        time.time_ns()
        return super().encode(window)


class Counts:
    """A sink that counts, wrongly by `wrong`."""

    wrong = 0

    def __init__(self) -> None:
        self.taken = self.wrong

    def write(self, window: Window) -> None:
        self.taken += len(window.detections)

    def close(self) -> Delivery:
        return Delivery(delivered=self.taken)


def sink_mutant(name: str, caught_by: str) -> Callable[[Any], Any]:
    """Offer a sink of a class of its own."""

    def offered(made: Any) -> Any:
        mutant(SinkModel, name, caught_by)(lambda _config, _context: made())
        return made

    return offered


@sink_mutant("one-too-many", "test_a_sink_without_windows_delivers_nothing")
class OneTooMany(Counts):
    wrong = 1


@sink_mutant("loses-some", "test_every_event_is_accounted_for")
class LosesSome(Counts):
    def write(self, window: Window) -> None:
        self.taken += len(window.detections) - (len(window.detections) > 20)


@sink_mutant("trips-over-nothing", "test_windows_without_events_are_accepted")
class TripsOverNothing(Counts):
    def write(self, window: Window) -> None:
        self.taken += 1 + int(np.argmax(window.detections.time_ns)) if len(window.detections) == 3 else 0
        window.detections.time_ns[0]


@sink_mutant("scribbles", "test_windows_are_not_modified")
class Scribbles(Counts):
    def write(self, window: Window) -> None:
        super().write(window)
        window.detections.confidence.flags.writeable = True
        window.detections.confidence[:] = 0.0


@sink_mutant("knows-no-tracks", "test_edge_case_windows_are_accepted")
class KnowsNoTracks(Counts):
    def write(self, window: Window) -> None:
        self.taken += int(np.sum(window.detections.track < 0))


@sink_mutant("runs-ahead", "test_every_event_is_accounted_for")
class RunsAhead(Counts):
    def delivery_so_far(self) -> Delivery:
        return Delivery(delivered=self.taken + 1)


@sink_mutant("half-buffered", "test_optional_abilities_are_complete")
class HalfBuffered(Counts):
    waits = 0


def offered(hook: str) -> Iterable[Any]:
    return _MADE.get(hook, [])


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    return offered("opir_sensor_models")


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    return offered("opir_detection_models")


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    return offered("opir_confidence_models")


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    return offered("opir_classifiers")


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    return offered("opir_trackers")


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    return offered("opir_target_models")


@hookimpl
def opir_event_encoders() -> Iterable[EventEncoder]:
    return offered("opir_event_encoders")


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    return offered("opir_sinks")
