"""The two modes of a burn, steady and staging, as an IMM of their own.

In steady burn the force follows the rocket equation but for a little noise. Where one stage follows another it jumps,
and so does its growth. That shows only after some seconds: a jump of 20 m/s² moves a target by 250 m in 5 s. So after a
jump the mode staging lasts for a while, with the noise of jumps that begin at any time, and hands over to the steady
one. Both move alike but for their noise.
"""

from collections.abc import Callable, Sequence
from math import expm1

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import COAST, dot, square_root
from opir_trackers.filter.dynamics import Dynamics
from opir_trackers.filter.estimates import BURN_SHARE, twice
from opir_trackers.filter.iterated_update import Mode, Updated
from opir_trackers.filter.thrust import SLOW_M_S, air_velocity

#: Means (n, 2, d), information roots (n, 2, d, d) and probabilities (n, 2) of steady burn and staging.
Burns = tuple[FloatArray, FloatArray, FloatArray]

#: Means (n, d) and information roots (n, d, d).
Gaussian = tuple[FloatArray, FloatArray]


@frozen(eq=False)
class NewStage:
    """The start of a stage: mean and standard deviations of specific force, m/s², and growth, 1/s.

    `every_s` is the mean time from one stage to the next.
    """

    force_m_s2: float
    force_sigma_m_s2: float
    growth_per_s: float
    growth_sigma_per_s: float
    every_s: float

    def begun(self, mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return burns (n, 10) whose next stage begins: force and growth of the prior, the force along the velocity."""
        velocity = air_velocity(mean)
        speed = np.sqrt(dot(velocity, velocity) + SLOW_M_S**2)
        after = mean.copy()
        after[:, 6:9] = self.force_m_s2 * velocity / speed[:, None]
        after[:, 9] = self.growth_per_s
        # What is known of the last columns whatever the first ones are.
        turned = np.empty_like(root)
        turned[:, :, :-COAST], turned[:, :, -COAST:] = root[:, :, COAST:], root[:, :, :COAST]
        known = square_root.triangular(turned)
        begun = np.zeros_like(root)
        begun[:, :COAST, :COAST] = known[:, -COAST:, -COAST:]
        begun[:, _FORCE, _FORCE] = 1.0 / self.force_sigma_m_s2
        begun[:, 9, 9] = 1.0 / self.growth_sigma_per_s
        return after, begun


_FORCE = np.arange(6, 9)


@frozen(eq=False)
class BurnModes:
    """The modes of a burn; without `stage` there is the burn alone, and its parts are not used.

    A burn is its means (n, d) and roots, and its parts; with stages the former are the moments of the latter.
    """

    motion: Dynamics
    stage: NewStage | None

    def predicted(self, boost: Gaussian, burns: Burns, step_s: float) -> tuple[Gaussian, Burns]:
        """Return burns a step later."""
        count = len(boost[0])
        if self.stage is None:
            return carried(self.motion, *boost, np.array([step_s] * count)), burns
        mean, root, share = _mixed(burns, self.stage, step_s)
        steps = np.array([step_s] * (count if count == 1 else 2 * count))
        if count == 1:
            # Single states have faster kernels.
            parts = [carried(self.motion, mean[:, part], root[:, part], steps) for part in (0, 1)]
            burns = (*_stacked(*parts), share)
        else:
            burns = (*each(lambda means, roots: carried(self.motion, means, roots, steps), mean, root), share)
        return moments(burns), burns

    def modes(self, boost: Gaussian, burns: Burns) -> Sequence[Mode]:
        """Return the modes to update."""
        if self.stage is None:
            return [Mode(self.motion, *boost)]
        return [Mode(self.motion, burns[0][:, part], burns[1][:, part]) for part in (0, 1)]

    def joined(
        self, burns: Burns, after: Sequence[Updated], log: Sequence[FloatArray]
    ) -> tuple[Gaussian, Burns, FloatArray]:
        """Return burns after an update of `modes`, whose log likelihoods are (n,), and that of the burn (n,)."""
        if self.stage is None:
            return after[0][:2], burns, log[0]
        change = log[1] - log[0]
        most = np.maximum(change, 0.0)
        steady, staging = burns[2][:, 0] * np.exp(-most), burns[2][:, 1] * np.exp(change - most)
        total = steady + staging
        share = np.empty_like(burns[2])
        share[:, 0], share[:, 1] = steady / total, staging / total
        burns = (*_stacked(after[0][:2], after[1][:2]), share)
        return moments(burns), burns, log[0] + most + np.log(total)


def carried(motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: FloatArray) -> Gaussian:
    """Return means (n, d) and information roots after steps (n,), s."""
    after = motion.propagated(mean, step_s)
    back = motion.transition(0.5 * (mean + after), -step_s)
    return after, square_root.time_update(root, back, motion.noise_root(step_s, after))


def moments(burns: Burns) -> tuple[FloatArray, FloatArray]:
    """Return the means (n, d) and information roots of burns, by moment matching."""
    mean, root, share = burns
    return square_root.moment_matched(share, (mean[:, 0], mean[:, 1]), (root[:, 0], root[:, 1]))


def with_rows(
    burns: Burns, known: tuple[FloatArray, FloatArray], rows: IntArray, share: FloatArray = BURN_SHARE
) -> Burns:
    """Return burns of which rows have no parts: both are the given means and roots."""
    mean, root = known
    return put(burns, rows, (twice(mean), twice(root), share.repeat(len(mean), axis=0)))


def put(burns: Burns, rows: IntArray, part: Burns) -> Burns:
    """Return burns with some rows replaced."""
    mean, root, share = (column.copy() for column in burns)
    mean[rows], root[rows], share[rows] = part
    return mean, root, share


def each(
    function: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]], mean: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a function's means and roots of each part, (n, 2, d) and (n, 2, d, d)."""
    count, parts, size = mean.shape
    found = function(mean.reshape(-1, size), root.reshape(-1, size, size))
    return found[0].reshape(count, parts, size), found[1].reshape(count, parts, size, size)


def _stacked(first: Gaussian, second: Gaussian) -> Gaussian:
    """Return means and roots of two parts, (n, 2, d) and (n, 2, d, d)."""
    count, size = first[0].shape
    mean, root = np.empty((count, 2, size)), np.empty((count, 2, size, size))
    mean[:, 0], root[:, 0] = first
    mean[:, 1], root[:, 1] = second
    return mean, root


def _mixed(burns: Burns, stage: NewStage, step_s: float) -> Burns:
    """Return burns whose next stage may have begun in a step, and of which the decided ones are in steady burn."""
    if step_s <= 0.0:
        return burns
    decided = (burns[2][:, 1] > _DECIDED).nonzero()[0]
    if decided.size:
        mean, root, share = (column[decided] for column in burns)
        burns = with_rows(burns, moments((mean, root, share)), decided, _STEADY)
    mean, root, before = burns
    begins = before[:, :1] * -expm1(-step_s / stage.every_s)
    share, into = before + begins * _BEGINS, before.copy()
    into[:, :1] = begins
    into /= share[:, 1:]
    first = stage.begun(mean[:, 0], root[:, 0])
    mixed = square_root.moment_matched(into, (first[0], mean[:, 1]), (first[1], root[:, 1]))
    return (*_stacked((mean[:, 0], root[:, 0]), mixed), share)


_BEGINS, _STEADY = np.array([-1.0, 1.0]), np.array([[1.0, 0.0]])

#: A new stage with this probability is the steady burn. The moments of both stay, so the choice costs no containment:
#: below, a doubtful stage is blurred with the old one; above, a third stage waits for the second to be certain.
_DECIDED = 0.9
