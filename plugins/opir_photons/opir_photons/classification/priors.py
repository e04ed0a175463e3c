"""What is to be expected before anything is measured: the share of each class among launches."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, nearest
from opir_core.plugin import Hypothesis
from opir_photons.classification.synthetic_looks import ClassFlight, flights_of

#: Shares of launches by group; notional, for a scene of warning. In a year of peace space launches
#: are most of them: about 260 in 2024 (J. McDowell, Space Activities in 2024).
GROUP_SHARES: Mapping[str, float] = {"missile": 0.85, "orbit": 0.1, "glide": 0.05}


def launch_shares(prior: Mapping[str, float], hypotheses: Sequence[Hypothesis]) -> FloatArray:
    """Return the share of launches (n,) of each hypothesis, 0 for what is no launch.

    Without a `prior` the groups that there are have `GROUP_SHARES`, the missile types equal shares
    of theirs, and so the classes of each type. Raises `ModelError` for a name that is no class.
    """
    classes = [hypothesis.name for hypothesis in hypotheses if hypothesis.is_launch]
    unknown = next((name for name in prior if name not in classes), None)
    if unknown is not None:
        raise ModelError(
            f"classification: prior: {unknown!r} is no target class{nearest(unknown, classes)};"
            f" these are {', '.join(classes)}"
        )
    if prior:
        return np.array([prior.get(hypothesis.name, 0.0) for hypothesis in hypotheses])
    cells = [(each.group, each.reported_type) if each.is_launch else None for each in hypotheses]
    types = {cell for cell in cells if cell is not None}
    total = math.fsum(GROUP_SHARES[group] for group in {group for group, _ in types})
    share = [
        0.0
        if cell is None
        else GROUP_SHARES[cell[0]] / sum(other[0] == cell[0] for other in types) / cells.count(cell)
        for cell in cells
    ]
    return np.array(share) / max(total, 1e-300)


@frozen(eq=False)
class LaunchPrior:
    """The hypotheses, the flights of those that are expected, and the share of launches of each
    flight (hypotheses, flights).
    """

    hypotheses: tuple[Hypothesis, ...]
    flights: tuple[ClassFlight, ...]
    share: FloatArray

    @classmethod
    def of(cls, prior: Mapping[str, float], hypotheses: tuple[Hypothesis, ...]) -> "LaunchPrior":
        """Return the prior of settings; flights of a class are equally frequent, a class without a
        share flies none.
        """
        shares = launch_shares(prior, hypotheses)
        expected = np.flatnonzero(shares).tolist()
        flights, own = flights_of(
            [each.target_class for row in expected if (each := hypotheses[row]).target_class]
        )
        share = np.zeros((len(hypotheses), len(flights)))
        for row, numbers in zip(expected, own, strict=True):
            share[row, numbers] = shares[row] / len(numbers)
        return cls(hypotheses, flights, share)

    def log_shares_of(self, types: Sequence[str]) -> FloatArray:
        """Return ln (n,) of the shares of launches of reported types."""
        kinds = [each.reported_type if each.is_launch else "" for each in self.hypotheses]
        of_type = [[kind == name for kind in kinds] for name in types]
        with np.errstate(divide="ignore"):
            return np.log([self.share[rows].sum() for rows in of_type])
