"""How tracks take in the rays of a slice: gates, assignments, and their being settled by what they led to."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_trackers.association import (
    Associated,
    Chances,
    as_owned,
    associate_joint,
    associate_nearest,
    crowded,
    related,
    scan_numbers,
    uncontested,
)
from opir_trackers.configs import StereoFilterConfig
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.mode_mixing import are_loose
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs, candidates, gated
from opir_trackers.sensors import Biases
from opir_trackers.stereo.ghosts import RANGE_M, Slice, without_ghosts
from opir_trackers.stereo.measurement_weights import FEW, Outliers, Span, doubtful, unsuspected, weighed
from opir_trackers.stereo.track_management import TrackTable

#: A settled assignment may reach this much farther than the first gate, in standard deviations.
_SETTLING_GATE = 6.0

#: Rays are assigned anew where a slice moved a track by more than this share of one look's error: a shift s changes the
#: log odds of a ray between two rivals d apart by s d, in errors; rivals farther apart than 3 contest few rays.
_RESTLESS = 1.0 / 3.0

_Asked = TypeVar("_Asked")
_Answer = TypeVar("_Answer")

_NONE = np.empty(0, dtype=np.int64)


class AssociationResult(NamedTuple):
    """Estimates after a slice, the row that each ray was given to, -1 for none, the pairs in which it was, and all.

    `strays` (n, shares) is what each track's own rays so far tell of the share of strays among them; it is missing
    where all tracks are known to have next to none.
    """

    bank: ModeEstimates
    owner: IntArray
    own: GatedPairs
    pairs: GatedPairs
    strays: FloatArray | None = None


@frozen(eq=False)
class AssociateAndUpdate:
    """How tracks take in rays."""

    config: StereoFilterConfig
    filter: ImmFilter
    chances: Chances
    light_time: bool
    biases: Biases
    #: The last bank moved, and the last one looked out from and held against rays: labels and estimates ask the same.
    last: dict[str, tuple[Any, float, Any]] = field(factory=dict)
    met: list[tuple[PredictedMeasurements, float, LinesOfSight, GatedPairs]] = field(factory=list)
    assigned: list[tuple[GatedPairs, IntArray | None, Associated]] = field(factory=list)

    def moved(self, bank: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return a bank a step later, as far as it is `expected`."""
        return self.remembered("moved", self.filter.expected, bank, step_s)

    def outlook(self, bank: ModeEstimates, time_s: float) -> PredictedMeasurements:
        """Return where the tracks of a bank are about its time."""
        return self.remembered("outlook", self.filter.outlook, bank, time_s)

    def blurred(self, bank: ModeEstimates, time_s: float, reports: IntArray) -> PredictedMeasurements:
        """Return where the tracks of a bank are, with what the biases of those that see them, by `reports`, add."""
        outlook = self.outlook(bank, time_s)
        if not self.biases.any:
            return outlook
        seen, place = reports >= 0, bank.likelier_position_m
        return self.remembered(
            "blurred", lambda one, when: one._replace(blur=self.biases.of_others(place, when, seen)), outlook, time_s
        )

    def moments(self, bank: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity of a bank's tracks."""
        return self.remembered("moments", lambda one, _: self.filter.moments(one), bank, 0.0)

    def restrained(self, bank: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the bank, of whose tracks `rows` no velocity is less certain than those of all targets are."""
        rows = rows[are_loose(self.moments(bank)[1][rows])]
        return self.filter.restrained(bank, rows) if len(rows) else bank

    def remembered(self, name: str, way: Callable[[_Asked, float], _Answer], asked: _Asked, value: float) -> _Answer:
        """Return what a way leads to from what it is asked; the last answer is kept by name."""
        known = self.last.get(name)
        if known is None or known[0] is not asked or known[1] != value:
            known = self.last[name] = asked, value, way(asked, value)
        answer: _Answer = known[2]
        return answer

    def followed(
        self, bank: ModeEstimates, end_s: float, rays: LinesOfSight, span: float, young: IntArray, known: TrackTable
    ) -> AssociationResult:
        """Return the bank with a slice's rays taken in, and what each ray told, given what is `known` of the tracks.

        The rays are assigned anew by the estimates they led to, until nothing changes or `settling` says stop: among
        near targets a whole slice tells more than one scan does. Rows `young` need it not: they are settled by all that
        was seen of them.
        """
        ahead = self.blurred(bank, end_s, known.reports)
        pairs, stray = self.paired(ahead, rays, span), Outliers(known.strays)
        found = self._associated(pairs, rays)
        after = self.filter.updated(bank, end_s, found.sights, span)
        busy = self._restless(bank, after, pairs, rays, young) if self.config.settling and found.contested else _NONE
        first = AssociationResult(after, found.owner, found.own, pairs)
        told = self._settled(first, bank, ahead, rays, span, pairs, busy) if len(busy) else first
        share = self.remembered("shares", lambda log, _: Outliers(log).share, stray.log, 0.0)
        doubted = doubtful(told.own, share) if self.config.association == "nearest" else _NONE
        if len(doubted) and found.contested:
            doubted = np.setdiff1d(doubted, crowded(pairs, rays), assume_unique=True)
        if not len(doubted):
            if not np.count_nonzero(share > FEW):
                return told
            strays = stray.log + unsuspected(told.own, stray, self.config.gate_sigma)
            return AssociationResult(told.bank, told.owner, told.own, told.pairs, strays)
        return self._weighed(told, bank, Span(end_s, span, self.config.gate_sigma), stray, doubted)

    def _weighed(
        self, told: AssociationResult, bank: ModeEstimates, span: Span, stray: Outliers, doubted: IntArray
    ) -> AssociationResult:
        """Return what was followed with the rays of tracks `doubted`, which have no rivals, weighed."""
        strays = unsuspected(told.own, stray, span.gate)
        place = np.full(len(bank), -1, dtype=np.int64)
        place[doubted] = np.arange(len(doubted))
        mine = told.own.take(np.flatnonzero(place[told.own.track] >= 0))
        own, before, after = evolve(mine, track=place[mine.track]), bank.take(doubted), told.bank.take(doubted)
        found = weighed(self.filter, before, after, span, own, stray.take(doubted))
        strays[doubted] = found.strays
        return told._replace(bank=told.bank.put(doubted, found.bank), strays=stray.after(strays).log)

    def _restless(
        self, bank: ModeEstimates, after: ModeEstimates, pairs: GatedPairs, rays: LinesOfSight, young: IntArray
    ) -> IntArray:
        """Return the tracks that have rivals, of clusters in which one, not young, moved enough for other rays."""
        rivals = crowded(pairs, rays)
        shift = after.take(rivals).likelier_position_m - bank.take(rivals).likelier_position_m
        far = np.sqrt(np.sum(shift * shift, axis=1)) > _RESTLESS * rays.sigma_rad.max(initial=0.0) * RANGE_M
        restless = np.setdiff1d(rivals[far], young, assume_unique=True)
        return rivals[related(pairs, restless)[rivals]]

    def _settled(
        self,
        first: AssociationResult,
        bank: ModeEstimates,
        ahead: PredictedMeasurements,
        rays: LinesOfSight,
        span: float,
        pairs: GatedPairs,
        busy: IntArray,
    ) -> AssociationResult:
        """Return what was followed with the rays of the tracks `busy`, which have rivals, assigned anew."""
        place = np.full(len(bank) + 1, -1, dtype=np.int64)
        place[busy] = np.arange(len(busy))
        rows = np.flatnonzero(place[pairs.track] >= 0)
        track, ray, before, then = place[pairs.track[rows]], pairs.ray[rows], bank.take(busy), first.bank.take(busy)
        found, mine, end_s = None, place[first.owner], ahead.time_s
        blur = None if ahead.blur is None else ahead.blur[busy]
        for turn in range(self.config.settling):
            path = self.filter.outlook(then, end_s)._replace(blur=blur)
            closer = gated(path, rays, track, ray, _SETTLING_GATE, self.light_time)
            anew = self._associated(closer, rays)
            if turn == 0:
                anew = self._unghosted(before, end_s, closer, rays, anew)
            if np.array_equal(anew.owner, mine):
                break
            found, mine = anew, anew.owner
            then = self.filter.updated(before, end_s, found.sights, span)
        if found is None:
            return first
        others = np.where((first.owner >= 0) & (place[first.owner] < 0), first.owner, -1)
        kept = first.own.take(np.flatnonzero(place[first.own.track] < 0))
        settled = evolve(found.own, track=busy[found.own.track])
        return AssociationResult(
            first.bank.put(busy, then),
            np.where(mine >= 0, busy[mine], others),
            GatedPairs.concatenate([kept, settled]),
            pairs,
        )

    def _unghosted(
        self, bank: ModeEstimates, end_s: float, pairs: GatedPairs, rays: LinesOfSight, found: Associated
    ) -> Associated:
        """Return the association with the rays of one sensor exchanged where that explains the slice better."""
        used = found.owner[pairs.ray] == pairs.track
        better = without_ghosts(Slice(self.filter, self.chances, self.light_time, bank, end_s, rays), pairs, used)
        return found if np.array_equal(better, used) else as_owned(pairs, rays, better)

    def paired(self, outlook: PredictedMeasurements, rays: LinesOfSight, span: float) -> GatedPairs:
        """Return the gated pairs of all tracks and the rays of a span; the same question twice is worked out once."""
        if self.met:
            before, reach, known, pairs = self.met[0]
            if before is outlook and reach == span and known is rays:
                return pairs
        gate = self.config.gate_sigma
        pairs = gated(outlook, rays, *candidates(outlook, rays, span, gate, self.light_time), gate, self.light_time)
        self.met[:] = [(outlook, span, rays, pairs)]
        return pairs

    def _associated(self, pairs: GatedPairs, rays: LinesOfSight) -> Associated:
        if self.config.association == "joint":
            return associate_joint(pairs, rays, self.chances)
        return self.nearest(pairs, rays)

    def nearest(self, pairs: GatedPairs, rays: LinesOfSight) -> Associated:
        """Return the likeliest assignment of each scan; the same question twice is worked out once."""
        if self.assigned and self.assigned[0][0] is pairs:
            _, known, found = self.assigned[0]
            scan = None if uncontested(pairs, rays) else scan_numbers(rays.sensor, rays.scan)
            if known is scan or (known is not None and scan is not None and np.array_equal(known, scan)):
                return found
        found = associate_nearest(pairs, rays, self.chances)
        self.assigned[:] = [(pairs, scan_numbers(rays.sensor, rays.scan) if found.contested else None, found)]
        return found
