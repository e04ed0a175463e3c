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

from collections.abc import Callable
from math import log as log_of

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import BOOST, COAST, dot, noise_roots, square_root
from opir_trackers.filter import burn_modes, iterated_update, mode_mixing
from opir_trackers.filter.burn_modes import (
    BurnModes,
    Burns,
    FreeBurn,
    Gaussian,
    NewStage,
    are_free,
    carried,
)
from opir_trackers.filter.dynamics import Dynamics
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.ground import above_ground
from opir_trackers.filter.hidden_marginal import replaced
from opir_trackers.filter.iterated_update import Mode
from opir_trackers.filter.mode_mixing import EXCLUDED_WEIGHT, with_velocity_prior
from opir_trackers.lines_of_sight import AngleMeasurements

__all__ = ("ImmFilter", "ModeEstimates")


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
        """Return whether targets switch between the modes."""
        return self.boost_s < np.inf or self.coast_s < np.inf

    @property
    def least_open_weight(self) -> float:
        """Return the weight from which a coast is computed despite detections; 0 where these
        exclude none.
        """
        return (
            EXCLUDED_WEIGHT / self.coast_detection
            if self.boost_s < np.inf and self.coast_detection < 1.0
            else 0.0
        )

    def predicted(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later."""
        return self._moved(estimates, step_s, 0.0) if len(estimates.weight) else estimates

    def predicted_open(self, estimates: ModeEstimates, step_s: float) -> ModeEstimates:
        """Return the estimates a step later, without coasts that a detection would exclude.

        `with_open_coast` adds those that remain open.
        """
        return (
            self._moved(estimates, step_s, self.least_open_weight)
            if len(estimates.weight)
            else estimates
        )

    def with_open_coast(
        self,
        estimates: ModeEstimates,
        predicted_open: ModeEstimates,
        before: ModeEstimates,
        step_s: float,
    ) -> ModeEstimates:
        """Return the estimates after a slice with all open coasts, given the `predicted_open` ones
        and those before.
        """
        rows = (
            (estimates.weight[:, 1] >= EXCLUDED_WEIGHT)
            & (predicted_open.weight[:, 1] < self.least_open_weight)
        ).nonzero()[0]
        if not len(rows):
            return estimates
        burnt = mode_mixing.coast_from_boost(before.part(rows), self.scan_s)
        mean, root = _with_rows(
            _modes_of(estimates)[1],
            self._carried(self.coast, *burnt, np.full(len(rows), step_s)),
            rows,
        )
        return evolve(estimates, coast_mean=mean, coast_root=root)

    def _moved(self, estimates: ModeEstimates, step_s: float, least: float) -> ModeEstimates:
        """Return the estimates a step later; coasts less probable than `least` stay as they
        were.
        """
        mixed = estimates
        if self.switches:
            mixed = mode_mixing.mixed(
                estimates, step_s, self.boost_s, self.coast_s, least, self.burns, self.scan_s
            )
        boost, coast = _modes_of(mixed)
        used = _in_use(estimates)
        steps = np.array([step_s] * len(estimates.weight))
        rows = (mixed.weight[:, 1] >= least).nonzero()[0] if used[1] else _NONE
        rests = mode_mixing.resting_rows(mixed) if len(rows) else _NONE
        burns: Burns = mixed.burn_mean, mixed.burn_root, mixed.burn_share
        if used[0] and rests.size < steps.size:
            boost, burns = self.burns.predicted(boost, burns, step_s)
        if len(rows) == len(steps):
            coast = self._carried(self.coast, *coast, steps)
        elif len(rows):
            part = coast[0][rows], coast[1][rows]
            coast = _with_rows(coast, self._carried(self.coast, *part, steps[rows]), rows)
        if len(rows) and self.residual_share > 0.0:
            coast = self._with_residual(coast, estimates, rows, step_s)
        if rests.size:
            lit, parts = mode_mixing.relit(
                estimates.part(rests), coast[0][rests], coast[1][rests], self.burns
            )
            boost = _with_rows(boost, lit, rests)
            burns = burn_modes.put(burns, rests, parts)
        return ModeEstimates(mixed.weight, *boost, *coast, mixed.detection_rate, *burns)

    def _with_residual(
        self, coast: Gaussian, estimates: ModeEstimates, rows: IntArray, step_s: float
    ) -> Gaussian:
        """Return coasts a step later with the process noise of what still acts after burnout,
        unseen.

        Thrust fades, stages part: a force below what sensors detect, in any direction. After
        `RESIDUAL_S` its velocity has a standard deviation of `residual_share` of the old force,
        times that time.
        """
        rows = rows[estimates.detection_rate[rows, 2] < RESIDUAL_S]
        if not rows.size:
            return coast
        force = estimates.burn_mean[rows, 0, COAST : COAST + 3]
        density = self.residual_share * np.sqrt(RESIDUAL_S * dot(force, force))
        noise = density[:, None, None] * noise_roots(np.array([step_s]), COAST // 3)
        still = np.broadcast_to(np.eye(COAST), (len(rows), COAST, COAST))
        root = square_root.time_update(coast[1][rows], still, noise)
        return _with_rows(coast, (coast[0][rows], root), rows)

    def _carried(
        self, motion: Dynamics, mean: FloatArray, root: FloatArray, step_s: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        return carried(
            motion if motion.about is None else motion.about(mean, root), mean, root, step_s
        )

    def updated(
        self,
        estimates: ModeEstimates,
        time_s: float,
        measurements: AngleMeasurements,
        step_s: float,
    ) -> ModeEstimates:
        """Return the estimates after the measurements of a slice of length `step_s` that ends at
        `time_s`.
        """
        if not len(estimates.weight):
            return estimates
        estimates = self._with_ignitions(estimates, time_s, measurements)
        if len(estimates.weight) == 1:
            return self._updated_alone(estimates, time_s, measurements, step_s)
        hits = np.bincount(measurements.track, minlength=len(estimates)).astype(np.float64)
        seen = hits > 0.0
        boost, burns, coast, change = self._taken_in(estimates, seen, time_s, measurements)
        if not self.switches and not all(_in_use(estimates)):
            return ModeEstimates(estimates.weight, *boost, *coast, estimates.detection_rate, *burns)
        last_s = np.full(len(estimates), time_s - step_s)
        np.maximum.at(last_s, measurements.track, measurements.time_s)
        change[seen, 1] += log_of(self.coast_detection)
        weighed = mode_mixing.mode_update(
            estimates, hits, time_s - last_s, change, step_s, self.memory_s, self.pause_s
        )
        return ModeEstimates(weighed[0], *boost, *coast, weighed[1], *burns)

    def _with_ignitions(
        self, estimates: ModeEstimates, time_s: float, measurements: AngleMeasurements
    ) -> ModeEstimates:
        """Return the estimates with the burns of resting targets that are detected: lit a little
        before the first look.

        With r detections per second, that is 1/r ± 1/r.
        """
        rests = mode_mixing.resting_rows(estimates)
        if self.stage is None or not rests.size or not len(measurements):
            return estimates
        first_s = np.full(len(estimates), np.inf)
        np.minimum.at(first_s, measurements.track, measurements.time_s)
        rows = rests[first_s[rests] < np.inf]
        if not rows.size:
            return estimates
        hits, spell, _ = estimates.detection_rate[rows].T
        pause = spell / np.maximum(hits, 1.0)
        parts: Burns = (
            estimates.burn_mean[rows],
            estimates.burn_root[rows],
            estimates.burn_share[rows],
        )
        lit, parts = self.burns.burning_for(parts, time_s - first_s[rows] + pause, pause)
        boost = _with_rows(_modes_of(estimates)[0], lit, rows)
        burns = burn_modes.put(
            (estimates.burn_mean, estimates.burn_root, estimates.burn_share), rows, parts
        )
        return ModeEstimates(
            estimates.weight, *boost, *_modes_of(estimates)[1], estimates.detection_rate, *burns
        )

    def _updated_alone(
        self,
        estimates: ModeEstimates,
        time_s: float,
        measurements: AngleMeasurements,
        step_s: float,
    ) -> ModeEstimates:
        """Return `updated` for one track."""
        weight = estimates.weight[0].tolist()
        change = [0.0, 0.0]
        burns: Burns = estimates.burn_mean, estimates.burn_root, estimates.burn_share
        boost, coast = _modes_of(estimates)
        coasts = weight[1] > 0.0 and weight[1] >= self.least_open_weight
        looks = len(measurements.time_s)
        silent_s = step_s
        if looks:
            modes = list(self.burns.modes(boost, burns)) if weight[0] > 0.0 else []
            modes += [Mode(self.coast, *coast)] * coasts
            results = iterated_update.updated(modes, time_s, measurements, self.rounds)
            logs = [
                iterated_update.log_likelihoods(*pair) for pair in zip(modes, results, strict=True)
            ]
            if weight[0] > 0.0:
                boost, burns, log = self.burns.joined(burns, results, logs)
                change[0] = float(log[0]) if coasts else 0.0
            if coasts:
                coast = (results[-1].mean, results[-1].root)
                change[1] = float(logs[-1][0])
            change[1] += log_of(self.coast_detection)
            silent_s = min(step_s, time_s - float(np.maximum.reduce(measurements.time_s)))
        if not self.switches and not all(weight):
            return ModeEstimates(estimates.weight, *boost, *coast, estimates.detection_rate, *burns)
        both = change[0], change[1]
        weighed = mode_mixing.mode_update_alone(
            estimates, looks, silent_s, both, step_s, self.memory_s, self.pause_s
        )
        return ModeEstimates(weighed[0], *boost, *coast, weighed[1], *burns)

    def _taken_in(
        self,
        estimates: ModeEstimates,
        seen: BoolArray,
        time_s: float,
        measurements: AngleMeasurements,
    ) -> tuple[Gaussian, Burns, Gaussian, FloatArray]:
        """Return boosts, their parts and coasts after looks, and log likelihoods (n, 2) where both
        are in use.
        """
        burns: Burns = estimates.burn_mean, estimates.burn_root, estimates.burn_share
        (boost, coast), change, used = (
            _modes_of(estimates),
            np.zeros((len(estimates), 2)),
            _in_use(estimates),
        )
        if not len(measurements):
            return boost, burns, coast, change
        open_ = estimates.weight[:, 1] >= self.least_open_weight
        free = seen & are_free(burns[2])
        groups = [(seen & open_, used[1]), (seen & ~open_, False)]
        if np.count_nonzero(free):
            groups = [(some & part, coasts) for some, coasts in groups for part in (free, ~free)]
        for some, coasts in groups:
            rows = _rows(some)
            if rows is not None and not len(rows):
                continue
            every = slice(None) if rows is None else rows
            mine: Burns = (
                burns if rows is None else (burns[0][rows], burns[1][rows], burns[2][rows])
            )
            burning = boost if rows is None else (boost[0][rows], boost[1][rows])
            modes = list(self.burns.modes(burning, mine)) if used[0] else []
            if coasts:
                modes.append(_mode(self.coast, *coast, rows))
            results = iterated_update.updated(
                modes, time_s, _of_rows(measurements, some, rows), self.rounds
            )
            logs = [
                iterated_update.log_likelihoods(*pair) for pair in zip(modes, results, strict=True)
            ]
            if used[0]:
                burning, mine, log = self.burns.joined(mine, results, logs)
                boost = _with_rows(boost, burning, rows)
                burns = mine if rows is None else burn_modes.put(burns, rows, mine)
                change[every, 0] = log if coasts else 0.0
            if coasts:
                coast = _with_rows(coast, (results[-1].mean, results[-1].root), rows)
                change[every, 1] = logs[-1]
        return boost, burns, coast, change

    def with_velocity_prior(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the velocity covariance of the tracks `rows` bounded by the
        prior.
        """
        burnt = self._with_bounded_burns(estimates, rows, with_velocity_prior)
        mean, root = _modes_of(estimates)[1]
        coast = _with_rows((mean, root), with_velocity_prior(mean[rows], root[rows]), rows)
        return evolve(burnt, coast_mean=coast[0], coast_root=coast[1])

    def above_ground(self, estimates: ModeEstimates, rows: IntArray) -> ModeEstimates:
        """Return the estimates with the burns of the tracks `rows` above the ground."""
        return self._with_bounded_burns(estimates, rows, above_ground)

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
        boost = _modes_of(estimates)[0]
        boost = _with_rows(
            boost, replaced(boost[0][rows], boost[1][rows], axis, along, covariance), rows
        )
        mean = estimates.burn_mean[rows]
        root = estimates.burn_root[rows]
        parts = [
            replaced(mean[:, part], root[:, part], axis, along, covariance)
            for part in range(mean.shape[1])
        ]
        burns: Burns = (
            np.stack([part[0] for part in parts], axis=1),
            np.stack([part[1] for part in parts], axis=1),
            estimates.burn_share[rows],
        )
        burns = burn_modes.put(
            (estimates.burn_mean, estimates.burn_root, estimates.burn_share), rows, burns
        )
        return evolve(
            estimates,
            boost_mean=boost[0],
            boost_root=boost[1],
            burn_mean=burns[0],
            burn_root=burns[1],
        )

    def _with_bounded_burns(
        self,
        estimates: ModeEstimates,
        rows: IntArray,
        bounded: Callable[[FloatArray, FloatArray], Gaussian],
    ) -> ModeEstimates:
        """Return the estimates with a function of means and roots applied to the burns of tracks
        `rows`.
        """
        boost = _modes_of(estimates)[0]
        boost = _with_rows(boost, bounded(boost[0][rows], boost[1][rows]), rows)
        burns: Burns = estimates.burn_mean, estimates.burn_root, estimates.burn_share
        parts = burn_modes.each(bounded, burns[0][rows], burns[1][rows])
        burns = burn_modes.put(burns, rows, (*parts, burns[2][rows]))
        return evolve(
            estimates,
            boost_mean=boost[0],
            boost_root=boost[1],
            burn_mean=burns[0],
            burn_root=burns[1],
        )

    def mode_updated(
        self,
        motion: Dynamics,
        mean: FloatArray,
        root: FloatArray,
        time_s: float,
        measurements: AngleMeasurements,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return means and roots of one mode after measurements of all tracks, and log likelihoods
        (n,).
        """
        mode = Mode(motion, mean, root)
        (after,) = iterated_update.updated([mode], time_s, measurements, self.rounds)
        return after.mean, after.root, iterated_update.log_likelihoods(mode, after)

    def predicted_measurements(
        self, estimates: ModeEstimates, time_s: float
    ) -> PredictedMeasurements:
        """Return the predictions about the estimates' time, by the likelier mode of each track."""
        coasts = estimates.weight[:, 1] > estimates.weight[:, 0]
        boost, coast = _modes_of(estimates)
        count = np.count_nonzero(coasts)
        if not count:
            return PredictedMeasurements(time_s, *_taylor_and_root(self.boost, *boost))
        if count == len(coasts):
            return PredictedMeasurements(time_s, *_taylor_and_root(self.coast, *coast))
        derivative = np.empty((len(estimates), 5, 3))
        side = np.empty((len(estimates), BOOST, BOOST))
        derivative[coasts], side[coasts] = _taylor_and_root(
            self.coast, coast[0][coasts], coast[1][coasts]
        )
        derivative[~coasts], side[~coasts] = _taylor_and_root(
            self.boost, boost[0][~coasts], boost[1][~coasts]
        )
        return PredictedMeasurements(time_s, derivative, side)

    def moments(self, estimates: ModeEstimates) -> tuple[FloatArray, FloatArray]:
        """Return mean (n, 6) and covariance (n, 6, 6) of inertial position and velocity, over both
        modes.
        """
        open_ = estimates.weight[:, 1:] >= (EXCLUDED_WEIGHT if self.least_open_weight else 0.0)
        if not np.count_nonzero(open_):
            side = square_root.inverse_root(estimates.boost_root)[:, :COAST]
            return estimates.boost_mean[:, :COAST], square_root.gram(side)
        weight = np.where(open_, estimates.weight, _BURNS)
        boost = weight[:, :1]
        coast = weight[:, 1:]
        apart = estimates.boost_mean[:, :COAST] - estimates.coast_mean
        width = estimates.boost_mean.shape[1]
        side = np.empty((len(apart), COAST, width + COAST + 1))
        share = np.sqrt(weight)[:, :, None, None]
        np.multiply(
            square_root.inverse_root(estimates.boost_root)[:, :COAST],
            share[:, 0],
            out=side[:, :, :width],
        )
        np.multiply(
            square_root.inverse_root(estimates.coast_root), share[:, 1], out=side[:, :, width:-1]
        )
        np.multiply(apart, np.sqrt(boost * coast), out=side[:, :, -1])
        return boost * estimates.boost_mean[
            :, :COAST
        ] + coast * estimates.coast_mean, square_root.gram(side)


#: Time after the last detection, s, in which a force may act unseen.
RESIDUAL_S = 5.0

_BURNS = np.array([1.0, 0.0])
_NONE = np.empty(0, dtype=np.int64)


def _modes_of(
    estimates: ModeEstimates,
) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]:
    """Return means and roots of boost and coast."""
    return (estimates.boost_mean, estimates.boost_root), (
        estimates.coast_mean,
        estimates.coast_root,
    )


def _in_use(estimates: ModeEstimates) -> tuple[bool, bool]:
    """Return whether any track may be in boost, and in coast."""
    boost, coast = (
        estimates.weight[0]
        if len(estimates.weight) == 1
        else np.maximum.reduce(estimates.weight, axis=0)
    ).tolist()
    return boost > 0.0, coast > 0.0


def _mode(motion: Dynamics, mean: FloatArray, root: FloatArray, rows: IntArray | None) -> Mode:
    return Mode(motion, mean, root) if rows is None else Mode(motion, mean[rows], root[rows])


def _rows(some: BoolArray) -> IntArray | None:
    """Return the rows of a mask, None for all."""
    return None if np.count_nonzero(some) == len(some) else some.nonzero()[0]


def _of_rows(
    measurements: AngleMeasurements, some: BoolArray, rows: IntArray | None
) -> AngleMeasurements:
    """Return the measurements of some rows (a mask, and its rows or None), renumbered."""
    if rows is None:
        return measurements
    mine = measurements.part(np.flatnonzero(some[measurements.track]))
    return mine.with_track((np.cumsum(some) - 1)[mine.track])


def _with_rows(
    whole: tuple[FloatArray, FloatArray], part: tuple[FloatArray, FloatArray], rows: IntArray | None
) -> tuple[FloatArray, FloatArray]:
    """Return means and roots with some rows replaced."""
    if rows is None:
        return part
    mean = whole[0].copy()
    root = whole[1].copy()
    mean[rows], root[rows] = part
    return mean, root


def _taylor_and_root(
    motion: Dynamics, mean: FloatArray, root: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return position derivatives (n, 5, 3) and covariance roots (n, 12, 12) of the first four."""
    return motion.taylor(mean), motion.derivative_roots(mean, square_root.inverse_root(root))
