"""The stereo filter: boost and coast side by side, as square roots of information, for a bank of tracks at once.

Each mode is an iterated extended filter: the looks of a slice are taken in together by one QR decomposition a track,
linearised anew at each round's solution. The modes interact by first and second moments (Blom and Bar-Shalom, "The
interacting multiple model algorithm", IEEE Trans. Automatic Control 33(8), 1988). The noise of a slice enters at its
start, so that within the slice a target follows one smooth path.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.columns import Columns, names_of
from opir_core.records import FloatArray, IntArray
from opir_core.tracking import square_root
from opir_core.tracking.motion import BOOST, COAST, Dynamics, Motion, followed, weights_at
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import Sights, along, dot

#: Mode weights stay above this, so that no mode is ever lost.
_LEAST_WEIGHT = 1e-6

#: A mode takes part in a mixture from this share on.
_LEAST_SHARE = 1e-4

#: Rounds of relinearisation stop once no look would move by more than this many standard deviations in another.
_SETTLED_SIGMAS = 1e-2


@frozen(eq=False)
class Bank(Columns):
    """The estimates of tracks, one row each, all at one time: mean and root of information of each mode, and weights.

    `weight` (n, 2) are the probabilities of boost and coast; `pace` (n, 3) the looks that detected and the time, s,
    over which they are counted, both fading, and the time since the last of them, s.
    """

    weight: FloatArray
    boost_mean: FloatArray
    boost_root: FloatArray
    coast_mean: FloatArray
    coast_root: FloatArray
    pace: FloatArray

    @classmethod
    def empty(cls) -> "Bank":
        """Return the bank of no tracks."""
        boost, coast = np.empty((0, BOOST)), np.empty((0, COAST))
        roots = np.empty((0, BOOST, BOOST)), np.empty((0, COAST, COAST))
        return cls(np.empty((0, 2)), boost, roots[0], coast, roots[1], np.empty((0, 3)))

    @property
    def likelier_position_m(self) -> FloatArray:
        """Return the inertial positions (n, 3) of the likelier mode of each track."""
        return np.where(self.weight[:, 1:] > self.weight[:, :1], self.coast_mean[:, :3], self.boost_mean[:, :3])

    def put(self, rows: IntArray, part: "Bank") -> "Bank":
        """Return the bank with its rows (m,) replaced by those of another."""
        columns = []
        for name in names_of(Bank):
            column = getattr(self, name).copy()
            column[rows] = getattr(part, name)
            columns.append(column)
        return Bank(*columns)


@frozen(eq=False)
class SwitchingFilter:
    """A filter of two modes; `boost_s` and `coast_s` are the mean times spent in each, inf for one that never ends.

    `rounds` bounds the relinearisations of an update. `cold_chance` is how likely a coasting target is seen in a slice
    in which a burning one is: 1 where a sensor follows bodies that do not burn.
    """

    boost: Dynamics
    coast: Motion
    boost_s: float
    coast_s: float
    rounds: int = 4
    memory_s: float = 20.0
    cold_chance: float = 1.0

    @property
    def switches(self) -> bool:
        """Return whether a target ever goes from one mode to the other."""
        return self.boost_s < np.inf or self.coast_s < np.inf

    def moved(self, bank: Bank, step_s: float) -> Bank:
        """Return the bank a step later."""
        if not len(bank):
            return bank
        mixed = self._mixed(bank, step_s)
        boost, coast = (mixed.boost_mean, mixed.boost_root), (mixed.coast_mean, mixed.coast_root)
        if _in_use(bank, 0):
            boost = self._carried(self.boost, *boost, step_s)
        if _in_use(bank, 1):
            coast = self._carried(self.coast, *coast, step_s)
        return Bank(mixed.weight, *boost, *coast, mixed.pace)

    def _carried(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: float
    ) -> tuple[FloatArray, FloatArray]:
        steps = np.full(len(mean), step_s)
        after = motion.propagated(mean, steps)
        back = motion.transition(0.5 * (mean + after), -steps)
        return after, square_root.moved(root, back, motion.noise_root(steps, after))

    def _mixed(self, bank: Bank, step_s: float) -> Bank:
        """Return the bank with its modes mixed by the chance of having switched during a step."""
        if not self.switches:
            return bank
        leave = -np.expm1(-step_s / np.array([self.boost_s, self.coast_s]))
        switch = np.array([[1.0 - leave[0], leave[0]], [leave[1], 1.0 - leave[1]]])
        weight = bank.weight @ switch
        share = bank.weight[:, :, None] * switch / np.maximum(weight, 1e-300)[:, None, :]
        # A target that burns has not coasted before: what its coast mode made of the looks so far is let go.
        share[(bank.weight[:, 0] > 0.5) & (leave[0] > 0.0), :, 1] = [1.0, 0.0]
        boost_mean, boost_root = bank.boost_mean.copy(), bank.boost_root.copy()
        coast_mean, coast_root = bank.coast_mean.copy(), bank.coast_root.copy()
        into_coast = np.flatnonzero(share[:, 0, 1] > _LEAST_SHARE)
        if len(into_coast):
            part, mine = bank.take(into_coast), share[into_coast, :, 1]
            burnt = _burnt_out(part)
            if np.any(mine[:, 1]):
                means, roots = (burnt[0], part.coast_mean), (burnt[1], part.coast_root)
                burnt = square_root.mixed(mine, means, roots)
            coast_mean[into_coast], coast_root[into_coast] = burnt
        into_boost = np.flatnonzero(share[:, 1, 0] > _LEAST_SHARE)
        if len(into_boost):
            part = bank.take(into_boost)
            means, roots = (part.boost_mean, _extended_mean(part)), (part.boost_root, _extended_root(part))
            boost_mean[into_boost], boost_root[into_boost] = square_root.mixed(share[into_boost, :, 0], means, roots)
        return Bank(weight, boost_mean, boost_root, coast_mean, coast_root, bank.pace)

    def updated(self, bank: Bank, time_s: float, sights: Sights, step_s: float) -> Bank:
        """Return the bank with sights of a slice of length `step_s` that ends at `time_s` taken in."""
        if not len(bank):
            return bank
        hits = np.bincount(sights.track, minlength=len(bank)).astype(np.float64)
        seen = np.flatnonzero(hits)
        used = _in_use(bank, 0), _in_use(bank, 1)
        mine = sights
        if len(seen) < len(bank):
            mine = evolve(sights, track=(np.cumsum(hits > 0.0) - 1)[sights.track])
        change = np.zeros((len(bank), 2))
        boost, boost_root = bank.boost_mean.copy(), bank.boost_root.copy()
        coast, coast_root = bank.coast_mean.copy(), bank.coast_root.copy()
        if len(seen):
            modes = ((self.boost, boost, boost_root), (self.coast, coast, coast_root))
            for number, (motion, mean, root) in enumerate(modes):
                if used[number]:
                    told = self.taken_in(motion, mean[seen], root[seen], time_s, mine, all(used))
                    mean[seen], root[seen], change[seen, number] = told
        if not self.switches and not all(used):
            return Bank(bank.weight, boost, boost_root, coast, coast_root, bank.pace)
        last_s = np.full(len(bank), time_s - step_s)
        np.maximum.at(last_s, sights.track, sights.time_s)
        missed, pace = self._misses(bank, hits, time_s - last_s, step_s)
        change[:, 0] += missed
        change[seen, 1] += np.log(self.cold_chance)
        return Bank(_reweighed(bank.weight, change), boost, boost_root, coast, coast_root, pace)

    def _misses(
        self, bank: Bank, hits: FloatArray, silent_s: FloatArray, step_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return what a silent slice takes from the boost's log weight, and the pace after it.

        A burning target that was seen r times a second stays unseen for t with the chance exp(-r t); one whose burn is
        over is not seen at all.
        """
        fade = np.exp(-step_s / self.memory_s)
        rate = bank.pace[:, 0] / np.maximum(bank.pace[:, 1], step_s)
        silent = hits == 0.0
        pace = np.stack([hits, np.full(len(hits), step_s), silent_s], axis=1)
        pace[:, :2] += fade * bank.pace[:, :2]
        pace[silent, :2], pace[silent, 2] = bank.pace[silent, :2], bank.pace[silent, 2] + step_s
        return np.where(silent, -rate * step_s, 0.0), pace

    def taken_in(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, time_s: float, sights: Sights, weighed: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return means and roots of a mode after sights of all tracks, and log likelihoods (n,), 0 if not `weighed`."""
        place, depth = _queued(sights.track, len(mean))
        weight = weights_at(sights.time_s - time_s)
        point, after, left = mean, root, np.zeros(len(mean))
        for turn in range(self.rounds):
            path = motion.taylor(point)
            position = followed(path[sights.track], weight)
            rows = _rows(sights, motion, point, position, weight, place, depth)
            owed = along(root, mean - point)
            after, step, left = square_root.updated(root, owed, rows)
            point = point + step
            if turn + 1 < self.rounds and _bend(sights, position, step, weight) < _SETTLED_SIGMAS:
                break
        if not weighed:
            return point, after, np.zeros(len(mean))
        gained = square_root.log_determinant(root) - square_root.log_determinant(after) - 0.5 * left
        return point, after, gained

    def outlook(self, bank: Bank, time_s: float) -> Outlook:
        """Return where tracks are about the bank's time, by the likelier mode of each."""
        derivative, side = np.zeros((len(bank), 5, 3)), np.zeros((len(bank), BOOST, BOOST))
        coasts = bank.weight[:, 1] > bank.weight[:, 0]
        coasting, burning = np.flatnonzero(coasts), np.flatnonzero(~coasts)
        if len(burning):
            state = bank.boost_mean[burning]
            derivative[burning] = self.boost.taylor(state)
            side[burning] = self.boost.sides(state, square_root.spread(bank.boost_root[burning]))
        if len(coasting):
            derivative[coasting] = self.coast.taylor(bank.coast_mean[coasting])
            side[coasting, :COAST, :COAST] = square_root.spread(bank.coast_root[coasting])
        return Outlook(time_s, derivative, side)

    def moments(self, bank: Bank) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity, over both modes."""
        center = bank.weight[:, :1] * bank.boost_mean[:, :COAST] + bank.weight[:, 1:] * bank.coast_mean
        total = np.zeros((len(bank), COAST, COAST))
        for number, (mean, root) in enumerate(
            ((bank.boost_mean[:, :COAST], bank.boost_root), (bank.coast_mean, bank.coast_root))
        ):
            side = square_root.spread(root)[:, :COAST]
            shift = (mean - center)[:, :, None]
            total += bank.weight[:, number, None, None] * (
                side @ side.transpose(0, 2, 1) + shift @ shift.transpose(0, 2, 1)
            )
        return center, 0.5 * (total + total.transpose(0, 2, 1))


def _in_use(bank: Bank, mode: int) -> bool:
    return bool((bank.weight[:, mode] > 0.0).any())


def _burnt_out(bank: Bank) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of boosts that ended soon after they were last seen.

    Of a target seen r times a second the burn ended 1/r ± 1/r after the last look. A time u after the end, velocity and
    position are less by f u and f u²/2 than had the force f gone on.
    """
    hits, spell, silent = bank.pace.T
    pause = spell / np.maximum(hits, 1.0)
    since, force = np.maximum(silent - pause, 0.0)[:, None], bank.boost_mean[:, COAST : COAST + 3]
    less = np.concatenate([force * (0.5 * since**2), force * since], axis=1)
    doubt = np.minimum(pause, silent)[:, None]
    spread = np.concatenate([force * (since * doubt), force * doubt], axis=1)
    root, size = bank.boost_root, bank.boost_root.shape[1]
    rows = np.zeros((len(bank), size + 1, size + 1))
    rows[:, 0, 0] = 1.0
    rows[:, 1:, 0] = along(root[:, :, :COAST], spread)
    rows[:, 1:, 1:-COAST], rows[:, 1:, -COAST:] = root[:, :, COAST:], root[:, :, :COAST]
    # What is known of the last columns whatever the first ones are.
    return bank.boost_mean[:, :COAST] - less, square_root.triangular(rows)[:, -COAST:, -COAST:]


def _extended_mean(bank: Bank) -> FloatArray:
    """Return the coast means with the boost's specific force and its rate."""
    return np.concatenate([bank.coast_mean, bank.boost_mean[:, COAST:]], axis=1)


def _extended_root(bank: Bank) -> FloatArray:
    """Return the coast roots with what the boost knows of specific force and its rate alone."""
    root = np.zeros_like(bank.boost_root)
    root[:, :COAST, :COAST] = bank.coast_root
    root[:, COAST:, COAST:] = square_root.root_of_spread(square_root.spread(bank.boost_root)[:, COAST:])
    return root


def _reweighed(weight: FloatArray, change: FloatArray) -> FloatArray:
    """Return weights times exp(change), normalised, none of a mode in use below the least."""
    used = np.where(weight > 0.0, change, -np.inf)
    scaled = weight * np.exp(used - used.max(axis=1, keepdims=True))
    scaled = np.where(weight > 0.0, np.maximum(scaled, _LEAST_WEIGHT * scaled.sum(axis=1, keepdims=True)), 0.0)
    total: FloatArray = scaled / scaled.sum(axis=1, keepdims=True)
    return total


def _bend(sights: Sights, position: FloatArray, step: FloatArray, weight: FloatArray) -> float:
    """Return how far, in standard deviations, a look is off the straight line of its linearisation after steps (n, d).

    A point moved by a small angle across and along the ray is off by the square of the angle.
    """
    blocks = step.shape[1] // 3
    moved = step[:, : 3 * blocks].reshape(len(step), blocks, 3)[sights.track]
    shift = np.add.reduce(weight[:, :blocks, None] * moved, axis=1)
    apart = position - sights.origin_m
    sharp = np.add.reduce(np.square(sights.whitener).reshape(len(shift), 4), axis=1)
    return float(np.max(dot(shift, shift) / dot(apart, apart) * np.sqrt(sharp), initial=0.0))


def _queued(track: IntArray, count: int) -> tuple[IntArray, int]:
    """Return each sight's place among those of its track, and how many the track with most has."""
    if count == 1:
        return np.arange(len(track)), len(track)
    order = np.argsort(track, kind="stable")
    starts = np.concatenate([[0], np.cumsum(np.bincount(track, minlength=count))])
    place = np.empty(len(track), dtype=np.int64)
    place[order] = np.arange(len(track)) - starts[track[order]]
    return place, int(place.max(initial=-1)) + 1


def _rows(
    sights: Sights,
    motion: Dynamics,
    point: FloatArray,
    position: FloatArray,
    weight: FloatArray,
    place: IntArray,
    depth: int,
) -> FloatArray:
    """Return whitened rows (n, 2 depth, d + 1), padded with zeros."""
    residual, slope = sights.residuals(position)
    count, width = point.shape[0], point.shape[1] + 1
    full = np.empty((len(position), 2, width))
    full[:, :, :-1] = motion.seen(slope, weight, point[sights.track])
    full[:, :, -1] = residual
    if count == 1:
        return full.reshape(1, 2 * depth, width)
    rows = np.zeros((count, depth, 2, width))
    rows[sights.track, place] = full
    return rows.reshape(count, 2 * depth, width)
