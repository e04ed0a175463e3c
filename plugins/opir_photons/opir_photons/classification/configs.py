"""Settings of the classifier `spectral` and of the confidence model `posterior`; imports nothing
heavy.
"""

import math
from collections.abc import Mapping
from typing import Any, ClassVar

from attrs import Factory, frozen

from opir_core.plugin import nested, number

#: Tolerance of the sum of the prior.
PRIOR_SUM_TOLERANCE = 1e-9


def _prior_complaint(prior: Mapping[str, Any]) -> str | None:
    total = math.fsum(prior.values())
    is_whole = not prior or abs(total - 1.0) <= PRIOR_SUM_TOLERANCE
    return None if is_whole else f"the shares sum to {total:.10g}, not to 1"


#: Kinds of hot sources that stand on the ground.
SOURCE_KINDS = ("fire", "flare", "glint")


def _sources_complaint(sources: Mapping[str, Any]) -> str | None:
    unknown = [name for name in sources if name not in SOURCE_KINDS]
    return (
        f"{unknown[0]!r} is not a kind of source; these are {', '.join(SOURCE_KINDS)}"
        if unknown
        else None
    )


@frozen
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
        default=Factory(dict),
        unit="1",
        minimum=0.0,
        maximum=1.0,
        check=_prior_complaint,
        help="before anything is measured: by target class the share of launches; classes not named"
        " are not expected."
        " Empty: 0.85 missiles, equally of each type, 0.1 space launches, 0.05 gliders",
        source="notional",
    )
    launches_per_day: float = number(
        default=1.0,
        above=0.0,
        maximum=1e9,
        unit="1/day",
        help="launches to be expected in a sensor's field of regard; with the rate of false alarms"
        " and the hot sources it gives the prior probability of a launch",
    )
    sources_in_view: Mapping[str, float] = nested(
        default=Factory(lambda: {"fire": 1.0, "flare": 1.0, "glint": 0.1}),
        unit="1",
        minimum=0.0,
        maximum=1e9,
        check=_sources_complaint,
        help="by kind the mean number of hot sources in the field of regard at a time; none of the"
        " kinds not named",
    )
    bolides_per_day: float = number(
        default=0.04,
        minimum=0.0,
        maximum=1e9,
        unit="1/day",
        source="CNEOS, 1988 to 2026: 35.8 a year on Earth, of which a geostationary sensor sees 42"
        " %",
        help="bolides in a sensor's field of regard",
    )
    reentries_per_day: float = number(
        default=0.5,
        minimum=0.0,
        maximum=1e9,
        unit="1/day",
        source="1 to 3 catalogued bodies re-enter a day, 1200 intact ones in 2024 (ESA, Space"
        " Environment Report, 2025), a third of them in view",
        help="bodies that enter the air from an orbit in a sensor's field of regard: of none of"
        " these",
    )
    unknown_per_day: float = number(
        default=0.03,
        above=0.0,
        maximum=1e9,
        unit="1/day",
        help="hot objects in a sensor's field of regard that are none of the others",
    )
    least_log_odds: float | None = number(
        default=None,
        minimum=-1e9,
        maximum=1e9,
        unit="1",
        source="no default: the probabilities decide",
        help="natural logarithm of the odds of a missile below which UNKNOWN is reported",
    )
    false_source_probability: float | None = number(
        default=None,
        above=0.0,
        below=1.0,
        unit="1",
        source="no default: the probabilities decide",
        help="probability with which a detection of a hot source is taken for a missile, at most,"
        " for any kind: it sets the least odds of each sensor",
        instead_of="least_log_odds",
    )
    brightness_log_sigma: float | None = number(
        default=None,
        minimum=0.0,
        maximum=2.0,
        unit="1",
        source="no default: gas_spread of opir_photons/data/propellants.json, 0.7",
        help="standard deviation of the logarithm of plumes' brightness, in all bands at once,"
        " within a class; that of their particles, and the propellants, are the table's",
    )
    colour_log_sigma: float | None = number(
        default=None,
        minimum=0.001,
        maximum=1.0,
        unit="1",
        source="no default: band_spread of opir_photons/data/propellants.json, 0.11",
        help="the same of each band by itself",
    )
    launches: int = number(
        default=120,
        minimum=8,
        maximum=10_000,
        unit="1",
        source="cost",
        help="synthetic launches of each class profile",
    )

    def __attrs_post_init__(self) -> None:
        if not isinstance(self.launches, int):
            raise ValueError(f"launches: {self.launches!r} is not a whole number")


@frozen(kw_only=True)
class PosteriorConfig:
    """Settings of the confidence model `posterior`: none."""

    #: The conformance tests run it with a classifier that computes probabilities.
    needs_posterior: ClassVar[bool] = True
