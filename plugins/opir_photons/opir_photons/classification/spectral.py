"""The classifier `spectral`: type posteriors from measured band intensities; see
docs/explanation/classification.md.
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import ByteArray, FloatArray, IntArray
from opir_core.errors import ModelError
from opir_core.plugin import (
    REPORTED_TYPES,
    TARGET_TYPES,
    Classifier,
    ClassifierInputs,
    Hypothesis,
    ModelContext,
    RandomDraws,
)
from opir_core.scene import UNKNOWN_TYPE
from opir_photons.classification.configs import SpectralConfig
from opir_photons.classification.false_sources import least_log_odds, source_detections
from opir_photons.classification.gaussian_mixture import log_shares, log_sum
from opir_photons.classification.priors import LaunchPrior
from opir_photons.classification.type_densities import (
    SECONDS_PER_DAY,
    Observer,
    ObserverDensities,
    TypeDensities,
    elevation_bin,
)
from opir_photons.detection.snr import SnrDetection


@frozen(eq=False)
class SpectralClassifier(Classifier):
    """Bayes' rule with densities from synthetic launches and hot sources, made at the first
    classification; sensor k has `banks[bank_of_sensor[k]]`.

    Posteriors are over the `hypotheses`. `log_prior` (types,) are logarithms of the types' shares
    of launches; `least_log_odds` is the limit below which UNKNOWN is reported; `reported_types` are
    those of the scene.
    """

    make_banks: Callable[[], tuple[TypeDensities, ...]]
    bank_of_sensor: IntArray
    hypotheses: tuple[Hypothesis, ...]
    reported_types: tuple[str, ...]
    log_prior: FloatArray
    confidence: float
    least_log_odds: float
    launches_per_day: float
    uses_truth: bool = False

    @cached_property
    def banks(self) -> tuple[TypeDensities, ...]:
        """The densities of distinct sensors."""
        return self.make_banks()

    def reported_type(self, sightings: ClassifierInputs, rng: RandomDraws) -> ByteArray:
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
        banks = self.banks
        bank = self.bank_of_sensor[sightings.sensor]
        for number in np.unique(bank).tolist():
            rows = np.flatnonzero(bank == number)
            for block in np.split(rows, range(512, len(rows), 512)):
                log_rates[block] = _log_rates(banks[number], sightings, block)
        return log_shares(log_rates)

    def over_types(self, log_posterior: FloatArray, types: Sequence[str]) -> FloatArray:
        """Return ln P (n, types): each class adds to its own name where that is a type, or else to
        its reported type; all else to UNKNOWN, and so does what most probably glides and has no
        name among the types.
        """
        names = [
            hypothesis.name if hypothesis.name in types else hypothesis.reported_type
            for hypothesis in self.hypotheses
        ]
        chances = _sums_of(names, types, log_posterior)
        unnamed = np.array(
            [
                hypothesis.group == "glide" and hypothesis.name not in types
                for hypothesis in self.hypotheses
            ]
        )
        rows = np.flatnonzero(unnamed[np.argmax(log_posterior, axis=1)])
        if len(rows):
            others = np.where(unnamed, REPORTED_TYPES[UNKNOWN_TYPE], names).tolist()
            chances[rows] = _sums_of(others, types, log_posterior[rows])
        return chances

    def revised(self, log_posterior: FloatArray, type_probability: FloatArray) -> FloatArray:
        """Return posteriors (n, hypotheses) with the prior of the missile types replaced by those
        of tracks, (n, 4).

        Rows of nan change nothing.
        """
        types = [hypothesis.reported_type for hypothesis in self.hypotheses]
        missiles = np.flatnonzero([name in TARGET_TYPES for name in types])
        code = [TARGET_TYPES.index(types[row]) for row in missiles.tolist()]
        with np.errstate(divide="ignore"):
            turned = np.log(type_probability[:, :UNKNOWN_TYPE]) - np.maximum(self.log_prior, -1e300)
        of_missiles = log_posterior[:, missiles]
        split = of_missiles + turned[:, code]
        rows = np.flatnonzero(np.isfinite(split.max(axis=1)))
        revised = log_posterior.copy()
        missile = log_sum(of_missiles[rows])[:, None]
        revised[np.ix_(rows, missiles)] = log_shares(split[rows]) + missile
        return revised

    def reported(self, log_posterior: FloatArray) -> ByteArray:
        """Return codes (n,): the most probable type but UNKNOWN, if it is probable enough, else
        UNKNOWN.

        A missile's type needs the least odds of a missile, too.
        """
        chances = self.over_types(log_posterior, self.reported_types)
        chances[:, UNKNOWN_TYPE] = -np.inf
        best = np.argmax(chances, axis=1).astype(np.uint8)
        odds = self.log_odds(self.over_types(log_posterior, REPORTED_TYPES))
        is_probable = np.exp(chances.max(axis=1)) >= self.confidence
        is_reported = is_probable & (odds >= self.least_log_odds)
        return np.where(is_reported, best, np.uint8(UNKNOWN_TYPE))

    def log_odds(self, type_log_probability: FloatArray) -> FloatArray:
        """Return ln of the odds (n,) of a missile over anything else, of ln P (n, 4) over
        `REPORTED_TYPES`.
        """
        return (
            log_sum(type_log_probability[:, :UNKNOWN_TYPE]) - type_log_probability[:, UNKNOWN_TYPE]
        )


def _sums_of(names: Sequence[str], types: Sequence[str], log_posterior: FloatArray) -> FloatArray:
    """Return ln P (n, types) of hypotheses that are reported by names."""
    is_of_type = np.array([[name == kind for name in names] for kind in types])
    return log_sum(np.where(is_of_type, log_posterior[:, None], -np.inf))


def _log_rates(bank: TypeDensities, sightings: ClassifierInputs, rows: IntArray) -> FloatArray:
    """Return ln of the rates (n, hypotheses) of events like rows of one bank, from apparent
    intensities: irradiance times range².
    """
    place = elevation_bin(sightings.elevation_sine[rows])
    area = np.square(sightings.range_m[rows])[:, None]
    intensity = sightings.band_irradiance_w_m2[rows, : bank.width] * area
    variance = np.square(sightings.band_noise_w_m2[rows, : bank.width] * area)
    count = sightings.detection_count[rows].astype(np.float64)
    return bank.log_rates(place, intensity, variance, count)


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
    observers = [
        Observer(detection, number, sensor) for number, sensor in enumerate(context.sensors)
    ]
    keys = list(map(_key, observers))
    distinct = dict(zip(keys[::-1], observers[::-1], strict=True))
    banks_of = list(dict.fromkeys(keys))
    prior = LaunchPrior.of(config.prior, context.hypotheses)
    densities = ObserverDensities(tuple(distinct[key] for key in banks_of), config, prior)
    classifier = SpectralClassifier(
        make_banks=densities,
        bank_of_sensor=np.array([banks_of.index(key) for key in keys], dtype=np.int64),
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
    for observer, bank in zip(densities.observers, classifier.banks, strict=True):
        sightings, kind = source_detections(observer, bank, densities.looks[observer.radius_m][1])
        log_types = classifier.over_types(classifier.log_posterior(sightings), REPORTED_TYPES)
        log_odds = classifier.log_odds(log_types)
        limits.append(least_log_odds(log_odds, kind, config.false_source_probability))
    return evolve(classifier, least_log_odds=max(limits))


def _key(observer: Observer) -> tuple[Any, ...]:
    """Return a key that is equal for sensors with equal densities."""
    sensor = observer.sensor
    return (
        observer.receiver.kind,
        sensor.scan.period_ns,
        sensor.field_of_regard_half_angle_rad,
        sensor.minimum_elevation_rad,
        observer.radius_m,
    )
