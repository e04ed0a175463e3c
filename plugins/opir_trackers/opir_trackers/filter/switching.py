"""The stereo filter: boost and coast side by side, as square roots of information, for a bank of tracks at once.

Each mode is an iterated extended filter (`slice_update`); the modes interact by first and second moments
(`mode_mixing`). The noise of a slice enters at its start, so that within the slice a target follows one smooth path.

A boost that has just ended moves as a burning one but for what its last second brought: the looks of one slice are as
likely from either, to within a seventh (measured on ICBMs from ignition to burnout). Where no sensor follows bodies,
that a target is seen at all says far more. So a look shuts out the coast of a track that burnt before, and such a coast
is not worked out: nothing depends on it, and the next step takes it from the boost anew.
"""

from math import log

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import square_root
from opir_core.estimation.lines_of_sight import Sights
from opir_core.estimation.motion import BOOST, COAST
from opir_trackers.filter import iterated_update, mode_mixing
from opir_trackers.filter.dynamics import Dynamics
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.iterated_update import Mode
from opir_trackers.filter.mode_mixing import SHUT_OUT, restrained

__all__ = ("ImmFilter", "ModeEstimates")


@frozen(eq=False)
class ImmFilter:
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

    @property
    def least_open(self) -> float:
        """Return the weight from which on a coast stays open whatever is seen; 0 where looks shut out none."""
        return SHUT_OUT / self.cold_chance if self.boost_s < np.inf and self.cold_chance < 1.0 else 0.0

    def moved(self, bank: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the bank a step later."""
        return self._moved(bank, step_s, 0.0) if len(bank.weight) else bank

    def expected(self, bank: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the bank a step later, but for coasts that a look would shut out: `completed` has those still open."""
        return self._moved(bank, step_s, self.least_open) if len(bank.weight) else bank

    def completed(
        self, bank: ModeEstimates, expected: ModeEstimates, before: ModeEstimates, step_s: float
    ) -> ModeEstimates:
        """Return a bank after a slice, `expected` from the one `before`, with all coasts that are still open."""
        rows = ((bank.weight[:, 1] >= SHUT_OUT) & (expected.weight[:, 1] < self.least_open)).nonzero()[0]
        if not len(rows):
            return bank
        burnt = mode_mixing.burnt_out(before.part(rows))
        known = _spread(_modes_of(bank)[1], self._carried(self.coast, *burnt, np.full(len(rows), step_s)), rows)
        return ModeEstimates(bank.weight, bank.boost_mean, bank.boost_root, *known, bank.pace)

    def _moved(self, bank: ModeEstimates, step_s: float, least: float) -> ModeEstimates:
        """Return the bank a step later; coasts that are then less probable than `least` stay as they were."""
        mixed = mode_mixing.mixed(bank, step_s, self.boost_s, self.coast_s, least) if self.switches else bank
        boost, coast = _modes_of(mixed)
        used, steps = _in_use(bank), np.array([step_s] * len(bank.weight))
        rows = (mixed.weight[:, 1] >= least).nonzero()[0] if used[1] else _NONE
        rests = mode_mixing.resting(mixed) if len(rows) else _NONE
        if used[0] and rests.size < steps.size:
            boost = self._carried(self.boost, *boost, steps)
        if len(rows) == len(steps):
            coast = self._carried(self.coast, *coast, steps)
        elif len(rows):
            part = coast[0][rows], coast[1][rows]
            coast = _spread(coast, self._carried(self.coast, *part, steps[rows]), rows)
        if rests.size:
            boost = _spread(boost, mode_mixing.begun_anew(bank.part(rests), coast[0][rests], coast[1][rests]), rests)
        return ModeEstimates(mixed.weight, *boost, *coast, mixed.pace)

    def _carried(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        if motion.about is not None:
            motion = motion.about(mean, root)
        after = motion.propagated(mean, step_s)
        back = motion.transition(0.5 * (mean + after), -step_s)
        return after, square_root.moved(root, back, motion.noise_root(step_s, after))

    def updated(self, bank: ModeEstimates, time_s: float, sights: Sights, step_s: float) -> ModeEstimates:
        """Return the bank with sights of a slice of length `step_s` that ends at `time_s` taken in."""
        if not len(bank.weight):
            return bank
        if len(bank.weight) == 1:
            return self._updated_alone(bank, time_s, sights, step_s)
        hits = np.bincount(sights.track, minlength=len(bank)).astype(np.float64)
        seen = hits > 0.0
        boost, coast, change = self._taken_in(bank, seen, time_s, sights)
        if not self.switches and not all(_in_use(bank)):
            return ModeEstimates(bank.weight, *boost, *coast, bank.pace)
        last_s = np.full(len(bank), time_s - step_s)
        np.maximum.at(last_s, sights.track, sights.time_s)
        change[seen, 1] += log(self.cold_chance)
        weighed = mode_mixing.weighed(bank, hits, time_s - last_s, change, step_s, self.memory_s, self.pause_s)
        return ModeEstimates(weighed[0], *boost, *coast, weighed[1])

    def _updated_alone(self, bank: ModeEstimates, time_s: float, sights: Sights, step_s: float) -> ModeEstimates:
        """Return what `updated` does, of one track."""
        every, change = list(_modes_of(bank)), [0.0, 0.0]
        weight = bank.weight[0].tolist()
        used = [number for number in (0, 1) if weight[number] > 0.0 and (not number or weight[1] >= self.least_open)]
        looks, silent_s = len(sights.time_s), step_s
        if looks:
            modes = [Mode((self.boost, self.coast)[number], *every[number]) for number in used]
            found = iterated_update.updated(modes, time_s, sights, self.rounds)
            for number, mode, after in zip(used, modes, found, strict=True):
                every[number] = after.mean, after.root
                change[number] = float(iterated_update.gained(mode, after)[0]) if len(used) == 2 else 0.0
            change[1] += log(self.cold_chance)
            silent_s = min(step_s, time_s - float(np.maximum.reduce(sights.time_s)))
        if not self.switches and not all(weight):
            return ModeEstimates(bank.weight, *every[0], *every[1], bank.pace)
        both = change[0], change[1]
        weighed = mode_mixing.weighed_alone(bank, looks, silent_s, both, step_s, self.memory_s, self.pause_s)
        return ModeEstimates(weighed[0], *every[0], *every[1], weighed[1])

    def _taken_in(
        self, bank: ModeEstimates, seen: BoolArray, time_s: float, sights: Sights
    ) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray], FloatArray]:
        """Return means and roots of both modes after sights, and log likelihoods (n, 2) where both are in use."""
        every, change, used = list(_modes_of(bank)), np.zeros((len(bank), 2)), _in_use(bank)
        if not len(sights):
            return every[0], every[1], change
        open_ = bank.weight[:, 1] >= self.least_open
        for some, numbers in ((seen & open_, [number for number in (0, 1) if used[number]]), (seen & ~open_, [0])):
            rows = _rows(some)
            if rows is not None and not len(rows):
                continue
            modes = [_mode((self.boost, self.coast)[number], *every[number], rows) for number in numbers]
            found = iterated_update.updated(modes, time_s, _of_rows(sights, some, rows), self.rounds)
            for number, mode, after in zip(numbers, modes, found, strict=True):
                every[number] = _spread(every[number], (after.mean, after.root), rows)
                if len(numbers) == 2:
                    change[slice(None) if rows is None else rows, number] = iterated_update.gained(mode, after)
        return every[0], every[1], change

    def restrained(self, bank: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the bank whose tracks `rows` have velocities no less certain than those of all targets."""
        boost, coast = (_spread(mode, restrained(mode[0][rows], mode[1][rows]), rows) for mode in _modes_of(bank))
        return ModeEstimates(bank.weight, *boost, *coast, bank.pace)

    def taken_in(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, time_s: float, sights: Sights
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return means and roots of a mode after sights of all tracks, and log likelihoods (n,)."""
        mode = Mode(motion, mean, root)
        (after,) = iterated_update.updated([mode], time_s, sights, self.rounds)
        return after.mean, after.root, iterated_update.gained(mode, after)

    def outlook(self, bank: ModeEstimates, time_s: float) -> PredictedMeasurements:
        """Return where tracks are about the bank's time, by the likelier mode of each."""
        coasts = bank.weight[:, 1] > bank.weight[:, 0]
        boost, coast = _modes_of(bank)
        count = np.count_nonzero(coasts)
        if not count:
            return PredictedMeasurements(time_s, *_seen_ahead(self.boost, *boost))
        if count == len(coasts):
            return PredictedMeasurements(time_s, *_seen_ahead(self.coast, *coast))
        derivative, side = np.empty((len(bank), 5, 3)), np.empty((len(bank), BOOST, BOOST))
        derivative[coasts], side[coasts] = _seen_ahead(self.coast, coast[0][coasts], coast[1][coasts])
        derivative[~coasts], side[~coasts] = _seen_ahead(self.boost, boost[0][~coasts], boost[1][~coasts])
        return PredictedMeasurements(time_s, derivative, side)

    def moments(self, bank: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity, over both modes."""
        open_ = bank.weight[:, 1:] >= (SHUT_OUT if self.least_open else 0.0)
        if not np.count_nonzero(open_):
            side = square_root.spread(bank.boost_root)[:, :COAST]
            return bank.boost_mean[:, :COAST], square_root.squared(side)
        weight = np.where(open_, bank.weight, _BURNS)
        boost, coast = weight[:, :1], weight[:, 1:]
        apart = bank.boost_mean[:, :COAST] - bank.coast_mean
        width = bank.boost_mean.shape[1]
        side = np.empty((len(apart), COAST, width + COAST + 1))
        share = np.sqrt(weight)[:, :, None, None]
        np.multiply(square_root.spread(bank.boost_root)[:, :COAST], share[:, 0], out=side[:, :, :width])
        np.multiply(square_root.spread(bank.coast_root), share[:, 1], out=side[:, :, width:-1])
        np.multiply(apart, np.sqrt(boost * coast), out=side[:, :, -1])
        return boost * bank.boost_mean[:, :COAST] + coast * bank.coast_mean, square_root.squared(side)


_BURNS, _NONE = np.array([1.0, 0.0]), np.empty(0, dtype=np.int64)


def _modes_of(bank: ModeEstimates) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return means and roots of boost and coast."""
    return (bank.boost_mean, bank.boost_root), (bank.coast_mean, bank.coast_root)


def _in_use(bank: ModeEstimates) -> tuple[bool, bool]:
    """Return whether any track may be in boost, and in coast."""
    boost, coast = (bank.weight[0] if len(bank.weight) == 1 else np.maximum.reduce(bank.weight, axis=0)).tolist()
    return boost > 0.0, coast > 0.0


def _mode(motion: Dynamics, mean: FloatArray, root: FloatArray, rows: IntArray | None) -> Mode:
    return Mode(motion, mean, root) if rows is None else Mode(motion, mean[rows], root[rows])


def _rows(some: BoolArray) -> IntArray | None:
    """Return the rows of a mask, None for all."""
    return None if np.count_nonzero(some) == len(some) else some.nonzero()[0]


def _of_rows(sights: Sights, some: BoolArray, rows: IntArray | None) -> Sights:
    """Return the sights of some rows of a bank (a mask, and its rows or None) as those of a bank of these rows."""
    if rows is None:
        return sights
    mine = sights.part(np.flatnonzero(some[sights.track]))
    return mine.placed((np.cumsum(some) - 1)[mine.track])


def _spread(
    whole: tuple[FloatArray, FloatArray], part: tuple[FloatArray, FloatArray], rows: IntArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return means and roots with those of some rows replaced."""
    if rows is None:
        return part
    mean, root = whole[0].copy(), whole[1].copy()
    mean[rows], root[rows] = part
    return mean, root


def _seen_ahead(motion: Dynamics, mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return derivatives (n, 5, 3) of the position, and spreads (n, 12, 12) of the first four."""
    return motion.taylor(mean), motion.sides(mean, square_root.spread(root))
