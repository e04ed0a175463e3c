"""What a bank remembers, with which hypotheses are linearised anew anywhere else."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_trackers.profile import fit
from opir_trackers.profile.family import Family, Priors
from opir_trackers.profile.fit import Hypotheses, Solved
from opir_trackers.profile.hypotheses import joined
from opir_trackers.profile.rows import Rows
from opir_trackers.profile.seen import TrackHistory


@frozen(eq=False)
class FitMemory:
    """All rows of tracks, what was seen of them, the priors of their classes and the biases (sensors,) of sensors."""

    rows: Rows
    seen: TrackHistory
    priors: Priors
    bias_sigma_rad: FloatArray

    def linearised(self, hypotheses: Hypotheses) -> tuple[Hypotheses, Family, Solved]:
        """Return hypotheses with all their rows, linearised where they stand, their paths, and the solutions."""
        family = fit.family_of(hypotheses, self.priors)
        row, owner = joined(hypotheses.track, self.rows.track)
        found = fit.with_rows(hypotheses.cleared(), family, self.rows.take(row), owner, np.ones(len(row)))
        return found, family, fit.solved(found, self.priors, self.bias_sigma_rad)
