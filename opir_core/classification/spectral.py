"""The classifier `spectral`: type posteriors from measured band intensities; see docs/explanation/classification.md."""

from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.classification.configs import SpectralConfig
from opir_core.classification.gaussian_mixture import log_shares, log_sum
from opir_core.classification.type_densities import (
    TypeDensities,
    canonical_radius_m,
    elevation_bin,
    looks_by_radius,
    type_densities,
)
from opir_core.detection.snr import SnrDetection
from opir_core.errors import ModelError
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.protocols import RandomDraws, Sensor
from opir_core.interfaces.records import ClassifierInputs
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES, UNKNOWN_TYPE

#: Rows classified at once.
_ROWS = 256

#: Probability that a detection count is uninformative (another object, a gap in visibility).
_UNINFORMATIVE = 0.01


class TypeEvidence(NamedTuple):
    """Of detections (n,): ln of the likelihood ratio of a plume over anything else, and ln P(type | plume) (n, 3)."""

    log_ratio: FloatArray
    log_type: FloatArray


@frozen(eq=False)
class SpectralClassifier:
    """Bayes' rule with densities from synthetic launches and hot sources; sensor k has `banks[bank_of_sensor[k]]`."""

    banks: tuple[TypeDensities, ...]
    bank_of_sensor: IntArray
    log_prior: FloatArray
    confidence: float
    least_log_ratio: float

    def pair_type(self, sensor: IndexArray, target: IndexArray, dice: RandomDraws) -> NDArray[np.uint8] | None:
        """Return None: types vary from detection to detection."""
        return None

    def reported_type(self, sightings: ClassifierInputs, dice: RandomDraws) -> NDArray[np.uint8]:
        """Return codes (n,) into `REPORTED_TYPES`; no random numbers are drawn."""
        return self.reported(self.log_posterior(sightings))

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        """Return ln P (n, 4) over `REPORTED_TYPES`; UNKNOWN is anything but a missile."""
        evidence = self.evidence(sightings)
        return log_posterior(evidence, self.log_prior)

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors (n, 4) with the prior replaced by those of tracks, (n, 4); nan rows change nothing."""
        with np.errstate(divide="ignore"):
            turned = np.log(type_probability[:, :UNKNOWN_TYPE]) - self.log_prior[:UNKNOWN_TYPE]
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
        is_reported = (chance >= self.confidence) & (self.log_ratio(log_posterior) >= self.least_log_ratio)
        return np.where(is_reported, best, np.uint8(UNKNOWN_TYPE))

    def log_ratio(self, log_posterior: FloatArray) -> FloatArray:
        """Return ln of the likelihood ratio (n,), plume over anything else, of posteriors (n, 4)."""
        odds = log_sum(self.log_prior[:UNKNOWN_TYPE]) - self.log_prior[UNKNOWN_TYPE]
        ratio: FloatArray = log_sum(log_posterior[:, :UNKNOWN_TYPE]) - log_posterior[:, UNKNOWN_TYPE] - odds
        return ratio

    def evidence(self, sightings: ClassifierInputs) -> TypeEvidence:
        """Return the evidence of measured intensities and counts, row by row."""
        if sightings.band_noise_w_m2.shape != sightings.band_irradiance_w_m2.shape:
            raise ModelError("the detection model has no noise of its irradiances, which spectral needs")
        ratio, split = np.empty(len(sightings)), np.empty((len(sightings), len(TARGET_TYPES)))
        bank = self.bank_of_sensor[sightings.sensor]
        for number in np.unique(bank).tolist():
            rows = np.flatnonzero(bank == number)
            for start in range(0, len(rows), _ROWS):
                block = rows[start : start + _ROWS]
                ratio[block], split[block] = self._evidence(self.banks[number], sightings, block)
        return TypeEvidence(ratio, split)

    def _evidence(self, bank: TypeDensities, seen: ClassifierInputs, rows: IntArray) -> TypeEvidence:
        """Return the evidence of rows of one bank, from apparent intensities: irradiance times range²."""
        place, area = elevation_bin(seen.elevation_sine[rows]), np.square(seen.range_m[rows])[:, None]
        intensity = seen.band_irradiance_w_m2[rows, : bank.width] * area
        variance = np.square(seen.band_noise_w_m2[rows, : bank.width] * area)
        columns = place, intensity, variance, seen.detection_count[rows].astype(np.float64)
        density, counted = bank.plumes.log_densities(*columns)
        counted = np.maximum(counted, np.log(_UNINFORMATIVE / bank.most_looks))
        prior = self.log_prior[:UNKNOWN_TYPE]
        plume = log_sum(bank.plumes.by_class(density) + prior) - log_sum(bank.log_seen_s[place] + prior)
        split = bank.plumes.by_class(density + counted) + prior
        other = log_sum(bank.others.log_densities(*columns)[0])
        return TypeEvidence(plume - other, log_shares(split))


def log_posterior(evidence: TypeEvidence, log_prior: FloatArray) -> FloatArray:
    """Return ln P (n, 4) over the types and UNKNOWN; `log_prior` (4,)."""
    odds = evidence.log_ratio + log_sum(log_prior[:UNKNOWN_TYPE]) - log_prior[UNKNOWN_TYPE]
    plume, other = -np.logaddexp(0.0, -odds), -np.logaddexp(0.0, odds)
    return np.concatenate([evidence.log_type + plume[:, None], other[:, None]], axis=1)


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
    return SpectralClassifier(
        banks=tuple(type_densities(detection, number, context.sensors[number], config, looks) for number in chosen),
        bank_of_sensor=np.array([chosen.index(number_of[key]) for key in keys], dtype=np.int64),
        log_prior=np.log([config.prior[name] for name in REPORTED_TYPES]),
        confidence=config.confidence,
        least_log_ratio=-np.inf if config.least_log_ratio is None else config.least_log_ratio,
    )


def _key(detection: SnrDetection, number: int, sensor: Sensor) -> tuple[Any, ...]:
    """Return a key that is equal for sensors with equal densities."""
    return (
        detection.receivers[number].kind,
        sensor.scan.period_ns,
        sensor.field_of_regard_half_angle_rad,
        sensor.minimum_elevation_rad,
        canonical_radius_m(sensor),
    )
