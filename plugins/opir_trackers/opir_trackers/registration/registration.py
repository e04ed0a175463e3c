"""What a tracker knows of its sensors at a time: it corrects lines of sight, shifts states and
widens covariances.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import COAST
from opir_core.plugin import Sensor
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.gating import GatedPairs
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.registration.error_filter import ErrorFilter, Moments
from opir_trackers.registration.innovations import (
    SensorInnovations,
    TrackInnovations,
    stated_squares,
)
from opir_trackers.registration.misfits import MeanResiduals, mean_residuals, misfits
from opir_trackers.registration.shared_errors import ERRORS, Vantages, corrected

#: Comparisons of a target's looks before gates rely on what is found.
_FEW = 15

#: Up to this number of tracks, sensors that are as stated are compared now and then; with more,
#: each track shows another combination.
_LONE = 3

#: Comparisons of targets after which they are made less often, and the least number of them a
#: second. Errors and noise change over a minute.
_OFTEN = 600
_MANY = 20

#: Looks that tracks explain as outliers, from which all looks are counted.
_SOME = 0.5

#: Sensors that are as stated are compared again after this time, s: innovations and noise have a
#: memory of 60 s.
_AGAIN_S = 5.0


@frozen(eq=False)
class Registration:
    """The filter of the sensors' shared errors, and what of it is taken off lines of sight.

    `known` is what is reported and taken off, `wide` includes improbable scales; `apart_rad` (s,)
    is the standard deviation of what the errors leave between the sensors that see a target,
    `noise` (s,) the scale of their noise. `period_s` (s,) are their scan periods; `compared_s` is
    the time of the last comparison.
    """

    errors: ErrorFilter
    known: Moments
    wide: Moments
    apart_rad: FloatArray
    noise: FloatArray
    innovations: SensorInnovations
    tracks: TrackInnovations
    period_s: FloatArray
    time_s: float = 0.0
    compared_s: float = -np.inf
    #: Whether what is not known of the errors counts in gates, and whether anything is taken off
    #: lines of sight.
    widens_gates: bool = field(
        default=Factory(
            lambda own: own.several and bool(own._of_gates.covariance.any()), takes_self=True
        ),
        init=False,
    )
    corrects: bool = field(
        default=Factory(
            lambda own: bool(
                own.known.mean.any() or own.apart_rad.any() or own.noise.max(initial=1.0) > 1.0
            ),
            takes_self=True,
        ),
        init=False,
    )
    has_outliers: bool = field(
        default=Factory(lambda own: bool(own.tracks.explained.sum() > _SOME), takes_self=True),
        init=False,
    )
    has_errors: bool = field(
        default=Factory(lambda own: bool(own.known.covariance.any()), takes_self=True), init=False
    )

    @classmethod
    def of(cls, errors: ErrorFilter, period_s: FloatArray) -> "Registration":
        """Return the registration before the first look."""
        known = errors.reported()
        wide = errors.moments()
        apart_rad = _angle_sigmas(known)
        none = np.empty(0, dtype=np.int64)
        sensors = len(apart_rad)
        sums = SensorInnovations.of(sensors), TrackInnovations.fresh(none, sensors)
        return cls(errors, known, wide, apart_rad, np.ones(sensors), *sums, period_s)

    @property
    def reported(self) -> Moments:
        """What is reported: where targets were compared, with improbable scales too."""
        return self.wide if self.errors.used else self.known

    @property
    def several(self) -> bool:
        """Whether there are sensors that may be compared."""
        return len(self.apart_rad) > 1

    @property
    def error(self) -> FloatArray:
        """The errors (s, 3) that are taken off lines of sight."""
        return self.known.mean.reshape(-1, ERRORS)

    @property
    def loose_rad(self) -> FloatArray:
        """Standard deviations (s,) of the errors at the initiation of tracks, which large errors
        must not stop.
        """
        return _LOOSE * _angle_sigmas(self.wide) if self.several else _angle_sigmas(self.known)

    def corrected(self, lines: LinesOfSight) -> LinesOfSight:
        """Return lines of sight without the errors that are known, and with the deviation of what
        is not.
        """
        if not self.corrects:
            return lines
        if self.known.mean.any():
            lines = corrected(lines, self.error)
        sigma_rad = np.hypot(
            self.noise[lines.sensor] * lines.sigma_rad, self.apart_rad[lines.sensor]
        )
        return evolve(lines, sigma_rad=sigma_rad)

    def stated_rad(self, sigma_rad: FloatArray, sensor: IntArray) -> FloatArray:
        """Return the stated errors (m,) of lines that `corrected` gave errors (m,), by sensor."""
        stated: FloatArray = (
            np.sqrt(np.square(sigma_rad) - np.square(self.apart_rad[sensor])) / self.noise[sensor]
        )
        return stated

    @property
    def _of_gates(self) -> Moments:
        return self.wide if self.errors.used < _FEW else self.known

    def is_due(self, time_s: float, tracks: int) -> bool:
        """Whether looks are compared at a time.

        Those of few tracks are now and then, once sensors are as stated, and those of many once
        they have been often.
        """
        since_s = time_s - self.compared_s
        if self.errors.used >= _OFTEN and tracks > _MANY:
            return since_s >= min(_AGAIN_S, tracks / _MANY) - 1e-6
        always = tracks > _LONE or self.widens_gates or self.corrects or self.has_outliers
        return always or since_s >= _AGAIN_S

    def counted(
        self, time_s: float, number: IntArray, track: IntArray, sensor: IntArray
    ) -> "Registration":
        """Return the registration after looks (m,) of rows of tracks `number` (n,) that are not
        compared.
        """
        now = self.at(time_s)
        return evolve(now, tracks=now.tracks.of(number).after(track, sensor))

    def gate_covariance(self, state: FloatArray, seen: BoolArray, vantages: Vantages) -> FloatArray:
        """Return the covariances (n, s, 3, 3), m², of what each sensor sees about where a track is,
        due to all errors.

        `state` (n, 6) is inertial; `seen` (n, s) marks the sensors whose looks the track is made
        of.
        """
        own = _own_less_shift(state, seen, vantages)
        return np.asarray(own @ self._of_gates.covariance @ own.transpose(0, 1, 3, 2))

    def covariance(self, state: FloatArray, seen: BoolArray, vantages: Vantages) -> FloatArray:
        """Return the covariances (n, 6, 6) of inertial states (n, 6) due to all errors."""
        shift = state_shifts(state, seen, vantages)
        return np.asarray(shift @ self.known.covariance @ shift.transpose(0, 2, 1))

    def at(self, time_s: float) -> "Registration":
        """Return the registration at a later time."""
        step_s = time_s - self.time_s
        later = self.innovations.faded(step_s), self.tracks.faded(step_s, self.period_s)
        return evolve(
            self,
            errors=self.errors.predicted(step_s),
            innovations=later[0],
            tracks=later[1],
            time_s=time_s,
        )


_LOOSE = 2.0


def _angle_sigmas(known: Moments) -> FloatArray:
    """Return the standard deviations (s,) of each sensor's angles, root mean square of both."""
    variance = np.diagonal(known.covariance).reshape(-1, ERRORS)
    return np.asarray(np.sqrt(0.5 * variance[:, :2].sum(axis=1)))


def state_shifts(state: FloatArray, seen: BoolArray, vantages: Vantages) -> FloatArray:
    """Return the shifts (n, 6, q) of inertial states (n, 6) by all errors of 1 rad and 1 s.

    Those of velocities are differences over a second of flight.
    """
    here = vantages.shifts(state[:, :3], state[:, 3:], seen)
    then = vantages.shifts(state[:, :3] + state[:, 3:], state[:, 3:], seen)
    return np.concatenate([here, then - here], axis=1)


def _own_less_shift(state: FloatArray, seen: BoolArray, vantages: Vantages) -> FloatArray:
    """Return what each sensor sees less where the track is (n, s, 3, q), by all errors of 1 rad and
    1 s.
    """
    count, sensors = seen.shape
    own = vantages.displacements(state[:, :3], state[:, 3:])
    shift = vantages.shifts(state[:, :3], state[:, 3:], seen)
    out = np.repeat(-shift[:, None], sensors, axis=1).reshape(count, sensors, 3, sensors, ERRORS)
    which = np.arange(sensors)
    out[:, which, :, which] += own.transpose(1, 0, 2, 3)
    return out.reshape(count, sensors, 3, ERRORS * sensors)


def registration_of(config: ImmConfig, sensors: Sequence[Sensor]) -> Registration:
    """Return the registration of a scene's sensors before the first look."""
    stated = np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors])
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    errors = ErrorFilter.of(stated, config.clock_sigma_s, config.bias_correlation_s)
    return Registration.of(errors, period_s)


class Followed(NamedTuple):
    """Tracks (n,) whose looks are compared: numbers, inertial states (n, 6), deviations of speeds,
    and visibility.

    `speed_m_s` (n,) is the standard deviation of the speed, `seen` (n, s) marks the sensors that
    saw them.
    """

    number: IntArray
    state: FloatArray
    speed_m_s: FloatArray
    seen: BoolArray

    @classmethod
    def of(
        cls, number: IntArray, moments: tuple[FloatArray, FloatArray], seen: BoolArray
    ) -> "Followed":
        """Return tracks with moments (n, 6) and (n, 6, 6)."""
        state, covariance = moments
        return cls(number, state, np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2)), seen)


def registered(
    before: Registration,
    assigned: GatedPairs,
    sensor: IntArray,
    tracks: Followed,
    vantages: Vantages,
) -> Registration:
    """Return the registration after a slice's assigned pairs (m,), by `sensor` (m,), of tracks
    (n,).
    """
    if not len(assigned):
        return before
    means = mean_residuals(assigned, sensor, len(before.apart_rad))
    after = _with_innovations(before, assigned, sensor, tracks, means)
    if not before.several:
        return after
    found = misfits(means, tracks.state[:, :3], tracks.state[:, 3:], tracks.speed_m_s, vantages)
    if not len(found.track):
        return after
    errors = before.errors.updated(found.about(before.known.mean))
    after = evolve(after, errors=errors, known=errors.reported(), wide=errors.moments())
    return evolve(after, apart_rad=_apart(after, tracks, vantages))


def _with_innovations(
    before: Registration,
    assigned: GatedPairs,
    sensor: IntArray,
    tracks: Followed,
    means: MeanResiduals,
) -> Registration:
    """Return the registration with the innovations and the scatter of pairs (m,)."""
    square = stated_squares(assigned, before.stated_rad(assigned.sigma_rad, sensor))
    stated_rad = before.stated_rad(means.look_rad, means.sensor)
    innovations = before.innovations.after(square, sensor, means, stated_rad)
    mine = before.tracks.of(tracks.number).after(assigned.track, sensor)
    return evolve(before, innovations=innovations, tracks=mine, noise=innovations.believed_scale)


def _apart(now: Registration, tracks: Followed, vantages: Vantages) -> FloatArray:
    """Return the largest deviations (s,), rad, that the errors leave between a sensor and the
    others, over tracks.
    """
    rows = np.flatnonzero(tracks.seen.sum(axis=1) > 1)
    if not now.known.covariance.any():
        return np.zeros_like(now.apart_rad)
    own = _own_less_shift(tracks.state[rows], tracks.seen[rows], vantages)
    left = own @ now.known.covariance @ own.transpose(0, 1, 3, 2)
    off = tracks.state[rows, None, :3] - vantages.origin_m
    square = np.sum(off * off, axis=2)
    along = np.sum(off * (left @ off[..., None])[..., 0], axis=2) / square
    across = np.trace(left, axis1=2, axis2=3) - along
    return np.asarray(
        np.sqrt(
            np.max(np.where(tracks.seen[rows], 0.5 * across / square, 0.0), axis=0, initial=0.0)
        )
    )


def shifted(
    estimates: ModeEstimates, change: FloatArray, tracks: Followed, vantages: Vantages
) -> ModeEstimates:
    """Return estimates (n,) after a change (q,) of the errors that are taken off the lines that
    they were made of.
    """
    if not len(estimates) or not change.any():
        return estimates
    moved = state_shifts(tracks.state, tracks.seen, vantages) @ change
    boost = estimates.boost_mean.copy()
    coast = estimates.coast_mean - moved
    burn = estimates.burn_mean.copy()
    boost[:, :COAST] -= moved
    burn[:, :, :COAST] -= moved[:, None]
    return evolve(estimates, boost_mean=boost, coast_mean=coast, burn_mean=burn)
