"""What sensors have seen of the tracks of a fit: the evidence for the end of a burn."""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.columns import Columns
from opir_trackers.profile.end import Silence
from opir_trackers.profile.rows import Rows
from opir_trackers.sensors import SensorSchedule
from opir_trackers.stereo.report import LONGEST_STAGING_S

#: A sensor's chance of detection is believed as much as so many looks.
_BELIEVED_LOOKS = 10.0

#: The logarithm of the chance that a stage ends just then, of a thousand looks: a pause has to be less probable.
_CHANCE = -7.0

#: The logarithm of the odds that a target does not fly as the family does, beforehand, and the variance of what it
#: would be off by, in units of what is expected of innovations.
FIRST_STRANGE, LEAN_VARIANCE = float(np.log(0.015)), 0.3

#: The logarithm of the share of staged flights that go on after a pause so that the family fits all that is seen: that
#: which makes likeliest what innovations after it said of a hundred SRBM of two stages.
_FITTED = float(np.log(1.0 / 3.0))

#: Of a pause no more is made than this, log.
_MOST = 12.0

#: Such odds that a target does not fly as the family does, log, are taken for certain. Of 200 flights with stages or of
#: another table 141 reached them, and none came back; of 520 of the family, with outliers, biases, rare looks or a
#: sensor that fails among them, none did.
_CERTAIN = 13.0

#: A target has burnt out where its silence, were it burning, would be less probable than one in a hundred, log.
_OUT = float(np.log(0.01))

#: A sensor that saw nothing for longer may have failed, s: its silence says nothing of a burn that others see.
_FAILED_S = 5.0


@frozen(eq=False)
class TrackHistory(Columns):
    """What sensors saw of tracks, sorted by number: first and last light, times at which it left, and how often.

    `drift` (n, sensors, 2) is the running mean of whitened innovations, `wander` (n, sensors) its variance if well.
    `lean` (n, sensors, 2) and `doubt` (n, sensors) are the mean and variance of what innovations would be off by, did
    the target not fly as the family does, and `strange` (n,) the logarithm of the odds that it does not (`strain`);
    `staged` (n,) is that of the odds that its burn has paused, but the family fits on. `newest` (n, sensors, 2) are the
    last innovations, `rough` (n,) is the sum of half the squares of what they differ by from one to the next, and
    `jumps` (n,) the number of those.
    """

    track: IntArray
    first_s: FloatArray
    last_s: FloatArray
    hits: FloatArray
    travel_s: FloatArray
    drift: FloatArray
    wander: FloatArray
    lean: FloatArray
    doubt: FloatArray
    strange: FloatArray
    staged: FloatArray
    newest: FloatArray
    rough: FloatArray
    jumps: FloatArray

    @classmethod
    def nothing(cls, track: IntArray, sensors: int) -> "TrackHistory":
        """Return what is seen of tracks before anything is."""
        shape = (len(track), sensors)
        return cls(
            track,
            np.full(shape, np.inf),
            np.full(shape, -np.inf),
            np.zeros(shape),
            np.zeros(shape),
            np.zeros((*shape, 2)),
            np.zeros(shape),
            np.zeros((*shape, 2)),
            np.full(shape, LEAN_VARIANCE),
            np.full(len(track), FIRST_STRANGE),
            np.full(len(track), -np.inf),
            np.full((*shape, 2), np.nan),
            np.zeros(len(track)),
            np.zeros(len(track)),
        )

    @property
    def otherwise(self) -> FloatArray:
        """Return the logarithms (n,) of the odds that targets do not fly as the family does, whatever tells it."""
        odds: FloatArray = np.logaddexp(self.strange, self.staged)
        return odds

    def strangers(self) -> IntArray:
        """Return the numbers of tracks, seen by two sensors, whose targets certainly do not fly as the family does."""
        is_certain = (self.otherwise > _CERTAIN) & (np.count_nonzero(self.hits > 0, axis=1) > 1)
        track: IntArray = self.track[is_certain]
        return track

    def drifted(self) -> FloatArray:
        """Return by how much (n,) the χ² of the running means of innovations exceeds their number."""
        square = np.square(self.drift) / np.maximum(self.wander, 1e-12)[:, :, None]
        beyond: FloatArray = square.sum(axis=(1, 2)) - 2.0 * np.count_nonzero(self.wander, axis=1)
        return beyond

    def of(self, track: IntArray) -> "TrackHistory":
        """Return what is seen of tracks by number (n,)."""
        return self.take(np.searchsorted(self.track, track))

    def seen_by_one_sensor(self, track: IntArray) -> BoolArray:
        """Return which tracks by number (n,) one sensor alone has seen."""
        alone: BoolArray = np.count_nonzero(self.of(track).hits > 0, axis=1) < 2
        return alone

    def with_rays(self, rays: Rows, look_s: FloatArray) -> "TrackHistory":
        """Return what is seen with rays (m,), looked at `look_s` (m,)."""
        fresh = np.setdiff1d(rays.track, self.track)
        every = (
            TrackHistory.concatenate([self, TrackHistory.nothing(fresh, self.hits.shape[1])]) if len(fresh) else self
        )
        every = every.take(np.argsort(every.track, kind="stable"))
        first, last, hits = every.first_s.copy(), every.last_s.copy(), every.hits.copy()
        travel = every.travel_s.copy()
        key = np.searchsorted(every.track, rays.track), rays.sensor
        np.minimum.at(first, key, rays.time_s)
        np.maximum.at(last, key, rays.time_s)
        np.add.at(hits, key, 1.0)
        travel[key] = look_s - rays.time_s
        return evolve(every, first_s=first, last_s=last, hits=hits, travel_s=travel)

    def paused(self, before: "TrackHistory", rays: Rows, watch: SensorSchedule) -> "TrackHistory":
        """Return what is seen, made stranger where rays (m,) come after a pause that no single burn has by chance.

        Between stages nothing burns. `before` is what was seen before the rays. The pause's probability is that of as
        many missed looks of all sensors that have seen the target lately. Innovations after it tell whether the family
        fits on, and so does it fit some flights with a pause, its parameters put wrong: the odds of those stay.
        """
        known = np.isin(rays.track, before.track)
        order = np.lexsort((rays.time_s[known], rays.track[known]))
        track, time_s = rays.track[known][order], rays.time_s[known][order]
        place = np.searchsorted(before.track, track)
        latest = np.max(before.last_s, axis=1)[place]
        first = np.append(True, np.diff(track) != 0)[: len(track)]
        since = np.where(first, latest, np.append(0.0, time_s)[: len(track)])
        pause = np.maximum(time_s - since, 0.0)[:, None]
        log = before.take(place).log_missed(np.maximum(pause / watch.period_s - 1.0, 0.0), watch)
        gain = np.zeros(len(self.track))
        np.maximum.at(gain, np.searchsorted(self.track, track), np.clip(_CHANCE - log, 0.0, _MOST))
        staged = np.maximum(self.staged, np.where(gain > 0.0, FIRST_STRANGE + gain + _FITTED, -np.inf))
        return evolve(self, strange=self.strange + gain, staged=staged)

    def log_missed(self, looks: FloatArray, watch: SensorSchedule) -> FloatArray:
        """Return the log chances (n,) that sensors miss burning targets in looks (n, sensors), whatever their class.

        Only those sensors count that have seen the target lately, and none that follows it after the burn.
        """
        latest = np.max(self.last_s, axis=1)
        hears = (self.last_s > latest[:, None] - _FAILED_S) & ~watch.follows_bodies
        before = np.maximum((self.last_s - self.first_s) / watch.period_s + 1.0, 1.0)
        believed = _BELIEVED_LOOKS * watch.detection_probability.mean(axis=1)
        share = np.clip((self.hits + believed) / (before + _BELIEVED_LOOKS), 0.01, 0.9)
        log: FloatArray = np.sum(np.where(hears, looks * np.log1p(-np.nan_to_num(share, nan=0.01)), 0.0), axis=1)
        return log

    def time_since_last_s(self, tick_s: float) -> FloatArray:
        """Return for how long (n,), s, no sensor has seen the tracks."""
        dark: FloatArray = tick_s - np.max(self.last_s, axis=1)
        return dark

    def are_out(self, tick_s: float, watch: SensorSchedule) -> BoolArray:
        """Return of which tracks (n,) the burn is over by their silence alone, too long for chance and for a stage."""
        since_s = np.maximum(tick_s - self.travel_s - self.last_s, 0.0)
        missed = self.log_missed(np.floor(since_s / watch.period_s), watch)
        out: BoolArray = (self.time_since_last_s(tick_s) > LONGEST_STAGING_S) & (missed < _OUT)
        return out

    def silence(self, kind: IntArray, tick_s: float, watch: SensorSchedule) -> Silence:
        """Return the silence at a tick of hypotheses (n,) of these classes, one row each.

        The chance of a detection is what the sensor is built for, and the more what was seen, the longer it was.
        """
        heard = (self.hits > 0) & ~watch.follows_bodies
        last = np.where(heard, self.last_s, np.nan)
        looks = np.where(heard, (self.last_s - self.first_s) / watch.period_s + 1.0, 0.0)
        share = (np.where(heard, self.hits, 0.0) + _BELIEVED_LOOKS * watch.detection_probability[:, kind].T) / (
            looks + _BELIEVED_LOOKS
        )
        until = np.where(heard, np.maximum(tick_s - self.travel_s, self.last_s), np.nan)
        return Silence(last, until, np.clip(share, 0.01, 0.999), watch.period_s)
