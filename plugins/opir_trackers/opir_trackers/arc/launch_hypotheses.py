"""What a launch may be, by its arc: the types by range, and the tracker's prior for what an arc
does not tell.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from opir_forecast import Outcomes, vehicle_model

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import REPORTED_TYPES, Hypothesis


@frozen(eq=False)
class LaunchHypotheses:
    """Probabilities of hypotheses given a launch: rows (types + 1, H) of `REPORTED_TYPES`, and of
    arcs in orbit.
    """

    rows: FloatArray

    @classmethod
    def of(cls, hypotheses: Sequence[Hypothesis]) -> "LaunchHypotheses":
        """Return those of a scene.

        A range separates missiles by type; classes of one type have their prior. It does not
        separate a missile from a glider or a space launch, as an arc through a boost falls short:
        these keep theirs. An arc that does not come down is a space launch or none of these.
        """
        prior = Outcomes(vehicle_model(), tuple(hypotheses)).prior
        group = np.array([hypothesis.group for hypothesis in hypotheses])
        types = np.array([hypothesis.reported_type for hypothesis in hypotheses])
        stays_up = np.where(np.isin(group, ["orbit", "none"]), prior, 0.0)
        rows = [_narrowed(prior, group == "missile", types == name) for name in REPORTED_TYPES]
        return cls(np.array([*rows, stays_up / stays_up.sum() if stays_up.any() else prior]))

    def given_launch(self, types: FloatArray, in_orbit: BoolArray) -> FloatArray:
        """Return probabilities (n, H) by those of `REPORTED_TYPES` (n, types) and which arcs (n,)
        do not come down.
        """
        shares = np.concatenate(
            [np.where(in_orbit[:, None], 0.0, types), in_orbit[:, None]], axis=1
        )
        return (shares[:, None, :] @ self.rows)[:, 0]


def _narrowed(prior: FloatArray, group: BoolArray, kind: BoolArray) -> FloatArray:
    """Return a prior (H,) whose mass on a group is on the group's hypotheses of one kind, if it has
    any.
    """
    selected = np.where(group & kind, prior, 0.0)
    return (
        np.where(group, selected * prior[group].sum() / selected.sum(), prior)
        if selected.any()
        else prior
    )
