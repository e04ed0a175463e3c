"""The probabilities of a scene's hypotheses, from those of the groups and of the target classes given a launch."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import REPORTED_TYPES, Hypothesis, Tracks
from opir_core.scene import UNKNOWN_TYPE
from opir_trackers.onset.motion_statistics import BOLIDE, GROUND, LAUNCH, NOISE, NONE

#: Columns of group probabilities by the groups of hypotheses other than launches.
_COLUMNS = {"noise": NOISE, "ground": GROUND, "bolide": BOLIDE, "none": NONE}


def hypothesis_probabilities(
    hypotheses: Sequence[Hypothesis], groups: FloatArray, given_launch: FloatArray
) -> FloatArray:
    """Return the probabilities (n, H) of hypotheses from those of groups (n, 5) and those given a launch (n, H).

    Given a launch, only target classes and "none of these" have a probability: P(h) = P(launch) P(h | launch), and for
    none of these P(none) + P(launch) P(none | launch).
    """
    probability = groups[:, LAUNCH, None] * given_launch
    for column, one in enumerate(hypotheses):
        if not one.is_launch:
            probability[:, column] += groups[:, _COLUMNS[one.group]]
    return probability


def given_types(hypotheses: Sequence[Hypothesis], types: FloatArray) -> FloatArray:
    """Return probabilities (n, H) given a launch from probabilities (n, types) of `REPORTED_TYPES`.

    The classes of a reported type share it equally; what is unknown, all target classes do.
    """
    launches = np.array([one.is_launch for one in hypotheses])
    kind = _reported_codes(hypotheses)
    share = np.zeros((len(types), len(hypotheses)))
    for code in range(len(REPORTED_TYPES)):
        own = launches & (kind == code)
        mine = launches if code == UNKNOWN_TYPE or not own.any() else own
        share[:, mine] += types[:, code, None] / max(int(mine.sum()), 1)
    return share


def _reported_codes(hypotheses: Sequence[Hypothesis]) -> IntArray:
    return np.array([REPORTED_TYPES.index(one.reported_type) for one in hypotheses])


def with_hypotheses(
    tracks: Tracks, hypotheses: Sequence[Hypothesis], groups: FloatArray, given_launch: FloatArray
) -> Tracks:
    """Return tracks with the probabilities of hypotheses, their sums, and the types that these are reported as."""
    probability = hypothesis_probabilities(hypotheses, groups, given_launch)
    of_group = np.array([one.group for one in hypotheses])
    kind = _reported_codes(hypotheses)
    types = np.stack([probability[:, kind == code].sum(axis=1) for code in range(len(REPORTED_TYPES))], axis=1)
    return evolve(
        tracks,
        hypothesis_probability=probability,
        probability_launch=probability[:, [one.is_launch for one in hypotheses]].sum(axis=1),
        probability_missile=probability[:, of_group == "missile"].sum(axis=1),
        probability_orbit=probability[:, of_group == "orbit"].sum(axis=1),
        type_probability=types,
    )
