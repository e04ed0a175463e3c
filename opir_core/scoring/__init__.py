"""Scores of tracks against truth: errors, consistency, bounds, containment, completeness, purity, GOSPA.

Truth enters here and nowhere else beside tracks; no tracker imports this.
"""

from opir_core.scoring.evidence import RunEvidence, evidence_of_run
from opir_core.scoring.scorecard import Scorecard, scorecard

__all__ = ["RunEvidence", "Scorecard", "evidence_of_run", "scorecard"]
