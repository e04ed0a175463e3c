"""Requirements on shares of launches, as sentences: `region_km2 < 1000 within 90 s in 90 % of
launches, in every condition`.

A launch that never has the figure misses every bound; one to which it does not apply, such as the
impact region of a launch into orbit, does not count.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import nearest
from opir_studies.configs import QUANTITIES, milestone_name
from opir_studies.launches import NAMES
from opir_studies.refusals import refusal

_NUMBER = r"[-+0-9.eE_]+"
_SENTENCE = re.compile(
    rf"(?P<name>[A-Za-z_]\w*)"
    rf"(?:\s*(?P<sign><=|>=|<|>|≤|≥)\s*(?P<limit>{_NUMBER}))?"
    rf"(?:\s+within\s+(?P<within>{_NUMBER})\s*s)?"
    rf"\s+in\s+(?P<percent>{_NUMBER})\s*%(?:\s+of\s+launches)?"
    rf"(?P<every>\s*,?\s+in\s+every\s+condition)?"
)
_EXAMPLE = "'region_km2 < 1000 within 90 s in 90 % of launches'"


@frozen
class ShareRequirement:
    """A share of launches that is required: those whose `column` is within a limit.

    `text` is the sentence. A value must be above the limit if `is_least`, else at most the limit.
    """

    text: str
    column: str
    limit: float
    is_least: bool
    share: float
    in_every_condition: bool
    #: The quantity of tracks and its bound that the column is of, if it is one of `QUANTITIES`.
    quantity: str = ""
    bound: float = math.nan

    @property
    def is_by_time(self) -> bool:
        """Whether the limit is a time since ignition."""
        return "within" in self.text

    def __str__(self) -> str:
        """Return the sentence."""
        return self.text

    def is_met(self, values: FloatArray) -> BoolArray:
        """Whether values (n,) of launches are within the limit; inf, which is never, is not."""
        is_within = values >= self.limit if self.is_least else values <= self.limit
        return np.asarray(is_within & np.isfinite(values))


def is_sentence(text: str) -> bool:
    """Whether a requirement is on a share of launches, not on a mean."""
    return "%" in text


def share_requirements_of(texts: Sequence[str], source: str) -> tuple[ShareRequirement, ...]:
    """Return the requirements on shares among some requirements; raises `SceneError` for a sentence
    that cannot be read.
    """
    return tuple(
        _requirement(text, f"requirements[{row}]", source)
        for row, text in enumerate(map(str, texts))
        if is_sentence(text)
    )


def _requirement(text: str, path: str, source: str) -> ShareRequirement:
    match = _SENTENCE.fullmatch(text.strip())
    if match is None:
        words = (
            f"{text!r} is no sentence such as {_EXAMPLE}, 'detected within 30 s in 95 % of launches'"
            " or 'launch_error_m < 2000 in 90 % of launches'; ', in every condition' may follow"
        )
        raise refusal(path, words, source)
    limit, within_s, percent = (
        _number(match[name], path, source) for name in ("limit", "within", "percent")
    )
    if not 0.0 < percent < 100.0:
        raise refusal(path, f"{percent:g} % is not between 0 and 100 %", source)
    name = match["name"]
    is_least = (match["sign"] or "<") in (">", ">=", "≥")
    column, limit, is_least, bound = _column(name, limit, is_least, within_s, path, source)
    return ShareRequirement(
        text=text.strip(),
        column=column,
        limit=limit,
        is_least=is_least,
        share=percent / 100.0,
        in_every_condition=match["every"] is not None,
        quantity=name if math.isfinite(bound) else "",
        bound=bound,
    )


def _column(
    name: str, limit: float, is_least: bool, within_s: float, path: str, source: str
) -> tuple[str, float, bool, float]:
    """Return the column that a sentence is on, its limit, whether that is the least value, and the
    bound of a quantity.
    """
    at_most_s = math.inf if math.isnan(within_s) else within_s
    if name in QUANTITIES and math.isfinite(limit):
        if is_least != QUANTITIES[name]:
            sign = ">" if QUANTITIES[name] else "<"
            raise refusal(path, f"{name} has bounds of one kind: {name} {sign} VALUE", source)
        if limit <= 0.0:
            raise refusal(path, f"{limit:g} is no bound of {name}; give one above 0", source)
        return f"{milestone_name(name, limit)}_s", at_most_s, False, limit
    if math.isfinite(limit) and math.isfinite(within_s):
        words = (
            f"'{name}' has no values over time; those of {', '.join(QUANTITIES)} have 'within'"
            f"{nearest(name, QUANTITIES)}"
        )
        raise refusal(path, words, source)
    if math.isfinite(limit):
        return name, limit, is_least, math.nan
    return (name if name.endswith("_s") else f"{name}_s"), at_most_s, False, math.nan


def _number(text: str | None, path: str, source: str) -> float:
    if text is None:
        return math.nan
    try:
        return float(text)
    except ValueError:
        raise refusal(path, f"{text!r} is not a number", source) from None


def require_columns(
    requirements: Sequence[ShareRequirement], units: Mapping[str, str], source: str
) -> None:
    """Raise `SceneError` for a requirement on a column that no launch of the study has."""
    columns = [name for name, unit in units.items() if unit != NAMES]
    for each in requirements:
        if each.column not in columns:
            words = (
                f"{each.text!r}: no launch has {each.column!r}{nearest(each.column, columns)};"
                f" metrics add columns, and there are {', '.join(columns)}"
            )
            raise refusal("requirements", words, source)


def missing_milestones(
    requirements: Sequence[ShareRequirement], units: Mapping[str, str]
) -> dict[str, list[float]] | None:
    """Return the bounds of quantities that requirements need and columns lack, as settings of the
    metric `milestones`; None without any.
    """
    bounds: dict[str, list[float]] = {quantity: [] for quantity in QUANTITIES}
    for each in requirements:
        if each.quantity and each.column not in units and each.bound not in bounds[each.quantity]:
            bounds[each.quantity].append(each.bound)
    return bounds if any(bounds.values()) else None


def require_conditions(
    requirements: Sequence[ShareRequirement], conditions: Mapping[str, Any], source: str
) -> None:
    """Raise `SceneError` for a requirement in every condition of a study that has none."""
    for each in requirements:
        if each.in_every_condition and not conditions:
            words = f"{each.text!r}: the study has no conditions; name them in `conditions`"
            raise refusal("requirements", words, source)
