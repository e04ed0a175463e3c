"""Normalised innovations by sensor, and looks that a track explains.

**Innovations.** Of each assigned look the squared distance from its prediction, in units of its
*stated* variance, is 1 in the mean for each of its two angles. Where the mean is far above 1, the
sensor is not as stated.

**Explained looks.** A target gives at most one look a scan. So outliers of a track's target lie
near it in scans in which it has no look of its own, while a second target is seen in both kinds of
scans, more often in those with such a look if the first is seen more often than not. Looks near a
track without a look in their scan initiate no track while there are more of them than beside its
own looks.
"""

from typing import Any

import numpy as np
from attrs import evolve, frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns
from opir_estimation.assignment import scan_numbers
from opir_estimation.gating import GatedPairs
from opir_estimation.lines_of_sight import LinesOfSight
from opir_estimation.registration.misfits import LAW

OUTLIER_SIGMAS: float = LAW.outlier_sigmas


@frozen(eq=False)
class SensorInnovations:
    """Sums over looks of each sensor (s,), with exponential forgetting: `square` of the normalised
    innovations, and `looks`.
    """

    square: FloatArray
    looks: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "SensorInnovations":
        """Return the sums before the first look."""
        return cls(np.zeros(sensors), np.zeros(sensors))

    def faded(self, step_s: float) -> "SensorInnovations":
        """Return the sums a step later."""
        decay = np.exp(-step_s / LAW.memory_s)
        return SensorInnovations(decay * self.square, decay * self.looks)

    @property
    def mean_square(self) -> FloatArray:
        """The mean square (s,) of normalised innovations, an angle each; nan without looks."""
        return np.divide(
            self.square,
            2.0 * self.looks,
            out=np.full_like(self.square, np.nan),
            where=self.looks > 0.0,
        )

    def after(self, square: FloatArray, sensor: IntArray) -> "SensorInnovations":
        """Return the sums after looks (m,) with normalised squares by `sensor`."""
        count = len(self.looks)
        return SensorInnovations(
            self.square + np.bincount(sensor, square, count),
            self.looks + np.bincount(sensor, minlength=count),
        )


@frozen(eq=False, repr=False)
class TrackInnovations(Columns):
    """Sums over the looks of tracks, by number: `looks`, with those `explained` as outliers.

    `looks`, `explained`, `owned`, `instead` and `beside` are (n, s), by sensor, and fade with its
    scans. `owned` are its own looks in slices with unassigned ones, also those that were not
    compared: looks of crowds. The last two count the unassigned looks of the last scans near the
    track, in scans without and with a look of its own.
    """

    number: IntArray
    looks: FloatArray
    explained: FloatArray
    owned: FloatArray
    instead: FloatArray
    beside: FloatArray

    @classmethod
    def begun(cls, number: IntArray, sensors: int) -> "TrackInnovations":
        """Return the sums of tracks without looks."""
        count = len(number)
        return cls(number, *(np.zeros((count, sensors)) for _ in range(5)))

    def of(self, number: IntArray) -> "TrackInnovations":
        """Return those of tracks (n,) in ascending order; new ones are without looks."""
        if np.array_equal(number, self.number):
            return self
        sums = TrackInnovations.begun(number, self.looks.shape[1])
        place = np.searchsorted(number, self.number)
        rows = np.flatnonzero(np.append(number, -1)[place] == self.number)
        sums.overwrite(place[rows], self.take(rows))
        return sums

    def faded(self, step_s: float, period_s: FloatArray) -> "TrackInnovations":
        """Return the sums a step later, of sensors with scan periods (s,)."""
        lasting = np.exp(-step_s / np.maximum(LAW.memory_s, LAW.scans * period_s))
        recent = np.exp(-step_s / (LAW.recent_scans * period_s))
        return TrackInnovations(
            self.number,
            self.looks * lasting,
            self.explained * lasting,
            self.owned * lasting,
            self.instead * recent,
            self.beside * recent,
        )

    def after(self, track: IntArray, sensor: IntArray) -> "TrackInnovations":
        """Return the sums after looks (m,), by rows and sensors."""
        return evolve(self, looks=_counted(self.looks, track, sensor))


def _counted(counts: FloatArray, track: IntArray, sensor: NDArray[np.integer[Any]]) -> FloatArray:
    """Return counts (n, s) with one more for each track and sensor (m,)."""
    counts = counts.copy()
    np.add.at(counts, (track, sensor), 1.0)
    return counts


def explained_looks(
    pairs: GatedPairs,
    free: LinesOfSight,
    owned: tuple[IntArray, LinesOfSight],
    tracks: TrackInnovations,
    gate: float,
) -> tuple[GatedPairs, TrackInnovations]:
    """Return the pairs of unassigned lines (f,) and the tracks (n,) that explain them, and the
    tracks' sums with these.

    `pairs` are those of tracks and lines `free` within a wide gate; `owned` are the rows of the
    tracks of the slice's other lines, and these lines; `gate` is that of tracks, in standard
    deviations.
    """
    reach = gate * np.exp(0.25 * pairs.log_volume) + OUTLIER_SIGMAS * pairs.sigma_rad
    is_near = np.sum(pairs.measured * pairs.measured, axis=1) <= reach * reach
    rows = _nearest(pairs, np.flatnonzero(is_near))
    track = pairs.track[rows]
    line = pairs.line[rows]
    sensor = free.sensor[line].astype(np.int64)
    has_look = _has_look(len(tracks), owned, free)[track, line]
    owner, lines = owned
    owned_looks = _counted(tracks.owned, owner, lines.sensor)
    beside = _counted(tracks.beside, track[has_look], sensor[has_look])
    instead = _counted(tracks.instead, track[~has_look], sensor[~has_look])
    of_target = ~has_look & (beside < instead)[track, sensor]
    explained = _counted(tracks.explained, track[of_target], sensor[of_target])
    limit = np.maximum(tracks.looks, owned_looks) + LAW.first_looks
    of_target &= (explained <= limit)[track, sensor]
    return pairs.take(rows[of_target]), evolve(
        tracks, explained=explained, owned=owned_looks, instead=instead, beside=beside
    )


def _has_look(tracks: int, owned: tuple[IntArray, LinesOfSight], free: LinesOfSight) -> BoolArray:
    """Whether tracks have a look of their own (tracks, f) in the scan of each unassigned line."""
    owner, lines = owned
    scan = scan_numbers(
        np.concatenate([lines.sensor, free.sensor]), np.concatenate([lines.scan, free.scan])
    )
    has_look = np.zeros((tracks, int(scan.max(initial=0)) + 1), dtype=np.bool_)
    has_look[owner, scan[: len(owner)]] = True
    return has_look[:, scan[len(owner) :]]


def _nearest(pairs: GatedPairs, rows: IntArray) -> IntArray:
    """Return the rows of pairs with the nearest track of each line."""
    order = rows[np.argsort(np.sum(pairs.measured[rows] ** 2, axis=1), kind="stable")]
    return order[np.unique(pairs.line[order], return_index=True)[1]]


def stated_squares(assigned: GatedPairs, stated_rad: FloatArray) -> FloatArray:
    """Return the squared innovations (m,) of pairs in units of their variances with stated errors
    (m,), two angles.

    The variance is that of a circle with the area of the innovation's ellipse.
    """
    spread = np.exp(0.5 * assigned.log_volume)
    stated = np.maximum(
        spread - np.square(assigned.sigma_rad) + np.square(stated_rad), np.square(stated_rad)
    )
    return assigned.distance * spread / stated
