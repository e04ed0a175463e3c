"""What tracks may be and how they ended, as plain values."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from opir_core.interfaces.impact_regions import IMPACT_CONDITIONS
from opir_core.interfaces.records import TRACK_ENDS, Tracks

_SUMS = ("probability_launch", "probability_missile", "probability_orbit")


def hypothesis_columns(
    tracks: Tracks, hypotheses: Sequence[str], decimals: int | None = None
) -> dict[str, list[Any]]:
    """Return the columns (n,) `hypotheses`, by name, their sums, `probability_comes_down` and `end`
    of tracks.

    Values are None where unknown: without hypotheses also whether a target comes down, which its
    regions tell. Probabilities are in full, or rounded to `decimals`.
    """
    chances = tracks.hypothesis_probability
    weighed = (np.isfinite(chances).all(axis=1) & (chances.shape[1] > 0)).tolist()
    regions = zip(weighed, tracks.impact_regions.tolist(), strict=True)
    sums = {name: getattr(tracks, name) for name in _SUMS}
    sums["probability_comes_down"] = [
        _comes_down(regions_of_row) if is_known else np.nan for is_known, regions_of_row in regions
    ]
    if decimals is not None:
        chances = np.round(chances, decimals)
        sums = {name: np.round(sums[name], decimals) for name in sums}
    shares = zip(weighed, chances.tolist(), strict=True)
    return {
        "hypotheses": [
            dict(zip(hypotheses, share, strict=True)) if is_known else None
            for is_known, share in shares
        ],
        **{
            name: [
                chance if np.isfinite(chance) else None for chance in np.asarray(column).tolist()
            ]
            for name, column in sums.items()
        },
        "end": [TRACK_ENDS[code] or None for code in tracks.end.tolist()],
    }


def _comes_down(regions: Sequence[Any]) -> float:
    """Return the probability of the condition of this name, else the sum of the others, which
    exclude each other.
    """
    chances = {region.condition: region.probability for region in regions}
    return chances.get(IMPACT_CONDITIONS[0], sum(chances.values())) if chances else np.nan
