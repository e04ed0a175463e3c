"""An associator from outside: each line of sight goes to the nearest track that is free."""

import numpy as np
from opir_trackers import Association, Associator

from opir_core.plugin import TrackerPart, hookimpl


class Nearest(Associator):
    def associate(self, problem):
        pairs = problem.pairs.take(np.argsort(problem.pairs.distance, kind="stable"))
        pairs = pairs.take(np.unique(pairs.line, return_index=True)[1])
        scan = problem.lines.scan[pairs.line]
        looks = np.stack([pairs.track, problem.lines.sensor[pairs.line], scan])
        pairs = pairs.take(np.sort(np.unique(looks, axis=1, return_index=True)[1]))
        owner = np.full(len(problem.lines), -1)
        owner[pairs.line] = pairs.track
        return Association(lines=problem.lines, owner=owner, pairs=pairs)


def nearest(_config, _context):
    return Nearest()


@hookimpl
def opir_tracker_parts():
    yield TrackerPart(
        name="nearest", summary="nearest first", role="association", build=nearest, reads=()
    )
