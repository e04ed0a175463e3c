"""The probabilities of a scene's hypotheses, from those of the groups and of the target classes
given a launch.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.plugin import REPORTED_TYPES, Hypothesis
from opir_trackers.onset.motion_statistics import BOLIDE, GROUND, LAUNCH, NOISE, NONE

#: Columns of group probabilities by the groups of hypotheses other than launches.
_COLUMNS = {"noise": NOISE, "ground": GROUND, "bolide": BOLIDE, "none": NONE}

#: Groups of launches whose sums tracks have, after those of reported types.
_SUMMED = ("missile", "orbit")


@frozen(eq=False)
class Composition:
    """Probabilities of hypotheses: P(h) = P(group) for what is no launch, P(launch) P(h | launch)
    for target classes.

    `of_groups` (5, H) takes group probabilities to hypotheses; `sums` (H, types + 2) are the sums
    that tracks have: reported types, missiles, orbits.
    """

    of_groups: FloatArray
    sums: FloatArray

    @classmethod
    def of(cls, hypotheses: Sequence[Hypothesis]) -> "Composition":
        """Return the composition of a scene's hypotheses."""
        kind = np.array(
            [REPORTED_TYPES.index(hypothesis.reported_type) for hypothesis in hypotheses]
        )
        of_groups = np.zeros((len(_COLUMNS) + 1, len(hypotheses)))
        for place, hypothesis in enumerate(hypotheses):
            if not hypothesis.is_launch:
                of_groups[_COLUMNS[hypothesis.group], place] = 1.0
        sums = [kind == code for code in range(len(REPORTED_TYPES))]
        sums += [
            np.array([hypothesis.group == group for hypothesis in hypotheses]) for group in _SUMMED
        ]
        return cls(of_groups, np.array(sums, dtype=np.float64).T)

    def probabilities(self, groups: FloatArray, given_launch: FloatArray) -> FloatArray:
        """Return the probabilities (n, H) of hypotheses from those of groups (n, 5) and those given
        a launch (n, H).

        `given_launch` is over target classes and "none of these", whose probability is P(none) +
        P(launch) P(none | launch).
        """
        return _products(groups, self.of_groups) + groups[:, LAUNCH, None] * given_launch

    def columns(self, groups: FloatArray, given_launch: FloatArray) -> dict[str, Any]:
        """Return the columns of tracks with the probabilities of hypotheses, their sums, and the
        types that these are reported as.

        That of a launch includes what was launched and is none of the known classes.
        """
        probability = self.probabilities(groups, given_launch)
        sums = _products(probability, self.sums)
        types = len(REPORTED_TYPES)
        return {
            "hypothesis_probability": probability,
            "probability_launch": groups[:, LAUNCH],
            "probability_missile": sums[:, types],
            "probability_orbit": sums[:, types + 1],
            "type_probability": sums[:, :types],
        }


def _products(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Return the products (n, k) of rows with a matrix, each row on its own."""
    return (rows[:, None, :] @ matrix)[:, 0]
