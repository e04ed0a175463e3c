"""The directors `operator`, `round-robin` and `cue`."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.builtin.director_models import CueConfig, RoundRobinConfig
from opir_core.errors import Problem, SceneError, nearest
from opir_core.geometry import geodetic_to_ecef
from opir_core.host.components import NoConfig
from opir_core.interfaces.directors import Command, Director, DirectorContext, Situation
from opir_core.interfaces.records import Tracks
from opir_core.interfaces.sensors import Sensor


class Operator(Director):
    """Leaves all sensors to the tasks of an operator; those that follow a track are pointed anew each
    second.
    """

    needs_detections: bool = False

    @property
    def interval_s(self) -> float:
        """Time between decisions, s."""
        return 1.0

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return no command."""
        return []


class RoundRobin(Director):
    """Points every sensor at one place after the other, those out of its reach left out."""

    needs_detections: bool = False

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
                mode = _mode_in(sensor, self._config.mode)
                commands.append(
                    Command(sensor=sensor.id, position_ecef_m=position_m, reason=reason, mode=mode)
                )
        self._turn += 1
        return commands


class Cue(Director):
    """Points sensors at tracks: each at one that no other sensor follows, as far as there are such.

    A track waits while no sensor follows it that will still see it in `hand_over_s`: another one,
    which will, then follows it beside the first until that has lost it. The least known position
    comes first. A sensor keeps its track for `dwell_s`, and as long as no track in its reach waits;
    one that follows a track beside another sensor goes at once to one that waits.

    Narrow fields to spare follow tracks beside other sensors. A wide field does not, as it surveys
    more without a track. Sensors without a track go into `search_mode`, if that is given and theirs;
    others stay as they are.
    """

    needs_detections: bool = False

    def __init__(self, config: CueConfig) -> None:
        self._config = config
        #: The sensors that were commanded into `search_mode` since they followed a track.
        self._searching: set[str] = set()
        #: By sensor the track that it follows and the time since when.
        self._followed: dict[str, tuple[int, float]] = {}

    @property
    def interval_s(self) -> float:
        """Time between decisions, s."""
        return self._config.interval_s

    def commands(self, situation: Situation) -> Sequence[Command]:
        """Return a command for each sensor that has a track to follow, or begins to search."""
        followed = self._following(situation)
        self._searching.difference_update(record.sensor for record in situation.refused)
        self._searching.difference_update(command.sensor for command in followed)
        busy = self._searching.union(command.sensor for command in followed)
        searches = [
            Command(sensor=sensor.id, mode=self._config.search_mode, reason="no track")
            for sensor in situation.sensors
            if sensor.id not in busy and _mode_in(sensor, self._config.search_mode)
        ]
        self._searching.update(command.sensor for command in searches)
        return [*followed, *searches]

    def _following(self, situation: Situation) -> Sequence[Command]:
        """Return a command for each sensor that has a track to follow."""
        tracks = tracks_to_follow(situation.tracks, self._config.least_probability_launch)
        if not len(tracks):
            return []
        sight = _Sight.of(situation, tracks, self._config.hand_over_s)
        order = np.argsort(-_variance_m2(tracks), kind="stable")
        for sensor in self._free(situation.time_s, sight):
            row = self._next_row(sight, sensor, order[sight.lasting[sensor][order]])
            if row is not None:
                self._followed[sensor] = sight.tracks[row], situation.time_s
        position_m = position_at(tracks, situation.time_s)
        rows = {track: row for row, track in enumerate(sight.tracks)}
        sensors = {sensor.id: sensor for sensor in situation.sensors}
        return [
            Command(
                sensor=sensor,
                position_ecef_m=position_m[rows[track]],
                velocity_m_s=tracks.state[rows[track], 3:],
                track=track,
                reason=f"track {track} since {since_s:g} s",
                mode=_mode_in(sensors[sensor], self._config.mode),
            )
            for sensor, (track, since_s) in self._followed.items()
        ]

    def _free(self, time_s: float, sight: "_Sight") -> list[str]:
        """Release sensors whose track is gone or out of reach, that a waiting track needs, or whose
        wide field can survey; return all that follow no track.
        """
        waiting = set(sight.tracks).difference(self._lasting_tracks(sight))
        for sensor, (track, since_s) in list(self._followed.items()):
            had_its_time = time_s - since_s >= self._config.dwell_s
            reached = [
                other
                for other in sorted(waiting.difference([track]))
                if sight.has(sight.lasting, sensor, other)
            ]
            is_double = self._lasting_tracks(sight).count(track) > 1
            is_needed = bool(reached) and (is_double or had_its_time)
            surveys = is_double and had_its_time and sensor in sight.wide
            if is_needed or surveys or not sight.has(sight.now, sensor, track):
                del self._followed[sensor]
            if is_double:
                # Of those beside another sensor one goes to each track that waits.
                waiting.difference_update(reached[:1])
        return [sensor for sensor in sight.now if sensor not in self._followed]

    def _lasting_tracks(self, sight: "_Sight") -> list[int]:
        """Return the track of each sensor that goes on seeing it."""
        return [
            track
            for sensor, (track, _) in self._followed.items()
            if sight.has(sight.lasting, sensor, track)
        ]

    def _next_row(self, sight: "_Sight", sensor: str, rows: IntArray) -> int | None:
        """Return the first of some rows whose track the fewest sensors follow; None without any
        that is worth this sensor.
        """
        followed = self._lasting_tracks(sight)
        counts = [followed.count(sight.tracks[row]) for row in rows.tolist()]
        if not counts or (min(counts) and sensor in sight.wide):
            return None
        return int(rows[int(np.argmin(counts))])


@frozen(eq=False)
class _Sight:
    """Which tracks, by number, each sensor can be pointed at: now, and still after a while; the
    narrow fields come first.

    `wide` are the sensors that see their whole field of regard unless they are in a mode.
    """

    tracks: list[int]
    now: dict[str, BoolArray]
    lasting: dict[str, BoolArray]
    wide: frozenset[str]

    @classmethod
    def of(cls, situation: Situation, tracks: Tracks, after_s: float) -> "_Sight":
        position_m = position_at(tracks, situation.time_s)
        later_m = position_at(tracks, situation.time_s + after_s)
        sensors = sorted(situation.sensors, key=lambda sensor: not sensor.is_narrow)
        ids = [sensor.id for sensor in sensors]
        wide = frozenset(sensor.id for sensor in sensors if not sensor.is_narrow)
        now = {sensor: situation.in_reach(sensor, position_m) for sensor in ids}
        lasting = {
            sensor: now[sensor] & situation.in_reach(sensor, later_m, after_s) for sensor in ids
        }
        return cls(tracks.track.tolist(), now, lasting, wide)

    def has(self, reach: dict[str, BoolArray], sensor: str, track: int) -> bool:
        return track in self.tracks and bool(reach[sensor][self.tracks.index(track)])


def tracks_to_follow(tracks: Tracks, least_probability_launch: float) -> Tracks:
    """Return the rows of tracks with a state that go on and may be launches."""
    has_state = np.isfinite(tracks.state).all(axis=1) & (tracks.end == 0)
    # A tracker that does not weigh launches says nan.
    may_be = ~(tracks.probability_launch < least_probability_launch)
    return tracks.take(np.flatnonzero(has_state & may_be))


def position_at(tracks: Tracks, time_s: float) -> FloatArray:
    """Return the positions (n, 3) of tracks, ECEF, m, at a time, if they move evenly."""
    since_s = (time_s - tracks.tick_s)[:, None]
    return tracks.state[:, :3] + tracks.state[:, 3:] * since_s


def _variance_m2(tracks: Tracks) -> FloatArray:
    """Return the variances (n,) of positions."""
    diagonal = np.diagonal(tracks.state_covariance, axis1=1, axis2=2)
    return np.nan_to_num(diagonal[:, :3].sum(axis=1), nan=np.inf)


def _mode_in(sensor: Sensor, mode: str) -> str:
    """Return a mode that a sensor has, "" for another one."""
    return mode if mode in sensor.modes else ""


def require_mode(setting: str, mode: str, context: DirectorContext) -> None:
    """Raise `SceneError` if no sensor has the mode of a setting."""
    known = {name for sensor in context.sensors for name in sensor.modes}
    if mode and mode not in known:
        words = f"no sensor has the mode {mode!r}{nearest(mode, known)}"
        raise SceneError([Problem(setting, words)])


def operator(_config: NoConfig, _context: DirectorContext) -> Operator:
    """Return the director `operator`."""
    return Operator()


def round_robin(config: RoundRobinConfig, context: DirectorContext) -> RoundRobin:
    """Return the director `round-robin`; raises `SceneError` if no sensor has its mode."""
    require_mode("mode", config.mode, context)
    return RoundRobin(config)


def cue(config: CueConfig, context: DirectorContext) -> Cue:
    """Return the director `cue`; raises `SceneError` if no sensor has one of its modes."""
    require_mode("mode", config.mode, context)
    require_mode("search_mode", config.search_mode, context)
    return Cue(config)
