"""The modes of a burn as an IMM of their own: steady, staging, and free.

In steady burn the force follows the rocket equation but for a little noise. Where one stage follows
another it jumps, and so does its growth. That shows only after some seconds: a jump of 20 m/s²
moves a target by 250 m in 5 s. So after a jump the mode staging lasts for a while, with the noise
of jumps that begin at any time, and hands over to the steady one. Both move alike but for their
noise. In the free mode the force has any direction (`free_thrust`): its probability is the evidence
for a burn unlike every boost.

The free mode is computed where it may matter alone: from a new ignition after the dark, or from
looks that neither of the others explains, until it is improbable.
"""

from collections.abc import Callable, Sequence
from math import expm1
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import COAST, dot, matvec, square_root
from opir_trackers.filter.dynamics import Dynamics
from opir_trackers.filter.estimates import BURN_SHARE, in_parts
from opir_trackers.filter.iterated_update import Mode, Updated
from opir_trackers.filter.measurement_updates import information_root, moment_matched
from opir_trackers.filter.thrust import SLOW_M_S, air_velocity

#: Means (n, 3, d), information roots (n, 3, d, d) and probabilities (n, 3) of steady burn, staging
#: and free.
Burns = tuple[FloatArray, FloatArray, FloatArray]

#: Means (n, d) and information roots (n, d, d).
Gaussian = tuple[FloatArray, FloatArray]

_FORCE = np.arange(6, 9)
_UNIT = np.eye(3)


@frozen(eq=False)
class NewStage:
    """The start of a stage: mean and standard deviations of specific force, m/s², and growth, 1/s.

    `every_s` is the mean time from one stage to the next, `tilt` the tangent of the standard
    deviation of the angle between force and velocity.
    """

    force_m_s2: float
    force_sigma_m_s2: float
    growth_per_s: float
    growth_sigma_per_s: float
    every_s: float
    tilt: float

    def begun(self, mean: FloatArray, root: FloatArray) -> Gaussian:
        """Return burns (n, 10) whose next stage begins: force and growth of the prior, the force
        along the velocity.
        """
        unit, speed = self._direction(mean)
        after, begun = self._along(mean[:, :COAST], _of_path(root), unit)
        # The force turns with the velocity, whatever that is: rows on their difference. At rest it
        # has no direction.
        along = unit[:, :, None] * unit[:, None, :]
        across = 1.0 / (self.force_m_s2 * (self.tilt + SLOW_M_S / speed))
        begun[:, 6:9, 3:6] = (across * self.force_m_s2 / speed)[:, None, None] * (along - _UNIT)
        begun[:, 6:9, 6:9] = across[:, None, None] * (_UNIT - along) + along / self.force_sigma_m_s2
        return after, square_root.triangular(begun)

    def lit(self, mean: FloatArray, root: FloatArray) -> Gaussian:
        """Return burns (n, 10) of a stage that begins at positions and velocities (n, 6) with roots
        (n, 6, 6).

        After the dark, in which it may have turned.
        """
        return self._along(mean, root, self._direction(mean)[0])

    def _along(self, mean: FloatArray, root: FloatArray, unit: FloatArray) -> Gaussian:
        """Return burns (n, 10) with mean forces along directions (n, 3)."""
        growth = self.growth_per_s, self.growth_sigma_per_s
        return _ignited(mean, root, self.force_m_s2 * unit, self.force_sigma_m_s2, growth)

    def _direction(self, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the directions (n, 3) of velocities, shorter for slow ones, and speeds (n,), m/s,
        at least 100.
        """
        velocity = air_velocity(mean)
        speed = np.sqrt(dot(velocity, velocity) + SLOW_M_S**2)
        return velocity / speed[:, None], speed


@frozen(eq=False)
class FreeBurn:
    """A force in any direction: its motion and the standard deviation of each axis at its start,
    m/s².

    `relit` is the probability that a burn after the dark is one, `lasts_s` the mean time until a
    free burn is a steady one. `surprise` is the squared innovation of the position, in standard
    deviations, at which looks start it.
    """

    motion: Dynamics
    force_sigma_m_s2: float
    relit: float
    lasts_s: float
    surprise: float

    def lit(self, mean: FloatArray, root: FloatArray, growth: tuple[float, float]) -> Gaussian:
        """Return burns (n, 10) that begin at positions and velocities (n, 6) with roots (n, 6,
        6).
        """
        return _ignited(mean, root, np.zeros((len(mean), 3)), self.force_sigma_m_s2, growth)

    def turned(self, mean: FloatArray, root: FloatArray, growth: tuple[float, float]) -> Gaussian:
        """Return burns (n, 10) whose force has had another direction for some seconds."""
        after, begun = self.lit(mean[:, :COAST], _of_path(root), growth)
        moved = np.zeros((len(mean), mean.shape[1], 3))
        moved[:, range(3), range(3)] = 0.5 * _UNNOTICED_S**2 * self.force_sigma_m_s2
        moved[:, range(3, COAST), range(3)] = _UNNOTICED_S * self.force_sigma_m_s2
        unmoved = np.broadcast_to(np.eye(mean.shape[1]), begun.shape)
        return after, square_root.time_update(begun, unmoved, moved)


#: Time, s, for which a force may have had another direction before looks show it.
_UNNOTICED_S = 4.0

#: Squared distance, in standard deviations of the prior, by which looks move an estimate that is
#: tested for surprise: one slice in ten of ordinary boosts.
_MOVED = 1.5

#: Probability that a burn whose looks surprise is free. Notional.
_TURNS = 0.02

#: Share of the prior covariance of the position that counts as learnt where looks teach nothing.
_LEAST_LEARNT = 1e-3


def _surprise(before: Gaussian, after: Gaussian) -> FloatArray:
    """Return the squared innovations (n,) of positions, in standard deviations: χ² of 3 degrees of
    freedom at most.

    Looks move an estimate by as much as they shrink its covariance.
    """
    spread, left = (
        square_root.gram(square_root.inverse_root(each[1])[:, :3]) for each in (before, after)
    )
    moved = (after[0] - before[0])[:, :3]
    learnt = spread - left + _LEAST_LEARNT * spread
    whitened: Any = np.linalg.solve(learnt, moved[:, :, None])[:, :, 0]
    return dot(moved, whitened)


def _of_path(root: FloatArray) -> FloatArray:
    """Return the roots (n, 6, 6) of position and velocity, whatever the force: those of the last
    columns.
    """
    turned = np.empty_like(root)
    turned[:, :, :-COAST] = root[:, :, COAST:]
    turned[:, :, -COAST:] = root[:, :, :COAST]
    return square_root.triangular(turned)[:, -COAST:, -COAST:]


def _ignited(
    mean: FloatArray,
    root: FloatArray,
    force: FloatArray,
    force_sigma_m_s2: float,
    growth: tuple[float, float],
) -> Gaussian:
    """Return burns (n, 10) at positions and velocities (n, 6), with forces (n, 3) and mean and
    sigma of the growth.
    """
    count = len(mean)
    size = COAST + 4
    after = np.empty((count, size))
    begun = np.zeros((count, size, size))
    after[:, :COAST] = mean
    after[:, _FORCE] = force
    after[:, 9] = growth[0]
    begun[:, :COAST, :COAST] = root
    begun[:, _FORCE, _FORCE] = 1.0 / force_sigma_m_s2
    begun[:, 9, 9] = 1.0 / growth[1]
    return after, begun


def _pushed(mean: FloatArray, root: FloatArray, since: FloatArray, doubt: FloatArray) -> Gaussian:
    """Return estimates (n, 10) after their forces have acted for times (n, 1), s, known to `doubt`
    (n, 1).
    """
    force = mean[:, _FORCE]
    size = mean.shape[1]
    after = mean.copy()
    back = np.empty((len(mean), size, size))
    noise = np.zeros((len(mean), size, 1))
    after[:, :3] += 0.5 * since**2 * force
    after[:, 3:COAST] += since * force
    back[:] = np.eye(size)
    back[:, range(3), _FORCE] = -0.5 * since**2
    back[:, range(3, COAST), _FORCE] = -since
    noise[:, :3, 0] = since * doubt * force
    noise[:, 3:COAST, 0] = doubt * force
    return after, square_root.time_update(root, back, noise)


@frozen(eq=False)
class BurnModes:
    """The modes of a burn; without `stage` there is the burn alone, and its parts are not used.

    A burn is its means (n, d) and roots, and its parts; with stages the former are the moments of
    the latter.
    """

    motion: Dynamics
    stage: NewStage | None
    free: FreeBurn | None = None

    @property
    def least_lit(self) -> float:
        """Return the least probability that a burn began in a step with which it is mixed into the
        boost.

        With stages a burn after the dark replaces the old one, once it is the likelier.
        """
        return _LEAST_SHARE if self.stage is None else 0.5

    def predicted(self, boost: Gaussian, burns: Burns, step_s: float) -> tuple[Gaussian, Burns]:
        """Return burns a step later."""
        count = len(boost[0])
        if self.stage is None:
            return carried(self.motion, *boost, np.array([step_s] * count)), burns
        mean, root, share = self._mixed(burns, self.stage, step_s)
        steps = np.array([step_s] * count)
        if count == 1:
            # Single states have faster kernels.
            for part in (0, 1):
                mean[:, part], root[:, part] = carried(
                    self.motion, mean[:, part], root[:, part], steps
                )
        else:
            mean[:, :2], root[:, :2] = each(
                lambda means, roots: carried(self.motion, means, roots, np.repeat(steps, 2)),
                mean[:, :2],
                root[:, :2],
            )
        rows = share[:, 2].nonzero()[0]
        if rows.size and self.free is not None:
            mean[rows, 2], root[rows, 2] = carried(
                self.free.motion, mean[rows, 2], root[rows, 2], steps[rows]
            )
        burns = mean, root, share
        return moments(burns), burns

    def modes(self, boost: Gaussian, burns: Burns) -> Sequence[Mode]:
        """Return the modes to update: of tracks whose free mode is computed, or of those where it
        is not.
        """
        if self.stage is None:
            return [Mode(self.motion, *boost)]
        modes = [Mode(self.motion, burns[0][:, part], burns[1][:, part]) for part in (0, 1)]
        if self.free is not None and burns[2][0, 2] > 0.0:
            modes.append(Mode(self.free.motion, burns[0][:, 2], burns[1][:, 2]))
        return modes

    def joined(
        self, burns: Burns, after: Sequence[Updated], log: Sequence[FloatArray]
    ) -> tuple[Gaussian, Burns, FloatArray]:
        """Return burns after an update of `modes`, whose log likelihoods are (n,), and that of the
        burn (n,).
        """
        if self.stage is None:
            return after[0][:2], burns, log[0]
        parts = 3 if self.free is not None and burns[2][0, 2] > 0.0 else 2
        mean, root, share = (column.copy() for column in burns)
        every = np.array(log[:parts])
        most = np.maximum.reduce(every)
        share[:, :parts] *= np.exp(every - most).T
        total = np.add.reduce(share, axis=1)
        share /= total[:, None]
        for part in range(parts):
            mean[:, part], root[:, part] = after[part][:2]
        joined: Burns = mean, root, share
        boost = moments(joined)
        if self.free is not None and parts == 2:
            boost, joined = self._with_surprised(self.free, burns, boost, joined)
        return boost, joined, most + np.log(total)

    def _with_surprised(
        self, free: FreeBurn, before: Burns, boost: Gaussian, burns: Burns
    ) -> tuple[Gaussian, Burns]:
        """Return burns with a free mode where looks moved steady burn and staging by more than is
        likely.
        """
        moved = matvec(before[1][:, 0], burns[0][:, 0] - before[0][:, 0])
        rows = (dot(moved, moved) > _MOVED).nonzero()[0]
        for part in (0, 1):
            if rows.size:
                pairs = [(each[0][rows, part], each[1][rows, part]) for each in (before, burns)]
                rows = rows[_surprise(*pairs) > free.surprise]
        if not rows.size:
            return boost, burns
        mean, root, share = (column.copy() for column in burns)
        mean[rows, 2], root[rows, 2] = free.turned(boost[0][rows], boost[1][rows], self._growth)
        share[rows, :2] *= 1.0 - _TURNS
        share[rows, 2] = _TURNS
        opened: Burns = mean, root, share
        return moments(opened), opened

    @property
    def _growth(self) -> tuple[float, float]:
        assert self.stage is not None
        return self.stage.growth_per_s, self.stage.growth_sigma_per_s

    def lit(self, coast: Gaussian, before: Burns) -> tuple[Gaussian, Burns]:
        """Return burns that begin where targets coast, and those `before` the dark.

        Most begin as a new stage; some go on as before, unseen for a while; some are free.
        """
        assert self.stage is not None
        count = len(coast[0])
        size = before[0].shape[2]
        mean = np.empty((count, 3, size))
        root = np.zeros((count, 3, size, size))
        mean[:, 0, :COAST] = coast[0]
        mean[:, 0, COAST:] = before[0][:, 0, COAST:]
        root[:, 0, :COAST, :COAST] = coast[1]
        root[:, 0, COAST:, COAST:] = force_root(before[1][:, 0])
        mean[:, 1], root[:, 1] = self.stage.lit(*coast)
        mean[:, 2] = mean[:, 1]
        root[:, 2] = root[:, 1]
        free = 0.0
        if self.free is not None:
            (mean[:, 2], root[:, 2]), free = self.free.lit(*coast, self._growth), self.free.relit
        share = np.array([[_UNSEEN, 1.0 - _UNSEEN - free, free]]).repeat(count, axis=0)
        burns: Burns = mean, root, share
        return moments(burns), burns

    def burning_for(
        self, burns: Burns, since_s: FloatArray, doubt_s: FloatArray
    ) -> tuple[Gaussian, Burns]:
        """Return burns that began where targets coast, after times (n,), s, of burning known to
        `doubt_s` (n,).
        """
        since = since_s[:, None]
        doubt = doubt_s[:, None]
        parts = [
            _pushed(burns[0][:, part], burns[1][:, part], since, doubt)
            for part in range(burns[0].shape[1])
        ]
        after: Burns = (
            np.stack([part[0] for part in parts], axis=1),
            np.stack([part[1] for part in parts], 1),
            burns[2],
        )
        return moments(after), after

    def _mixed(self, burns: Burns, stage: NewStage, step_s: float) -> Burns:
        """Return copies of burns whose next stage may have begun in a step.

        Those whose stage is decided are in steady burn; an improbable free mode is dropped, one
        that ends is mixed into the steady burn.
        """
        mean, root, share = (column.copy() for column in burns)
        if step_s <= 0.0:
            return mean, root, share
        if np.count_nonzero(share[:, 2]):
            self._end_free(mean, root, share, step_s)
        decided = (share[:, 1] > _DECIDED).nonzero()[0]
        if decided.size:
            stages = share[decided] * _STAGES
            total = np.add.reduce(stages, axis=1)
            known = moments((mean[decided], root[decided], stages / total[:, None]))
            mean[decided, :2] = known[0][:, None]
            root[decided, :2] = known[1][:, None]
            share[decided, 0] = total
            share[decided, 1] = 0.0
        begins = share[:, 0] * -expm1(-step_s / stage.every_s)
        into = np.stack([begins, share[:, 1]], axis=1)
        share[:, 0] -= begins
        share[:, 1] += begins
        into /= share[:, 1:2]
        first = stage.begun(mean[:, 0], root[:, 0])
        mean[:, 1], root[:, 1] = moment_matched(
            into, (first[0], mean[:, 1]), (first[1], root[:, 1])
        )
        return mean, root, share

    def _end_free(
        self, mean: FloatArray, root: FloatArray, share: FloatArray, step_s: float
    ) -> None:
        """Drop improbable free modes, and let others end, in place."""
        assert self.free is not None
        share[share[:, 2] < _NEGLIGIBLE, 2] = 0.0
        share /= share.sum(axis=1, keepdims=True)
        rows = are_free(share).nonzero()[0]
        ends = share[rows, 2] * -expm1(-step_s / self.free.lasts_s)
        into = np.stack([share[rows, 0], ends], axis=1)
        share[rows, 0] += ends
        share[rows, 2] -= ends
        into /= share[rows, :1]
        mean[rows, 0], root[rows, 0] = moment_matched(
            into, (mean[rows, 0], mean[rows, 2]), (root[rows, 0], root[rows, 2])
        )


def are_free(share: FloatArray) -> BoolArray:
    """Return which burns (n,) have a free mode that is computed."""
    free: BoolArray = share[:, 2] > 0.0
    return free


def carried(motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: FloatArray) -> Gaussian:
    """Return means (n, d) and information roots after steps (n,), s."""
    after = motion.propagated(mean, step_s)
    back = motion.transition(0.5 * (mean + after), -step_s)
    return after, square_root.time_update(root, back, motion.noise_root(step_s, after))


def force_root(root: FloatArray) -> FloatArray:
    """Return the roots (n, 4, 4) of force and growth, whatever position and velocity, of burns (n,
    10, 10).
    """
    return information_root(square_root.inverse_root(root)[:, COAST:])


def moments(burns: Burns) -> Gaussian:
    """Return the means (n, d) and information roots of burns, by moment matching."""
    mean, root, share = burns
    count = np.count_nonzero(share[:, 2])
    if not count:
        return moment_matched(share[:, :2], (mean[:, 0], mean[:, 1]), (root[:, 0], root[:, 1]))
    if count == len(share):
        return moment_matched(share, tuple(mean.swapaxes(0, 1)), tuple(root.swapaxes(0, 1)))
    whole = (np.empty_like(mean[:, 0]), np.empty_like(root[:, 0]))
    free = are_free(share)
    for rows in (free, ~free):
        whole[0][rows], whole[1][rows] = moments((mean[rows], root[rows], share[rows]))
    return whole


def parts_of(known: Gaussian) -> Burns:
    """Return burns without parts of their own: all are the given means and roots."""
    mean, root = known
    return in_parts(mean), in_parts(root), BURN_SHARE.repeat(len(mean), axis=0)


def put(burns: Burns, rows: IntArray, part: Burns) -> Burns:
    """Return burns with some rows replaced."""
    mean, root, share = (column.copy() for column in burns)
    mean[rows], root[rows], share[rows] = part
    return mean, root, share


def each(
    function: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
    mean: FloatArray,
    root: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return a function's means and roots of each part, (n, k, d) and (n, k, d, d)."""
    count, parts, size = mean.shape
    found = function(mean.reshape(-1, size), root.reshape(-1, size, size))
    return found[0].reshape(count, parts, size), found[1].reshape(count, parts, size, size)


#: A new stage with this probability is the steady burn. The moments of both stay, so the choice
#: costs no containment: below, a doubtful stage is blurred with the old one; above, a third stage
#: waits for the second to be certain.
_DECIDED = 0.9

#: Least mixing probability with which a burn that begins takes part in a boost.
_LEAST_SHARE = 1e-4

#: Probability that a burn after the dark is the old one, which no sensor saw for a while. Notional.
_UNSEEN = 0.1

_STAGES = np.array([1.0, 1.0, 0.0])

#: A free mode less probable than this is not computed: it moves the moments of a burn by less than
#: a hundredth.
_NEGLIGIBLE = 1e-3
