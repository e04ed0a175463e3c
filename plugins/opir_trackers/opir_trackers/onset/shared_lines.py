"""What lines that several tracks share say of each one's motion.

The label of an association follows the track: where flares stand side by side, a track that seems
to rise takes the lines that rise with it. So the motion statistics ask the group first. Its lines
are explained by as many places that stand as it has tracks, with the labels summed out; each place
takes of a line the probability that it is its own. What no place explains is the owner's.

Labels by places that do not change show no motion of what stands, even where the places are wrong:
each takes the same share of the same lines at all times. And with labels by places that stand, the
sums give a lower bound on the evidence for a motion of one track (Jensen's inequality: Neal and
Hinton, in "Learning in Graphical Models", 1998), which is tight where the labels are sure: a launch
is known once it has left the places. So the places are those of the lines before the statistics
began anew, which those of a young group do some times, as rounds of expectation maximisation.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import (
    LinesOfSight,
    PredictedMeasurements,
    SharedLooks,
    ground_velocities,
    place_probabilities,
)

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.onset.motion_statistics import MotionStatistics

#: Derivatives of a path, and the size of its covariance root.
_DERIVATIVES = 5
_SIZE = 12


@frozen
class SharingLaw:
    """How groups of tracks that share lines settle."""

    #: A round of a young group ends after this number of lines of a track: its place is then known
    #: to a sixth of the error of a line.
    round_lines: float = 40.0

    #: Rounds begin up to this age of a track, s: places of groups of eight within 1 km have then
    #: found their sources.
    young_s: float = 4.0

    #: A line that is less probably of a place than this says nothing of it.
    least_probability: float = 0.01


LAW = SharingLaw()


class OwnedLines(NamedTuple):
    """Lines of sight (m,), the rows (m,) of the tracks whose motion they tell, -1 for none, and the
    probabilities (m,) that they do.
    """

    lines: LinesOfSight
    owner: IntArray
    probability: FloatArray


def path_of_places(
    position_m: FloatArray, covariance: FloatArray, time_s: float
) -> PredictedMeasurements:
    """Return the predictions of sources that stand at inertial positions (n, 3) at a time, with
    covariances (n, 3, 3).
    """
    count = len(position_m)
    derivative = np.zeros((count, _DERIVATIVES, 3))
    derivative[:, 0] = position_m
    derivative[:, 1] = ground_velocities(position_m)
    root = np.zeros((count, _SIZE, _SIZE))
    root[:, :3, :3] = np.linalg.cholesky(covariance)
    return PredictedMeasurements(time_s, derivative, root)


def shared_lines(
    looks: SharedLooks,
    path: PredictedMeasurements,
    rows: IntArray,
    owned: OwnedLines,
    *,
    light_time: bool,
) -> OwnedLines:
    """Return what lines say of tracks `rows` (k,) that may stand at the places of a path, by the
    `looks` at these; `owned` are the lines by the association. Those of other tracks stay theirs.
    """
    pairs = looks.pairs
    probability = place_probabilities(looks, path, light_time=light_time)
    explained = np.bincount(pairs.line, probability, minlength=len(owned.owner))
    is_shared = np.isin(owned.owner, rows)
    share = np.where(is_shared, np.clip(1.0 - explained, 0.0, 1.0), owned.probability)
    remaining = np.flatnonzero((owned.owner >= 0) & (share > LAW.least_probability))
    likely = np.flatnonzero(probability > LAW.least_probability)
    return OwnedLines(
        owned.lines.take(np.concatenate([pairs.line[likely], remaining])),
        np.concatenate([rows[pairs.track[likely]], owned.owner[remaining]]),
        np.concatenate([probability[likely], share[remaining]]),
    )


def settled(
    motion: MotionStatistics, rows: IntArray, first_s: FloatArray, time_s: float
) -> MotionStatistics:
    """Return the statistics after a slice in which tracks `rows` (k,) shared lines: those whose
    round is over have begun anew. `first_s` (n,) are the times of the first detections.
    """
    if not rows.size:
        return motion
    motion = motion.sharing(rows)
    is_young = motion.epoch_s[rows] < first_s[rows] + LAW.young_s
    is_over = is_young & (motion.lines[rows] >= LAW.round_lines) & ~motion.is_decided[rows]
    if not is_over.any():
        return motion
    return motion.restarted(rows[is_over], time_s, adds_up=False)
