"""How soon the burns of known stages end in the dark, given how long they have burned."""

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_forecast.particles import LAW as PARTICLES
from opir_forecast.present_burn import PresentBurns, present_burns
from opir_forecast.vehicles import LAW, STAGES, VehicleModel, VehicleStages

#: Rate of burns that do not end, 1/s: its logarithm is finite.
LEAST_RATE = 1e-30


@frozen(eq=False)
class StageEndings:
    """Stages of vehicles (n,) of a law, by their families (n,)."""

    model: VehicleModel
    family: IntArray
    stages: VehicleStages

    def log_rates(self, vehicle: IntArray, since_s: FloatArray) -> FloatArray:
        """Return the logarithms of the rates (m,), 1/s, at which burns of vehicles (m,) end at
        times since their first ignitions (m,), s, and nothing ignites at once.

        A stage moves as each other one of its first acceleration and growth, until the shorter one
        ends: what it shows so far leaves the law of its burn time.
        """
        starts_s = self.stages.starts_s[vehicle]
        stage = np.maximum(np.sum(starts_s <= since_s[:, None], axis=1) - 1, 0)
        age_s = since_s - starts_s[np.arange(len(stage)), stage]
        burns = self._present(vehicle, stage, np.maximum(age_s, PARTICLES.least_since_s))
        rate = burns.cells[:, 0] * LAW.cells / (burns.longest_s - burns.since_s)
        later = np.minimum(stage + 1, STAGES - 1)
        is_hot = self.stages.gap_s[vehicle, later] == 0.0
        is_followed = (self.stages.burn_s[vehicle, later] > 0.0) & (later > stage)
        return np.log(np.where(is_hot & is_followed, 0.0, rate) + LEAST_RATE)

    def _present(self, vehicle: IntArray, stage: IntArray, age_s: FloatArray) -> PresentBurns:
        """Return the stages (m,) of vehicles (m,), of ages (m,)."""
        first = self.stages.first_m_s2[vehicle, stage]
        rate = self.stages.growth_per_s[vehicle, stage]
        mass = np.maximum(1.0 - rate * age_s, LAW.least_mass)
        nothing = np.zeros((len(stage), 4))
        law = self.model.law(self.family[vehicle], stage, nothing, nothing)
        highest_m_s2 = self.model.data["highest_m_s2"]
        return present_burns(first / mass, rate / mass, age_s, law, highest_m_s2)
