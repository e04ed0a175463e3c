"""Lines of sight of a slice with the rays that several tracks may have, and tracks worked out anew by all of theirs."""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, Sights, dot
from opir_trackers.assignment import different, lone
from opir_trackers.association import Chances, plain, scan_groups, scan_numbers
from opir_trackers.filter.switching import ImmFilter, ModeEstimates
from opir_trackers.gating import GatedPairs
from opir_trackers.predicted_measurements import PredictedMeasurements
from opir_trackers.stereo.ambiguous_measurements import LEAST_WEIGHT, AmbiguousMeasurements, expected
from opir_trackers.stereo.associate_and_update import AssociationResult
from opir_trackers.stereo.histories import Histories, parted_sights, weighed

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
