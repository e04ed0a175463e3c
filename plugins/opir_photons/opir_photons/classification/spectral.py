"""The classifier `spectral`: type posteriors from measured band intensities; see docs/explanation/classification.md."""

from typing import Any, NamedTuple

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import ModelError
from opir_core.plugin import TARGET_TYPES, Classifier, ClassifierInputs, ModelContext, RandomDraws, Sensor
from opir_core.scene import UNKNOWN_TYPE
from opir_photons.classification.configs import SpectralConfig
from opir_photons.classification.false_sources import least_log_odds, source_detections
from opir_photons.classification.gaussian_mixture import log_shares, log_sum
from opir_photons.classification.type_densities import (
    TypeDensities,
    canonical_radius_m,
    elevation_bin,
    looks_by_radius,
    type_densities,
)
from opir_photons.detection.snr import SnrDetection

#: Rows classified at once.
_ROWS = 512

#: Counts are whole numbers from 1 on; their densities begin half a step below.
_LEAST_COUNT = 0.5

#: Probability that a detection count is uninformative (another object, a gap in visibility).
_UNINFORMATIVE = 0.01


class TypeEvidence(NamedTuple):
    """Of detections (n,): ln of the odds of a missile, and ln P(type | missile) (n, 3)."""

    log_odds: FloatArray
    log_type: FloatArray


@frozen(eq=False)
class SpectralClassifier(Classifier):
    """Bayes' rule with densities from synthetic launches and hot sources; sensor k has `banks[bank_of_sensor[k]]`.

    `log_prior` (types,) are logarithms of the shares of launches; `least_log_odds` is the limit below which UNKNOWN is
    reported.
    """

    banks: tuple[TypeDensities, ...]
    bank_of_sensor: IntArray
    log_prior: FloatArray
    confidence: float
    least_log_odds: float

    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> NDArray[np.uint8]:
        """Return codes (n,) into `REPORTED_TYPES`; no random numbers are drawn."""
        return self.reported(self.log_posterior(sightings))

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        """Return ln P (n, 4) over `REPORTED_TYPES`; UNKNOWN is anything but a missile."""
        evidence = self.evidence(sightings)
        missile, other = -np.logaddexp(0.0, -evidence.log_odds), -np.logaddexp(0.0, evidence.log_odds)
        return np.concatenate([evidence.log_type + missile[:, None], other[:, None]], axis=1)

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors (n, 4) with the prior replaced by those of tracks, (n, 4); nan rows change nothing."""
        with np.errstate(divide="ignore"):
            turned = np.log(type_probability[:, :UNKNOWN_TYPE]) - self.log_prior
        split = log_posterior[:, :UNKNOWN_TYPE] + turned
        known = np.isfinite(split.max(axis=1))
        plume = log_sum(log_posterior[known, :UNKNOWN_TYPE])
        revised = log_posterior.copy()
        revised[known, :UNKNOWN_TYPE] = log_shares(split[known]) + plume[:, None]
        return revised

    def reported(self, log_posterior: FloatArray) -> NDArray[np.uint8]:
        """Return codes (n,): the most probable type if it and the plume are probable enough, else UNKNOWN."""
        best = np.argmax(log_posterior[:, :UNKNOWN_TYPE], axis=1).astype(np.uint8)
        chance = np.exp(np.take_along_axis(log_posterior, best[:, None].astype(np.int64), axis=1)[:, 0])
        is_reported = (chance >= self.confidence) & (self.log_odds(log_posterior) >= self.least_log_odds)
        return np.where(is_reported, best, np.uint8(UNKNOWN_TYPE))

    def log_odds(self, log_posterior: FloatArray) -> FloatArray:
        """Return ln of the odds (n,) of a missile over anything else, of posteriors (n, 4)."""
        return log_sum(log_posterior[:, :UNKNOWN_TYPE]) - log_posterior[:, UNKNOWN_TYPE]

    def evidence(self, sightings: ClassifierInputs) -> TypeEvidence:
        """Return the evidence of measured intensities and counts, row by row."""
        if sightings.band_noise_w_m2.shape != sightings.band_irradiance_w_m2.shape:
            raise ModelError("the detection model has no noise of its irradiances, which spectral needs")
        odds, split = np.empty(len(sightings)), np.empty((len(sightings), len(TARGET_TYPES)))
        bank = self.bank_of_sensor[sightings.sensor]
        for number in np.unique(bank).tolist():
            rows = np.flatnonzero(bank == number)
            for start in range(0, len(rows), _ROWS):
                block = rows[start : start + _ROWS]
                odds[block], split[block] = _evidence(self.banks[number], sightings, block)
        return TypeEvidence(odds, split)


def _evidence(bank: TypeDensities, seen: ClassifierInputs, rows: IntArray) -> TypeEvidence:
    """Return the evidence of rows of one bank, from apparent intensities: irradiance times range².

    Rates of events with these intensities and this number of detections: the sensor's rate of such events, times the
    density of the intensities given a detection, times the probability of the number.
    """
    place, area = elevation_bin(seen.elevation_sine[rows]), np.square(seen.range_m[rows])[:, None]
    intensity = seen.band_irradiance_w_m2[rows, : bank.width] * area
    variance = np.square(seen.band_noise_w_m2[rows, : bank.width] * area)
    count = seen.detection_count[rows].astype(np.float64)
    density, counted = bank.plumes.log_densities(place, intensity, variance, count, _LEAST_COUNT)
    counted = np.maximum(counted, np.log(_UNINFORMATIVE / bank.most_looks))
    launched = bank.plumes.by_class(density + counted) - bank.log_seen_s[place] + bank.rates.log_type
    other = bank.log_others(place, intensity, variance, count)
    return TypeEvidence(log_sum(launched) - other, log_shares(launched))


def spectral_classifier(config: SpectralConfig, context: ModelContext) -> SpectralClassifier:
    """Return the classifier `spectral`; raises `ModelError` for detection models without measured irradiances."""
    detection = context.detection
    if not isinstance(detection, SnrDetection):
        raise ModelError(
            "classification: spectral uses measured band intensities, which the scene's detection model does not"
            " measure; choose detection: snr, or classification: paper"
        )
    keys = [_key(detection, number, sensor) for number, sensor in enumerate(context.sensors)]
    number_of = dict[tuple[Any, ...], int]()
    for number, key in enumerate(keys):
        number_of.setdefault(key, number)
    chosen = list(number_of.values())
    looks = looks_by_radius(detection.environment.bands, config.launches)
    banks = tuple(type_densities(detection, number, context.sensors[number], config, looks) for number in chosen)
    classifier = SpectralClassifier(
        banks=banks,
        bank_of_sensor=np.array([chosen.index(number_of[key]) for key in keys], dtype=np.int64),
        log_prior=np.log([config.prior[name] for name in TARGET_TYPES]),
        confidence=config.confidence,
        least_log_odds=-np.inf if config.least_log_odds is None else config.least_log_odds,
    )
    if config.false_source_probability is None:
        return classifier
    limits = []
    for number, bank in zip(chosen, banks, strict=True):
        sensor = context.sensors[number]
        seen, kind = source_detections(detection, number, sensor, bank, looks(canonical_radius_m(sensor))[1])
        limits.append(least_log_odds(classifier.evidence(seen).log_odds, kind, config.false_source_probability))
    return evolve(classifier, least_log_odds=max(limits))


def _key(detection: SnrDetection, number: int, sensor: Sensor) -> tuple[Any, ...]:
    """Return a key that is equal for sensors with equal densities."""
    return (
        detection.receivers[number].kind,
        sensor.scan.period_ns,
        sensor.field_of_regard_half_angle_rad,
        sensor.minimum_elevation_rad,
        canonical_radius_m(sensor),
    )
