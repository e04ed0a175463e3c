"""The law of boosts of the tracker `imm` with the core's hypotheses, for tests of its forecast."""

from opir_forecast.ascents import ascents_of
from opir_forecast.outcomes import Outcomes
from opir_forecast.vehicles import FAMILIES, StageRow, vehicle_model

from opir_core.scene import core_hypotheses

MODEL = vehicle_model()
STAGES = MODEL.stages.shape[1]
MISSILE, SPACE, NONE = range(len(FAMILIES))
BURN, FORCE, RATIO, GAP = StageRow
HYPOTHESES = core_hypotheses()
NAMES = [hypothesis.name for hypothesis in HYPOTHESES]
OUTCOMES = Outcomes(MODEL, HYPOTHESES)
ASCENTS = ascents_of(OUTCOMES)
