"""What each sensor saw of young tracks, a line of sight a slice: what tells targets from ghosts.

Rays are assigned sensor by sensor and slice by slice. Two tracks can agree with each sensor's picture and still follow
no target (ghosts): each sits where one target's rays from one sensor pass the other's from another. What tells is how
near the rays of two sensors pass each other, again and again, and what was known beforehand. So what a sensor saw of a
track is kept as long as it may belong to another.

Lines of sight of a slice with the rays that several tracks may have, and tracks worked out anew by all of theirs.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, Sights, along, axes_across, dot, no_sights
from opir_trackers.assignment import different, lone
from opir_trackers.association import Chances, plain, scan_groups, scan_numbers
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs
from opir_trackers.stereo.associate_and_update import AssociationResult
from opir_trackers.stereo.measurement_weights import LEAST_WEIGHT, AmbiguousMeasurements, expected

_NONE = np.empty(0, dtype=np.int64)


@frozen(eq=False)
class Histories:
    """What was seen of tracks that may have one another's rays, and what was known of them before their first.

    `number` (n,), rising, are the tracks' numbers, `begun_s` (n,) when they began and `first` (n rows) the estimates
    they began with, carried to the present without a ray; `sights` (m rows) are mean lines of sight of tracks 0 to
    n - 1, and `sensor` (m,) says whose each is. `contested` are the rays of which it is open whose they are, and
    `doubt` (n,) is how doubtful it was when last asked which histories are whose.
    """

    number: IntArray
    begun_s: FloatArray
    first: ModeEstimates
    sights: Sights
    sensor: IntArray
    contested: AmbiguousMeasurements = field(factory=AmbiguousMeasurements.empty)
    doubt: FloatArray = field(default=Factory(lambda self: np.ones(len(self.first)), takes_self=True))

    @classmethod
    def none(cls) -> "Histories":
        """Return the histories of no tracks."""
        return cls(_NONE, np.empty(0), ModeEstimates.empty(), no_sights(), _NONE)

    def __len__(self) -> int:
        return len(self.number)

    @property
    def blur(self) -> FloatArray:
        """Return how many rays, by the chance that they are another's or none's (n,), each track may have and not."""
        open_ = self.contested
        track = self.sights.track[open_.sight]
        return np.bincount(track, open_.weight * (1.0 - open_.weight), len(self)).astype(np.float64)

    def joined(self, new: "Histories") -> "Histories":
        """Return the histories with those of new tracks, of higher numbers."""
        sights = new.sights.placed(new.sights.track + len(self))
        return Histories(
            number=np.concatenate([self.number, new.number]),
            begun_s=np.concatenate([self.begun_s, new.begun_s]),
            first=ModeEstimates.concatenate([self.first, new.first]),
            sights=Sights.concatenate([self.sights, sights]),
            sensor=np.concatenate([self.sensor, new.sensor]),
            contested=self.contested,
            doubt=np.concatenate([self.doubt, new.doubt]),
        )

    def moved(self, move: Callable[[ModeEstimates, float], ModeEstimates], step_s: float) -> "Histories":
        """Return the histories a step later."""
        return evolve(self, first=move(self.first, step_s)) if len(self.number) else self

    def of(self, keep: BoolArray) -> "Histories":
        """Return the histories of some tracks (n,) alone."""
        if keep.all():
            return self
        place = np.cumsum(keep) - 1
        stays = keep[self.sights.track]
        mine = np.flatnonzero(stays)
        sights = self.sights.take(mine)
        return Histories(
            number=self.number[keep],
            begun_s=self.begun_s[keep],
            first=self.first.take(np.flatnonzero(keep)),
            sights=sights.placed(place[sights.track]),
            sensor=self.sensor[mine],
            contested=self.contested.without(~stays, np.cumsum(stays) - 1),
            doubt=self.doubt[keep],
        )

    def seen(self, sights: Sights, sensor: IntArray, contested: AmbiguousMeasurements) -> "Histories":
        """Return the histories with more lines of sight, and the rays that may be part of these."""
        sensor = np.concatenate([self.sensor, sensor])
        if not len(contested):
            return evolve(self, sights=Sights.concatenate([self.sights, sights]), sensor=sensor)
        fresh = evolve(
            contested,
            sight=contested.sight + len(self.sights),
            ray=contested.ray + int(self.contested.ray.max(initial=-1)) + 1,
            scan=contested.scan + int(self.contested.scan.max(initial=-1)) + 1,
        )
        return evolve(
            self,
            sights=Sights.concatenate([self.sights, sights]),
            sensor=sensor,
            contested=AmbiguousMeasurements.concatenate([self.contested, fresh]),
        )


def lasting_s(jerk_noise_m_s3: float, look_m: float, period_s: float) -> float:
    """Return for how long, s, a boost's path is smooth enough for its first look to speak of its last.

    That is until the noise of the jerk has moved the target, by q √3 t^3.5 / √252, as far as looks of an error `look_m`
    each, one every `period_s`, leave open over the whole time.
    """
    if jerk_noise_m_s3 == 0.0:
        return float("inf")
    return float((look_m * np.sqrt(84.0 * period_s) / jerk_noise_m_s3) ** 0.25)


def mean_sights(
    outlook: PredictedMeasurements, sights: Sights, sensor: IntArray, slice_s: float
) -> tuple[Sights, IntArray]:
    """Return one line of sight for all sights of a track by a sensor in a slice, and the sensors.

    Residuals to the track's own path are averaged, each as sure as it is: near that path nothing is lost.
    """
    return parted_sights(outlook, sights, sensor, slice_s)[:2]


def parted_sights(
    outlook: PredictedMeasurements, sights: Sights, sensor: IntArray, slice_s: float
) -> tuple[Sights, IntArray, IntArray]:
    """Return mean lines of sight and the sensors, as `mean_sights`, and which mean (n,) each sight is part of."""
    if not len(sights):
        return sights, sensor, sensor
    part = np.floor((sights.time_s - outlook.time_s) / slice_s).astype(np.int64)
    part -= part.min()
    sensors, parts = int(sensor.max()) + 1, int(part.max()) + 1
    key, group = np.unique((sights.track * sensors + sensor) * parts + part, return_inverse=True)
    residual = sights.missed(outlook.positions(sights.track, sights.time_s))
    turned = sights.whitener.transpose(0, 2, 1)
    weight = _sums(group, (turned @ sights.whitener).reshape(-1, 4)).reshape(-1, 2, 2)
    mean: Any = np.linalg.solve(weight, _sums(group, along(turned, residual))[:, :, None])
    count = np.bincount(group)[:, None]
    time_s = _sums(group, sights.time_s[:, None])[:, 0] / count[:, 0]
    origin = _sums(group, sights.origin_m) / count
    track = key // (parts * sensors)
    apart = outlook.positions(track, time_s) - origin
    axes = axes_across(apart / np.sqrt(dot(apart, apart))[:, None])
    root: Any = np.linalg.cholesky(weight)
    return Sights(track, time_s, origin, axes, mean[:, :, 0], root.transpose(0, 2, 1)), key // parts % sensors, group


def with_biases(known: Histories, bias_sigma_rad: FloatArray) -> Sights:
    """Return the lines of sight of histories, each so wide that a whole history is no surer than its sensor's bias."""
    bias = bias_sigma_rad[known.sensor]
    if not bias.any():
        return known.sights
    _, history, length = np.unique(
        known.sights.track * len(bias_sigma_rad) + known.sensor, return_inverse=True, return_counts=True
    )
    sharp = np.abs(np.linalg.det(known.sights.whitener))
    wider = 1.0 / np.sqrt(1.0 + length[history] * bias**2 * sharp)
    return evolve(known.sights, whitener=known.sights.whitener * wider[:, None, None])


def _sums(group: IntArray, values: FloatArray) -> FloatArray:
    """Return the sums of rows (n, k) by group."""
    total: FloatArray = np.stack([np.bincount(group, column) for column in values.T], axis=1)
    return total


def weighed(filter_: ImmFilter, bank: ModeEstimates, time_s: float, sights: Sights) -> tuple[FloatArray, ModeEstimates]:
    """Return the log likelihoods (n,) of sights of the tracks of a bank, and the bank after them.

    The likelier mode of each track takes them in. The other stays: it takes all but nothing of a track, and the next
    step mixes it from this one.
    """
    boost, boost_root = bank.boost_mean.copy(), bank.boost_root.copy()
    coast, coast_root = bank.coast_mean.copy(), bank.coast_root.copy()
    gained = np.zeros(len(bank))
    coasts = bank.weight[:, 1] > bank.weight[:, 0]
    seen = np.bincount(sights.track, minlength=len(bank)) > 0
    modes = ((filter_.boost, boost, boost_root, ~coasts), (filter_.coast, coast, coast_root, coasts))
    for motion, mean, root, mode in modes:
        rows = np.flatnonzero(mode & seen)
        if not len(rows):
            continue
        place = np.full(len(bank), -1, dtype=np.int64)
        place[rows] = np.arange(len(rows))
        part = sights.take(np.flatnonzero(place[sights.track] >= 0))
        part = part.placed(place[part.track])
        mean[rows], root[rows], gained[rows] = filter_.taken_in(motion, mean[rows], root[rows], time_s, part)
    return gained, ModeEstimates(bank.weight, boost, boost_root, coast, coast_root, bank.pace)


def rows_of(track: IntArray, wanted: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows that are of tracks `wanted` (n,), one after the other, and for which of them each row is."""
    order = np.argsort(track, kind="stable")
    known = track[order]
    start, stop = np.searchsorted(known, wanted), np.searchsorted(known, wanted, side="right")
    length = stop - start
    which = np.repeat(np.arange(len(wanted)), length)
    spot = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return order[spot], which


#: A ray this much less likely (log) to be a track's than noise is none of its, wherever the track turns out to be.
_HOPELESS_LOG = -12.0

#: For this long a track's histories are kept in any case: a rival may begin some slices later, s.
_RIVALS_S = 4.0

#: Histories whose assignment is less doubtful than this are settled.
_SETTLED = 1e-4

#: Settled ones are asked for again once a track is this much older (log): √2 times.
_AGAIN = 0.5 * float(np.log(2.0))

#: Histories of tracks with no more rays than this that may as well be another's are sharp.
_SHARP = 0.5

#: They are settled as they are after this time, s.
LONGEST_S = 60.0

#: Rays are weighed anew as long as they are no older than this, s; older lines of sight stay as they are.
_RECENT_S = 20.0


def slice_sights(
    path: PredictedMeasurements,
    told: AssociationResult,
    rows: IntArray,
    rays: LinesOfSight,
    chances: Chances,
    span: float,
) -> tuple[Sights, IntArray, AmbiguousMeasurements]:
    """Return the lines of sight of tracks in a slice of length `span`, whose sensors', and the contested rays in them.

    The tracks are `rows` of the bank that was followed, and `path` says where they are after the slice.
    """
    place = np.full(len(told.bank) + 1, -1, dtype=np.int64)
    place[rows] = np.arange(len(rows))
    owner, pairs = place[told.owner], told.pairs if len(rows) > 1 else told.own
    free = (told.owner < 0) | (owner >= 0)
    pairs = pairs.part(np.flatnonzero((place[pairs.track] >= 0) & free[pairs.ray]))
    pairs, contested = _disputed(path, evolve(pairs, track=place[pairs.track]), owner, rays, chances)
    sights, sensor = plain(pairs), rays.sensor[pairs.ray].astype(np.int64)
    weight = np.where(owner[pairs.ray] == pairs.track, 1.0, LEAST_WEIGHT)
    weighed_sights = evolve(sights, whitener=sights.whitener * np.sqrt(weight)[:, None, None])
    means, whose, part = parted_sights(path, weighed_sights, sensor, span)
    rows = np.flatnonzero(contested)
    if not len(rows):
        return means, whose, AmbiguousMeasurements.empty()
    residual = sights.missed(path.positions(pairs.track, pairs.time_s))
    open_ = AmbiguousMeasurements(
        sight=part[rows],
        ray=pairs.ray[rows],
        scan=scan_numbers(rays.sensor, rays.scan)[pairs.ray[rows]],
        seen=residual[rows] * pairs.sigma_rad[rows, None],
        sigma_rad=pairs.sigma_rad[rows],
        odds=chances.odds[sensor[rows]] - 2.0 * np.log(pairs.sigma_rad[rows]),
        weight=weight[rows],
        end_s=np.full(len(rows), path.time_s),
    )
    return means, whose, open_


def _disputed(
    path: PredictedMeasurements, pairs: GatedPairs, owner: IntArray, rays: LinesOfSight, chances: Chances
) -> tuple[GatedPairs, BoolArray]:
    """Return the pairs that count, and which of them (n,) are of lines of sight in which some ray has a rival."""
    if len(path.side) < 2:
        return pairs, np.zeros(len(pairs), dtype=bool)
    sensor = rays.sensor[pairs.ray].astype(np.int64)
    residual = plain(pairs).missed(path.positions(pairs.track, pairs.time_s))
    log = chances.odds[sensor] - 2.0 * np.log(pairs.sigma_rad) - 0.5 * dot(residual, residual)
    own = owner[pairs.ray] == pairs.track
    some = np.flatnonzero(own | (log > _HOPELESS_LOG))
    pairs, own, sensor = pairs.take(some), own[some], sensor[some]
    sight = pairs.track * (int(sensor.max(initial=0)) + 1) + sensor
    rivals = ~lone(scan_groups(pairs, rays), pairs.ray)
    contested = np.bincount(sight, rivals)[sight] > 0.0 if len(sight) else rivals
    some = np.flatnonzero(own | contested)
    return pairs.take(some), contested[some]


def turned(filter_: ImmFilter, known: Histories, bank: ModeEstimates, time_s: float) -> tuple[Histories, ModeEstimates]:
    """Return histories with their contested rays weighed anew by estimates (a bank) at `time_s`, and what follows."""
    recent = np.flatnonzero(known.contested.end_s > time_s - _RECENT_S)
    if not len(recent):
        return evolve(known, contested=AmbiguousMeasurements.empty()) if len(known.contested) else known, bank
    known = evolve(known, contested=known.contested.part(recent))
    whose = known.sights.track
    used = different(known.contested.sight)
    rows = different(whose[used])
    place = np.full(len(known), -1, dtype=np.int64)
    place[rows] = np.arange(len(rows))
    part, sights = bank.take(rows), known.sights.take(used)
    seen = np.zeros((len(whose), 2))
    seen[used] = expected(filter_.outlook(part, time_s), sights.placed(place[sights.track]))
    contested = known.contested.weighed(whose, seen)
    known = evolve(known, sights=contested.gathered(known.sights)[0], contested=contested)
    theirs = np.flatnonzero(place[whose] >= 0)
    first = evolve(known.first.take(rows), weight=part.weight, pace=part.pace)
    after = weighed(filter_, first, time_s, known.sights.take(theirs).placed(place[whose[theirs]]))[1]
    return known, bank.put(rows, _of_likelier_mode(part, after))


def _of_likelier_mode(before: ModeEstimates, after: ModeEstimates) -> ModeEstimates:
    """Return estimates with those of each track's likelier mode alone replaced."""
    coasts = (before.weight[:, 1] > before.weight[:, 0])[:, None]
    return ModeEstimates(
        before.weight,
        np.where(coasts, before.boost_mean, after.boost_mean),
        np.where(coasts[:, None], before.boost_root, after.boost_root),
        np.where(coasts, after.coast_mean, before.coast_mean),
        np.where(coasts[:, None], after.coast_root, before.coast_root),
        before.pace,
    )


def asked(known: Histories, age_s: FloatArray, step_s: float) -> BoolArray:
    """Return the tracks (n,) whose histories are to be assigned anew after a step, at ages (n,)."""
    before, after = (np.floor(np.log(np.maximum(age, 1e-9)) / _AGAIN) for age in (age_s - step_s, age_s))
    anew: BoolArray = (age_s < _RIVALS_S) | (known.doubt > _SETTLED) | (after > before)
    return anew


def kept(known: Histories, age_s: FloatArray, boosts: BoolArray, boost_lasts_s: float) -> BoolArray:
    """Return the tracks (n,) whose histories still may change, at ages (n,)."""
    young = age_s < np.where(boosts, boost_lasts_s, LONGEST_S)
    open_: BoolArray = (age_s < _RIVALS_S) | (known.doubt > _SETTLED) | (known.blur > _SHARP)
    return young & open_
