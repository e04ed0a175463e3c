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

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_estimation import square_root
from opir_estimation.directions import dot, matvec
from opir_estimation.filter.dynamics import Dynamics
from opir_estimation.filter.estimates import Burns, rows_of
from opir_estimation.filter.iterated_update import Mode, Updated
from opir_estimation.filter.measurement_updates import Gaussian, information_root, moment_matched
from opir_estimation.filter.motion_model import MotionModel
from opir_estimation.filter.thrust import SLOW_M_S, air_velocity
from opir_estimation.motion import COAST

_UNIT = np.eye(3)


@frozen
class BurnLaw:
    """Probabilities and thresholds of the modes of a burn; notional where no reason is given."""

    #: Time, s, for which a force may have had another direction before looks show it.
    unnoticed_s: float = 4.0

    #: Squared distance, in standard deviations of the prior, by which looks move an estimate that
    #: is tested for surprise: one slice in ten of ordinary boosts.
    tested_distance: float = 1.5

    #: Probability that a burn whose looks surprise is free.
    surprised_free: float = 0.02

    #: Share of the prior covariance of the position that counts as learnt where looks teach
    #: nothing.
    least_learnt: float = 1e-3

    #: A new stage with this probability is the steady burn. The moments of both stay, so the choice
    #: costs no containment: below, a doubtful stage is blurred with the old one; above, a third
    #: stage waits for the second to be certain.
    decided: float = 0.9

    #: Least mixing probability with which a burn that begins takes part in a boost.
    least_share: float = 1e-4

    #: Probability that a burn after the dark is the old one, which no sensor saw for a while.
    unseen: float = 0.1

    #: A free mode less probable than this is not computed: it moves the moments of a burn by less
    #: than a hundredth.
    negligible: float = 1e-3


LAW = BurnLaw()


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

    @property
    def growth(self) -> tuple[float, float]:
        """Mean and standard deviation of the growth, 1/s."""
        return self.growth_per_s, self.growth_sigma_per_s

    def begun(self, burn: Gaussian) -> Gaussian:
        """Return burns (n, 10) whose next stage begins: force and growth of the prior, the force
        along the velocity.
        """
        unit, speed = self._direction(burn.mean)
        begun = self._along(_paths_of(burn), unit)
        # The force turns with the velocity, whatever that is: rows on their difference. At rest it
        # has no direction.
        along = unit[:, :, None] * unit[:, None, :]
        across = _UNIT - along
        sharp = 1.0 / (self.force_m_s2 * (self.tilt + SLOW_M_S / speed))
        by_speed = sharp * self.force_m_s2 / speed
        begun.root[:, 6:9, 3:6] = by_speed[:, None, None] * -across
        begun.root[:, 6:9, 6:9] = sharp[:, None, None] * across + along / self.force_sigma_m_s2
        return Gaussian(begun.mean, square_root.triangular(begun.root))

    def lit(self, coast: Gaussian) -> Gaussian:
        """Return burns (n, 10) of a stage that begins where targets coast (n, 6).

        After the dark, in which it may have turned.
        """
        return self._along(coast, self._direction(coast.mean)[0])

    def _along(self, path: Gaussian, unit: FloatArray) -> Gaussian:
        """Return burns (n, 10) with mean forces along directions (n, 3)."""
        return _ignited(path, self.force_m_s2 * unit, self.force_sigma_m_s2, self.growth)

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

    def lit(self, coast: Gaussian, growth: tuple[float, float]) -> Gaussian:
        """Return burns (n, 10) that begin where targets coast (n, 6)."""
        no_force = np.zeros((len(coast.mean), 3))
        return _ignited(coast, no_force, self.force_sigma_m_s2, growth)

    def turned(self, burn: Gaussian, growth: tuple[float, float]) -> Gaussian:
        """Return burns (n, 10) whose force has had another direction for some seconds."""
        begun = self.lit(_paths_of(burn), growth)
        since_s = LAW.unnoticed_s
        size = burn.mean.shape[1]
        noise = np.zeros((len(burn.mean), size, 3))
        noise[:, range(3), range(3)] = 0.5 * since_s**2 * self.force_sigma_m_s2
        noise[:, range(3, COAST), range(3)] = since_s * self.force_sigma_m_s2
        identity = np.broadcast_to(np.eye(size), begun.root.shape)
        return Gaussian(begun.mean, square_root.time_update(begun.root, identity, noise))

    def surprises(self, prior: Gaussian, burn: Gaussian) -> BoolArray:
        """Whether looks surprise (n,): squared innovations of positions in standard deviations, χ²
        of 3 degrees of freedom at most.

        Looks move an estimate by as much as they shrink its covariance.
        """
        prior_covariance = _position_covariance(prior)
        step = (burn.mean - prior.mean)[:, :3]
        least = LAW.least_learnt * prior_covariance
        learnt = prior_covariance - _position_covariance(burn) + least
        return dot(step, square_root.solved(learnt, step)) > self.surprise


def _position_covariance(burn: Gaussian) -> FloatArray:
    return square_root.gram(square_root.inverse_root(burn.root)[:, :3])


def _paths_of(burn: Gaussian) -> Gaussian:
    """Return position and velocity (n, 6), whatever the force: the roots of the last columns."""
    turned = np.empty_like(burn.root)
    turned[:, :, :-COAST] = burn.root[:, :, COAST:]
    turned[:, :, -COAST:] = burn.root[:, :, :COAST]
    root = square_root.triangular(turned)[:, -COAST:, -COAST:]
    return Gaussian(burn.mean[:, :COAST], root)


def _ignited(
    path: Gaussian, force: FloatArray, force_sigma_m_s2: float, growth: tuple[float, float]
) -> Gaussian:
    """Return burns (n, 10) on paths (n, 6), with forces (n, 3) and mean and sigma of the growth."""
    count = len(force)
    size = COAST + 4
    mean = np.empty((count, size))
    root = np.zeros((count, size, size))
    mean[:, :COAST] = path.mean
    mean[:, 6:9] = force
    mean[:, 9] = growth[0]
    root[:, :COAST, :COAST] = path.root
    root[:, range(6, 9), range(6, 9)] = 1.0 / force_sigma_m_s2
    root[:, 9, 9] = 1.0 / growth[1]
    return Gaussian(mean, root)


def _pushed(burn: Gaussian, since_s: FloatArray, sigma_s: FloatArray) -> Gaussian:
    """Return burns (n, 10) after their forces have acted for times (n, 1), s, known to `sigma_s`
    (n, 1).
    """
    force = burn.mean[:, 6:9]
    size = burn.mean.shape[1]
    half_square = 0.5 * since_s**2
    mean = burn.mean.copy()
    mean[:, :3] += half_square * force
    mean[:, 3:COAST] += since_s * force
    back = np.eye(size)[None].repeat(len(mean), axis=0)
    back[:, range(3), range(6, 9)] = -half_square
    back[:, range(3, COAST), range(6, 9)] = -since_s
    noise = np.zeros((len(mean), size, 1))
    noise[:, :3, 0] = since_s * sigma_s * force
    noise[:, 3:COAST, 0] = sigma_s * force
    return Gaussian(mean, square_root.time_update(burn.root, back, noise))


@frozen(eq=False)
class BurnModes:
    """The modes of a burn; without `stage` there is the burn alone, and its parts are not used.

    A burn is its moments, and its parts.
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
        return LAW.least_share if self.stage is None else 0.5

    def predicted(self, boost: Gaussian, burns: Burns, step_s: float) -> tuple[Gaussian, Burns]:
        """Return burns a step later."""
        steps = np.array([step_s] * len(boost.mean))
        if self.stage is None:
            return carried(self.motion, boost, steps), burns
        burns = burns.copied()
        if step_s > 0.0:
            self._mix(burns, self.stage, step_s)
        mean, root, share = burns
        if len(share) == 1:
            # Single states have faster kernels.
            for number in (0, 1):
                mean[:, number], root[:, number] = carried(self.motion, burns.part(number), steps)
        else:
            moving = Burns(mean[:, :2], root[:, :2], share)
            mean[:, :2], root[:, :2] = each_part(
                lambda state: carried(self.motion, state, steps.repeat(2)), moving
            )
        rows = share[:, 2].nonzero()[0]
        if rows.size and self.free is not None:
            mean[rows, 2], root[rows, 2] = carried(
                self.free.motion, rows_of(burns.part(2), rows), steps[rows]
            )
        return moments(burns), burns

    def modes(self, boost: Gaussian, burns: Burns) -> Sequence[Mode]:
        """Return the modes to update: of tracks whose free mode is computed, or of those where it
        is not.
        """
        if self.stage is None:
            return [Mode(self.motion, *boost)]
        mean, root, _ = burns
        modes = [Mode(self.motion, mean[:, number], root[:, number]) for number in (0, 1)]
        if self.free is not None and burns.share[0, 2] > 0.0:
            modes.append(Mode(self.free.motion, *burns.part(2)))
        return modes

    def joined(
        self, burns: Burns, updates: Sequence[Updated], log: Sequence[FloatArray]
    ) -> tuple[Gaussian, Burns, FloatArray]:
        """Return burns after an update of `modes`, whose log likelihoods are (n,), and that of the
        burn (n,).
        """
        if self.stage is None:
            return Gaussian(*updates[0][:2]), burns, log[0]
        components = 3 if self.free is not None and burns.share[0, 2] > 0.0 else 2
        updated = burns.copied()
        logs = np.array(log[:components])
        greatest = np.maximum.reduce(logs)
        updated.share[:, :components] *= np.exp(logs - greatest).T
        total = np.add.reduce(updated.share, axis=1)
        updated.share[:] /= total[:, None]
        for number in range(components):
            updated.mean[:, number], updated.root[:, number] = updates[number][:2]
        boost = moments(updated)
        if self.free is not None and components == 2:
            boost, updated = self._with_surprised(self.free, burns, boost, updated)
        return boost, updated, greatest + np.log(total)

    def _with_surprised(
        self, free: FreeBurn, prior: Burns, boost: Gaussian, burns: Burns
    ) -> tuple[Gaussian, Burns]:
        """Return burns with a free mode where looks moved steady burn and staging by more than is
        likely.
        """
        assert self.stage is not None
        step = matvec(prior.root[:, 0], burns.mean[:, 0] - prior.mean[:, 0])
        rows = (dot(step, step) > LAW.tested_distance).nonzero()[0]
        for number in (0, 1):
            if rows.size:
                states = [rows_of(components.part(number), rows) for components in (prior, burns)]
                rows = rows[free.surprises(*states)]
        if not rows.size:
            return boost, burns
        opened = burns.copied()
        turned = free.turned(rows_of(boost, rows), self.stage.growth)
        opened.mean[rows, 2], opened.root[rows, 2] = turned
        opened.share[rows, :2] *= 1.0 - LAW.surprised_free
        opened.share[rows, 2] = LAW.surprised_free
        return moments(opened), opened

    def lit(self, coast: Gaussian, dark: Burns) -> tuple[Gaussian, Burns]:
        """Return burns that begin where targets coast, and those before the dark.

        Most begin as a new stage; some go on as before, unseen for a while; some are free.
        """
        assert self.stage is not None
        begun = self.stage.lit(coast)
        free = begun
        free_share = 0.0
        if self.free is not None:
            free = self.free.lit(coast, self.stage.growth)
            free_share = self.free.relit
        components = (resumed(coast, dark.part(0)), begun, free)
        share = np.array([[LAW.unseen, 1.0 - LAW.unseen - free_share, free_share]])
        burns = stacked(components, share.repeat(len(coast.mean), axis=0))
        return moments(burns), burns

    def burning_for(
        self, burns: Burns, since_s: FloatArray, sigma_s: FloatArray
    ) -> tuple[Gaussian, Burns]:
        """Return burns that began where targets coast, after times (n,), s, of burning known to
        `sigma_s` (n,).
        """
        components = [
            _pushed(burns.part(number), since_s[:, None], sigma_s[:, None]) for number in range(3)
        ]
        pushed = stacked(components, burns.share)
        return moments(pushed), pushed

    def _mix(self, burns: Burns, stage: NewStage, step_s: float) -> None:
        """Begin the next stages that a step may have, in place.

        Burns whose stage is decided are in steady burn; an improbable free mode is dropped, one
        that ends is mixed into the steady burn.
        """
        mean, root, share = burns
        if share[:, 2].nonzero()[0].size:
            self._end_free(burns, step_s)
        _settle_stages(burns)
        begins = share[:, 0] * -expm1(-step_s / stage.every_s)
        weight = np.array([begins, share[:, 1]]).T
        share[:, 0] -= begins
        share[:, 1] += begins
        weight /= share[:, 1:2]
        begun = stage.begun(burns.part(0))
        mean[:, 1], root[:, 1] = moment_matched(
            weight, (begun.mean, mean[:, 1]), (begun.root, root[:, 1])
        )

    def _end_free(self, burns: Burns, step_s: float) -> None:
        """Drop improbable free modes, and let others end, in place."""
        assert self.free is not None
        mean, root, share = burns
        _drop_improbable(share)
        rows = burns.are_free.nonzero()[0]
        ends = share[rows, 2] * -expm1(-step_s / self.free.lasts_s)
        weight = np.array([share[rows, 0], ends]).T
        share[rows, 0] += ends
        share[rows, 2] -= ends
        weight /= share[rows, :1]
        mean[rows, 0], root[rows, 0] = moment_matched(
            weight, (mean[rows, 0], mean[rows, 2]), (root[rows, 0], root[rows, 2])
        )


def _drop_improbable(share: FloatArray) -> None:
    """Set negligible shares of free modes to 0, in place."""
    share[share[:, 2] < LAW.negligible, 2] = 0.0
    share /= share.sum(axis=1, keepdims=True)


def _settle_stages(burns: Burns) -> None:
    """Make burns whose stage is decided the moments of steady burn and staging, in place."""
    mean, root, share = burns
    rows = (share[:, 1] > LAW.decided).nonzero()[0]
    if not rows.size:
        return
    stages = share[rows] * [1.0, 1.0, 0.0]
    total = np.add.reduce(stages, axis=1)
    boost = moments(Burns(mean[rows], root[rows], stages / total[:, None]))
    mean[rows, :2] = boost.mean[:, None]
    root[rows, :2] = boost.root[:, None]
    share[rows, 0] = total
    share[rows, 1] = 0.0


def resumed(coast: Gaussian, burn: Gaussian) -> Gaussian:
    """Return burns with the positions and velocities of coasts (n, 6), and old forces."""
    root = np.zeros_like(burn.root)
    root[:, :COAST, :COAST] = coast.root
    root[:, COAST:, COAST:] = information_root(square_root.inverse_root(burn.root)[:, COAST:])
    return Gaussian(np.concatenate([coast.mean, burn.mean[:, COAST:]], axis=1), root)


def carried(motion: Dynamics, state: Gaussian, step_s: FloatArray) -> Gaussian:
    """Return estimates after steps (n,), s."""
    if isinstance(motion, MotionModel):
        mean, back, noise = motion.step(state.mean, step_s)
        return Gaussian(mean, square_root.time_update(state.root, back, noise))
    mean = motion.propagated(state.mean, step_s)
    back = motion.transition(0.5 * (state.mean + mean), -step_s)
    coasting = motion.noise_root(step_s, mean)
    return Gaussian(mean, square_root.time_update(state.root, back, coasting))


def moments(burns: Burns) -> Gaussian:
    """Return the moments of burns."""
    mean, root, share = burns
    count = share[:, 2].nonzero()[0].size
    if 0 < count < share.shape[0]:
        return _moments_by_kind(burns)
    size = 3 if count else 2
    means = mean[:, :size].swapaxes(0, 1)
    return moment_matched(share[:, :size], means, root[:, :size].swapaxes(0, 1))


def _moments_by_kind(burns: Burns) -> Gaussian:
    """Return the moments of burns, of which only some have a free part."""
    mean, root, _ = burns
    matched = Gaussian(np.empty_like(mean[:, 0]), np.empty_like(root[:, 0]))
    for mask in (burns.are_free, ~burns.are_free):
        rows = mask.nonzero()[0]
        matched.mean[rows], matched.root[rows] = moments(rows_of(burns, rows))
    return matched


def stacked(components: Sequence[Gaussian], share: FloatArray) -> Burns:
    """Return burns of three parts."""
    mean, root = (np.stack(columns, axis=1) for columns in zip(*components, strict=True))
    return Burns(mean, root, share)


def each_part(function: Callable[[Gaussian], Gaussian], burns: Burns) -> Gaussian:
    """Return a function's values for each part of burns: means (n, k, d) and roots (n, k, d, d)."""
    mean, root, _ = burns
    size = mean.shape[2]
    values = function(Gaussian(mean.reshape(-1, size), root.reshape(-1, size, size)))
    return Gaussian(values.mean.reshape(mean.shape), values.root.reshape(root.shape))
