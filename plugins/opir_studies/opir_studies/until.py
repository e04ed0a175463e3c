"""Stopping early: when the interval of a figure is narrow enough.

Decisions are made after fixed numbers of runs, so the result depends neither on the executor nor on
the order in which runs end.
"""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.errors import nearest
from opir_studies.refusals import refusal
from opir_studies.statistics import interval
from opir_studies.study import MINIMUM_RUNS, Study

#: Runs of a round, as a multiple of those of the one before.
_GROWTH = 1.5
#: The condition that every requirement on a share of launches is decided.
DECIDED = "decided"


@frozen
class Until:
    """The largest half width of the 95 % interval of a figure: in its unit, or as a share of the
    mean.
    """

    figure: str
    half_width: float
    is_relative: bool

    def is_met(self, values: Any) -> bool:
        """Whether the interval of values (n,) is narrow enough; runs without a value do not
        count.
        """
        mean, low, high = interval(np.asarray(values, dtype=np.float64))
        limit = self.half_width * abs(mean) if self.is_relative else self.half_width
        return bool(0.5 * (high - low) <= limit)


def until_of(study: Study, units: Mapping[str, str]) -> Until | None:
    """Return the condition of an early stop; raises `SceneError` for an invalid text, or an unknown
    figure.
    """
    if study.until in ("", DECIDED):
        return None
    source = f"study {study.study}"
    figure, colon, width = study.until.partition(":")
    is_relative = width.strip().endswith("%")
    try:
        value = float(width.strip().removesuffix("%")) * (0.01 if is_relative else 1.0)
    except ValueError:
        value = np.nan
    if not colon or not 0.0 < value < np.inf:
        words = (
            f"{study.until!r} is not FIGURE:WIDTH; write latency_s:0.5% or latency_s:0.2, or"
            f" {DECIDED} for requirements on shares of launches"
        )
        raise refusal("until", words, source)
    if figure.strip() not in units:
        figures = ", ".join(units)
        words = (
            f"no metric of the study gives {figure!r}{nearest(figure, units)}; there are {figures}"
        )
        raise refusal("until", words, source)
    return Until(figure.strip(), value, is_relative)


def rounds(runs: int, *, stops_early: bool) -> Iterator[int]:
    """Yield the numbers of runs of a design after which it may stop; the last one is `runs`."""
    if not stops_early:
        yield runs
        return
    number = min(MINIMUM_RUNS, runs)
    while number < runs:
        yield number
        number = int(np.ceil(number * _GROWTH))
    yield runs
