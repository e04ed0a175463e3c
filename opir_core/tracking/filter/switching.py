"""The stereo filter: boost and coast side by side, as square roots of information, for a bank of tracks at once.

Each mode is an iterated extended filter (`slice_update`); the modes interact by first and second moments
(`mode_mixing`). The noise of a slice enters at its start, so that within the slice a target follows one smooth path.
"""

from math import log

import numpy as np
from attrs import evolve, frozen

from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.tracking.filter import mode_mixing, slice_update, square_root
from opir_core.tracking.filter.bank import Bank
from opir_core.tracking.filter.motion import BOOST, COAST, Dynamics
from opir_core.tracking.filter.slice_update import Mode, Updated
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import Sights

__all__ = ("Bank", "SwitchingFilter")


@frozen(eq=False)
class SwitchingFilter:
    """A filter of two modes; `boost_s` and `coast_s` are the mean times spent in each, inf for one that never ends.

    `rounds` bounds the relinearisations of an update. `cold_chance` is how likely a coasting target is seen in a slice
    in which a burning one is: 1 where a sensor follows bodies that do not burn. `memory_s` and `pause_s` say how often
    a target is taken to be seen (`mode_mixing.weighed`).
    """

    boost: Dynamics
    coast: Dynamics
    boost_s: float
    coast_s: float
    rounds: int = 4
    memory_s: float = 20.0
    cold_chance: float = 1.0
    pause_s: float = 0.0

    @property
    def switches(self) -> bool:
        """Return whether a target ever goes from one mode to the other."""
        return self.boost_s < np.inf or self.coast_s < np.inf

    def moved(self, bank: Bank, step_s: float) -> Bank:
        """Return the bank a step later."""
        if not len(bank.weight):
            return bank
        mixed = mode_mixing.mixed(bank, step_s, self.boost_s, self.coast_s) if self.switches else bank
        boost, coast = _modes_of(mixed)
        used, steps = _in_use(bank), np.full(len(bank.weight), step_s)
        if used[0]:
            boost = self._carried(self.boost, *boost, steps)
        if used[1]:
            coast = self._carried(self.coast, *coast, steps)
        return Bank(mixed.weight, *boost, *coast, mixed.pace)

    def _carried(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        after = motion.propagated(mean, step_s)
        back = motion.transition(0.5 * (mean + after), -step_s)
        return after, square_root.moved(root, back, motion.noise_root(step_s, after))

    def updated(self, bank: Bank, time_s: float, sights: Sights, step_s: float) -> Bank:
        """Return the bank with sights of a slice of length `step_s` that ends at `time_s` taken in."""
        if not len(bank.weight):
            return bank
        if len(bank.weight) == 1:
            return self._updated_alone(bank, time_s, sights, step_s)
        hits = np.bincount(sights.track, minlength=len(bank)).astype(np.float64)
        seen = hits > 0.0
        boost, coast, change = self._taken_in(bank, seen, time_s, sights)
        if not self.switches and not all(_in_use(bank)):
            return Bank(bank.weight, *boost, *coast, bank.pace)
        last_s = np.full(len(bank), time_s - step_s)
        np.maximum.at(last_s, sights.track, sights.time_s)
        change[seen, 1] += log(self.cold_chance)
        weighed = mode_mixing.weighed(bank, hits, time_s - last_s, change, step_s, self.memory_s, self.pause_s)
        return Bank(weighed[0], *boost, *coast, weighed[1])

    def _updated_alone(self, bank: Bank, time_s: float, sights: Sights, step_s: float) -> Bank:
        """Return what `updated` does, of one track."""
        every, change = list(_modes_of(bank)), [0.0, 0.0]
        used = [number for number, weight in enumerate(bank.weight[0].tolist()) if weight > 0.0]
        looks, silent_s = len(sights.time_s), step_s
        if looks:
            modes = [Mode((self.boost, self.coast)[number], *every[number]) for number in used]
            found = slice_update.updated(modes, time_s, sights, self.rounds)
            for number, mode, after in zip(used, modes, found, strict=True):
                every[number] = after.mean, after.root
                change[number] = float(slice_update.gained(mode, after)[0]) if len(used) == 2 else 0.0
            change[1] += log(self.cold_chance)
            silent_s = min(step_s, time_s - float(np.maximum.reduce(sights.time_s)))
        if not self.switches and len(used) < 2:
            return Bank(bank.weight, *every[0], *every[1], bank.pace)
        both = change[0], change[1]
        weighed = mode_mixing.weighed_alone(bank, looks, silent_s, both, step_s, self.memory_s, self.pause_s)
        return Bank(weighed[0], *every[0], *every[1], weighed[1])

    def _taken_in(
        self, bank: Bank, seen: BoolArray, time_s: float, sights: Sights
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray], FloatArray]:
        """Return means and roots of both modes after sights, and log likelihoods (n, 2) where both are in use."""
        every, change, used = list(_modes_of(bank)), np.zeros((len(bank), 2)), _in_use(bank)
        if not len(sights):
            return every[0], every[1], change
        rows = None if np.count_nonzero(seen) == len(seen) else seen.nonzero()[0]
        if rows is not None:
            sights = evolve(sights, track=(np.cumsum(seen) - 1)[sights.track])
        numbers = [number for number in (0, 1) if used[number]]
        modes = [_mode((self.boost, self.coast)[number], *every[number], rows) for number in numbers]
        found = slice_update.updated(modes, time_s, sights, self.rounds)
        for number, mode, after in zip(numbers, modes, found, strict=True):
            every[number] = _spread(every[number], after, rows)
            if all(used):
                change[slice(None) if rows is None else rows, number] = slice_update.gained(mode, after)
        return every[0], every[1], change

    def taken_in(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, time_s: float, sights: Sights
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return means and roots of a mode after sights of all tracks, and log likelihoods (n,)."""
        mode = Mode(motion, mean, root)
        (after,) = slice_update.updated([mode], time_s, sights, self.rounds)
        return after.mean, after.root, slice_update.gained(mode, after)

    def outlook(self, bank: Bank, time_s: float) -> Outlook:
        """Return where tracks are about the bank's time, by the likelier mode of each."""
        coasts = bank.weight[:, 1] > bank.weight[:, 0]
        boost, coast = _modes_of(bank)
        count = np.count_nonzero(coasts)
        if not count:
            return Outlook(time_s, *_seen_ahead(self.boost, *boost))
        if count == len(coasts):
            return Outlook(time_s, *_seen_ahead(self.coast, *coast))
        derivative, side = np.empty((len(bank), 5, 3)), np.empty((len(bank), BOOST, BOOST))
        derivative[coasts], side[coasts] = _seen_ahead(self.coast, coast[0][coasts], coast[1][coasts])
        derivative[~coasts], side[~coasts] = _seen_ahead(self.boost, boost[0][~coasts], boost[1][~coasts])
        return Outlook(time_s, derivative, side)

    def moments(self, bank: Bank) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity, over both modes."""
        boost, coast = bank.weight[:, :1], bank.weight[:, 1:]
        apart = bank.boost_mean[:, :COAST] - bank.coast_mean
        width = bank.boost_mean.shape[1]
        side = np.empty((len(apart), COAST, width + COAST + 1))
        share = np.sqrt(bank.weight)[:, :, None, None]
        np.multiply(square_root.spread(bank.boost_root)[:, :COAST], share[:, 0], out=side[:, :, :width])
        np.multiply(square_root.spread(bank.coast_root), share[:, 1], out=side[:, :, width:-1])
        np.multiply(apart, np.sqrt(boost * coast), out=side[:, :, -1])
        total = side @ side.transpose(0, 2, 1)
        return boost * bank.boost_mean[:, :COAST] + coast * bank.coast_mean, 0.5 * (total + total.transpose(0, 2, 1))


def _modes_of(bank: Bank) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return means and roots of boost and coast."""
    return (bank.boost_mean, bank.boost_root), (bank.coast_mean, bank.coast_root)


def _in_use(bank: Bank) -> tuple[bool, bool]:
    """Return whether any track may be in boost, and in coast."""
    boost, coast = np.maximum.reduce(bank.weight, axis=0).tolist()
    return boost > 0.0, coast > 0.0


def _mode(motion: Dynamics, mean: FloatArray, root: FloatArray, rows: IntArray | None) -> Mode:
    return Mode(motion, mean, root) if rows is None else Mode(motion, mean[rows], root[rows])


def _spread(
    whole: tuple[FloatArray, FloatArray], after: Updated, rows: IntArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return means and roots with those of the rows that were seen replaced."""
    if rows is None:
        return after.mean, after.root
    mean, root = whole[0].copy(), whole[1].copy()
    mean[rows], root[rows] = after.mean, after.root
    return mean, root


def _seen_ahead(motion: Dynamics, mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return derivatives (n, 5, 3) of the position, and spreads (n, 12, 12) of the first four."""
    return motion.taylor(mean), motion.sides(mean, square_root.spread(root))
