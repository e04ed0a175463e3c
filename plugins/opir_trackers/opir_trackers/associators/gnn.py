"""The associator `gnn`: the most likely one-to-one assignment of each scan (global nearest
neighbour).
"""

from typing import Any

from opir_trackers.association import ambiguous_tracks
from opir_trackers.parts import Association, AssociationProblem, Associator, PartContext


class NearestAssociator(Associator):
    """Global nearest neighbour."""

    def associate(self, problem: AssociationProblem) -> Association:
        """Return the association of a slice's lines with the predicted tracks."""
        lines = problem.lines
        nearest = problem.nearest
        if not nearest.is_ambiguous:
            return Association(lines=lines, owner=nearest.owner, pairs=nearest.assigned)
        doubtful = ambiguous_tracks(problem.pairs, lines)
        return Association(
            lines=lines, owner=nearest.owner, pairs=nearest.assigned, doubtful=doubtful
        )


def nearest_associator(_config: Any, _context: PartContext) -> NearestAssociator:
    """Return the associator `gnn`."""
    return NearestAssociator()
