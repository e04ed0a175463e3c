"""When a launch is reported: the number of reports by a time, from P_d of its looks, confirmation and latency.

A sensor looks once in each scan, at a phase that is uniform over the scan. Given the flight, looks are independent; a
look is reported if it is the last of M detections in N successive scans. The number of reports follows as a Markov chain
over the outcomes of the last N - 1 scans, exact for looks at the steps of the chain.
"""

from collections.abc import Iterator

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray

#: Longest step between two phases of a scan, s.
_LONGEST_STEP_S = 2.0
#: Time within a look's step: its middle.
_MIDDLE = 0.5


@frozen(eq=False)
class ScanSteps:
    """The steps of a chain of looks: `phases` steps of `step_s` make a scan; `steps` of them cover a burn."""

    step_s: float
    phases: int
    steps: int

    @classmethod
    def of(cls, period_s: float, burn_s: float) -> "ScanSteps":
        """Return the steps of a scan period over a burn."""
        phases = max(1, round(period_s / _LONGEST_STEP_S))
        step_s = period_s / phases
        return cls(step_s, phases, max(1, round(burn_s / step_s)))

    def times_s(self) -> FloatArray:
        """Return the times (steps,) of looks since ignition, s."""
        return (np.arange(self.steps) + _MIDDLE) * self.step_s


def report_counts(
    chances: Iterator[FloatArray], phases: int, confirmation: tuple[int, int], most: int
) -> Iterator[FloatArray]:
    """Yield, before the first look and after each, the chances (most, n) of 0 to most - 1 reports so far.

    `chances` are P_d (n,) of looks, one step after another, of which each belongs to one of `phases` equally likely
    phases in turn; `confirmation` are M and N.
    """
    needed, scans = confirmation
    kinds = 1 << (scans - 1)
    states: FloatArray | None = None
    total: FloatArray
    for step, chance in enumerate(chances):
        if states is None:
            states = np.zeros((phases, most, kinds, len(chance)))
            states[:, 0, 0] = 1.0
            total = states[0].sum(axis=1)
            yield total.copy()
        old = states[step % phases]
        new = _after(old, chance, needed)
        total += (new.sum(axis=1) - old.sum(axis=1)) / phases
        states[step % phases] = new
        yield total.copy()


def _after(old: FloatArray, chance: FloatArray, needed: int) -> FloatArray:
    """Return the states (reports, outcomes, n) after a look with P_d (n,)."""
    new, mask = np.zeros(old.shape), old.shape[1] - 1
    missed = 1.0 - chance
    for past in range(old.shape[1]):
        new[:, (past << 1) & mask] += old[:, past] * missed
        hit, now = old[:, past] * chance, ((past << 1) | 1) & mask
        if past.bit_count() + 1 >= needed:
            new[1:, now] += hit[:-1]
        else:
            new[:, now] += hit
    return new


def joined(counts: FloatArray, others: FloatArray) -> FloatArray:
    """Return the chances (…, most, n) of numbers of reports of two independent sources, each (…, most, n)."""
    both = np.zeros(counts.shape)
    for more in range(counts.shape[-2]):
        both[..., more:, :] += counts[..., : counts.shape[-2] - more, :] * others[..., more : more + 1, :]
    return both


class Reports:
    """The chances (T, most, n) of fewer than `most` reports by times since ignition (T,), of all sensors together."""

    def __init__(self, time_s: FloatArray, most: int, cells: int) -> None:
        self.time_s = time_s
        self.chance = np.zeros((len(time_s), most, cells), dtype=np.float32)
        self.chance[:, 0] = 1.0

    def add(self, rows: FloatArray, counts: Iterator[FloatArray], first_s: float, step_s: float) -> None:
        """Add a sensor: `counts` as from `report_counts` for some cells, the first at `first_s`, then at each step."""
        place = np.maximum((self.time_s - first_s) / step_s, 0.0)
        early, wanted = None, 0
        for number, late in enumerate(counts):
            while wanted < len(place) and place[wanted] <= number:
                share = place[wanted] - (number - 1) if early is not None else 1.0
                now = late if early is None else early + (late - early) * share
                self.chance[wanted][:, rows] = joined(self.chance[wanted][:, rows], now)
                wanted += 1
            early = late
        for left in range(wanted, len(place)):
            assert early is not None
            self.chance[left][:, rows] = joined(self.chance[left][:, rows], early)

    def times_s(self, reports: int, probability: float) -> FloatArray:
        """Return the times (n,) since ignition by which so many reports have come with a probability; nan if never."""
        have = 1.0 - self.chance[:, :reports].sum(axis=1)
        reached = have >= probability
        late = reached.argmax(axis=0)
        cells = np.arange(have.shape[1])
        early = np.maximum(late - 1, 0)
        low, high = have[early, cells], have[late, cells]
        share = np.where(late > 0, (probability - low) / np.maximum(high - low, 1e-12), 0.0)
        time = self.time_s[early] + (self.time_s[late] - self.time_s[early]) * share
        return np.where(reached.any(axis=0), time, np.nan)

    def probability(self, reports: int) -> FloatArray:
        """Return the probability (n,) of so many reports by the last time."""
        return 1.0 - self.chance[-1, :reports].sum(axis=0)
