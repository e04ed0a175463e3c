"""The number of reports of a launch by a time, from P_d of its looks, confirmation and latency.

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
#: Looks that are prepared in a block.
_BLOCK = 8
#: Chance of fewer than all reports below which a launch is left out of further looks.
_SURE = 1e-6
#: Least share of such launches that are removed from the arrays, which copies them.
_WORTH_PRUNING = 0.05
#: P_d below which a look is left out: a thousand such looks change a chance by less than 0.001.
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
    """Chances `total` (limit, n) of 0 to limit - 1 reports so far, of one sensor's launches.

    `confirmation` are M and N. Launches with `report_limit` reports, with certainty, are left out
    of further looks.
    """

    def __init__(
        self, rows: int, phases: int, confirmation: tuple[int, int], report_limit: int
    ) -> None:
        self._needed = confirmation[0]
        self._phases = phases
        self._step = 0
        # After this number of steps without a chance of a detection, past outcomes are all misses.
        self._memory = phases * (confirmation[1] - 1)
        self._last = np.full(rows, -self._memory - 1)
        self._active = np.arange(rows)
        self._states: Chances = np.zeros(
            (phases, report_limit, 1 << (confirmation[1] - 1), rows), dtype=np.float32
        )
        self._states[:, 0, 0] = 1.0
        self.total: Chances = np.zeros((report_limit, rows), dtype=np.float32)
        self.total[0] = 1.0

    @property
    def active(self) -> IntArray:
        """The launches that may have fewer than `most` reports."""
        return self._active

    def look(self, chance: FloatArray, at: IntArray | None = None) -> None:
        """Look at the next phase, with P_d (k,) of the active launches, or of those `at` (k,)."""
        place = np.arange(len(self._active)) if at is None else at
        is_possible = chance > _IMPOSSIBLE
        rows = place[is_possible]
        chances = chance[is_possible]
        if self._memory:
            self._last[rows] = self._step
            all_chances = np.zeros(len(self._active))
            all_chances[rows] = chances
            rows = np.flatnonzero(self._step - self._last <= self._memory)
            chances = all_chances[rows]
        phase = self._step % self._phases
        if len(rows):
            old = self._states[phase][..., rows]
            new = _after(old, chances.astype(np.float32), self._needed)
            self.total[:, self._active[rows]] += (_whole(new) - _whole(old)) / self._phases
            self._states[phase][..., rows] = new
        self._step += 1

    def prune(self, is_done: BoolArray) -> None:
        """Leave out launches with all reports: of this sensor, or by `is_done` (rows,) of all."""
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
    total = states[:, 0].copy()
    for past in range(1, states.shape[1]):
        total += states[:, past]
    return total


def _after(old: Chances, chance: Chances, needed: int) -> Chances:
    """Return the states (reports, outcomes, n) after a look with P_d (n,)."""
    new = np.zeros_like(old)
    mask = old.shape[1] - 1
    missed = 1.0 - chance
    for past in range(old.shape[1]):
        new[:, (past << 1) & mask] += old[:, past] * missed
        hit = old[:, past] * chance
        outcome = ((past << 1) | 1) & mask
        if past.bit_count() + 1 >= needed:
            new[1:, outcome] += hit[:-1]
        else:
            new[:, outcome] += hit
    return new


def joined(counts: Chances, other_counts: Chances) -> Chances:
    """Return the chances (…, limit, n) of the sums of two independent numbers of reports."""
    sums = np.zeros_like(counts)
    for more in range(counts.shape[-2]):
        sums[..., more:, :] += (
            counts[..., : counts.shape[-2] - more, :] * other_counts[..., more : more + 1, :]
        )
    return sums


class Reports:
    """Chances (T, limit, n) of fewer than `limit` reports of all sensors by times (T,), s.

    Times are since ignition.
    """

    def __init__(self, time_s: FloatArray, report_limit: int, cells: int) -> None:
        self.time_s = time_s
        self.chance: Chances = np.zeros((len(time_s), report_limit, cells), dtype=np.float32)
        self.chance[:, 0] = 1.0

    def add(
        self,
        rows: IntArray,
        chain: ReportChain,
        nodes: FloatArray,
        steps: ScanSteps,
        latency_s: float,
    ) -> None:
        """Add a chain over cells `rows` (n,).

        `nodes` (K, n) are normal quantiles of P_d at equal steps of the burn, ends included; nan
        without a look. `rows` are those of one sensor in order, then of another with equal scans.
        """
        place = (self.time_s - latency_s) / steps.step_s
        at_node = steps.times_s() * ((len(nodes) - 1) / (steps.step_s * steps.steps))
        sensors = np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) <= 0) + 1)
        previous = chain.total.copy()
        time_index = int(np.searchsorted(place, 0.0, side="right"))
        for number in range(steps.steps):
            if number % _BLOCK == 0:
                chain.prune(self._have_all(time_index)[rows])
                at, chance = _possible(nodes, at_node[number : number + _BLOCK], chain.active)
            if len(chain.active):
                chain.look(chance[number % _BLOCK], at)
            if time_index == len(place) or place[time_index] > number + 2.0:
                continue
            end = int(np.searchsorted(place, number + 1, side="right"))
            for index in range(time_index, end):
                share = max(place[index] - number, 0.0)
                self._join(index, rows, sensors, previous + (chain.total - previous) * share)
            time_index = end
            previous = chain.total.copy()
        for index in range(time_index, len(place)):
            self._join(index, rows, sensors, chain.total)

    def _have_all(self, time_index: int) -> BoolArray:
        """Return the cells that have all reports with certainty before the time `time_index`.

        Their chances at later times become 0.
        """
        if not 0 < time_index < len(self.time_s):
            return np.zeros(self.chance.shape[2], dtype=np.bool_)
        have_all: BoolArray = self.chance[time_index - 1].sum(axis=0) < _SURE
        self.chance[
            time_index:, :, np.flatnonzero(have_all & self.chance[time_index].any(axis=0))
        ] = 0.0
        return have_all

    def _join(
        self, place: int, rows: IntArray, sensors: Sequence[IntArray], counts: Chances
    ) -> None:
        # Cells that surely have all reports have chances of exactly 0 from then on.
        has_reported = (counts[0] < 1.0) & self.chance[place].any(axis=0)[rows]
        for all_cells in sensors:
            columns = all_cells[has_reported[all_cells]]
            cells = rows[columns]
            self.chance[place][:, cells] = joined(self.chance[place][:, cells], counts[:, columns])

    def times_s(self, reports: int, probability: float) -> FloatArray:
        """Return the times (n,) since ignition, s, by which reports have a probability; or nan."""
        have = 1.0 - self.chance[:, :reports].sum(axis=1)
        reached = have >= probability
        upper = reached.argmax(axis=0)
        cells = np.arange(have.shape[1])
        lower = np.maximum(upper - 1, 0)
        low = have[lower, cells]
        high = have[upper, cells]
        share = np.where(upper > 0, (probability - low) / np.maximum(high - low, 1e-12), 0.0)
        time = self.time_s[lower] + (self.time_s[upper] - self.time_s[lower]) * share
        return np.where(reached.any(axis=0), time, np.nan)

    def probability(self, reports: int) -> FloatArray:
        """Return the probability (n,) of a number of reports by the last time."""
        return 1.0 - self.chance[-1, :reports].sum(axis=0)


def _possible(
    nodes: FloatArray, place: FloatArray, active: IntArray
) -> tuple[IntArray, FloatArray]:
    """Return the active launches that may be detected, and their P_d (b, n) at places (b,).

    Places are in steps between nodes (K, launches).
    The normal quantile is interpolated, as the engine does between looks; beside a node without a
    look (nan) the nearer node decides.
    """
    lower = np.minimum(place.astype(np.int64), len(nodes) - 2)
    start = int(lower[0])
    around = nodes[start : int(lower[-1]) + 2, active]
    at = np.flatnonzero(np.fmax.reduce(around, axis=0) > _IMPOSSIBLE_QUANTILE)
    around = around[:, at]
    share = (place - lower)[:, None]
    lower_quantile = around[lower - start]
    upper_quantile = around[lower - start + 1]
    with np.errstate(invalid="ignore"):
        quantile = lower_quantile + share * (upper_quantile - lower_quantile)
    lone = np.isnan(quantile)
    if lone.any():
        nearer = np.where(share < _MIDDLE, lower_quantile, upper_quantile)[lone]
        quantile[lone] = np.where(np.isnan(nearer), -np.inf, nearer)
    return at, ndtr(quantile)
