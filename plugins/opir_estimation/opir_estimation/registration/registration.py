"""The estimated errors of a tracker's sensors at a time: they correct lines of sight, shift states
and widen covariances.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_estimation.filter.estimates import ModeEstimates
from opir_estimation.gating import GatedPairs
from opir_estimation.lines_of_sight import LinesOfSight, least_sigma_rad
from opir_estimation.registration.agreement import Agreement
from opir_estimation.registration.error_filter import LAW, ErrorFilter, Moments
from opir_estimation.registration.innovations import (
    SensorInnovations,
    TrackInnovations,
    stated_squares,
)
from opir_estimation.registration.misfits import MeanResiduals, mean_residuals, misfits
from opir_estimation.registration.noise_scales import (
    NoiseScales,
    innovation_log_likelihood,
    scatter_log_likelihood,
)
from opir_estimation.registration.shared_errors import ERRORS, Vantages, corrected


class _Innovations(NamedTuple):
    """Pairs (m,) with their sensors, whose lines a registration corrected."""

    pairs: GatedPairs
    sensor: IntArray
    before: "Registration"


@frozen(eq=False)
class Registration:
    """The filter of the sensors' shared errors, and the estimates that correct lines of sight.

    `known` are the reported and corrected errors, `wide` includes improbable scales; `apart_rad`
    (s,) is the standard deviation that the errors leave between the sensors that see a target,
    `noise` (s,) the scale of their noise, of which `scales` has the probabilities, and `most_noise`
    (s,) the largest one since they were as stated. `agreement` is how often they see what others
    see. `period_s` (s,) are their scan periods; `compared_s` is the time of the last comparison,
    `is_doubted` whether it spoke against sensors that are as stated without certainty. `waiting` are
    the innovations since the noise was judged by some, at `judged_s`.
    """

    errors: ErrorFilter
    known: Moments
    wide: Moments
    apart_rad: FloatArray
    noise: FloatArray
    most_noise: FloatArray
    scales: NoiseScales
    innovations: SensorInnovations
    tracks: TrackInnovations
    agreement: Agreement
    period_s: FloatArray
    time_s: float = 0.0
    compared_s: float = -np.inf
    is_doubted: bool = False
    waiting: tuple[_Innovations, ...] = ()
    judged_s: float = -np.inf

    @classmethod
    def of(cls, errors: ErrorFilter, period_s: FloatArray) -> "Registration":
        """Return the registration before the first look."""
        reported = errors.reported()
        apart_rad = _angle_sigmas(reported)
        sensors = len(apart_rad)
        return cls(
            errors,
            reported,
            errors.moments(),
            apart_rad,
            np.ones(sensors),
            np.ones(sensors),
            NoiseScales.of(sensors),
            SensorInnovations.of(sensors),
            TrackInnovations.begun(np.empty(0, dtype=np.int64), sensors),
            Agreement.of(sensors),
            period_s,
        )

    @cached_property
    def widens_gates(self) -> bool:
        """Whether the uncertainty of the errors counts in gates."""
        return self.is_comparable and bool(self._of_gates.covariance.any())

    @cached_property
    def corrects(self) -> bool:
        """Whether lines of sight are corrected."""
        has_shift = self.known.mean.any() or self.apart_rad.any()
        return bool(has_shift or (self.noise != 1.0).any())

    @cached_property
    def has_outliers(self) -> bool:
        """Whether tracks explain looks as outliers."""
        return bool(self.tracks.explained.sum() > LAW.explained_looks)

    @cached_property
    def has_errors(self) -> bool:
        """Whether errors are uncertain."""
        return bool(self.known.covariance.any())

    @property
    def reported(self) -> Moments:
        """The reported moments: where targets were compared, with improbable scales too."""
        return self.wide if self.errors.comparisons else self.known

    @property
    def is_comparable(self) -> bool:
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
        if not self.is_comparable:
            return _angle_sigmas(self.known)
        return LAW.loose * _angle_sigmas(self.wide)

    def corrected(self, lines: LinesOfSight) -> LinesOfSight:
        """Return lines of sight less the estimated errors, with the deviation of the remaining
        ones.
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
        if not self.corrects:
            return sigma_rad
        return (
            np.sqrt(np.square(sigma_rad) - np.square(self.apart_rad[sensor])) / self.noise[sensor]
        )

    def after_explained(
        self, pairs: GatedPairs, sensor: IntArray, before: "Registration"
    ) -> "Registration":
        """Return the registration after looks beyond the gate (m,), by sensor, which count as noise
        of sensors whose looks within it show more noise than stated; else they are outliers.

        Their lines were corrected with the registration of `before`.
        """
        rows = (self.noise[sensor] > 1.0).nonzero()[0]
        if not rows.size:
            return self
        return self._judged([_Innovations(pairs.take(rows), sensor[rows], before)])

    def after_few_looks(
        self, pairs: GatedPairs, sensor: IntArray, before: "Registration", tracks: int
    ) -> "Registration":
        """Return the registration after the innovations of those of a slice's pairs (m,) of which a
        sensor has few looks on a track, if there are few tracks; `before` as in `after_explained`.

        They wait for those of later slices, but of slow sensors: one alone may be an outlier.
        """
        group = pairs.track * self.noise.size + sensor
        few = (np.bincount(group)[group] <= LAW.few_looks).nonzero()[0]
        if not few.size or tracks > LAW.many_tracks:
            return self
        if few.size < len(sensor):
            pairs = pairs.take(few)
            sensor = sensor[few]
        waiting = [*self.waiting, _Innovations(pairs, sensor, before)]
        begun_s = max(waiting[0].pairs.time_s[0], self.judged_s)
        is_early = pairs.time_s[-1] < begun_s + LAW.judged_s > begun_s + self.period_s.max()
        if is_early:
            return evolve(self, waiting=tuple(waiting))
        return evolve(self._judged(waiting), waiting=(), judged_s=float(pairs.time_s[-1]))

    def _judged(self, innovations: Sequence[_Innovations]) -> "Registration":
        sensor = np.concatenate([part.sensor for part in innovations])
        stated_rad, noise = np.hstack([_stated_noise(part) for part in innovations])
        pairs = GatedPairs.concatenate([part.pairs for part in innovations])
        least = np.square(least_sigma_rad(pairs.origin_m))
        stated = np.square(stated_rad)
        assumed = np.square(noise) * stated
        log_likelihood = innovation_log_likelihood(pairs, stated, assumed, least)
        return self._with_scales(self.scales.after(sensor, *log_likelihood))

    def _with_scales(self, scales: NoiseScales) -> "Registration":
        noise = scales.believed
        most_noise = np.where(noise > 1.0, np.maximum(noise, self.most_noise), 1.0)
        return evolve(self, scales=scales, noise=noise, most_noise=most_noise)

    def widening(self, before: "Registration", is_seen: BoolArray) -> FloatArray | None:
        """Return the factors (n,) of the deviations of tracks whose looks had the noise of `before`,
        None where no noise is more; `is_seen` (n, s) as in `gate_covariance`.

        What one sensor does not see, as the range, does not owe to its looks.
        """
        factor = self.most_noise / before.most_noise
        if not (factor > 1.0).any():
            return None
        square = np.where(is_seen, np.square(np.maximum(factor, 1.0)), 0.0)
        sensors = is_seen.sum(axis=1)
        mean = square.sum(axis=1) / np.maximum(sensors, 1)
        return np.where(sensors > 1, np.sqrt(mean), 1.0)

    @property
    def _of_gates(self) -> Moments:
        return self.wide if self.errors.comparisons < LAW.few_comparisons else self.known

    def is_due(self, time_s: float, tracks: int) -> bool:
        """Whether looks are compared at a time.

        Those of few tracks are now and then, once sensors are as stated, and those of many once
        they have been often.
        """
        since_s = time_s - self.compared_s
        if self.errors.comparisons >= LAW.many_comparisons and tracks > LAW.many_tracks:
            return bool(since_s >= min(LAW.again_s, tracks / LAW.many_tracks) - 1e-6)
        has_news = self.is_doubted or self.widens_gates or self.corrects or self.has_outliers
        is_open = self.is_comparable and self.errors.weight[0] < LAW.settled
        again_s = LAW.open_s if is_open else LAW.again_s
        return bool(tracks > LAW.few_tracks or has_news or since_s >= again_s)

    def counted(
        self, time_s: float, number: IntArray, track: IntArray, sensor: IntArray
    ) -> "Registration":
        """Return the registration after looks (m,) of rows of tracks `number` (n,) that are not
        compared.
        """
        later = self.at(time_s)
        return evolve(later, tracks=later.tracks.of(number).after(track, sensor))

    def gate_covariance(
        self, state: FloatArray, is_seen: BoolArray, vantages: Vantages
    ) -> FloatArray:
        """Return the covariances (n, s, 3, 3), m², of positions of tracks as each sensor sees them,
        due to all errors.

        `state` (n, 6) is inertial; `is_seen` (n, s) marks the sensors whose looks the track is made
        of.
        """
        relative = _relative_shifts(state, is_seen, vantages)
        return relative @ self._of_gates.covariance @ relative.mT

    def covariance(self, state: FloatArray, is_seen: BoolArray, vantages: Vantages) -> FloatArray:
        """Return the covariances (n, 6, 6) of inertial states (n, 9) with accelerations due to all
        errors.
        """
        shift = state_shifts(state, is_seen, vantages)
        return shift @ self.known.covariance @ shift.mT

    def at(self, time_s: float) -> "Registration":
        """Return the registration at a later time."""
        step_s = time_s - self.time_s
        return evolve(
            self,
            errors=self.errors.predicted(step_s),
            scales=self.scales.at(step_s),
            innovations=self.innovations.faded(step_s),
            tracks=self.tracks.faded(step_s, self.period_s),
            agreement=self.agreement.faded(step_s),
            time_s=time_s,
        )


def _stated_noise(part: _Innovations) -> tuple[FloatArray, FloatArray]:
    """Return the stated errors (m,), rad, of innovations, and the scales (m,) that were assumed."""
    stated_rad = part.before.stated_rad(part.pairs.sigma_rad, part.sensor)
    return stated_rad, part.before.noise[part.sensor]


def _angle_sigmas(errors: Moments) -> FloatArray:
    """Return the standard deviations (s,) of each sensor's angles, root mean square of both."""
    variance = np.diagonal(errors.covariance).reshape(-1, ERRORS)
    return np.sqrt(0.5 * variance[:, :2].sum(axis=1))


def state_shifts(state: FloatArray, is_seen: BoolArray, vantages: Vantages) -> FloatArray:
    """Return the shifts (n, 6, q) of positions and velocities of inertial states (n, 9) with
    accelerations, by all errors of 1 rad and 1 s.

    Those of velocities are differences over a second of flight.
    """
    position_m, velocity_m_s, acceleration_m_s2 = state[:, :3], state[:, 3:6], state[:, 6:]
    shift = vantages.shifts(position_m, velocity_m_s, is_seen)
    later_m_s = velocity_m_s + acceleration_m_s2
    later_shift = vantages.shifts(position_m + velocity_m_s, later_m_s, is_seen)
    return np.concatenate([shift, later_shift - shift], axis=1)


def _relative_shifts(state: FloatArray, is_seen: BoolArray, vantages: Vantages) -> FloatArray:
    """Return the shifts (n, s, 3, q) of each sensor's view relative to the track, by all errors of
    1 rad and 1 s.
    """
    count, sensors = is_seen.shape
    displacement = vantages.displacements(state[:, :3], state[:, 3:6])
    shift = vantages.shifts(state[:, :3], state[:, 3:6], is_seen)
    relative = np.repeat(-shift[:, None], sensors, axis=1)
    relative = relative.reshape(count, sensors, 3, sensors, ERRORS)
    sensor = np.arange(sensors)
    relative[:, sensor, :, sensor] += displacement.transpose(1, 0, 2, 3)
    return relative.reshape(count, sensors, 3, ERRORS * sensors)


class Followed(NamedTuple):
    """Tracks (n,) whose looks are compared: numbers, inertial states (n, 9) with accelerations,
    deviations of speeds, and visibility.

    `speed_m_s` (n,) is the standard deviation of the speed, `is_seen` (n, s) marks the sensors
    that saw them.
    """

    number: IntArray
    state: FloatArray
    speed_m_s: FloatArray
    is_seen: BoolArray

    @classmethod
    def of(
        cls,
        number: IntArray,
        moments: tuple[FloatArray, FloatArray],
        acceleration_m_s2: FloatArray,
        is_seen: BoolArray,
    ) -> "Followed":
        """Return tracks with moments (n, 6) and (n, 6, 6), and accelerations (n, 3)."""
        state, covariance = moments
        speed_m_s = np.sqrt(np.trace(covariance[:, 3:, 3:], axis1=1, axis2=2))
        return cls(number, np.hstack([state, acceleration_m_s2]), speed_m_s, is_seen)


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
    least_rad = least_sigma_rad(vantages.origin_m)
    registration = _with_innovations(before, assigned, sensor, tracks, means, least_rad)
    if not before.is_comparable:
        return registration
    position_m = tracks.state[:, :3]
    information = misfits(means, position_m, tracks.state[:, 3:6], tracks.speed_m_s, vantages)
    if not len(information.track):
        return registration
    errors = before.errors.updated(information.about(before.known.mean))
    known = errors.reported()
    apart_rad = _apart(known, tracks, vantages)
    wide = errors.moments()
    stated = errors.weight[0]
    return evolve(
        registration,
        errors=errors,
        known=known,
        wide=wide,
        apart_rad=apart_rad,
        is_doubted=bool(stated < min(before.errors.weight[0], LAW.settled)),
    )


def _with_innovations(
    registration: Registration,
    assigned: GatedPairs,
    sensor: IntArray,
    tracks: Followed,
    means: MeanResiduals,
    least_rad: FloatArray,
) -> Registration:
    """Return the registration with the innovations and the scatter of pairs (m,), of sensors with
    least errors (s,).
    """
    square = stated_squares(assigned, registration.stated_rad(assigned.sigma_rad, sensor))
    stated_rad = registration.stated_rad(means.look_rad, means.sensor)
    innovations = registration.innovations.after(square, sensor)
    sums = registration.tracks.of(tracks.number).after(assigned.track, sensor)
    registration = evolve(registration, innovations=innovations, tracks=sums)
    if not means.degrees.any():
        return registration
    variance = np.square(stated_rad)
    least = np.square(least_rad[means.sensor]) / variance
    scatter = means.scatter_rad2 / variance
    log_likelihood = scatter_log_likelihood(scatter, means.degrees, least)
    scales = registration.scales.after(means.sensor, log_likelihood, means.degrees)
    return registration._with_scales(scales)


def _apart(errors: Moments, tracks: Followed, vantages: Vantages) -> FloatArray:
    """Return the largest deviations (s,), rad, that the errors leave between a sensor and the
    others, over tracks.
    """
    if not errors.covariance.any():
        return np.zeros(tracks.is_seen.shape[1])
    rows = (tracks.is_seen.sum(axis=1) > 1).nonzero()[0]
    is_seen = tracks.is_seen[rows]
    relative = _relative_shifts(tracks.state[rows], is_seen, vantages)
    spread = relative @ errors.covariance @ relative.mT
    line = tracks.state[rows, None, :3] - vantages.origin_m
    variance = np.where(is_seen, _angle_variances(line, spread), 0.0)
    return np.sqrt(np.max(variance, axis=0, initial=0.0))


def _angle_variances(line: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the variances (n, s), rad², across lines (n, s, 3) of positions with covariances (n,
    s, 3, 3), mean of both axes.
    """
    square = np.sum(line * line, axis=2)
    along = np.sum(line * (spread @ line[..., None])[..., 0], axis=2) / square
    across = np.trace(spread, axis1=2, axis2=3) - along
    return 0.5 * across / square


def shifted(
    estimates: ModeEstimates, change: FloatArray, tracks: Followed, vantages: Vantages
) -> ModeEstimates:
    """Return estimates (n,) after a change (q,) of the errors that were taken off their lines of
    sight.
    """
    if not len(estimates) or not change.any():
        return estimates
    shift = state_shifts(tracks.state, tracks.is_seen, vantages) @ change
    return estimates.moved_by(-shift)
