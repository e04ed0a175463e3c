"""Burns of targets and the dark gaps between them, as columns of intervals (n, k, 2), nan where a
target has fewer.
"""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IndexArray


def one_burn_s(ignition_s: FloatArray, burnout_s: FloatArray) -> FloatArray:
    """Return the burns (n, 1, 2) of targets that burn from ignition to burnout (n,)."""
    return np.stack([ignition_s, burnout_s], axis=-1)[:, None, :]


def dark_gaps_s(burns_s: FloatArray) -> FloatArray:
    """Return the dark gaps (n, k, 2) between burns; nan where there are fewer, k = 0 if no target
    has one.
    """
    gaps = np.stack([burns_s[:, :-1, 1], burns_s[:, 1:, 0]], axis=-1)
    # A burn that follows at once leaves no gap.
    gaps[~(gaps[..., 1] > gaps[..., 0])] = np.nan
    return gaps[:, np.isfinite(gaps[..., 0]).any(axis=0)]


def in_gap(gaps_s: FloatArray, target: IndexArray, time_s: FloatArray) -> BoolArray:
    """Return whether targets (m,) are dark at times (m,); at the ends of a gap they still burn."""
    dark = np.zeros(len(target), dtype=np.bool_)
    for number in range(gaps_s.shape[1]):
        dark |= (time_s > gaps_s[target, number, 0]) & (time_s < gaps_s[target, number, 1])
    return dark


def joined_burns_s(groups: Sequence[FloatArray]) -> FloatArray:
    """Return the burns of the targets of all parts, in order, filled up with nan."""
    count = max(burns_s.shape[1] for burns_s in groups)
    filled = [
        np.pad(burns_s, ((0, 0), (0, count - burns_s.shape[1]), (0, 0)), constant_values=np.nan)
        for burns_s in groups
    ]
    return np.concatenate(filled)


def plain_gaps_s(burns_s: FloatArray) -> list[list[float]]:
    """Return the dark gaps of one target with burns (k, 2), as plain values."""
    gaps = dark_gaps_s(burns_s[None])[0]
    return gaps[np.isfinite(gaps[:, 0])].tolist()
