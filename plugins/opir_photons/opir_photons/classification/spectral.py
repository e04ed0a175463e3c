"""The classifier `spectral`: type posteriors from measured band intensities; see
docs/explanation/classification.md.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import ModelError
from opir_core.plugin import (
    REPORTED_TYPES,
    TARGET_TYPES,
    Classifier,
    ClassifierInputs,
    Hypothesis,
    ModelContext,
    RandomDraws,
    Sensor,
)
from opir_core.scene import UNKNOWN_TYPE
from opir_photons.classification.configs import SpectralConfig
from opir_photons.classification.false_sources import least_log_odds, source_detections
from opir_photons.classification.gaussian_mixture import log_shares, log_sum
from opir_photons.classification.priors import LaunchPrior
from opir_photons.classification.type_densities import (
    SECONDS_PER_DAY,
    TypeDensities,
    canonical_radius_m,
    elevation_bin,
    looks_by_radius,
    type_densities,
)
from opir_photons.detection.snr import SnrDetection

#: Rows classified at once.
_ROWS = 512


@frozen(eq=False)
class SpectralClassifier(Classifier):
    """Bayes' rule with densities from synthetic launches and hot sources; sensor k has
    `banks[bank_of_sensor[k]]`.

    Posteriors are over the `hypotheses`. `log_prior` (types,) are logarithms of the types' shares
    of launches; `least_log_odds` is the limit below which UNKNOWN is reported; `reported_types` are
    those of the scene.
    """

    banks: tuple[TypeDensities, ...]
    bank_of_sensor: IntArray
    hypotheses: tuple[Hypothesis, ...]
    reported_types: tuple[str, ...]
    log_prior: FloatArray
    confidence: float
    least_log_odds: float
    launches_per_day: float
    uses_truth: bool = False

    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> NDArray[np.uint8]:
        """Return codes (n,) into the scene's reported types; no random numbers are drawn."""
        return self.reported(self.log_posterior(sightings))

    def expected_launches(self, duration_s: float) -> float:
        """Return the mean number of launches by the prior."""
        return self.launches_per_day * duration_s / SECONDS_PER_DAY

    def log_posterior(self, sightings: ClassifierInputs) -> FloatArray:
        """Return ln P (n, hypotheses) of measured intensities and counts, row by row."""
        if sightings.band_noise_w_m2.shape != sightings.band_irradiance_w_m2.shape:
            raise ModelError(
                "the detection model has no noise of its irradiances, which spectral needs"
            )
        log_rates = np.empty((len(sightings), len(self.hypotheses)))
        bank = self.bank_of_sensor[sightings.sensor]
        for number in np.unique(bank).tolist():
            rows = np.flatnonzero(bank == number)
            for start in range(0, len(rows), _ROWS):
                block = rows[start : start + _ROWS]
                log_rates[block] = _log_rates(self.banks[number], sightings, block)
        return log_shares(log_rates)

    def over_types(self, log_posterior: FloatArray, types: Sequence[str]) -> FloatArray:
        """Return ln P (n, types): each class adds to its own name where that is a type, or else to
        its reported type; what is no missile and none of these to UNKNOWN.
        """
        of_type = [
            each.name if each.name in types else each.reported_type for each in self.hypotheses
        ]
        is_of_type = np.array([[other == name for other in of_type] for name in types])
        return log_sum(np.where(is_of_type, log_posterior[:, None], -np.inf))

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors (n, hypotheses) with the prior of the missile types replaced by those
        of tracks, (n, 4).

        Rows of nan change nothing.
        """
        missiles = np.flatnonzero([each.reported_type in TARGET_TYPES for each in self.hypotheses])
        code = [TARGET_TYPES.index(self.hypotheses[row].reported_type) for row in missiles.tolist()]
        with np.errstate(divide="ignore"):
            turned = np.log(type_probability[:, :UNKNOWN_TYPE]) - np.maximum(self.log_prior, -1e300)
        split = log_posterior[:, missiles] + turned[:, code]
        known = np.flatnonzero(np.isfinite(split.max(axis=1)))
        missile = log_sum(log_posterior[:, missiles][known])
        revised = log_posterior.copy()
        revised[np.ix_(known, missiles)] = log_shares(split[known]) + missile[:, None]
        return revised

    def reported(self, log_posterior: FloatArray) -> NDArray[np.uint8]:
        """Return codes (n,): the most probable type but UNKNOWN, if it is probable enough, else
        UNKNOWN.

        A missile's type needs the least odds of a missile, too.
        """
        chances = self.over_types(log_posterior, self.reported_types)
        chances[:, UNKNOWN_TYPE] = -np.inf
        best = np.argmax(chances, axis=1).astype(np.uint8)
        odds = self.log_odds(self.over_types(log_posterior, REPORTED_TYPES))
        is_reported = (np.exp(chances.max(axis=1)) >= self.confidence) & (
            odds >= self.least_log_odds
        )
        return np.where(is_reported, best, np.uint8(UNKNOWN_TYPE))

    def log_odds(self, type_log_probability: FloatArray) -> FloatArray:
        """Return ln of the odds (n,) of a missile over anything else, of ln P (n, 4) over
        `REPORTED_TYPES`.
        """
        return (
            log_sum(type_log_probability[:, :UNKNOWN_TYPE]) - type_log_probability[:, UNKNOWN_TYPE]
        )


def _log_rates(bank: TypeDensities, seen: ClassifierInputs, rows: IntArray) -> FloatArray:
    """Return ln of the rates (n, hypotheses) of events like rows of one bank, from apparent
    intensities: irradiance times range².
    """
    place = elevation_bin(seen.elevation_sine[rows])
    area = np.square(seen.range_m[rows])[:, None]
    intensity = seen.band_irradiance_w_m2[rows, : bank.width] * area
    variance = np.square(seen.band_noise_w_m2[rows, : bank.width] * area)
    return bank.log_rates(place, intensity, variance, seen.detection_count[rows].astype(np.float64))


def spectral_classifier(config: SpectralConfig, context: ModelContext) -> SpectralClassifier:
    """Return the classifier `spectral`; raises `ModelError` for detection models without measured
    irradiances.
    """
    detection = context.detection
    if not isinstance(detection, SnrDetection):
        raise ModelError(
            "classification: spectral uses measured band intensities, which the scene's detection"
            " model does not measure; choose detection: snr, or classification: paper"
        )
    keys = [_key(detection, number, sensor) for number, sensor in enumerate(context.sensors)]
    number_of = dict[tuple[Any, ...], int]()
    for number, key in enumerate(keys):
        number_of.setdefault(key, number)
    chosen = list(number_of.values())
    prior = LaunchPrior.of(config.prior, context.hypotheses)
    looks = looks_by_radius(detection.environment.bands, prior, config.launches)
    banks = tuple(
        type_densities(detection, number, context.sensors[number], config, prior, looks)
        for number in chosen
    )
    classifier = SpectralClassifier(
        banks=banks,
        bank_of_sensor=np.array([chosen.index(number_of[key]) for key in keys], dtype=np.int64),
        hypotheses=prior.hypotheses,
        reported_types=context.reported_types,
        log_prior=prior.log_shares_of(TARGET_TYPES),
        confidence=config.confidence,
        least_log_odds=-np.inf if config.least_log_odds is None else config.least_log_odds,
        launches_per_day=config.launches_per_day,
    )
    if config.false_source_probability is None:
        return classifier
    limits = []
    for number, bank in zip(chosen, banks, strict=True):
        sensor = context.sensors[number]
        seen, kind = source_detections(
            detection, number, sensor, bank, looks(canonical_radius_m(sensor))[1]
        )
        log_types = classifier.over_types(classifier.log_posterior(seen), REPORTED_TYPES)
        limits.append(
            least_log_odds(classifier.log_odds(log_types), kind, config.false_source_probability)
        )
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
