"""Normalised innovations by sensor and track, the scale of each sensor's noise, and looks that a track explains.

**Innovations.** Of each assigned look the squared distance from its prediction, in units of its *stated* variance, is 1
in the mean for each of its two angles. Where the mean is far above 1, a sensor or a track is not what it is said to be.

**Noise.** The looks of one sensor on one track within a slice scatter about a straight line by its noise alone,
whatever track and bias are. Their mean square, over some time, gives the scale of the noise; once it is significantly
above 1, lines of sight get the larger error. A sensor that is better than stated gains nothing.

**Explained looks.** A target gives at most one look a scan. So a look near a track that has none in this scan is
probably an outlier of that track's target, while a second target soon has looks in the scans in which the track has its
own. Such looks initiate no track, as long as they are fewer than the track's own.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns
from opir_trackers.association import scan_numbers
from opir_trackers.gating import GatedPairs
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.registration.misfits import MeanResiduals

#: Time, s, over which innovations and noise are averaged: long enough for 2 % of the noise of one target at 10 Hz, short
#: enough to follow a sensor that changes; notional.
MEMORY_S = 60.0

#: Degrees of freedom for which the stated noise counts.
_BELIEVED = 20.0

#: Number of standard deviations by which noise must exceed what is stated before it is believed.
_SURE = 2.0

#: An outlier may be this far from its track, standard deviations of a look, beyond the gate of the track; notional: 44 km
#: at 20 µrad from geostationary height. Farther ones seldom form the clusters that tracks begin with.
OUTLIER_SIGMAS = 60.0


@frozen(eq=False)
class SensorInnovations:
    """Sums over looks of each sensor (s,), with exponential forgetting.

    `square` of the normalised innovations and `looks`; `scatter` of looks about their line, in stated variances, and
    its `degrees` of freedom; `outliers` that tracks explain.
    """

    square: FloatArray
    looks: FloatArray
    scatter: FloatArray
    degrees: FloatArray
    outliers: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "SensorInnovations":
        """Return the sums before the first look."""
        return cls(*(np.zeros(sensors) for _ in range(5)))

    def faded(self, step_s: float) -> "SensorInnovations":
        """Return the sums a step later."""
        kept = np.exp(-step_s / MEMORY_S)
        sums = self.square, self.looks, self.scatter, self.degrees, self.outliers
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
        return np.divide(self.square, 2.0 * self.looks, out=np.full_like(self.square, np.nan), where=self.looks > 0.0)

    def after(
        self, square: FloatArray, sensor: IntArray, means: MeanResiduals, stated_rad: FloatArray
    ) -> "SensorInnovations":
        """Return the sums after looks (m,) with normalised squares by `sensor`, and their means (k,).

        `stated_rad` (k,) is the stated error of the looks of each mean.
        """
        count = len(self.looks)
        return evolve(
            self,
            square=self.square + np.bincount(sensor, square, count),
            looks=self.looks + np.bincount(sensor, minlength=count),
            scatter=self.scatter + np.bincount(means.sensor, means.scatter_rad2 / np.square(stated_rad), count),
            degrees=self.degrees + np.bincount(means.sensor, means.degrees, count),
        )


@frozen(eq=False, repr=False)
class TrackInnovations(Columns):
    """Sums over the looks of tracks, by number: normalised `square` and `looks`, with those `explained` as outliers.

    `looks` and `explained` are (n, s), by sensor; all fade with the track's scans.
    """

    number: IntArray
    square: FloatArray
    looks: FloatArray
    explained: FloatArray

    @classmethod
    def fresh(cls, number: IntArray, sensors: int) -> "TrackInnovations":
        """Return the sums of tracks without looks."""
        count = len(number)
        return cls(number, np.zeros(count), np.zeros((count, sensors)), np.zeros((count, sensors)))

    def of(self, number: IntArray) -> "TrackInnovations":
        """Return those of tracks (n,) in ascending order: of what is known, or without looks."""
        if np.array_equal(number, self.number):
            return self
        fresh = TrackInnovations.fresh(number, self.looks.shape[1])
        place = np.searchsorted(number, self.number)
        here = np.flatnonzero(np.append(number, -1)[place] == self.number)
        for name in ("square", "looks", "explained"):
            getattr(fresh, name)[place[here]] = getattr(self, name)[here]
        return fresh

    @property
    def mean_square(self) -> FloatArray:
        """The mean square (n,) of normalised innovations, an angle each; nan without looks."""
        looks = self.looks.sum(axis=1)
        return np.divide(self.square, 2.0 * looks, out=np.full_like(self.square, np.nan), where=looks > 0.0)

    def faded(self, step_s: float, period_s: FloatArray) -> "TrackInnovations":
        """Return the sums a step later, of sensors with scan periods (s,)."""
        kept = np.exp(-step_s / np.maximum(MEMORY_S, _SCANS * period_s))
        square = self.square * kept.max(initial=0.0)
        return TrackInnovations(self.number, square, self.looks * kept, self.explained * kept)

    def after(self, square: FloatArray, track: IntArray, sensor: IntArray) -> "TrackInnovations":
        """Return the sums after looks (m,) with normalised squares, by rows and sensors."""
        looks = self.looks.copy()
        np.add.at(looks, (track, sensor), 1.0)
        return evolve(self, square=self.square + np.bincount(track, square, len(self)), looks=looks)


#: Scans of slow sensors over which a track's looks are counted.
_SCANS = 10.0


def explained_looks(
    pairs: GatedPairs, free: LinesOfSight, owned: tuple[IntArray, LinesOfSight], tracks: TrackInnovations, gate: float
) -> tuple[BoolArray, TrackInnovations]:
    """Return which unassigned lines (f,) tracks (n,) explain, and the tracks' sums with these.

    `pairs` are those of tracks and lines `free` within a wide gate; `owned` are the rows of the tracks of the slice's
    other lines, and these lines; `gate` is that of tracks, in standard deviations.
    """
    reach = gate * np.exp(0.25 * pairs.log_volume) + OUTLIER_SIGMAS * pairs.sigma_rad
    near = np.sum(pairs.measured * pairs.measured, axis=1) <= reach * reach
    owner, lines = owned
    scan = scan_numbers(np.concatenate([lines.sensor, free.sensor]), np.concatenate([lines.scan, free.scan]))
    scans = int(scan.max(initial=0)) + 1
    has_own = np.zeros((len(tracks), scans), dtype=np.bool_)
    has_own[owner, scan[: len(owner)]] = True
    mine = scan[len(owner) :][pairs.line]
    good = np.flatnonzero(near & ~has_own[pairs.track, mine])
    good = good[np.argsort(np.sum(pairs.measured[good] ** 2, axis=1), kind="stable")]
    good = good[np.unique(pairs.line[good], return_index=True)[1]]
    good = good[np.unique(pairs.track[good] * scans + mine[good], return_index=True)[1]]
    track, sensor = pairs.track[good], free.sensor[pairs.line[good]].astype(np.int64)
    explained = tracks.explained.copy()
    np.add.at(explained, (track, sensor), 1.0)
    sound = explained[track, sensor] <= tracks.looks[track, sensor]
    which = np.zeros(len(free.time_s), dtype=np.bool_)
    which[pairs.line[good[sound]]] = True
    return which, evolve(tracks, explained=explained)


def stated_squares(assigned: GatedPairs, stated_rad: FloatArray) -> FloatArray:
    """Return the squared innovations (m,) of pairs in units of their variances with stated errors (m,), two angles.

    The variance is that of a circle with the area of the innovation's ellipse.
    """
    spread = np.exp(0.5 * assigned.log_volume)
    stated = np.maximum(spread - np.square(assigned.sigma_rad) + np.square(stated_rad), np.square(stated_rad))
    return np.asarray(assigned.distance * spread / stated)

