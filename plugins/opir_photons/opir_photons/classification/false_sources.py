"""The odds of a missile above which at most a given share of the detections of hot sources lie."""

import numpy as np
from attrs import evolve
from scipy.special import ndtri

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.plugin import ClassifierInputs, Exposures
from opir_photons.classification.hot_sources import KINDS
from opir_photons.classification.synthetic_looks import SyntheticLooks, low_discrepancy_points
from opir_photons.classification.type_densities import Observer, TypeDensities

#: Numbers of detections, in geometric steps, at which each synthetic source is classified.
_COUNTS = 6


def source_detections(
    observer: Observer, bank: TypeDensities, shining: SyntheticLooks
) -> tuple[ClassifierInputs, IntArray]:
    """Return detections of synthetic hot sources as a classifier gets them, and their kinds (n,).

    Each is repeated, block by block, for `_COUNTS` numbers of detections so far, up to those of the
    longest launch.
    """
    response, is_visible = observer.response(shining)
    receiver = observer.receiver
    width = bank.width
    # Two measurements of each source.
    row = np.tile(np.arange(len(is_visible)), 2)
    noise = response.noise_w_m2[row, :width]
    exposures = shining.exposures.take(row)
    snr = response.snr[row, :width]
    measured = snr + ndtri(low_discrepancy_points(len(row), width))
    slopes = receiver.slopes(snr, noise, exposures.elevation_sine)
    detected = np.flatnonzero(is_visible[row] & receiver.rule.passes(measured, slopes))
    needed = bank.rates.needed
    counts = np.ceil(np.geomspace(needed, max(bank.longest_launch, needed), _COUNTS))
    rows = np.tile(detected, _COUNTS)
    strength = receiver.rule.strength(measured[rows], slopes[rows])
    measured_w_m2 = measured[rows] * noise[rows]
    count = np.repeat(counts, len(detected)).astype(np.int32)
    inputs = _inputs(observer, exposures.take(rows), count, strength)
    inputs = evolve(inputs, band_irradiance_w_m2=measured_w_m2, band_noise_w_m2=noise[rows])
    return inputs, shining.number[row[rows]]


def _inputs(
    observer: Observer, exposures: Exposures, count: IndexArray, snr: FloatArray
) -> ClassifierInputs:
    """Return the inputs of detections with these counts so far, without irradiances."""
    zeros = np.zeros(len(exposures), dtype=np.int64)
    nothing = np.empty((len(exposures), 0))
    return ClassifierInputs(
        time_s=exposures.time_s,
        sensor=np.full(len(exposures), observer.number, dtype=np.int32),
        target=zeros.astype(np.int32),
        range_m=exposures.range_m,
        elevation_sine=exposures.elevation_sine,
        bands=zeros.astype(np.uint8),
        band_count=zeros,
        band_total=zeros + observer.width,
        detection_count=count,
        snr=snr,
        band_irradiance_w_m2=nothing,
        band_noise_w_m2=nothing,
    )


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
