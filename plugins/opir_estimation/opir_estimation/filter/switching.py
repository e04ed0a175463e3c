"""The IMM filter of boost and coast in square-root information form, for all tracks at once.

Each mode is an iterated extended Kalman filter (`iterated_update`); the modes interact by moment
matching (`mode_mixing`). The process noise of a slice enters at its start, so within a slice a
target follows one smooth path.

A boost that has just ended moves as a burning one except for the last second: the looks of a slice
are as likely in either mode, to within a seventh (measured on ICBMs from ignition to burnout).
Where no sensor detects bodies after burnout, the detection itself discriminates far better. So a
detection excludes the coast of a track that burned before. An excluded coast is not computed:
nothing depends on it, and the next step derives it from the boost.
"""

from collections.abc import Callable, Iterator, Mapping
from math import log as log_of
from typing import NamedTuple

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_estimation import square_root
from opir_estimation.assignment import group_minima
from opir_estimation.directions import dot, matvec
from opir_estimation.filter import iterated_update, mode_mixing
from opir_estimation.filter.burn_ends import BurnEnd
from opir_estimation.filter.burn_modes import (
    BurnModes,
    FreeBurn,
    NewStage,
    carried,
    each_part,
    stacked,
)
from opir_estimation.filter.dynamics import Dynamics
from opir_estimation.filter.estimates import (
    Burns,
    ModeEstimates,
    PredictedMeasurements,
    rows_of,
    with_rows,
)
from opir_estimation.filter.ground import raised_above_ground
from opir_estimation.filter.hidden_marginal import replaced
from opir_estimation.filter.iterated_update import Mode
from opir_estimation.filter.measurement_updates import Gaussian, information_root
from opir_estimation.filter.mode_mixing import EXCLUDED_WEIGHT, LookTimes, with_velocity_prior
from opir_estimation.lines_of_sight import AngleMeasurements
from opir_estimation.motion import BOOST, COAST, chain_roots

__all__ = ("ImmFilter", "ModeEstimates")

#: Time after the last detection, s, in which a force may act unseen.
RESIDUAL_S = 5.0

#: Squared distance, in standard deviations of the filter, of a state at burnout that contradicts the
#: filter: 99 % of six degrees of freedom.
CONTRADICTION = 16.8


class _Group(NamedTuple):
    """Rows of tracks with the same modes, and whether their coasts are open."""

    rows: IntArray
    is_open: bool


class _Modes(NamedTuple):
    """The modes of tracks, and log likelihoods (n, 2) of measurements in boost and coast."""

    boost: Gaussian
    burns: Burns
    coast: Gaussian
    log: FloatArray


@frozen(eq=False)
class ImmFilter:
    """A filter of two modes; `boost_s` and `coast_s` are the mean times in each mode, inf for one
    that never ends.

    `rounds` bounds the iterations of an update. `coast_detection` is the probability that a
    coasting target is detected in a slice, relative to a burning one: 1 where a sensor detects
    bodies after burnout. `memory_s` and `pause_s` govern the detection rate
    (`mode_mixing.mode_update`); `scan_s` is the shortest scan period. `residual_share` is the
    standard deviation of the unseen force after burnout, as a share of that before
    (`_with_residual`).
    """

    boost: Dynamics
    coast: Dynamics
    boost_s: float
    coast_s: float
    rounds: int = 4
    memory_s: float = 20.0
    coast_detection: float = 1.0
    pause_s: float = 0.0
    scan_s: float = 0.0
    residual_share: float = 0.0
    stage: NewStage | None = None
    free: FreeBurn | None = None
    burns: BurnModes = field(
        default=Factory(lambda self: BurnModes(self.boost, self.stage, self.free), takes_self=True),
        init=False,
    )

    @property
    def switches(self) -> bool:
        """Whether targets switch between the modes."""
        return self.boost_s < np.inf or self.coast_s < np.inf

    @property
    def least_open_weight(self) -> float:
        """The weight from which a coast is computed despite detections; 0 where these exclude
        none.
        """
        excludes = self.boost_s < np.inf and self.coast_detection < 1.0
        return EXCLUDED_WEIGHT / self.coast_detection if excludes else 0.0

    def predicted(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later."""
        return self._moved(estimates, step_s, 0.0)

    def predicted_open(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later, without coasts that a detection would exclude.

        `with_open_coast` adds those that remain open.
        """
        return self._moved(estimates, step_s, self.least_open_weight)

    def with_open_coast(
        self,
        estimates: ModeEstimates,
        predicted_open: ModeEstimates,
        earlier: ModeEstimates,
        step_s: float,
    ) -> ModeEstimates:
        """Return the estimates after a slice with all open coasts, given the `predicted_open` ones
        and those before.
        """
        is_open = estimates.weight[:, 1] >= EXCLUDED_WEIGHT
        rows = (is_open & (predicted_open.weight[:, 1] < self.least_open_weight)).nonzero()[0]
        if not len(rows):
            return estimates
        burnt = mode_mixing.coast_from_boost(earlier.part(rows), self.scan_s)
        coast = with_rows(estimates.coast, rows, self._coasted(burnt, step_s))
        return evolve(estimates, coast_mean=coast.mean, coast_root=coast.root)

    def _moved(self, estimates: ModeEstimates, step_s: float, least: float) -> ModeEstimates:
        """Return the estimates a step later; coasts less probable than `least` stay as they
        were.
        """
        if not estimates.weight.size:
            return estimates
        mixed = estimates
        if self.switches:
            mixed = mode_mixing.mixed(
                estimates,
                step_s,
                self.boost_s,
                self.coast_s,
                least,
                self.burns,
                self.scan_s,
                forgets_coasts=self.coast_detection < 1.0,
            )
        boost, burns, coast = mixed.boost, mixed.burns, mixed.coast
        burns_used, coasts_used = estimates.are_used
        is_coasting = (mixed.weight[:, 1] >= least) & coasts_used
        rows = is_coasting.nonzero()[0]
        resting = mode_mixing.resting_rows(mixed) if rows.size else rows
        if burns_used and resting.size < boost.mean.shape[0]:
            boost, burns = self.burns.predicted(boost, burns, step_s)
        if rows.size:
            moved = self._coasted(rows_of(coast, rows), step_s)
            coast = self._with_residual(with_rows(coast, rows, moved), estimates, rows, step_s)
        if resting.size:
            lit, components = mode_mixing.relit(
                estimates.part(resting), rows_of(coast, resting), self.burns
            )
            boost = with_rows(boost, resting, lit)
            burns = with_rows(burns, resting, components)
        return ModeEstimates(mixed.weight, *boost, *coast, mixed.detection_rate, *burns)

    def _with_residual(
        self, coast: Gaussian, estimates: ModeEstimates, rows: IntArray, step_s: float
    ) -> Gaussian:
        """Return coasts a step later with the process noise of what still acts after burnout,
        unseen.

        Thrust fades: a force below what sensors detect, along that before. After `RESIDUAL_S` its
        velocity has a standard deviation of `residual_share` of the old force,
        times that time.
        """
        rows = rows[estimates.detection_rate[rows, 2] < RESIDUAL_S]
        if not rows.size or self.residual_share <= 0.0:
            return coast
        force = estimates.burn_mean[rows, 0, COAST : COAST + 3]
        widened = self._with_force_noise(rows_of(coast, rows), force, step_s)
        return with_rows(coast, rows, widened)

    def _with_force_noise(self, coast: Gaussian, force: FloatArray, span_s: float) -> Gaussian:
        """Return coasts (n, 6) after the noise of a span of what is left of forces (n, 3)."""
        density = self.residual_share * np.sqrt(RESIDUAL_S) * force
        chain = chain_roots(np.array([span_s]), COAST // 3)
        noise = (chain[:, :, None] * density[:, None, :, None]).reshape(len(force), COAST, -1)
        identity = np.broadcast_to(np.eye(COAST), (len(force), COAST, COAST))
        return Gaussian(coast.mean, square_root.time_update(coast.root, identity, noise))

    def with_burn_ends(
        self, estimates: ModeEstimates, ends: Mapping[int, BurnEnd], time_s: float
    ) -> ModeEstimates:
        """Return the estimates at a time with coasts from the ends of burns by row, where these know
        the velocity better, and do not contradict the filter, as burns do that are unlike any along
        the velocity.

        The filter knows earlier stages too.
        """
        mean = estimates.coast_mean.copy()
        root = estimates.coast_root.copy()
        for row, end in ends.items():
            coast = self._coast_from_end(estimates.part(np.array([row])), end, time_s)
            step = matvec(estimates.coast_root[row : row + 1], coast.mean - mean[row])
            is_surer = _velocity_sharpness(coast.root[0]) > _velocity_sharpness(root[row])
            if is_surer and dot(step, step)[0] < CONTRADICTION:
                mean[row] = coast.mean[0]
                root[row] = coast.root[0]
        return evolve(estimates, coast_mean=mean, coast_root=root)

    def _coast_from_end(self, lone: ModeEstimates, end: BurnEnd, time_s: float) -> Gaussian:
        """Return the coast (1, 6) at a time of a lone track from the end of its burn."""
        side = np.asarray(np.linalg.cholesky(end.covariance), dtype=np.float64)
        ended = Gaussian(end.mean[None], information_root(side[None]))
        coast = mode_mixing.coasts_from_ends(ended, lone.detection_rate, self.scan_s)
        span_s = time_s - end.time_s
        coast = self._coasted(coast, span_s)
        return self._with_force_noise(coast, end.mean[None, COAST:], min(span_s, RESIDUAL_S))

    def _coasted(self, coast: Gaussian, step_s: float) -> Gaussian:
        """Return coasts a step later."""
        return self._carried(coast, np.array([step_s] * len(coast.mean)))

    def _carried(self, coast: Gaussian, step_s: FloatArray) -> Gaussian:
        """Return coasts after steps (n,), s."""
        motion = self.coast if self.coast.about is None else self.coast.about(*coast)
        return carried(motion, coast, step_s)

    def updated(
        self,
        estimates: ModeEstimates,
        time_s: float,
        measurements: AngleMeasurements,
        step_s: float,
        watched: LookTimes | None = None,
    ) -> ModeEstimates:
        """Return the estimates after the measurements of a slice of length `step_s` that ends at
        `time_s`, of which only some may have been `watched`.
        """
        count = len(estimates.weight)
        if not count:
            return estimates
        if not measurements.track.size:
            return self._undetected(estimates, step_s, watched)
        estimates = self._with_ignitions(estimates, time_s, measurements)
        hits = np.bincount(measurements.track, minlength=count)
        boost, burns, coast, change = self._measured(estimates, hits, time_s, measurements)
        weight = estimates.weight
        rate = estimates.detection_rate
        if self.switches or all(estimates.are_used):
            last_s = np.array([-np.inf] * count)
            np.maximum.at(last_s, measurements.track, measurements.time_s)
            silent_s = np.minimum(step_s, time_s - last_s)
            change[:, 1] += log_of(self.coast_detection) * (hits > 0)
            weight, rate = mode_mixing.mode_update(
                estimates, hits, silent_s, change, step_s, self.memory_s, self.pause_s, watched
            )
        return ModeEstimates(weight, *boost, *coast, rate, *burns)

    def _undetected(
        self, estimates: ModeEstimates, step_s: float, watched: LookTimes | None
    ) -> ModeEstimates:
        """Return the estimates after a slice without measurements."""
        if not self.switches and not all(estimates.are_used):
            return estimates
        count = len(estimates.weight)
        change = np.zeros((count, 2))
        silent_s = np.array([step_s] * count)
        times_s = step_s, self.memory_s, self.pause_s
        weight, rate = mode_mixing.mode_update(
            estimates, change[:, 0], silent_s, change, *times_s, watched
        )
        return ModeEstimates(weight, *estimates.boost, *estimates.coast, rate, *estimates.burns)

    def _with_ignitions(
        self, estimates: ModeEstimates, time_s: float, measurements: AngleMeasurements
    ) -> ModeEstimates:
        """Return the estimates with the burns of resting targets that are detected: lit a little
        before the first look.

        With r detections per second, that is 1/r ± 1/r.
        """
        resting = mode_mixing.resting_rows(estimates)
        if self.stage is None or not resting.size or not len(measurements):
            return estimates
        first_s = group_minima(measurements.track, measurements.time_s, len(estimates))
        rows = resting[first_s[resting] < np.inf]
        if not rows.size:
            return estimates
        hits, spell, _ = estimates.detection_rate[rows].T
        pause = spell / np.maximum(hits, 1.0)
        boost, burns = self.burns.burning_for(
            rows_of(estimates.burns, rows), time_s - first_s[rows] + pause, pause
        )
        return _with_burns(estimates, rows, boost, burns)

    def _measured(
        self,
        estimates: ModeEstimates,
        hits: IntArray,
        time_s: float,
        measurements: AngleMeasurements,
    ) -> _Modes:
        """Return modes after looks of a slice, and log likelihoods where both modes are in use."""
        boost, burns, coast = estimates.boost, estimates.burns, estimates.coast
        change = np.zeros((hits.size, 2))
        burns_used, coasts_used = estimates.are_used
        for rows, is_open in self._groups(estimates, hits):
            is_coasting = is_open and coasts_used
            burn_rows = rows_of(burns, rows)
            boost_rows = rows_of(boost, rows)
            modes = list(self.burns.modes(boost_rows, burn_rows)) if burns_used else []
            if is_coasting:
                modes.append(Mode(self.coast, *rows_of(coast, rows)))
            looks = _of_rows(measurements, rows, hits.size)
            results = iterated_update.updated(modes, time_s, looks, self.rounds)
            logs = list(map(iterated_update.log_likelihoods, modes, results))
            if burns_used:
                boost_rows, burn_rows, log = self.burns.joined(burn_rows, results, logs)
                boost = with_rows(boost, rows, boost_rows)
                burns = with_rows(burns, rows, burn_rows)
                change[rows, 0] = log if is_coasting else 0.0
            if is_coasting:
                coast = with_rows(coast, rows, Gaussian(*results[-1][:2]))
                change[rows, 1] = logs[-1]
        return _Modes(boost, burns, coast, change)

    def _groups(self, estimates: ModeEstimates, hits: IntArray) -> Iterator[_Group]:
        """Yield the groups of tracks with looks, by whether coasts and free burns are computed."""
        if hits.size == 1:
            if hits[0]:
                is_open = bool(estimates.weight[0, 1] >= self.least_open_weight)
                yield _Group(np.zeros(1, dtype=np.int64), is_open)
            return
        are_open = estimates.weight[:, 1] >= self.least_open_weight
        kinds = 2 * are_open + estimates.burns.are_free
        rows_seen = hits.nonzero()[0]
        kinds_seen = kinds[rows_seen]
        for kind in sorted(set(kinds_seen.tolist())):
            yield _Group(rows_seen[kinds_seen == kind], kind >= 2)

    def with_velocity_prior(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the velocity covariance of the tracks `rows` bounded by the
        prior.
        """
        burnt = _with_bounded_burns(estimates, rows, with_velocity_prior)
        bounded = with_velocity_prior(rows_of(estimates.coast, rows))
        coast = with_rows(estimates.coast, rows, bounded)
        return evolve(burnt, coast_mean=coast.mean, coast_root=coast.root)

    def raised_above_ground(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the burns of the tracks `rows` above the ground."""
        return _with_bounded_burns(estimates, rows, raised_above_ground)

    def replaced_along(
        self,
        estimates: ModeEstimates,
        rows: IntArray,
        axis: FloatArray,
        along: FloatArray,
        covariance: FloatArray,
    ) -> ModeEstimates:
        """Return the estimates with what the burns of tracks `rows` (m,) do along axes (m, 3) of
        given moments.

        These are of position, velocity and force, (m, 3) and (m, 3, 3).
        """
        boost = replaced(rows_of(estimates.boost, rows), axis, along, covariance)
        burns = rows_of(estimates.burns, rows)
        components = [replaced(burns.part(number), axis, along, covariance) for number in range(3)]
        return _with_burns(estimates, rows, boost, stacked(components, burns.share))

    def coasts_before(
        self, estimates: ModeEstimates, rows: IntArray, since_s: FloatArray
    ) -> Gaussian:
        """Return the coasts of tracks `rows` (m,) at times (m,), s, before the estimates'."""
        return self._carried(rows_of(estimates.coast, rows), -since_s)

    def coasts_replaced_along(
        self,
        estimates: ModeEstimates,
        rows: IntArray,
        since_s: FloatArray,
        axis: FloatArray,
        along: FloatArray,
        covariance: FloatArray,
    ) -> ModeEstimates:
        """Return the estimates with what the coasts of tracks `rows` (m,) did along axes (m, 3) of
        given moments, times (m,), s, ago.

        These are of position and velocity, (m, 2) and (m, 2, 2).
        """
        coast = replaced(self.coasts_before(estimates, rows, since_s), axis, along, covariance)
        coast = with_rows(estimates.coast, rows, self._carried(coast, since_s))
        return evolve(estimates, coast_mean=coast.mean, coast_root=coast.root)

    def predicted_measurements(
        self, estimates: ModeEstimates, time_s: float
    ) -> PredictedMeasurements:
        """Return the predictions about the estimates' time, by the likelier mode of each track."""
        coasts = estimates.weight[:, 1] > estimates.weight[:, 0]
        if True not in coasts:
            return PredictedMeasurements(time_s, *_path(self.boost, estimates.boost))
        if False not in coasts:
            return PredictedMeasurements(time_s, *_path(self.coast, estimates.coast))
        derivative = np.empty((len(estimates), 5, 3))
        root = np.empty((len(estimates), BOOST, BOOST))
        modes = ((coasts, self.coast, estimates.coast), (~coasts, self.boost, estimates.boost))
        for mask, motion, state in modes:
            rows = mask.nonzero()[0]
            derivative[rows], root[rows] = _path(motion, rows_of(state, rows))
        return PredictedMeasurements(time_s, derivative, root)

    def moments(self, estimates: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity, over both
        modes.
        """
        least = EXCLUDED_WEIGHT if self.least_open_weight else 0.0
        are_open = estimates.weight[:, 1:] >= least
        boost_mean = estimates.boost_mean[:, :COAST]
        boost_side = square_root.inverse_root(estimates.boost_root)[:, :COAST]
        if True not in are_open:
            return boost_mean, square_root.gram(boost_side)
        weight = np.where(are_open, estimates.weight, [1.0, 0.0])
        boost = weight[:, :1]
        coast = weight[:, 1:]
        width = boost_side.shape[2]
        side = np.empty((len(weight), COAST, width + COAST + 1))
        share = np.sqrt(weight)[:, :, None, None]
        np.multiply(boost_side, share[:, 0], out=side[:, :, :width])
        coast_side = square_root.inverse_root(estimates.coast_root)
        np.multiply(coast_side, share[:, 1], out=side[:, :, width:-1])
        difference = boost_mean - estimates.coast_mean
        np.multiply(difference, np.sqrt(boost * coast), out=side[:, :, -1])
        mean: FloatArray = boost * boost_mean + coast * estimates.coast_mean
        return mean, square_root.gram(side)


def _velocity_sharpness(root: FloatArray) -> float:
    """Return the product of the velocity's inverse standard deviations by an information root (6, 6),
    on independent axes.
    """
    return float(np.abs(np.prod(np.diagonal(root)[3:])))


def _with_bounded_burns(
    estimates: ModeEstimates, rows: IntArray, bounded: Callable[[Gaussian], Gaussian]
) -> ModeEstimates:
    """Return the estimates with a function applied to the burns of tracks `rows`."""
    boost = bounded(rows_of(estimates.boost, rows))
    burns = rows_of(estimates.burns, rows)
    components = each_part(bounded, burns)
    return _with_burns(estimates, rows, boost, Burns(*components, burns.share))


def _with_burns(
    estimates: ModeEstimates, rows: IntArray, boost: Gaussian, burns: Burns
) -> ModeEstimates:
    """Return the estimates with the burns of tracks `rows` replaced."""
    boost = with_rows(estimates.boost, rows, boost)
    burns = with_rows(estimates.burns, rows, burns)
    return ModeEstimates(
        estimates.weight, *boost, *estimates.coast, estimates.detection_rate, *burns
    )


def _of_rows(measurements: AngleMeasurements, rows: IntArray, count: int) -> AngleMeasurements:
    """Return the measurements of some of the tracks (count,), renumbered."""
    if rows.size == count:
        return measurements
    number = np.full(count, -1)
    number[rows] = np.arange(len(rows))
    track = number[measurements.track]
    selected = (track >= 0).nonzero()[0]
    return measurements.part(selected).with_track(track[selected])


def _path(motion: Dynamics, state: Gaussian) -> tuple[FloatArray, FloatArray]:
    """Return position derivatives (n, 5, 3) and covariance roots (n, 12, 12) of the first four."""
    side = square_root.inverse_root(state.root)
    return motion.taylor(state.mean), motion.derivative_roots(state.mean, side)
