"""The odds of a missile above which at most a given share of the detections of hot sources lie."""

import numpy as np
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import ClassifierInputs, Sensor
from opir_photons.classification.hot_sources import KINDS
from opir_photons.classification.synthetic_looks import SyntheticLooks, low_discrepancy_points
from opir_photons.classification.type_densities import TypeDensities, looks_response
from opir_photons.detection.snr import SnrDetection

#: Measurements of each synthetic source; numbers of detections, in geometric steps, at which each
#: is classified.
_DRAWS = 2
_COUNTS = 6


def source_detections(
    detection: SnrDetection,
    number: int,
    sensor: Sensor,
    bank: TypeDensities,
    shining: SyntheticLooks,
) -> tuple[ClassifierInputs, IntArray]:
    """Return detections of synthetic hot sources as a classifier sees them, and their kinds (n,).

    Each is repeated, block by block, for `_COUNTS` numbers of detections so far, up to those of the
    longest launch.
    """
    response, seen = looks_response(detection, number, sensor, shining)
    receiver = detection.receivers[number]
    width = bank.width
    row = np.tile(np.arange(len(seen)), _DRAWS)
    noise = response.noise_w_m2[row, :width]
    exposures = shining.exposures.take(row)
    snr = response.snr[row, :width]
    measured = snr + ndtri(low_discrepancy_points(len(row), width))
    slopes = receiver.slopes(snr, noise, exposures.elevation_sine)
    found = np.flatnonzero(seen[row] & receiver.rule.passes(measured, slopes))
    counts = np.geomspace(bank.rates.needed, max(bank.most_looks, bank.rates.needed), _COUNTS)
    count = np.repeat(np.ceil(counts), len(found))
    found = np.tile(found, _COUNTS)
    none = np.zeros(len(found), dtype=np.int64)
    exposures = exposures.take(found)
    inputs = ClassifierInputs(
        time_s=exposures.time_s,
        sensor=np.full(len(found), number, dtype=np.int32),
        target=none.astype(np.int32),
        range_m=exposures.range_m,
        elevation_sine=exposures.elevation_sine,
        bands=none.astype(np.uint8),
        band_count=none,
        band_total=none + width,
        detection_count=count.astype(np.int32),
        snr=receiver.rule.strength(measured[found], slopes[found]),
        band_irradiance_w_m2=measured[found] * noise[found],
        band_noise_w_m2=noise[found],
    )
    return inputs, shining.number[row[found]]


def least_log_odds(log_odds: FloatArray, kind: IntArray, probability: float) -> float:
    """Return the log odds (n,) that a detection of any kind exceeds, at any number so far, with
    this probability.
    """
    worst = log_odds.reshape(_COUNTS, -1).max(axis=0)
    kinds = kind[: len(kind) // _COUNTS]
    limits = [
        float(np.quantile(worst[kinds == code], 1.0 - probability, method="higher"))
        for code in range(len(KINDS))
        if np.any(kinds == code)
    ]
    return max(limits, default=-np.inf)
