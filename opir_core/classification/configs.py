"""Settings of the classifier `spectral`; imports nothing heavy."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from attrs import Factory, frozen

from opir_core.scene.fields import nested, number
from opir_core.scene.scene import REPORTED_TYPES

#: Tolerance of the sum of the prior.
PRIOR_SUM_TOLERANCE = 1e-9


def _prior_complaint(prior: Mapping[str, Any]) -> str | None:
    strange = [name for name in prior if name not in REPORTED_TYPES]
    if strange:
        return f"{strange[0]!r} is not a type to report; these are {', '.join(REPORTED_TYPES)}"
    missing = [name for name in REPORTED_TYPES if not prior.get(name, 0.0) > 0.0]
    if missing:
        return f"{missing[0]} has no share above 0"
    total = math.fsum(prior.values())
    return None if abs(total - 1.0) <= PRIOR_SUM_TOLERANCE else f"the shares sum to {total:.10g}, not to 1"


@frozen(kw_only=True)
class SpectralConfig:
    """Settings of the classifier `spectral`."""

    #: The conformance tests run it with a detection model that measures irradiances.
    needs_irradiance: ClassVar[bool] = True

    confidence: float = number(
        default=0.6,
        minimum=0.0,
        maximum=1.0,
        unit="1",
        help="probability below which the likeliest type is not reported, but UNKNOWN",
    )
    prior: Mapping[str, float] = nested(
        default=Factory(lambda: dict.fromkeys(REPORTED_TYPES, 0.25)),
        unit="1",
        minimum=0.0,
        maximum=1.0,
        check=_prior_complaint,
        help="before anything is measured: by type the share of launches, and as UNKNOWN the share of detections that"
        " are of no missile",
    )
    least_log_ratio: float | None = number(
        default=None,
        minimum=-1e9,
        maximum=1e9,
        unit="1",
        source="no default: the probabilities decide",
        help="natural logarithm of the likelihood ratio of a plume over anything else below which UNKNOWN is reported",
    )
    brightness_log_sigma: float = number(
        default=0.2,
        minimum=0.0,
        maximum=2.0,
        unit="1",
        help="standard deviation of the logarithm of plumes' brightness, in all bands at once, within a class",
    )
    colour_log_sigma: float = number(
        default=0.05,
        minimum=0.001,
        maximum=1.0,
        unit="1",
        help="the same of each band by itself",
    )
    launches: int = number(
        default=96, minimum=8, maximum=10_000, unit="1", source="cost", help="synthetic launches of each class profile"
    )

    def __attrs_post_init__(self) -> None:
        if not isinstance(self.launches, int):
            raise ValueError(f"launches: {self.launches!r} is not a whole number")
