"""Confidence models: `weighted` is the paper's formula; `always` is sure each time, `never` not once."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.builtin.configs import WeightedConfig
from opir_core.interfaces.contexts import ModelContext
from opir_core.interfaces.protocols import Confidence
from opir_core.interfaces.records import ClassifierInputs
from opir_core.plugin.components import NoConfig

#: min(1, log10(1 + n)) for n = 0 to 9, from where on it is 1.
_COUNT_TERMS = np.log10(1.0 + np.arange(10))


@frozen
class WeightedConfidence:
    """C = w_b n_b/N_b + w_n min(1, log10(1 + n)) + w_g max(0, sin(theta)); opir-simulator paper (2026), section 4.3.

    The paper's count term is unbounded and its elevation term negative below the horizon; with the bounds above, C is
    in [0, 1] for every input. The count term is 1 from nine detections on.
    """

    band: float
    count: float
    geometry: float

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return confidences (n,) in [0, 1]; a term whose input is not finite or has no bands is 0."""
        total = (
            self.band * _band_share(sightings)
            + self.count * _count_term(sightings)
            + self.geometry * _elevation_term(sightings)
        )
        return np.clip(total, 0.0, 1.0)


@frozen
class ConstantConfidence:
    """One confidence for all."""

    value: float

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return the confidence (n,)."""
        return np.full(len(sightings), self.value)


def weighted_confidence(config: WeightedConfig, _context: ModelContext) -> Confidence:
    """Return the model `weighted`."""
    return WeightedConfidence(config.band, config.count, config.geometry)


def full_confidence(_config: NoConfig, _context: ModelContext) -> Confidence:
    """Return the model `always`."""
    return ConstantConfidence(1.0)


def no_confidence(_config: NoConfig, _context: ModelContext) -> Confidence:
    """Return the model `never`."""
    return ConstantConfidence(0.0)


def _band_share(sightings: ClassifierInputs) -> FloatArray:
    total = np.maximum(sightings.band_total, 1)
    return np.clip(np.where(sightings.band_total > 0, sightings.band_count, 0) / total, 0.0, 1.0)


def _count_term(sightings: ClassifierInputs) -> FloatArray:
    terms: FloatArray = _COUNT_TERMS.take(np.clip(sightings.detection_count, 0, len(_COUNT_TERMS) - 1))
    return terms


def _elevation_term(sightings: ClassifierInputs) -> FloatArray:
    return np.nan_to_num(np.maximum(sightings.elevation_sine, 0.0), nan=0.0)
