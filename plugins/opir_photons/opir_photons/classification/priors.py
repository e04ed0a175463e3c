"""Priors before any measurement: the share of each class among launches."""

import math
from collections import Counter
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
    """Return the share of launches (n,) of each hypothesis, 0 for hypotheses of no launch.

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
    return _usual_shares(hypotheses)


def _usual_shares(hypotheses: Sequence[Hypothesis]) -> FloatArray:
    """Return the share of launches (n,) of each hypothesis by `GROUP_SHARES`."""
    launches = [
        (hypothesis.group, hypothesis.reported_type)
        for hypothesis in hypotheses
        if hypothesis.is_launch
    ]
    groups = Counter(group for group, _ in set(launches))
    classes_of = Counter(launches)
    share = np.zeros(len(hypotheses))
    for row, hypothesis in enumerate(hypotheses):
        if hypothesis.is_launch:
            group = hypothesis.group
            of_type = classes_of[group, hypothesis.reported_type]
            share[row] = GROUP_SHARES[group] / groups[group] / of_type
    return share / max(math.fsum(GROUP_SHARES[group] for group in groups), 1e-300)


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
        classes = [hypotheses[row].target_class for row in expected]
        flights, numbers_of = flights_of([kind for kind in classes if kind])
        share = np.zeros((len(hypotheses), len(flights)))
        for row, numbers in zip(expected, numbers_of, strict=True):
            share[row, numbers] = shares[row] / len(numbers)
        return cls(hypotheses, flights, share)

    def log_shares_of(self, types: Sequence[str]) -> FloatArray:
        """Return ln (n,) of the shares of launches of reported types."""
        is_of_type = [
            [
                hypothesis.is_launch and hypothesis.reported_type == name
                for hypothesis in self.hypotheses
            ]
            for name in types
        ]
        with np.errstate(divide="ignore"):
            return np.log([self.share[rows].sum() for rows in is_of_type])
