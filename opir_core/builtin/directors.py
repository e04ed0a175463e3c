"""The directors `round-robin` and `cue`."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.builtin.director_models import CueConfig, RoundRobinConfig
from opir_core.geometry import geodetic_to_ecef
from opir_core.interfaces.directors import Command, Director, DirectorContext, Situation
from opir_core.interfaces.records import Tracks


class RoundRobin(Director):
    """Points every sensor at one place after the other, those out of its reach left out."""

    def __init__(self, config: RoundRobinConfig) -> None:
        self._config = config
        lat_rad, lon_rad = np.radians(config.places_deg).T
        self._places_m = geodetic_to_ecef(lat_rad, lon_rad, 0.0)
        self._turn = 0

    @property
    def interval_s(self) -> float:
        """Time from one place to the next, s."""
        return self._config.dwell_s

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return a command to the next place for each sensor that reaches one."""
        commands = []
        for sensor in situation.sensors:
            places = np.flatnonzero(situation.in_reach(sensor.id, self._places_m))
            if len(places):
                place = int(places[self._turn % len(places)])
                position_m = self._places_m[place]
                reason = f"place {place + 1} in turn"
                commands.append(
                    Command(sensor=sensor.id, position_ecef_m=position_m, reason=reason)
                )
        self._turn += 1
        return commands


class Cue(Director):
    """Points sensors at tracks: each at one that no other sensor follows, as far as there are such.

    A sensor keeps its track for `dwell_s`, and as long as no track waits. The least known position
    comes first. A track that leaves the reach of its sensor is handed over to one that sees it.
    """

    def __init__(self, config: CueConfig) -> None:
        self._config = config
        #: By sensor the track that it follows and the time since when.
        self._followed: dict[str, tuple[int, float]] = {}

    @property
    def interval_s(self) -> float:
        """Time between decisions, s."""
        return self._config.interval_s

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return a command for each sensor that has a track to follow."""
        tracks = self._worth_a_look(situation.tracks)
        if not len(tracks):
            return []
        position_m = _position_at(tracks, situation.time_s)
        reach = {
            sensor.id: situation.in_reach(sensor.id, position_m) for sensor in situation.sensors
        }
        free = self._kept(tracks, situation.time_s, reach)
        order = np.argsort(-_variance_m2(tracks), kind="stable")
        for sensor in free:
            row = self._next_row(tracks, order[reach[sensor][order]])
            if row is not None:
                self._followed[sensor] = int(tracks.track[row]), situation.time_s
        rows = {int(track): row for row, track in enumerate(tracks.track.tolist())}
        return [
            Command(
                sensor=sensor,
                position_ecef_m=position_m[rows[track]],
                velocity_m_s=tracks.state[rows[track], 3:],
                track=track,
                reason=f"track {track} since {since_s:g} s",
            )
            for sensor, (track, since_s) in self._followed.items()
        ]

    def _worth_a_look(self, tracks: Tracks) -> Tracks:
        """Return the rows of tracks with a state that go on and may be launches."""
        has_state = np.isfinite(tracks.state).all(axis=1) & (tracks.end == 0)
        # A tracker that does not weigh launches says nan.
        may_be = ~(tracks.probability_launch < self._config.least_probability_launch)
        return tracks.take(np.flatnonzero(has_state & may_be))

    def _kept(self, tracks: Tracks, time_s: float, reach: dict[str, BoolArray]) -> list[str]:
        """Forget tracks that are gone, out of reach or had their time; return the sensors that are
        free.
        """
        numbers = tracks.track.tolist()
        waiting = set(numbers).difference(track for track, _ in self._followed.values())
        for sensor, (track, since_s) in list(self._followed.items()):
            is_seen = track in numbers and reach[sensor][numbers.index(track)]
            had_its_time = time_s - since_s >= self._config.dwell_s and waiting
            if not is_seen or had_its_time:
                del self._followed[sensor]
        return [sensor for sensor in reach if sensor not in self._followed]

    def _next_row(self, tracks: Tracks, rows: IntArray) -> int | None:
        """Return the first of some rows whose track the fewest sensors follow; None without any."""
        if not len(rows):
            return None
        followed = [track for track, _ in self._followed.values()]
        counts = [followed.count(int(tracks.track[row])) for row in rows]
        return int(rows[int(np.argmin(counts))])


def _position_at(tracks: Tracks, time_s: float) -> FloatArray:
    """Return the positions (n, 3) of tracks, ECEF, m, at a time, if they move evenly."""
    since_s = (time_s - tracks.tick_s)[:, None]
    return tracks.state[:, :3] + tracks.state[:, 3:] * since_s


def _variance_m2(tracks: Tracks) -> FloatArray:
    """Return the variances (n,) of positions."""
    diagonal = np.diagonal(tracks.state_covariance, axis1=1, axis2=2)
    return np.nan_to_num(diagonal[:, :3].sum(axis=1), nan=np.inf)


def round_robin(config: RoundRobinConfig, _context: DirectorContext) -> RoundRobin:
    """Return the director `round-robin`."""
    return RoundRobin(config)


def cue(config: CueConfig, _context: DirectorContext) -> Cue:
    """Return the director `cue`."""
    return Cue(config)
