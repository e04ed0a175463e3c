"""Crowds: tracks with contested lines of sight, each with a track of its own in the focal plane of
every sensor.

A track joins when others have its lines in their gates in enough sensors for the pairing to be
open, when it shares a line with a crowd, or when it begins near another one before two sensors; it
leaves some time after it was last contested. While it is in, its lines are those of its focal-plane
tracks, and its state follows from them.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, field, frozen
from opir_estimation import (
    BOOST,
    ERRORS,
    FAR_M,
    GatedPairs,
    LinesOfSight,
    PredictedMeasurements,
    earth_rotated,
    gated,
    group_maxima,
    group_sums,
    matvec,
    turned_back,
)

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.plugin import Sensor
from opir_trackers.association import AssociationModel, connected_tracks
from opir_trackers.imm import focal_plane
from opir_trackers.imm.focal_plane import FocalPlanePairs, FocalPlaneTracks
from opir_trackers.imm.mixtures import Mixtures
from opir_trackers.pairing import LAW as PAIRING, Directions


@frozen
class CrowdLaw:
    """When tracks join and leave crowds."""

    #: New tracks within this distance of another one, m, may have one another's lines: their
    #: crossings may be ghosts.
    near_m: float = 60e3

    #: A focal-plane track without a line for this time, s, or this many scans ends.
    silent_s: float = 10.0
    silent_scans: float = 4.0

    #: Time after the last contest, s, in which three sensors decide a pairing twice over; two need
    #: the stretch.
    decided_s: float = 10.0

    #: Sensors that fix a state.
    fixing: int = 2

    #: How many neighbours that share a line are compared, in order of their numbers.
    compared: int = 3

    #: Error of the angle of a new focal-plane track beside that of the state, in looks: states may
    #: be of wrong pairings.
    angle_sigmas: float = 0.3


LAW = CrowdLaw()


class SensorView(NamedTuple):
    """The sensors of a scene, the deviation (s,), rad, that is left of their errors, and whether
    light takes time.
    """

    sensors: tuple[Sensor, ...]
    shared_rad: FloatArray
    light_time: bool

    def received_s(self, time_s: float, range_m: FloatArray) -> FloatArray:
        """Return when (n,) light that is received from `FAR_M` at a time is received from ranges
        (n,).
        """
        delay_s: FloatArray = (range_m - FAR_M) / SPEED_OF_LIGHT_M_S * self.light_time
        return time_s + delay_s

    def positions(self, sensor: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the positions (n, 3) in ECEF of sensors (n,) at times (n,)."""
        place = np.empty((len(sensor), 3))
        for number in np.unique(sensor).tolist():
            rows = np.flatnonzero(sensor == number)
            place[rows] = self.sensors[number].orbit.position_ecef_m(time_s[rows])
        return place


@frozen(eq=False)
class Crowds:
    """Focal-plane tracks, their kept directions, the mixtures of undecided pairings, when they were
    last paired, and the errors (s, 3) that were taken off their lines.
    """

    tracks: FocalPlaneTracks = field(factory=FocalPlaneTracks.empty)
    stored: Directions = field(factory=Directions.empty)
    mixtures: Mixtures = field(factory=Mixtures.empty)
    paired_s: float = -np.inf
    errors: FloatArray = field(factory=lambda: np.zeros((1, ERRORS)))

    @property
    def are_there(self) -> bool:
        """Whether any track is in a crowd."""
        return self.tracks.number.size > 0

    def holds(self, number: IntArray) -> BoolArray:
        """Return which tracks (n,) are in a crowd."""
        return np.isin(number, self.tracks.number)

    def follows(self, number: IntArray, sensors: int) -> BoolArray:
        """Return in which sensors (n, sensors) tracks `number` (n,), ascending, have a focal-plane
        track.
        """
        table = np.zeros((len(number), sensors), dtype=bool)
        table[np.searchsorted(number, self.tracks.number), self.tracks.sensor] = True
        return table

    def without(self, number: IntArray) -> "Crowds":
        """Return the crowds without tracks."""
        if not self.are_there:
            return self
        return evolve(
            self,
            tracks=self.tracks.take(np.flatnonzero(~np.isin(self.tracks.number, number))),
            stored=self.stored.take(np.flatnonzero(~np.isin(self.stored.number, number))),
            mixtures=self.mixtures.take(np.flatnonzero(~np.isin(self.mixtures.number, number))),
        )


class CrowdUpdate(NamedTuple):
    """Crowds after a slice, the track number of each line (m,), -1 for none, and equivalent lines
    and their numbers.
    """

    crowds: Crowds
    number: IntArray
    equivalent: LinesOfSight
    of: IntArray


def contested_tracks(
    track: IntArray, line: IntArray, sensor: IndexArray, seen: BoolArray
) -> IntArray:
    """Return the sorted rows of tracks whose pairing gated pairs (m,) leave open.

    `sensor` (m,) is that of the lines, `seen` (n, sensors) which sensors see which track. Two
    sensors that resolve two tracks fix both states, and these separate the lines of other sensors.
    So two tracks that share lines are contested where fewer than two sensors resolve both.
    """
    order = np.lexsort((track, line))
    keys = _shared_keys(track[order], line[order], sensor[order], seen.shape)
    pair, shared_in = np.unique(keys // seen.shape[1], return_counts=True)
    row, neighbour = divmod(pair, max(len(seen), 1))
    resolved_in = np.count_nonzero(seen[row] & seen[neighbour], axis=1) - shared_in
    is_open = resolved_in < LAW.fixing
    return np.unique(np.concatenate([row[is_open], neighbour[is_open]]))


def _shared_keys(
    track: IntArray, line: IntArray, sensor: IndexArray, shape: tuple[int, ...]
) -> IntArray:
    """Return the distinct keys of two tracks and a sensor in which they share a line, of pairs (m,)
    in order of lines.
    """
    count, sensors = shape
    keys = [np.empty(0, dtype=np.int64)]
    for lag in range(1, LAW.compared + 1):
        shared = np.flatnonzero(line[lag:] == line[:-lag])
        keys.append((track[shared] * count + track[shared + lag]) * sensors + sensor[shared])
    return np.unique(np.concatenate(keys))


class CrowdPairs(NamedTuple):
    """Focal-plane tracks at the start of a slice, and the pairs with its lines within their
    gates.
    """

    tracks: FocalPlaneTracks
    pairs: FocalPlanePairs


def paired(
    tracks: FocalPlaneTracks, start_s: float, lines: LinesOfSight, span: float, gate: float
) -> CrowdPairs:
    """Return focal-plane tracks and their pairs with the lines of a slice of length `span`."""
    tracks = tracks.predicted(start_s)
    candidates = focal_plane.candidate_pairs(tracks, lines, span, gate)
    return CrowdPairs(tracks, focal_plane.gated_pairs(tracks, lines, *candidates, gate))


def updated_crowds(
    crowds: Crowds,
    focal_pairs: CrowdPairs,
    lines: LinesOfSight,
    end_s: float,
    model: AssociationModel,
    gate: float,
    view: SensorView,
) -> CrowdUpdate:
    """Return the crowds after the lines of a slice that ends at `end_s`."""
    tracks = focal_pairs.tracks
    update = focal_plane.updated(tracks, lines, focal_pairs.pairs, model, gate)
    tracks_now = _with_contested(update.tracks.predicted(end_s), update.pairs, lines.sensor, end_s)
    new_directions = _mean_directions(tracks_now, update.equivalent, update.row, end_s, view)
    recent = np.flatnonzero(crowds.stored.time_s > end_s - PAIRING.kept_s)
    stored = Directions.concatenate([crowds.stored.take(recent), new_directions])
    number = np.append(tracks.number, -1)
    return CrowdUpdate(
        evolve(crowds, tracks=tracks_now, stored=stored),
        number[update.owner],
        update.equivalent,
        tracks.number[update.row],
    )


def corrected_crowds(crowds: Crowds, errors: FloatArray, view: SensorView) -> Crowds:
    """Return the crowds after the errors (s, 3) that are taken off lines of sight have changed.

    Kept directions share their instants: clocks move focal-plane tracks alone.
    """
    change = errors - crowds.errors
    crowds = evolve(crowds, errors=errors)
    if not change.any():
        return crowds
    tracks = crowds.tracks
    stored = crowds.stored
    changes = change[tracks.sensor]
    origin = view.positions(tracks.sensor, tracks.time_s)
    axes = np.stack([turned_back(tracks.axes[:, row], origin, changes) for row in range(3)], axis=1)
    right = turned_back(stored.direction_ecef, stored.origin_ecef_m, change[stored.sensor])
    tracks = evolve(tracks, axes=axes, time_s=tracks.time_s - changes[:, 2])
    return evolve(crowds, tracks=tracks, stored=evolve(stored, direction_ecef=right))


def _with_contested(
    tracks: FocalPlaneTracks, pairs: FocalPlanePairs, sensor: IndexArray, time_s: float
) -> FocalPlaneTracks:
    """Return the tracks with the time at which they, or one they are connected to by shared lines,
    were contested.
    """
    number, track_row = np.unique(tracks.number, return_inverse=True)
    visible = np.zeros((len(number), int(tracks.sensor.max(initial=0)) + 1), dtype=bool)
    visible[track_row, tracks.sensor] = True
    of_pair = track_row[pairs.row]
    rows = contested_tracks(of_pair, pairs.line, sensor[pairs.line], visible)
    if not len(rows):
        return tracks
    is_open = connected_tracks(of_pair, pairs.line, rows)
    is_open = np.append(is_open, np.zeros(len(number) - len(is_open), dtype=bool))
    return evolve(tracks, contested_s=np.where(is_open[track_row], time_s, tracks.contested_s))


def _mean_directions(
    tracks: FocalPlaneTracks, lines: LinesOfSight, row: IntArray, end_s: float, view: SensorView
) -> Directions:
    """Return one direction of each row with equivalent lines: their mean about the row's path, at
    its end.

    Light of the same instant reaches sensors at different times: directions are those of light that
    left the target when light from `FAR_M`, received at `end_s`, did.
    """
    if not len(row):
        return Directions.empty()
    local = matvec(tracks.axes.take(row, axis=0), lines.direction_ecef)
    off = local[:, :2] / local[:, 2:] - tracks.places(row, lines.time_s)[0]
    weight = 1.0 / np.square(lines.sigma_rad)
    total = np.bincount(row, weight, len(tracks))
    have = np.flatnonzero(total)
    mean = group_sums(row, weight[:, None] * off, len(tracks))[have]
    sigma = np.hypot(1.0 / np.sqrt(total[have]), view.shared_rad[tracks.sensor[have]])
    return directions_at(tracks, have, end_s, view, mean / total[have, None], sigma)


def directions_at(
    tracks: FocalPlaneTracks,
    row: IntArray,
    time_s: float,
    view: SensorView,
    off: FloatArray | float = 0.0,
    sigma_rad: FloatArray | None = None,
) -> Directions:
    """Return the directions of rows (m,) at a time, shifted by angles (m, 2); errors by default
    those of the rows.
    """
    received_s = view.received_s(time_s, tracks.range_m[row])
    place, variance = tracks.places(row, received_s)
    origin = view.positions(tracks.sensor[row], received_s)
    sigma = np.sqrt(variance) if sigma_rad is None else sigma_rad
    when = np.full(len(row), time_s)
    return Directions(
        tracks.number[row],
        tracks.sensor[row],
        when,
        origin,
        tracks.directions(row, place + off),
        sigma,
    )


def joined(
    crowds: Crowds,
    number: IntArray,
    rows: IntArray,
    predicted: PredictedMeasurements,
    seen: BoolArray,
    view: SensorView,
) -> Crowds:
    """Return the crowds with tracks `rows` of predictions, `number` (n,) and `seen` (n, sensors) as
    new ones.
    """
    row, sensor = np.nonzero(seen[rows])
    if not len(row):
        return crowds
    row = rows[row]
    time_s = predicted.time_s
    motion = _motion(predicted, row, sensor, view)
    turn = earth_rotated(np.eye(3), np.full(3, -time_s)).T
    roots = turn @ predicted.root[row].reshape(len(row), 4, 3, BOOST)[:, :3]
    sigmas = np.array([part.line_of_sight_sigma_rad for part in view.sensors])
    noise = LAW.angle_sigmas * sigmas[sensor]
    begun = focal_plane.begun(number[row], sensor, time_s, motion, roots, noise)
    if crowds.are_there:
        # A sensor more does not contest a track anew.
        known_rows = np.searchsorted(number, crowds.tracks.number)
        last_s = group_maxima(known_rows, crowds.tracks.contested_s, len(number))[row]
        begun = evolve(begun, contested_s=np.where(np.isfinite(last_s), last_s, time_s))
    return evolve(crowds, tracks=FocalPlaneTracks.concatenate([crowds.tracks, begun]))


def _motion(
    predicted: PredictedMeasurements, row: IntArray, sensor: IntArray, view: SensorView
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the vectors (m, 3) from sensors to tracks `row` (m,), in ECEF, and two
    derivatives.
    """
    delay_s = FAR_M / SPEED_OF_LIGHT_M_S * view.light_time
    offsets = []
    for step in (-1.0, 0.0, 1.0):
        received_s = np.full(len(row), predicted.time_s + step)
        emitted_s = np.full(len(row), predicted.time_s + step - delay_s)
        position = earth_rotated(predicted.positions(row, emitted_s), -emitted_s)
        offsets.append(position - view.positions(sensor, received_s))
    start, middle, end = offsets
    return middle, 0.5 * (end - start), end - 2.0 * middle + start


def begun_near(position_m: FloatArray, new_count: int, visible: BoolArray) -> IntArray:
    """Return the rows of tracks, at positions (n, 3) of which the last `new_count` are new,
    that are near a new one.

    Only tracks that at most two sensors see, by `visible` (n, sensors), count: lines of three do
    not cross by chance.
    """
    from scipy.spatial import cKDTree

    candidates = np.flatnonzero(np.count_nonzero(visible, axis=1) <= LAW.fixing)
    new = candidates[candidates >= len(position_m) - new_count]
    if len(candidates) < 2 or not len(new):
        return np.empty(0, dtype=np.int64)
    neighbours = cKDTree(position_m[candidates]).query_ball_point(position_m[new], LAW.near_m)
    crowd = [row for group in neighbours if len(group) > 1 for row in group]
    return candidates[np.unique(np.array(crowd, dtype=np.int64))]


def equivalent_pairs(
    update: CrowdUpdate, number: IntArray, predicted: PredictedMeasurements, light_time: bool
) -> GatedPairs:
    """Return the equivalent lines as pairs with their tracks, rows of `number` (n,), ascending."""
    row = np.searchsorted(number, update.of)
    return gated(predicted, update.equivalent, row, np.arange(len(row)), np.inf, light_time)


def label_pairs(focal_pairs: CrowdPairs, number: IntArray, lines: LinesOfSight) -> GatedPairs:
    """Return the pairs of lines with tracks of crowds, rows of `number` (n,), ascending, within
    their gates.

    Of these pairs only the distances and volumes are meant to be used: their axes are 0.
    """
    tracks, pairs = focal_pairs
    count = len(pairs.row)
    line = pairs.line
    return GatedPairs(
        np.searchsorted(number, tracks.number[pairs.row]),
        line,
        lines.time_s[line],
        lines.origin_ecef_m[line],
        np.zeros((count, 3, 3)),
        pairs.off,
        pairs.distance,
        2.0 * np.log(pairs.variance),
        lines.sigma_rad[line],
    )


def pruned(crowds: Crowds, time_s: float, period_s: FloatArray) -> Crowds:
    """Return the crowds without silent focal-plane tracks, and without tracks uncontested for
    long.
    """
    tracks = crowds.tracks
    if not len(tracks):
        return crowds
    silent = time_s - tracks.seen_s > np.maximum(
        LAW.silent_s, LAW.silent_scans * period_s[tracks.sensor]
    )
    number, track_row = np.unique(tracks.number, return_inverse=True)
    last_s = group_maxima(track_row, tracks.contested_s, len(number))
    gone = time_s - last_s > np.where(
        np.bincount(track_row) > LAW.fixing, LAW.decided_s, PAIRING.kept_s
    )
    if not np.count_nonzero(silent) and not np.count_nonzero(gone):
        return crowds
    quiet = evolve(crowds, tracks=tracks.take(np.flatnonzero(~silent)))
    alone = number[gone | ~np.isin(number, quiet.tracks.number)]
    return quiet.without(alone)
