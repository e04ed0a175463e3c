"""Data association of lines of sight with tracks: one line per track and scan, one track per
line.
"""

from typing import NamedTuple

import numpy as np
from attrs import Factory, evolve, field, frozen
from opir_estimation import (
    FEW_PAIRS,
    AngleMeasurements,
    GatedPairs,
    LinesOfSight,
    PredictedMeasurements,
    cheapest_assignment,
    dot,
    group_sums,
    ranks,
    scan_numbers,
    tangent_axes,
    unambiguous,
)

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray

_UNIT = np.eye(2)


class NearestLines(NamedTuple):
    """The track of each line of sight (m,), -1 for none, and the assigned pairs.

    `is_ambiguous` is False where no line had two candidate tracks and no track two lines of one
    scan.
    """

    owner: IntArray
    assigned: GatedPairs
    is_ambiguous: bool


def _log_odds(model: "AssociationModel") -> FloatArray:
    return np.log(
        model.detection_probability
        / ((1.0 - model.detection_probability) * 2.0 * np.pi * model.clutter_per_sr)
    )


@frozen
class AssociationModel:
    """Detection probability per look, by sensor, and clutter density per scan, 1/sr.

    `log_odds` are the logarithms of P_d over (1 - P_d) times the clutter in 2π sr, by sensor.
    """

    detection_probability: FloatArray
    clutter_per_sr: float
    log_odds: FloatArray = field(default=Factory(_log_odds, takes_self=True), init=False)

    def log_ratio(self, pairs: GatedPairs, lines: LinesOfSight) -> FloatArray:
        """Return the log likelihood ratio (n,) of pairs to a miss and a false alarm."""
        return self.log_odds.take(lines.sensor.take(pairs.line)) - 0.5 * (
            pairs.distance + pairs.log_volume
        )


def scan_groups(pairs: GatedPairs, lines: LinesOfSight) -> IntArray:
    """Return the group (n,) of each pair's track, sensor and scan; a track takes at most one line
    per group.
    """
    scan = scan_numbers(lines.sensor, lines.scan)
    return ranks(pairs.track * (int(scan.max(initial=0)) + 1) + scan[pairs.line])


def ambiguous_tracks(pairs: GatedPairs, lines: LinesOfSight) -> IntArray:
    """Return the sorted tracks that share a line with another track or have several lines of one
    scan.
    """
    rivals = ~unambiguous(scan_groups(pairs, lines), pairs.line)
    return np.bincount(pairs.track[rivals]).nonzero()[0]


def is_unambiguous(pairs: GatedPairs, lines: LinesOfSight) -> bool:
    """Return whether a quick test shows that no line has two candidate tracks and no track two
    lines of a scan.
    """
    line = pairs.line.tolist()
    count = lines.scan.size
    if pairs.line.size > FEW_PAIRS or len(set(line)) < pairs.line.size:
        return False
    if (
        count <= FEW_PAIRS
        and len(set(zip(lines.sensor.tolist(), lines.scan.tolist(), strict=True))) == count
    ):
        return True
    sensor = lines.sensor.take(pairs.line).tolist()
    scan = lines.scan.take(pairs.line).tolist()
    return len(set(zip(pairs.track.tolist(), sensor, scan, strict=True))) == pairs.line.size


def unassigned(count: int) -> IntArray:
    """Return owners (n,) of lines that are all unassigned: -1."""
    owner = np.empty(count, dtype=np.int64)
    owner.fill(-1)
    return owner


def associate_nearest(
    pairs: GatedPairs, lines: LinesOfSight, model: AssociationModel
) -> NearestLines:
    """Return the assignment of each scan by global nearest neighbour."""
    lone = lone_lines(pairs, lines, model)
    if lone is not None:
        return lone
    ratio = model.log_ratio(pairs, lines)
    is_chosen = cheapest_assignment(scan_groups(pairs, lines), pairs.line, -ratio)
    return _of_chosen(pairs, lines, is_chosen, is_ambiguous=True)


def lone_lines(
    pairs: GatedPairs, lines: LinesOfSight, model: AssociationModel
) -> NearestLines | None:
    """Return the assignment of lines without a choice, None where there may be one."""
    if not is_unambiguous(pairs, lines):
        return None
    is_likely = model.log_ratio(pairs, lines) > 0.0
    return _of_chosen(pairs, lines, is_likely, is_ambiguous=False)


def _of_chosen(
    pairs: GatedPairs, lines: LinesOfSight, is_chosen: BoolArray, *, is_ambiguous: bool
) -> NearestLines:
    assigned = pairs.take(is_chosen.nonzero()[0]) if False in is_chosen else pairs
    owner = unassigned(lines.scan.size)
    owner[assigned.line] = assigned.track
    return NearestLines(owner, assigned, is_ambiguous)


def merged(pairs: GatedPairs, sensor: IndexArray, path: PredictedMeasurements) -> GatedPairs:
    """Return one pair (k,) of each track and sensor in each half second of a slice: the mean of
    theirs, `sensor` (n,).

    A target's path bends by 1 m in half of that.
    """
    interval = np.ceil((path.time_s - pairs.time_s) / 0.5).astype(np.int64)
    interval -= interval.min(initial=0)
    key = pairs.track * (int(sensor.max(initial=0)) + 1) + sensor
    group = ranks(key * (int(interval.max(initial=0)) + 1) + interval)
    count = int(group.max(initial=-1)) + 1
    if count == len(pairs):
        return pairs
    weight = 1.0 / np.square(pairs.sigma_rad)
    total = np.bincount(group, weight)
    share = weight / total[group]
    columns = np.column_stack([pairs.time_s, pairs.origin_m, pairs.measured])
    mean = group_sums(group, share[:, None] * columns)
    newest = np.empty(count, dtype=np.int64)
    newest[group] = np.arange(len(group))
    origin = mean[:, 1:4]
    along = path.positions(pairs.track[newest], mean[:, 0]) - origin
    return evolve(
        pairs.take(newest),
        time_s=mean[:, 0],
        origin_m=origin,
        axes=tangent_axes(along / np.sqrt(dot(along, along))[:, None]),
        measured=mean[:, 4:],
        sigma_rad=1.0 / np.sqrt(total),
    )


def hard_measurements(pairs: GatedPairs) -> AngleMeasurements:
    """Return pairs as measurements with association probability 1."""
    return pairs.measurements(pairs.measured, _UNIT / pairs.sigma_rad[:, None, None])
