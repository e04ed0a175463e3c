"""Broken detection models."""

import datetime
import os
import random
import socket
import time
from typing import Any

import numpy as np

from broken_components.offers import mutant
from opir_core.builtin.detection import ConstantDetection, always_detection
from opir_core.plugin import DetectionModel, Measured, Response


class Changed(ConstantDetection):
    """P_d 0.5 for all."""

    surroundings: Any = None

    def pair_probability(self, sensor, target):
        return None

    def probability(self, exposures):
        return np.full(len(exposures), 0.5)


def detection_mutant(name, caught_by):
    """Offer a detection model of a class of its own."""

    def offered(model):
        def build(config, context):
            like = always_detection(config, context)
            mutated = model(
                like.probability_table, like.class_number, like.band_count, 1.0, needs_geometry=True
            )
            mutated.surroundings = context.surroundings
            return mutated

        mutant(DetectionModel, name, caught_by)(build)
        return model

    return offered


detection_mutant("sound-detection", "")(Changed)


@detection_mutant("moody", "test_the_same_seed_gives_the_same_bytes")
class Moody(Changed):
    """Less likely each time it is asked, throughout the process."""

    asked = 0

    def probability(self, exposures):
        Moody.asked += 1
        return np.full(len(exposures), 0.9 / (1.0 + 0.05 * Moody.asked))


@detection_mutant("sown", "test_what_replicates_share_does_not_use_the_seed")
class Sown(Changed):
    """Built from the scene's seed, and says that it is not."""

    def probability(self, exposures):
        return np.full(len(exposures), 0.3 + 0.4 * (self.surroundings.scene.seed % 2))


@detection_mutant("hashed", "test_another_process_and_hash_seed_give_the_same_bytes")
class Hashed(Changed):
    """Depends on how this process hashes text."""

    def probability(self, exposures):
        return np.full(len(exposures), 0.2 + 0.6 * (hash("hashed") % 1009) / 1009.0)


@detection_mutant("by-window", "test_windows_of_any_size_give_the_same_bytes")
class ByWindow(Changed):
    """Depends on the first look of the call."""

    def probability(self, exposures):
        start_s = float(exposures.time_s.min()) if len(exposures) else 0.0
        return np.full(len(exposures), 0.3 + 0.6 * (start_s % 7.0) / 7.0)


@detection_mutant("by-mean", "test_probabilities_are_independent")
class ByMean(Changed):
    """Looks are compared with the mean of those asked about with them."""

    def probability(self, exposures):
        return np.where(exposures.range_m < np.mean(exposures.range_m), 0.7, 0.3)


@detection_mutant("by-number", "test_targets_in_any_order_give_the_same_events")
class ByNumber(Changed):
    """Targets are distinguished by their place in the scene."""

    def probability(self, exposures):
        return 0.2 + 0.15 * exposures.target


@detection_mutant("by-crowd", "test_results_of_others_do_not_change")
class ByCrowd(Changed):
    """Less likely the more targets there are."""

    def probability(self, exposures):
        return np.full(len(exposures), 1.0 / len(self.class_number))


@detection_mutant("beyond-certain", "test_probabilities_lie_in_the_unit_interval")
class BeyondCertain(Changed):
    """Rounding takes it over 1."""

    def probability(self, exposures):
        return np.full(len(exposures), 1.0 + 1e-9)


@detection_mutant("two-minds", "test_pairs_and_looks_agree")
class TwoMinds(Changed):
    """Says one thing of pairs and another of looks."""

    def pair_probability(self, sensor, target):
        return np.full(len(sensor), 0.4)


@detection_mutant("needs-what-it-denies", "test_geometry_is_declared_if_it_is_used")
class NeedsWhatItDenies(Changed):
    """Reads geometry and says it needs none."""

    @property
    def needs_geometry(self):
        return False

    @needs_geometry.setter
    def needs_geometry(self, _value):
        pass

    def probability(self, exposures):
        return np.clip(1.0 - exposures.range_m / 1e9, 0.0, 1.0)


@detection_mutant("bandless", "test_confirming_bands_are_the_sensors_bands")
class Bandless(Changed):
    """No band confirms."""

    def measure(self, exposures, rng):
        return Measured(np.zeros(len(exposures), dtype=np.uint8), np.full(len(exposures), np.nan))


@detection_mutant("snr-by-rank", "test_measurements_are_independent")
class SnrByRank(Changed):
    """The SNR is the place in the call."""

    def measure(self, exposures, rng):
        return Measured(
            np.ones(len(exposures), dtype=np.uint8), np.arange(len(exposures), dtype=np.float64)
        )


@detection_mutant("draws-again", "test_reserved_random_streams_are_not_used")
class DrawsAgain(Changed):
    """The SNR is drawn from the numbers that decided the detection."""

    def measure(self, exposures, rng):
        return Measured(np.ones(len(exposures), dtype=np.uint8), rng.uniforms("detection")[:, 0])


@detection_mutant("tired", "test_detections_occur_at_the_stated_rate")
class Tired(Changed):
    """Every second call is answered with half of what the others are."""

    rested = False

    def probability(self, exposures):
        Tired.rested = not Tired.rested
        return np.full(len(exposures), 0.5 if Tired.rested else 0.25)


@detection_mutant("promises-noise", "test_optional_abilities_are_complete")
class PromisesNoise(Changed):
    """States a rate of false alarms and has no measurements of them."""

    @property
    def rate_per_scan(self):
        return np.full(len(self.band_count), 0.1)


@detection_mutant("noise-of-targets", "test_false_alarms_occur_at_the_stated_rate")
class NoiseOfTargets(Changed):
    """Its rate of false alarms depends on the number of targets."""

    words = 1

    @property
    def rate_per_scan(self):
        return np.full(len(self.band_count), 0.1 * len(self.class_number))

    def measure_noise(self, sensor, uniforms):
        return Measured(np.ones(len(sensor), dtype=np.uint8), np.full(len(sensor), 5.0))


@detection_mutant("other-response", "test_expected_measurements_agree_with_probabilities")
class OtherResponse(Changed):
    """Its quantiles are not those of its probabilities."""

    probability_tolerance = None

    def response(self, exposures, *, slack=0.0):
        ones = np.ones((len(exposures), 1))
        return Response(ones[:, 0], ones, ones)

    def measure_response(self, response, sensor, rng, probability=None):
        return Measured(np.ones(len(sensor), dtype=np.uint8), response.snr[:, 0])


@detection_mutant("look-by-look", "test_looks_are_computed_as_arrays")
class LookByLook(Changed):
    """A loop over looks."""

    def probability(self, exposures):
        return np.array([0.5 if range_m > 0.0 else 0.0 for range_m in exposures.range_m.tolist()])


@detection_mutant("clock-watcher", "test_clock_network_and_global_random_state_are_not_used")
class ClockWatcher(Changed):
    """Looks at the clock, and makes nothing of it."""

    def probability(self, exposures):
        time.time()
        return super().probability(exposures)


@detection_mutant("date-watcher", "test_clock_network_and_global_random_state_are_not_used")
class DateWatcher(Changed):
    """Looks at the date."""

    def probability(self, exposures):
        datetime.datetime.now(tz=datetime.UTC)
        return super().probability(exposures)


@detection_mutant("global-rng", "test_clock_network_and_global_random_state_are_not_used")
class GlobalDice(Changed):
    """Draws from numpy's global generator."""

    def probability(self, exposures):
        np.random.random()  # noqa: NPY002 - the fault
        return super().probability(exposures)


@detection_mutant("seeds-the-world", "test_clock_network_and_global_random_state_are_not_used")
class SeedsTheWorld(Changed):
    """Seeds Python's global generator."""

    def probability(self, exposures):
        random.seed(1)
        return super().probability(exposures)


@detection_mutant("entropy", "test_clock_network_and_global_random_state_are_not_used")
class Entropy(Changed):
    """Asks for entropy."""

    def probability(self, exposures):
        os.urandom(1)
        return super().probability(exposures)


@detection_mutant("phones-home", "test_clock_network_and_global_random_state_are_not_used")
class PhonesHome(Changed):
    """Opens a socket."""

    def probability(self, exposures):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
            line.getsockname()
        return super().probability(exposures)


@detection_mutant("afraid-of-the-empty", "test_a_scene_without_targets_runs")
class AfraidOfTheEmpty(Changed):
    """Fails where there is nothing to see."""

    def pair_probability(self, sensor, target):
        int(np.min(np.asarray(self.type_code)))


@detection_mutant("infinitely-clear", "test_columns_are_valid_at_pole_antimeridian_and_far_side")
class InfinitelyClear(Changed):
    """An infinite SNR, over the pole."""

    def measure(self, exposures, rng):
        over = np.abs(exposures.target_ecef_m[:, 2]) > 6.3e6
        return Measured(np.ones(len(exposures), dtype=np.uint8), np.where(over, np.inf, 5.0))


@detection_mutant("keeps-a-lock", "test_a_built_model_pickles")
class KeepsALock(Changed):
    """Holds what cannot be pickled."""

    def __reduce__(self):
        raise TypeError("cannot pickle a lock")
