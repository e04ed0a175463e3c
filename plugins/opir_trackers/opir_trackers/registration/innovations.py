"""Normalised innovations by sensor, the scale of each sensor's noise, and looks that a track
explains.

**Innovations.** Of each assigned look the squared distance from its prediction, in units of its
*stated* variance, is 1 in the mean for each of its two angles. Where the mean is far above 1, the
sensor is not as stated.

**Noise.** The looks of one sensor on one track within a slice scatter about a straight line by its
noise alone, whatever track and bias are. Their mean square, over some time, gives the scale of the
noise; once it is significantly above 1, lines of sight get the larger error. A sensor that is
better than stated gains nothing.

**Explained looks.** A target gives at most one look a scan. So outliers of a track's target lie
near it in scans in which it has no look of its own, while a second target is seen in both kinds of
scans, more often in those with one if the first is seen more often than not. Looks near a track
that has none in their scan initiate no track while there are more of them than beside its own
looks.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns, names_of
from opir_trackers.association import scan_numbers
from opir_trackers.gating import GatedPairs
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.registration.misfits import MeanResiduals

#: Time, s, over which innovations and noise are averaged: long enough for 2 % of the noise of one
#: target at 10 Hz, short enough to follow a sensor that changes; notional.
MEMORY_S = 60.0

#: Degrees of freedom for which the stated noise counts.
_BELIEVED = 20.0

#: Number of standard deviations by which noise must exceed what is stated before it is believed.
_SURE = 2.0

#: An outlier may be this far from its track, standard deviations of a look, beyond the gate of the
#: track: 44 km at 20 µrad from geostationary height. Farther ones seldom form the clusters that
#: tracks begin with. Notional.
OUTLIER_SIGMAS = 60.0


@frozen(eq=False)
class SensorInnovations:
    """Sums over looks of each sensor (s,), with exponential forgetting.

    `square` of the normalised innovations and `looks`; `scatter` of looks about their line, in
    stated variances, and its `degrees` of freedom.
    """

    square: FloatArray
    looks: FloatArray
    scatter: FloatArray
    degrees: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "SensorInnovations":
        """Return the sums before the first look."""
        return cls(*(np.zeros(sensors) for _ in range(4)))

    def faded(self, step_s: float) -> "SensorInnovations":
        """Return the sums a step later."""
        kept = np.exp(-step_s / MEMORY_S)
        sums = self.square, self.looks, self.scatter, self.degrees
        return SensorInnovations(*(kept * each for each in sums))

    @property
    def noise_scale(self) -> FloatArray:
        """The noise (s,) in units of what is stated; nan where too few looks show it."""
        known = self.degrees > _BELIEVED
        scale = np.sqrt((self.scatter + _BELIEVED) / (self.degrees + _BELIEVED))
        return np.where(known, scale, np.nan)

    @property
    def noise_scale_sigma(self) -> FloatArray:
        """The standard deviation (s,) of `noise_scale`."""
        return np.asarray(self.noise_scale / np.sqrt(2.0 * np.maximum(self.degrees, 1.0)))

    @property
    def believed_scale(self) -> FloatArray:
        """The noise (s,) that is assumed, at least 1."""
        least = self.noise_scale - _SURE * self.noise_scale_sigma
        return np.where(least > 1.0, least, 1.0)

    @property
    def mean_square(self) -> FloatArray:
        """The mean square (s,) of normalised innovations, an angle each; nan without looks."""
        return np.divide(
            self.square,
            2.0 * self.looks,
            out=np.full_like(self.square, np.nan),
            where=self.looks > 0.0,
        )

    def after(
        self, square: FloatArray, sensor: IntArray, means: MeanResiduals, stated_rad: FloatArray
    ) -> "SensorInnovations":
        """Return the sums after looks (m,) with normalised squares by `sensor`, and their means
        (k,).

        `stated_rad` (k,) is the stated error of the looks of each mean.
        """
        count = len(self.looks)
        return evolve(
            self,
            square=self.square + np.bincount(sensor, square, count),
            looks=self.looks + np.bincount(sensor, minlength=count),
            scatter=self.scatter
            + np.bincount(means.sensor, means.scatter_rad2 / np.square(stated_rad), count),
            degrees=self.degrees + np.bincount(means.sensor, means.degrees, count),
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
    def fresh(cls, number: IntArray, sensors: int) -> "TrackInnovations":
        """Return the sums of tracks without looks."""
        count = len(number)
        return cls(number, *(np.zeros((count, sensors)) for _ in range(5)))

    def of(self, number: IntArray) -> "TrackInnovations":
        """Return those of tracks (n,) in ascending order: of what is known, or without looks."""
        if np.array_equal(number, self.number):
            return self
        fresh = TrackInnovations.fresh(number, self.looks.shape[1])
        place = np.searchsorted(number, self.number)
        here = np.flatnonzero(np.append(number, -1)[place] == self.number)
        for name in names_of(TrackInnovations)[1:]:
            getattr(fresh, name)[place[here]] = getattr(self, name)[here]
        return fresh

    def faded(self, step_s: float, period_s: FloatArray) -> "TrackInnovations":
        """Return the sums a step later, of sensors with scan periods (s,)."""
        kept = np.exp(-step_s / np.maximum(MEMORY_S, _SCANS * period_s))
        soon = np.exp(-step_s / (_RECENT_SCANS * period_s))
        recent = self.instead * soon, self.beside * soon
        lasting = self.looks * kept, self.explained * kept, self.owned * kept
        return TrackInnovations(self.number, *lasting, *recent)

    def after(self, track: IntArray, sensor: IntArray) -> "TrackInnovations":
        """Return the sums after looks (m,), by rows and sensors."""
        looks = self.looks.copy()
        np.add.at(looks, (track, sensor), 1.0)
        return evolve(self, looks=looks)


#: Scans of slow sensors over which a track's looks are counted, and those over which outliers and a
#: second target are discriminated.
_SCANS = 10.0
_RECENT_SCANS = 20.0


#: Looks that a track explains before it has as many of its own: those of the first scans.
_FIRST = 4.0


def explained_looks(
    pairs: GatedPairs,
    free: LinesOfSight,
    owned: tuple[IntArray, LinesOfSight],
    tracks: TrackInnovations,
    gate: float,
) -> tuple[BoolArray, TrackInnovations]:
    """Return which unassigned lines (f,) tracks (n,) explain, and the tracks' sums with these.

    `pairs` are those of tracks and lines `free` within a wide gate; `owned` are the rows of the
    tracks of the slice's other lines, and these lines; `gate` is that of tracks, in standard
    deviations.
    """
    reach = gate * np.exp(0.25 * pairs.log_volume) + OUTLIER_SIGMAS * pairs.sigma_rad
    near = np.sum(pairs.measured * pairs.measured, axis=1) <= reach * reach
    owner, lines = owned
    scan = scan_numbers(
        np.concatenate([lines.sensor, free.sensor]), np.concatenate([lines.scan, free.scan])
    )
    scans = int(scan.max(initial=0)) + 1
    has_own = np.zeros((len(tracks), scans), dtype=np.bool_)
    has_own[owner, scan[: len(owner)]] = True
    near = _nearest(pairs, np.flatnonzero(near))
    track = pairs.track[near]
    line = pairs.line[near]
    mine = scan[len(owner) :][line]
    sensor = free.sensor[line].astype(np.int64)
    beside = tracks.beside.copy()
    instead = tracks.instead.copy()
    explained = tracks.explained.copy()
    own_looks = tracks.owned.copy()
    np.add.at(own_looks, (owner, lines.sensor), 1.0)
    own = has_own[track, mine]
    np.add.at(beside, (track[own], sensor[own]), 1.0)
    np.add.at(instead, (track[~own], sensor[~own]), 1.0)
    of_target = ~own & (beside < instead)[track, sensor]
    np.add.at(explained, (track[of_target], sensor[of_target]), 1.0)
    of_target &= (explained <= np.maximum(tracks.looks, own_looks) + _FIRST)[track, sensor]
    which = np.zeros(len(free.time_s), dtype=np.bool_)
    which[line[of_target]] = True
    return which, evolve(
        tracks, explained=explained, owned=own_looks, instead=instead, beside=beside
    )


def _nearest(pairs: GatedPairs, rows: IntArray) -> IntArray:
    """Return those of rows of pairs with the nearest track of each line."""
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
    return np.asarray(assigned.distance * spread / stated)
