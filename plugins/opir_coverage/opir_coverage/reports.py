"""When a launch is reported: the number of reports by a time, from P_d of its looks, confirmation
and latency.

A sensor looks once in each scan, at a phase that is uniform over the scan. Given the flight, looks
are independent; a look is reported if it is the last of M detections in N successive scans. The
number of reports is a Markov chain over the outcomes of the last N - 1 scans.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from opir_core.arrays import BoolArray, FloatArray, IntArray

#: Longest step between two phases of a scan, s. A sensor that looks more often than every shortest
#: step is taken to look no more often: its M-th detection is at most M such steps late.
_LONGEST_STEP_S = 2.0
_SHORTEST_STEP_S = 0.2
#: So many looks are prepared at once. After them launches that have fewer than the reports with
#: less than this chance are left out, if they are this share of all.
_BLOCK = 8
_SURE = 1e-6
_WORTH_PRUNING = 0.05
#: P_d below which a look is taken as none: a thousand such looks change a chance by less than
#: 0.001.
_IMPOSSIBLE = 1e-6
_IMPOSSIBLE_QUANTILE = float(ndtri(_IMPOSSIBLE))
#: Time within a look's step: its middle.
_MIDDLE = 0.5

#: Chances of numbers of reports, in single precision: they are read to a thousandth.
Chances = NDArray[np.float32]


@frozen(eq=False)
class ScanSteps:
    """The steps of a chain of looks: `phases` steps of `step_s` make a scan; `steps` of them cover
    a burn.
    """

    step_s: float
    phases: int
    steps: int

    @classmethod
    def of(cls, period_s: float, burn_s: float) -> "ScanSteps":
        """Return the steps of a scan period over a burn."""
        phases = max(1, round(period_s / _LONGEST_STEP_S))
        step_s = max(period_s / phases, _SHORTEST_STEP_S)
        return cls(step_s, phases, max(1, round(burn_s / step_s)))

    def times_s(self) -> FloatArray:
        """Return the times (steps,) of looks since ignition, s."""
        return np.asarray((np.arange(self.steps) + _MIDDLE) * self.step_s)


class ReportChain:
    """Chances (most, n) of 0 to most - 1 reports so far, `total`, of the launches that one sensor
    looks at.

    `confirmation` are M and N. Launches that surely have `most` reports are left out of further
    looks.
    """

    def __init__(self, rows: int, phases: int, confirmation: tuple[int, int], most: int) -> None:
        self._needed = confirmation[0]
        self._phases = phases
        self._step = 0
        # After this number of steps without a chance of a detection, past outcomes are all misses.
        self._memory = phases * (confirmation[1] - 1)
        self._last = np.full(rows, -self._memory - 1)
        self._active = np.arange(rows)
        self._states: Chances = np.zeros(
            (phases, most, 1 << (confirmation[1] - 1), rows), dtype=np.float32
        )
        self._states[:, 0, 0] = 1.0
        self.total: Chances = np.zeros((most, rows), dtype=np.float32)
        self.total[0] = 1.0

    @property
    def active(self) -> IntArray:
        """The launches that may have fewer than `most` reports."""
        return self._active

    def look(self, chance: FloatArray, at: IntArray | None = None) -> None:
        """Look once more, at one of the phases in turn, with P_d (k,) of the active launches, or of
        those `at` (k,).
        """
        place = np.arange(len(self._active)) if at is None else at
        is_possible = chance > _IMPOSSIBLE
        rows = place[is_possible]
        own = chance[is_possible]
        if self._memory:
            self._last[rows] = self._step
            whole = np.zeros(len(self._active))
            whole[rows] = own
            rows = np.flatnonzero(self._step - self._last <= self._memory)
            own = whole[rows]
        phase = self._step % self._phases
        if len(rows):
            old = self._states[phase][..., rows]
            new = _after(old, own.astype(np.float32), self._needed)
            self.total[:, self._active[rows]] += (_whole(new) - _whole(old)) / self._phases
            self._states[phase][..., rows] = new
        self._step += 1

    def prune(self, is_done: BoolArray) -> None:
        """Leave out launches that surely have all reports of this sensor, or of all sensors:
        `is_done` (rows,).
        """
        if not len(self._active):
            return
        is_done = is_done[self._active] | (self.total[:, self._active].sum(axis=0) < _SURE)
        if is_done.mean() > _WORTH_PRUNING:
            self.total[:, self._active[is_done]] = 0.0
            self._active = self._active[~is_done]
            self._last = self._last[~is_done]
            self._states = self._states[..., ~is_done]


def _whole(states: Chances) -> Chances:
    """Return the chances (reports, n) over all past outcomes."""
    whole = states[:, 0].copy()
    for past in range(1, states.shape[1]):
        whole += states[:, past]
    return whole


def _after(old: Chances, chance: Chances, needed: int) -> Chances:
    """Return the states (reports, outcomes, n) after a look with P_d (n,)."""
    new = np.zeros_like(old)
    mask = old.shape[1] - 1
    missed = 1.0 - chance
    for past in range(old.shape[1]):
        new[:, (past << 1) & mask] += old[:, past] * missed
        hit = old[:, past] * chance
        now = ((past << 1) | 1) & mask
        if past.bit_count() + 1 >= needed:
            new[1:, now] += hit[:-1]
        else:
            new[:, now] += hit
    return new


def joined(counts: Chances, others: Chances) -> Chances:
    """Return the chances (…, most, n) of numbers of reports of two independent sources, each (…,
    most, n).
    """
    both = np.zeros_like(counts)
    for more in range(counts.shape[-2]):
        both[..., more:, :] += (
            counts[..., : counts.shape[-2] - more, :] * others[..., more : more + 1, :]
        )
    return both


class Reports:
    """The chances (T, most, n) of fewer than `most` reports by times since ignition (T,), of all
    sensors together.
    """

    def __init__(self, time_s: FloatArray, most: int, cells: int) -> None:
        self.time_s = time_s
        self.chance: Chances = np.zeros((len(time_s), most, cells), dtype=np.float32)
        self.chance[:, 0] = 1.0

    def add(
        self,
        rows: IntArray,
        chain: ReportChain,
        nodes: FloatArray,
        steps: ScanSteps,
        latency_s: float,
    ) -> None:
        """Add a chain over cells `rows` (n,), with normal quantiles of P_d (K, n) at equal steps of
        the burn, ends included; nan without a look.

        `rows` are those of one sensor in order, then those of another that looks as often.
        """
        place = (self.time_s - latency_s) / steps.step_s
        at_node = steps.times_s() * ((len(nodes) - 1) / (steps.step_s * steps.steps))
        sensors = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) <= 0) + 1)
        early = chain.total.copy()
        wanted = int(np.searchsorted(place, 0.0, side="right"))
        for number in range(1, steps.steps + 1):
            if (number - 1) % _BLOCK == 0:
                chain.prune(self._have_all(wanted)[rows])
                at, chance = _possible(
                    nodes, at_node[number - 1 : number - 1 + _BLOCK], chain.active
                )
            if len(chain.active):
                chain.look(chance[(number - 1) % _BLOCK], at)
            if wanted == len(place) or place[wanted] > number + 1.0:
                continue
            late = chain.total
            while wanted < len(place) and place[wanted] <= number:
                now = early + (late - early) * max(place[wanted] - (number - 1.0), 0.0)
                self._join(wanted, rows, sensors, now)
                wanted += 1
            early = late.copy()
        for left in range(wanted, len(place)):
            self._join(left, rows, sensors, chain.total)

    def _have_all(self, wanted: int) -> BoolArray:
        """Return which cells surely have all reports by the last of the first `wanted` times, and
        so at later ones.
        """
        if not 0 < wanted < len(self.time_s):
            return np.zeros(self.chance.shape[2], dtype=np.bool_)
        have_all: BoolArray = self.chance[wanted - 1].sum(axis=0) < _SURE
        self.chance[wanted:, :, np.flatnonzero(have_all & self.chance[wanted].any(axis=0))] = 0.0
        return have_all

    def _join(
        self, place: int, rows: IntArray, sensors: Sequence[IntArray], counts: Chances
    ) -> None:
        # Cells that surely have all reports have chances of exactly 0 from then on.
        has_reported = (counts[0] < 1.0) & self.chance[place].any(axis=0)[rows]
        for all_cells in sensors:
            own = all_cells[has_reported[all_cells]]
            cells = rows[own]
            self.chance[place][:, cells] = joined(self.chance[place][:, cells], counts[:, own])

    def times_s(self, reports: int, probability: float) -> FloatArray:
        """Return the times (n,) since ignition by which a probability of a number of reports is
        reached, or nan.
        """
        have = 1.0 - self.chance[:, :reports].sum(axis=1)
        reached = have >= probability
        late = reached.argmax(axis=0)
        cells = np.arange(have.shape[1])
        early = np.maximum(late - 1, 0)
        low = have[early, cells]
        high = have[late, cells]
        share = np.where(late > 0, (probability - low) / np.maximum(high - low, 1e-12), 0.0)
        time = self.time_s[early] + (self.time_s[late] - self.time_s[early]) * share
        return np.where(reached.any(axis=0), time, np.nan)

    def probability(self, reports: int) -> FloatArray:
        """Return the probability (n,) of a number of reports by the last time."""
        return 1.0 - self.chance[-1, :reports].sum(axis=0)


def _possible(
    nodes: FloatArray, place: FloatArray, active: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return which active launches may be detected at places (b,) between nodes (K, launches), and
    P_d (b, those).

    The normal quantile is interpolated, as the engine does between looks; beside a node without a
    look (nan) the nearer node decides.
    """
    early = np.minimum(place.astype(np.int64), len(nodes) - 2)
    first = int(early[0])
    around = nodes[first : int(early[-1]) + 2, active]
    at = np.flatnonzero(np.fmax.reduce(around, axis=0) > _IMPOSSIBLE_QUANTILE)
    around = around[:, at]
    share = (place - early)[:, None]
    one = around[early - first]
    other = around[early - first + 1]
    with np.errstate(invalid="ignore"):
        quantile = one + share * (other - one)
    lone = np.isnan(quantile)
    if lone.any():
        nearer = np.where(share < _MIDDLE, one, other)[lone]
        quantile[lone] = np.where(np.isnan(nearer), -np.inf, nearer)
    return at, ndtr(quantile)
