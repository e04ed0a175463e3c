"""Scores of tracks against truth: errors, consistency, bounds, containment, completeness, purity, GOSPA.

Only scores compare tracks with truth; no tracker imports this package.
"""

from opir_core.scoring.containments import Consistency, consistency, containment, nees
from opir_core.scoring.evidence import Ownership, RunEvidence, evidence_of_files, evidence_of_run, ownership
from opir_core.scoring.gospa_metric import Gospa, gospa
from opir_core.scoring.impacts import ImpactScores, impact_scores
from opir_core.scoring.scorecards import Scorecard, ScoreSettings, scorecard

__all__ = [
    "Consistency",
    "Gospa",
    "ImpactScores",
    "Ownership",
    "RunEvidence",
    "ScoreSettings",
    "Scorecard",
    "consistency",
    "containment",
    "evidence_of_files",
    "evidence_of_run",
    "gospa",
    "impact_scores",
    "nees",
    "ownership",
    "scorecard",
]
