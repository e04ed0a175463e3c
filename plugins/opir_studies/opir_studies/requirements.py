"""Requirements on the mean of a figure, `warning_time_s >= 900`: lines in plots, verdicts in
tables.

A launch without a value, and a run without one, misses every bound: a mean over the others meets no
requirement.
"""

import math
import re
from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import nearest
from opir_studies.refusals import refusal
from opir_studies.share_requirements import is_sentence

_FORM = re.compile(r"\s*([A-Za-z_]\w*)\s*(<=|>=|<|>|≤|≥)\s*(\S+)\s*")


@frozen
class FigureRequirement:
    """A bound of a figure's mean: the least value if `is_least`, else the largest."""

    figure: str
    limit: float
    is_least: bool

    def violation(self, mean: float) -> float:
        """Return the share of the limit by which a mean misses it, 0 where it is met; a mean that
        is nan misses it by 1.
        """
        if not math.isfinite(mean):
            return 1.0
        missing = self.limit - mean if self.is_least else mean - self.limit
        return max(missing, 0.0) / (abs(self.limit) or 1.0)

    def is_met(self, means: FloatArray, shares: FloatArray) -> BoolArray:
        """Whether means (n,) over shares (n,) of all launches or runs meet it.

        A mean that is nan, or of a share below 1, does not.
        """
        met = [self.violation(float(mean)) == 0.0 for mean in means]
        return np.array(met) & (shares == 1.0)

    def __str__(self) -> str:
        """Return the requirement as it is written."""
        return f"{self.figure} {'>=' if self.is_least else '<='} {self.limit:g}"


def requirements_of(
    texts: Sequence[str], units: Mapping[str, str], source: str
) -> tuple[FigureRequirement, ...]:
    """Return the requirements on means of figures with these units among some requirements; raises
    `SceneError` for what cannot be read, or is unknown.
    """
    return tuple(
        _requirement(text, f"requirements[{row}]", units, source)
        for row, text in enumerate(map(str, texts))
        if not is_sentence(text)
    )


def _requirement(text: str, path: str, units: Mapping[str, str], source: str) -> FigureRequirement:
    match = _FORM.fullmatch(text)
    try:
        limit = float(match[3]) if match is not None else math.nan
    except ValueError:
        limit = math.nan
    if match is None or not math.isfinite(limit):
        words = (
            f"{text!r} is not FIGURE >= VALUE or FIGURE <= VALUE, such as 'warning_time_s >= 900',"
            " nor a share of launches, such as 'detected within 30 s in 95 % of launches'"
        )
        raise refusal(path, words, source)
    require_figures([match[1]], path, units, source)
    return FigureRequirement(match[1], limit, match[2] in (">", ">=", "≥"))


def require_figures(names: Sequence[str], path: str, units: Mapping[str, str], source: str) -> None:
    """Raise `SceneError` for a figure that no metric gives."""
    for name in names:
        if name not in units:
            words = (
                f"no metric of the study gives {name!r}{nearest(name, units)}; there are"
                f" {', '.join(units)}"
            )
            raise refusal(path, words, source)
