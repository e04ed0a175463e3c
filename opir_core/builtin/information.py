"""The director `information`: each sensor to the track of which its next looks tell most."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.builtin.director_models import InformationConfig
from opir_core.builtin.directors import position_at, require_mode, tracks_to_follow
from opir_core.geometry import dot
from opir_core.geometry.vectors import angle_between_rad
from opir_core.interfaces.directors import Command, Director, DirectorContext, Situation
from opir_core.interfaces.records import Tracks
from opir_core.interfaces.sensors import Pointing, Sensor

#: Standard deviations of a track that states none: it is worth a look.
_UNKNOWN_M = 1e5
_UNKNOWN_M_S = 3e3
#: Least standard deviation of a line of sight, rad: a look of an exact one tells a finite amount.
_FINEST_RAD = 1e-8


class Information(Director):
    """Gives sensors their tracks greedily: the pair first whose looks shrink the expected covariance
    most, given those of the pairs before it.

    The gain is that of half the log determinant of the state's covariance, in nats, weighed by
    P(launch). The covariance is the tracker's, predicted to the decision. Looks are those of
    `horizon_s` after the turn, evenly spread; a standing bias of lines of sight is not averaged.
    Of the modes that it may choose, a sensor gets that whose looks tell most.
    """

    needs_detections: bool = False

    def __init__(self, config: InformationConfig) -> None:
        self._config = config
        #: By sensor the last command that it was given, and when.
        self._last: dict[str, tuple[Command, float]] = {}

    @property
    def interval_s(self) -> float:
        """Time between decisions, s."""
        return self._config.interval_s

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return a command for each sensor whose looks tell something."""
        for record in situation.refused:
            self._last.pop(record.sensor, None)
        tracks = tracks_to_follow(situation.tracks, self._config.least_probability_launch)
        if not len(tracks):
            return []
        position_m = position_at(tracks, situation.time_s)
        options = [
            (number, mode)
            for number, sensor in enumerate(situation.sensors)
            for mode in [name for name in self._config.modes if name in sensor.modes] or [""]
        ]
        looks = np.stack(
            [
                self._look_information(situation.sensors[number], mode, situation, tracks)
                for number, mode in options
            ]
        )
        covariance = expected_covariance(
            tracks, situation.time_s, self._config.acceleration_density_m2_s3
        )
        prior = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        weights = np.nan_to_num(tracks.probability_launch, nan=1.0)
        commands = []
        owner = np.array([number for number, _ in options])
        for option, row, gain in greedy_pairs(prior, looks, weights, owner):
            number, mode = options[option]
            track = int(tracks.track[row])
            command = Command(
                sensor=situation.sensors[number].id,
                position_ecef_m=position_m[row],
                velocity_m_s=tracks.state[row, 3:],
                track=track,
                reason=f"track {track}: {gain:.2f} nats in {self._config.horizon_s:g} s",
                mode=mode,
            )
            self._last[command.sensor] = command, situation.time_s
            commands.append(command)
        return commands

    def _look_information(
        self, sensor: Sensor, mode: str, situation: Situation, tracks: Tracks
    ) -> FloatArray:
        """Return the information (n, 6, 6) on the states of tracks at the decision of a sensor's
        looks at each, in a mode.
        """
        horizon_s = self._config.horizon_s
        position_m = position_at(tracks, situation.time_s)
        velocity_m_s = tracks.state[:, 3:]
        looking = sensor.modes.get(mode, sensor)
        now = situation.in_reach(sensor.id, position_m)
        later = situation.in_reach(sensor.id, position_m + velocity_m_s * horizon_s, horizon_s)
        times_s = situation.time_s + np.array([0.0, 0.5 * horizon_s])
        sensor_m, middle_sensor_m = sensor.orbit.position_ecef_m(times_s)
        start_s = self._turn_s(sensor, mode, situation.time_s, position_m, sensor_m)
        end_s = np.maximum(horizon_s, start_s + self._config.interval_s)
        # Who is in reach at one end alone is so for half of the time.
        share = 0.5 * (now + 1.0 * later) * now * _mean_probability(looking)
        looks = share * (end_s - start_s) / (looking.scan.period_ns * 1e-9)
        middle_m = position_m + velocity_m_s * (0.5 * horizon_s)
        across = _across_line(middle_m - middle_sensor_m, looks, looking)
        mean_s = 0.5 * (start_s + end_s)
        mean_square_s2 = (start_s * start_s + start_s * end_s + end_s * end_s) / 3.0
        of_velocity = across * mean_s[:, None, None]
        return np.block(
            [[across, of_velocity], [of_velocity, across * mean_square_s2[:, None, None]]]
        )

    def _turn_s(
        self,
        sensor: Sensor,
        mode: str,
        time_s: float,
        position_m: FloatArray,
        sensor_m: FloatArray,
    ) -> FloatArray:
        """Return the times (n,) until a sensor would look at positions (n, 3) in a mode, 0 in its
        field if it is in that mode.
        """
        pointing = sensor.modes.get(mode, sensor).pointing
        assert pointing is not None
        angle_rad = angle_between_rad(
            position_m - sensor_m, self._aim(sensor.id, pointing, time_s, sensor_m)
        )
        turn_s = pointing.delay_s + angle_rad / pointing.slew_rad_s + pointing.settle_s
        changes = sensor.id not in self._last or self._last[sensor.id][0].mode != mode
        turns = (angle_rad > pointing.half_angle_rad) | (changes and bool(mode))
        return np.where(turns, turn_s, 0.0)

    def _aim(
        self, sensor: str, pointing: Pointing, time_s: float, sensor_m: FloatArray
    ) -> FloatArray:
        """Return the direction (3,) of a sensor's field."""
        if sensor in self._last:
            command, since_s = self._last[sensor]
            assert command.position_ecef_m is not None
            moved_m = command.velocity_m_s * (time_s - since_s)
            return command.position_ecef_m + moved_m - sensor_m
        return -sensor_m if pointing.at_ecef_m is None else pointing.at_ecef_m - sensor_m


def greedy_pairs(
    prior: FloatArray, looks: FloatArray, weights: FloatArray, owner: IntArray | None = None
) -> Sequence[tuple[int, int, float]]:
    """Return row of `looks`, track and gain of each pair, nats, in the order of choice; at most one
    pair a sensor.

    `prior` (n, d, d) is the information on each track, `looks` (m, n, d, d) what each of m sensors,
    or of its modes, would add, `weights` (n,) are factors of the gains. `owner` (m,) are the
    numbers of the sensors; by default each row is one.
    """
    owners = np.arange(len(looks)) if owner is None else owner
    known = prior.copy()
    gains = np.stack([_gain(known, of_sensor) for of_sensor in looks]) * weights
    pairs = []
    for _ in range(len(looks)):
        number, row = np.unravel_index(int(np.argmax(gains)), gains.shape)
        gain = float(gains[number, row])
        if not gain > 0.0:
            break
        pairs.append((int(number), int(row), gain))
        known[row] += looks[number, row]
        gains[:, row] = np.where(
            np.isneginf(gains[:, row]), -np.inf, _gain(known[row], looks[:, row]) * weights[row]
        )
        gains[owners == owners[number]] = -np.inf
    return pairs


def _gain(known: FloatArray, more: FloatArray) -> FloatArray:
    """Return the gains (n,) of information (n, d, d) or (d, d) by more (n, d, d), nats."""
    after = np.linalg.slogdet(known + more)[1]
    return np.nan_to_num(0.5 * (after - np.linalg.slogdet(known)[1]), nan=0.0)


def expected_covariance(tracks: Tracks, time_s: float, density_m2_s3: float) -> FloatArray:
    """Return the covariances (n, 6, 6) of tracks at a time, if the velocity walks at random with a
    density.
    """
    unknown = np.diag([_UNKNOWN_M**2] * 3 + [_UNKNOWN_M_S**2] * 3)
    total = tracks.state_covariance.sum(axis=(1, 2), keepdims=True)
    covariance = np.where(np.isfinite(total), tracks.state_covariance, unknown)
    since_s = (time_s - tracks.tick_s)[:, None, None]
    of_place = covariance[:, :3, :3]
    cross = covariance[:, :3, 3:]
    of_velocity = covariance[:, 3:, 3:]
    noise = density_m2_s3 * np.eye(3) * np.abs(since_s)
    later_cross = cross + of_velocity * since_s + 0.5 * noise * since_s
    later_place = (
        of_place
        + (cross + cross.mT) * since_s
        + of_velocity * since_s * since_s
        + noise * since_s * since_s / 3.0
    )
    return np.block([[later_place, later_cross], [later_cross.mT, of_velocity + noise]])


def _across_line(line_m: FloatArray, looks: FloatArray, sensor: Sensor) -> FloatArray:
    """Return the information (n, 3, 3) on positions of looks (n,) along lines (n, 3), 1/m²."""
    square_m2 = dot(line_m, line_m)
    variance = sensor.line_of_sight_bias_sigma_rad**2 + np.divide(
        max(sensor.line_of_sight_sigma_rad, _FINEST_RAD) ** 2,
        looks,
        out=np.full(len(looks), np.inf),
        where=looks > 0.0,
    )
    along = line_m[:, :, None] * line_m[:, None, :] / square_m2[:, None, None]
    return (np.eye(3) - along) / (variance * square_m2)[:, None, None]


def _mean_probability(sensor: Sensor) -> float:
    """Return the mean of the probabilities of detection by type; 1 where a light model decides."""
    return float(np.mean([*sensor.detection_probability.values()] or [1.0]))


def information(config: InformationConfig, context: DirectorContext) -> Information:
    """Return the director `information`; raises `SceneError` if no sensor has one of its modes."""
    for mode in config.modes:
        require_mode("modes", mode, context)
    return Information(config)
