"""The smallest plugin that does something: a confidence model, one minus what is left of doubt."""

import numpy as np
from attrs import frozen

from opir_core.plugin import ConfidenceModel, hookimpl, number


@frozen(kw_only=True)
class HalvingConfig:
    half: float = number(default=3.0, above=0.0, help="detections after which doubt is halved")


@frozen
class Halving:
    half: float

    def confidence(self, sightings):
        return -np.expm1(-np.log(2.0) * sightings.detection_count / self.half)


@hookimpl
def opir_confidence_models():
    build = lambda config, context: Halving(config.half)  # noqa: E731
    yield ConfidenceModel(name="halving", summary="doubt halves", config=HalvingConfig, build=build)
