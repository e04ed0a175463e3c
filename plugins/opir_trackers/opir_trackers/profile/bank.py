"""All tracks' boost profiles at a time: rays in, hypotheses of class and heading side by side, step by step."""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_trackers.profile import fit, windows
from opir_trackers.profile import hypotheses as hypotheses_of
from opir_trackers.profile.end import BurnEnds, ends_of
from opir_trackers.profile.family import Family, Priors
from opir_trackers.profile.fit import Hypotheses, Solved
from opir_trackers.profile.hypotheses import FitMemory, joined
from opir_trackers.profile.parts import are_open, parted, parts_of
from opir_trackers.profile.rows import SPAN_S, Rows, compressed, means, normal_points, single
from opir_trackers.profile.seen import TrackHistory
from opir_trackers.profile.start import started
from opir_trackers.profile.strain import OffModelFilters, strained
from opir_trackers.sensors import SensorSchedule

#: Ticks of a track at which its hypotheses are reviewed: linearised anew, row by row.
REVIEWS = frozenset({1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 63, 79, 100, 126, 158, 200, 251, 316})

#: Tracks that fell silent are reviewed for so long, s: the end of a burn moves much.
_QUIET_S = 3.5

#: Steps of Gauss and Newton in a review of young tracks, of which there are so many ticks, and of others; of those that
#: are split by windows, which are reviewed at every tick; and of those of them that one sensor sees alone: the looks of
#: a tick move these by half a standard deviation, along ridges that bend, and one step does not follow. Trials of
#: boosts that pitched over unseen come from farther off.
_STEPS, _YOUNG_TICKS, _LATER_STEPS, _SPLIT_STEPS, _LONE_STEPS, _EARLY_STEPS = 3, 20, 2, 1, 2, 6

#: Hypotheses less probable than this ask for no review, and for no second step.
_TELLING = 0.02

#: No class is given up before this tick.
_TRIED = 6

#: The latest tick at which hypotheses are bent.
_BENT_TICK = 14

#: A drift of innovations so improbable, χ² beyond the number of its components, has what sees through windows split
#: anew, every so many ticks: well before it is believed, and the past that would tell the right from the wrong fades.
_DOUBTED, _AGAIN_TICKS = 8.0, 2


@frozen(eq=False)
class Fitting:
    """How one bank leads to the next."""

    priors: Priors
    watch: SensorSchedule
    light_time: bool

    def stepped(
        self, bank: OffModelFilters, tick_s: float, track: IntArray, rays: LinesOfSight, stray: FloatArray | None = None
    ) -> OffModelFilters:
        """Return the bank at a tick, with rays (m,) since the last one, given to tracks by number (m,).

        `stray` (m,) is the share of strays among each ray's track's, where that is known. Tracks of certain strangers
        lose their fits for good, and cost no more than what was seen of them.
        """
        fresh, travelled = self._points(bank, track, rays, stray)
        seen = bank.seen.with_rays(travelled, rays.time_s) if len(rays) else bank.seen
        seen = seen.paused(bank.seen, travelled, self.watch)
        ticks = np.zeros(len(seen.track), dtype=np.int64)
        ticks[np.searchsorted(seen.track, bank.seen.track)] = bank.ticks
        begun = np.setdiff1d(seen.track, bank.seen.track)
        hypotheses = Hypotheses.concatenate([bank.hypotheses, self._begun(fresh, begun)])
        bank = OffModelFilters(hypotheses, bank.rows, seen, ticks + 1)
        if not len(hypotheses):
            return bank
        fresh = fresh.take(np.isin(fresh.track, hypotheses.track))
        bank = strained(bank, fresh, self.priors, self.watch.bias_sigma_rad)
        bank = bank.without_fits(bank.seen.strangers())
        return self._fitted(bank, fresh.take(np.isin(fresh.track, bank.hypotheses.track)), tick_s)

    def memory(self, bank: OffModelFilters) -> FitMemory:
        """Return what a bank remembers."""
        return FitMemory(bank.rows, bank.seen, self.priors, self.watch.bias_sigma_rad)

    def parts(self, bank: OffModelFilters, tick_s: float) -> Hypotheses | None:
        """Return the hypotheses of a bank, those of what one sensor alone sees in parts by when the boost started.

        None where none has parts.
        """
        every = bank.hypotheses
        apart = (every.window[:, 3] > 0.0) & bank.seen.seen_by_one_sensor(every.track) & are_open(every, tick_s)
        chosen = np.flatnonzero(apart & (hypotheses_of.probability(every) > _TELLING))
        if not len(chosen):
            return None
        whole = every.take(chosen)
        first_s = np.min(bank.seen.of(whole.track).first_s, axis=1) - whole.anchor_s
        solution = fit.solved(whole, self.priors, self.watch.bias_sigma_rad)
        parts = parts_of(whole, solution, first_s, self.priors.take(whole.kind))
        if not len(parts.origin):
            return None
        trial, family, solution = self.memory(bank).linearised(parts.hypotheses)
        trial = self._finished(trial, parts.given(solution), family, bank.seen, tick_s)
        return parted(every, trial, chosen[parts.origin])

    def _points(
        self, bank: OffModelFilters, track: IntArray, rays: LinesOfSight, stray: FloatArray | None
    ) -> tuple[Rows, Rows]:
        """Return the normal points of rays, and the rays as rows at the times at which light left."""
        rows = single(track, rays)
        known = np.isin(track, bank.hypotheses.track)
        old, new = np.flatnonzero(known), np.flatnonzero(~known)
        parts, left = [], rows.time_s.copy()
        if len(new):
            left[new] = self.left_s(rows.take(new), hypotheses_of.on_the_ground(rows.take(new)))
            parts.append(means(evolve(rows.take(new), time_s=left[new]), None if stray is None else stray[new]))
        if len(old):
            path = hypotheses_of.HypothesisPath.of(bank.hypotheses, self.priors, rows.take(old))
            left[old] = self.left_s(rows.take(old), path.at(rows.take(old)))
            mine = evolve(rows.take(old), time_s=left[old])
            span = np.floor(rays.time_s[old] / SPAN_S).astype(np.int64)
            parts.append(normal_points(mine, path.at, span, None if stray is None else stray[old]))
        return Rows.concatenate(parts) if parts else Rows.empty(), evolve(rows, time_s=left)

    def left_s(self, rows: Rows, position: FloatArray) -> FloatArray:
        """Return when the light of rows left positions (m, 3)."""
        if not self.light_time:
            return rows.time_s
        away = position - rows.origin_ecef_m
        left: FloatArray = rows.time_s - np.sqrt(np.sum(away * away, axis=1)) / SPEED_OF_LIGHT_M_S
        return left

    def _begun(self, fresh: Rows, track: IntArray) -> Hypotheses:
        """Return hypotheses of every class for new tracks."""
        lead = fresh.take(np.lexsort((fresh.time_s, fresh.track)))
        lead = lead.take(np.searchsorted(lead.track, track))
        return hypotheses_of.first(lead, len(self.priors.burn_s), len(self.watch.period_s))

    def _fitted(self, bank: OffModelFilters, fresh: Rows, tick_s: float) -> OffModelFilters:
        hypotheses = bank.hypotheses
        ticks = bank.ticks[np.searchsorted(bank.seen.track, hypotheses.track)]
        due = self._due(bank, ticks, fresh, tick_s)
        bank = evolve(bank, rows=Rows.concatenate([bank.rows, fresh]))
        rows = bank.rows
        if due.any():
            rows = self._compressed(bank, hypotheses.track[due], tick_s)
        kept = self._added(hypotheses.take(~due), fresh, bank.seen, tick_s)
        seen = self._reviewed(hypotheses.take(due), rows, bank.seen, tick_s, ticks[due])
        every = Hypotheses.concatenate([kept, seen])
        every = every.take(np.lexsort((-every.evidence, every.kind, every.track)))
        ticks = bank.ticks[np.searchsorted(bank.seen.track, every.track)]
        likely = hypotheses_of.probability(every) > np.where(ticks < _TRIED, 0.0, hypotheses_of.GIVEN_UP)
        return OffModelFilters(every.take(likely), rows, bank.seen, bank.ticks)

    def _due(self, bank: OffModelFilters, ticks: IntArray, fresh: Rows, tick_s: float) -> BoolArray:
        """Return which hypotheses are to be reviewed: all of a track, so that they stay comparable."""
        hypotheses = bank.hypotheses
        last = np.max(bank.seen.of(hypotheses.track).last_s, axis=1)
        quiet = ~np.isin(hypotheses.track, fresh.track)
        bent = (hypotheses.window[:, 3] > 0.0) | _has_moved(hypotheses)
        moved = bent & (hypotheses_of.probability(hypotheses) > _TELLING)
        due = np.where(quiet, tick_s - last < _QUIET_S, np.isin(ticks, list(REVIEWS)) | moved) | (ticks == 1)
        every: BoolArray = np.isin(hypotheses.track, hypotheses.track[due])
        return every

    def _compressed(self, bank: OffModelFilters, track: IntArray, tick_s: float) -> Rows:
        mine = np.isin(bank.rows.track, track)
        path = hypotheses_of.HypothesisPath.of(bank.hypotheses, self.priors, None)
        joined_rows = compressed(bank.rows.take(mine), tick_s, path.at)
        return Rows.concatenate([bank.rows.take(~mine), joined_rows])

    def _added(self, hypotheses: Hypotheses, fresh: Rows, seen: TrackHistory, tick_s: float) -> Hypotheses:
        """Return the hypotheses with this tick's rows, each linearised where its hypothesis stands."""
        if not len(hypotheses):
            return hypotheses
        chosen, owner = joined(hypotheses.track, fresh.track)
        family = fit.family_of(hypotheses, self.priors)
        share = np.ones(len(chosen))
        return self._settled(fit.with_rows(hypotheses, family, fresh.take(chosen), owner, share), family, seen, tick_s)

    def _reviewed(
        self, hypotheses: Hypotheses, rows: Rows, seen: TrackHistory, tick_s: float, ticks: IntArray
    ) -> Hypotheses:
        """Return the hypotheses with all their rows linearised anew, and those that bend now through windows."""
        if not len(hypotheses):
            return hypotheses
        bends = (hypotheses.is_bent == 0) & (hypotheses_of.may_bend(hypotheses, self.priors) | (ticks >= _BENT_TICK))
        older = hypotheses.track[ticks > _YOUNG_TICKS]
        settled = self._through_windows(hypotheses.take(~bends), rows, seen, tick_s, older)
        doubted = (seen.of(hypotheses.track).drifted() > _DOUBTED) & (ticks % _AGAIN_TICKS == 0)
        settled = self._again(settled, rows, seen, tick_s, hypotheses.track[doubted])
        settled = self._pitched_early(settled, rows, seen, tick_s, hypotheses.track[np.isin(ticks, list(REVIEWS))])
        if not bends.any():
            return hypotheses_of.distinct(settled)
        spread = hypotheses.take(bends)
        spread = windows.windowed(spread, self.priors, seen.seen_by_one_sensor(spread.track))
        spread = hypotheses_of.distinct(self._relinearised(spread, rows, seen, tick_s, _STEPS))
        spread = self._relinearised(spread, rows, seen, tick_s, _STEPS)
        return hypotheses_of.distinct(Hypotheses.concatenate([settled, spread]))

    def _through_windows(
        self, trial: Hypotheses, rows: Rows, seen: TrackHistory, tick_s: float, older: IntArray
    ) -> Hypotheses:
        """Return hypotheses with all their rows linearised anew, and windows no wider and no longer than they need."""
        if not len(trial):
            return trial
        trial, fresh = windows.laid(trial, self.priors)
        young, split = ~np.isin(trial.track, older) | fresh, trial.window[:, 3] > 0.0
        lone = split & seen.seen_by_one_sensor(trial.track) & (hypotheses_of.probability(trial) > _TELLING)
        parts = (
            (young, _STEPS),
            (~young & ~split, _LATER_STEPS),
            (~young & split & ~lone, _SPLIT_STEPS),
            (~young & lone, _LONE_STEPS),
        )
        trial = Hypotheses.concatenate(
            [self._relinearised(trial.take(part), rows, seen, tick_s, steps) for part, steps in parts]
        )
        trial, lone = windows.straightened(trial)
        again = self._relinearised(trial.take(lone), rows, seen, tick_s, _LATER_STEPS)
        return Hypotheses.concatenate([trial.take(~lone), again])

    def _again(self, found: Hypotheses, rows: Rows, seen: TrackHistory, tick_s: float, track: IntArray) -> Hypotheses:
        """Return hypotheses with those that tracks by number have in headings where none was left."""
        mine = found.take(np.isin(found.track, track))
        trial = windows.anew(mine, self.priors, seen.seen_by_one_sensor(mine.track))
        if not len(trial):
            return found
        for _ in range(2):
            trial = hypotheses_of.distinct(self._relinearised(trial, rows, seen, tick_s, _STEPS))
        return windows.enlarged(found, trial)

    def _pitched_early(
        self, found: Hypotheses, rows: Rows, seen: TrackHistory, tick_s: float, track: IntArray
    ) -> Hypotheses:
        """Return hypotheses with those of tracks, by number, that one sensor sees, which pitched over unseen."""
        may = (found.window[:, 3] > 0.0) & seen.seen_by_one_sensor(found.track) & are_open(found, tick_s)
        may &= np.isin(found.track, track) & (hypotheses_of.probability(found) > _TELLING)
        trial = windows.pitched_early(found.take(may), self.priors)
        return Hypotheses.concatenate([found, self._relinearised(trial, rows, seen, tick_s, _EARLY_STEPS)])

    def _relinearised(self, trial: Hypotheses, rows: Rows, seen: TrackHistory, tick_s: float, steps: int) -> Hypotheses:
        chosen, owner = joined(trial.track, rows.track)
        part, share = rows.take(chosen), np.ones(len(chosen))
        for _ in range(steps if len(trial) else 0):
            family = fit.family_of(trial, self.priors)
            trial = self._settled(fit.with_rows(trial.cleared(), family, part, owner, share), family, seen, tick_s)
        return evolve(trial, stood=trial.parameters)

    def _settled(self, hypotheses: Hypotheses, family: Family, seen: TrackHistory, tick_s: float) -> Hypotheses:
        """Return the hypotheses at the solutions of their normal equations, given when their burns may end."""
        solution = fit.solved(hypotheses, self.priors, self.watch.bias_sigma_rad)
        return self._finished(hypotheses, started(hypotheses, solution, self.priors, seen), family, seen, tick_s)

    def _finished(
        self, hypotheses: Hypotheses, solution: Solved, family: Family, seen: TrackHistory, tick_s: float
    ) -> Hypotheses:
        """Return the hypotheses at solutions, given when their burns may end."""
        solution, ends = self._ended(hypotheses, solution, family, seen, tick_s)
        parameters = fit.moved(hypotheses, solution.parameters, self.priors)
        return evolve(
            hypotheses,
            end=np.stack([ends.nodes, ends.weights], axis=1),
            end_quantiles=ends.quantiles,
            parameters=parameters,
            spread=solution.spread,
            evidence=solution.evidence - fit.shortfall(solution, parameters),
            misfit=solution.misfit,
        )

    def _ended(
        self, hypotheses: Hypotheses, solution: Solved, family: Family, seen: TrackHistory, tick_s: float
    ) -> tuple[Solved, BurnEnds]:
        """Return the solution given what was seen, or not, of the ends of burns, and these."""
        away, spread = solution.parameters - hypotheses.parameters, solution.spread
        mean = np.log(family.courses.burn_s) + np.sum(family.end_slope() * away, axis=1)
        gain, variance = family.with_end(spread)
        silence = seen.of(hypotheses.track).silence(hypotheses.kind, tick_s, self.watch)
        ends = ends_of(family.start_s, mean, variance, silence)
        gain = gain / variance[:, None]
        less = (variance - ends.variance)[:, None, None]
        settled = Solved(
            solution.parameters + gain * (ends.mean - mean)[:, None],
            spread - less * gain[:, :, None] * gain[:, None, :],
            solution.evidence + ends.evidence,
            solution.misfit,
        )
        return settled, ends


def _has_moved(hypotheses: Hypotheses) -> BoolArray:
    """Return which hypotheses have moved so far since they were reviewed that their rows look different from there."""
    moved: BoolArray = np.any(np.abs(hypotheses.parameters - hypotheses.stood) > _MOVED, axis=1)
    return moved


#: Moves beyond these ask for a review: m, m, s, rad and shares. They bend rows by some ten metres:
#: what a sharp sensor makes of ten seconds' looks is known to about three times that.
_MOVED = np.array([np.inf, np.inf, np.inf, 0.015, 0.015, 0.015, 0.015, 0.03, 0.045, np.inf])
