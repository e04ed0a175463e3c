"""The tracker `boost-profile`: association by the stereo filter, estimates by the fit of boost profiles."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from attrs import evolve, frozen

from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry import geodetic_to_ecef
from opir_core.protocols import Sensor, TrackerContext
from opir_core.records import Detections, FloatArray, IntArray, Tracks
from opir_core.scene import TARGET_TYPES
from opir_core.tracking import profile_fit as fit
from opir_core.tracking import profile_hypotheses as hypotheses_of
from opir_core.tracking.profile_family import CLASS_TYPE, CLASSES, SIZE, TURN_NORTH, Anchors, Shapes
from opir_core.tracking.profile_fit import Hypotheses
from opir_core.tracking.profile_hypotheses import HEADINGS
from opir_core.tracking.profile_report import report
from opir_core.tracking.profile_rows import Rows, averaged, single
from opir_core.tracking.rays import Rays
from opir_core.tracking.stereo_tracker import StereoTracker

if TYPE_CHECKING:
    from opir_core.builtin.configs import BoostProfileConfig
    from opir_core.flight.forces import ForceModel

#: Ticks of a track at which its hypotheses are reviewed: linearised anew, row by row.
_REVIEWS = frozenset({1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 63, 79, 100, 126, 158, 200, 251, 316})

#: Steps of Gauss and Newton in a review.
_REVIEW_STEPS = 4

#: Where the direction of the turn is less well known than this, a fit is tried from several headings, rad.
_KNOWN_HEADING_RAD = 0.3

#: Silence as improbable as e to this, were the target still burning, ends the burn.
_SILENCE_LOG = -12.0

#: The chance below which a class is given up.
_GIVEN_UP = 1e-6

#: The tick of a track at which earlier rays that belong to no track are claimed, and within how many deviations.
_CLAIM_TICK = 3
_CLAIM_SIGMA = 4.5
_POOL_S = 20.0


@frozen(eq=False)
class Watch:
    """What the sensors of a scene are to the fit: scan periods, chances of detection by type, and biases."""

    period_s: FloatArray
    chance: FloatArray
    bias_sigma_rad: FloatArray

    @classmethod
    def of(cls, sensors: Sequence[Sensor]) -> "Watch":
        """Return the watch of a scene's sensors."""
        chances = [[sensor.detection_probability.get(kind, 0.5) for kind in TARGET_TYPES] for sensor in sensors]
        return cls(
            period_s=np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors]),
            chance=np.clip(np.array(chances, dtype=np.float64).reshape(len(sensors), len(TARGET_TYPES)), 0.02, 0.999),
            bias_sigma_rad=np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors]),
        )


class ProfileTracker:
    """The tracker `boost-profile`."""

    def __init__(self, config: "BoostProfileConfig", context: TrackerContext, inner: StereoTracker) -> None:
        self.cadence_s: float | None = config.cadence_s
        self._inner = inner
        self._watch = Watch.of(context.sensors)
        self._forces: ForceModel = context.forces
        self._light_time = context.light_time
        self._rows = Rows.empty()
        self._pool: list[Rays] = []
        self._last_s: dict[int, FloatArray] = {}
        self._ticks: dict[int, int] = {}
        self._hypotheses = hypotheses_of.blank(0, len(context.sensors))

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, judged by the tracks as of the last tick; changes nothing."""
        return self._inner.associate(detections)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Take in the detections since the last tick and return the estimates at this one."""
        followed = self._inner.step(tick_s, detections)
        mine = np.flatnonzero(detections.track >= 0)
        rows = averaged(detections.track[mine], Rays.of(detections.take(mine)))
        self._remember(rows, detections, mine)
        self._forget(followed.track, tick_s)
        self._begin(followed.track)
        self._update(rows, tick_s)
        return self._told(followed, tick_s)

    def _remember(self, rows: Rows, detections: Detections, mine: IntArray) -> None:
        self._rows = Rows.concatenate([self._rows, rows])
        free = np.setdiff1d(np.arange(len(detections)), mine)
        if len(free):
            self._pool.append(Rays.of(detections.take(free)))
        for number in np.unique(detections.track[mine]).tolist():
            last = self._last_s.setdefault(number, np.full(len(self._watch.period_s), -np.inf))
            part = np.flatnonzero(detections.track == number)
            np.maximum.at(last, detections.sensor[part], detections.time_s[part])

    def _forget(self, followed: IntArray, tick_s: float) -> None:
        """Let go of what belongs to tracks that are no longer followed, and of old rays that belong to none."""
        self._pool = [rays for rays in self._pool if rays.time_s[-1] > tick_s - _POOL_S]
        gone = set(self._ticks) - set(followed.tolist())
        if not gone:
            return
        dropped = np.array(sorted(gone))
        self._hypotheses = self._hypotheses.take(~np.isin(self._hypotheses.track, dropped))
        self._rows = self._rows.take(~np.isin(self._rows.track, dropped))
        for number in gone:
            del self._ticks[number]
            self._last_s.pop(number, None)

    def _begin(self, followed: IntArray) -> None:
        """Begin hypotheses of every class for tracks that are new and have rows."""
        fresh = [number for number in followed.tolist() if number not in self._ticks and number in self._last_s]
        begun = [self._first(number) for number in fresh]
        self._ticks.update(dict.fromkeys(fresh, 0))
        self._hypotheses = Hypotheses.concatenate([self._hypotheses, *begun])

    def _first(self, number: int) -> Hypotheses:
        row = self._rows.take(np.flatnonzero(self._rows.track == number)[:1])
        position = hypotheses_of.on_the_ground(row.origin_ecef_m[0], row.axes[0, 2])
        travel_s = np.linalg.norm(position - row.origin_ecef_m[0]) / SPEED_OF_LIGHT_M_S if self._light_time else 0.0
        start_s = row.time_s - 1.0 - travel_s
        anchors = Anchors.at(position[None], start_s).take(np.zeros(len(CLASSES), dtype=np.int64))
        count, sensors = len(CLASSES), len(self._watch.period_s)
        parameters = np.zeros((count, SIZE))
        parameters[:, TURN_NORTH] = Shapes.of(np.arange(count)).turn_rad
        blank = hypotheses_of.blank(count, sensors)
        return evolve(
            blank,
            track=np.full(count, number),
            kind=np.arange(count),
            anchor_latitude_rad=anchors.latitude_rad,
            anchor_longitude_rad=anchors.longitude_rad,
            anchor_s=anchors.time_s,
            parameters=parameters,
            log_prior=np.full(count, -np.log(len(TARGET_TYPES))) - np.log(np.bincount(CLASS_TYPE)[CLASS_TYPE]),
        )

    def _update(self, rows: Rows, tick_s: float) -> None:
        for number in self._ticks:
            self._ticks[number] += 1
        if not len(self._hypotheses):
            return
        self._mark_ends(tick_s)
        ticks = np.array([self._ticks[number] for number in self._hypotheses.track.tolist()])
        due = np.isin(ticks, list(_REVIEWS))
        fresh = np.isin(self._hypotheses.track, rows.track)
        review = np.flatnonzero(due & (fresh | (ticks <= 1)))
        others = np.flatnonzero(~due | ~(fresh | (ticks <= 1)))
        kept = self._added(self._hypotheses.take(others), rows)
        claiming = np.unique(self._hypotheses.track[ticks == _CLAIM_TICK])
        seen = self._reviewed(self._hypotheses.take(review))
        if len(claiming) and self._claim(seen.take(np.isin(seen.track, claiming))):
            seen = self._reviewed(seen)
        every = Hypotheses.concatenate([kept, seen])
        every = every.take(np.lexsort((every.kind, every.track)))
        self._hypotheses = every.take(hypotheses_of.probability(every) > _GIVEN_UP)

    def _added(self, hypotheses: Hypotheses, rows: Rows) -> Hypotheses:
        """Return the hypotheses with this tick's rows, each linearised where its hypothesis stands."""
        chosen, owner = hypotheses_of.joined(hypotheses.track, rows.track)
        hypotheses = fit.with_rows(hypotheses, rows.take(chosen), owner, self._light_time)
        return fit.moved(hypotheses) if len(hypotheses) else hypotheses

    def _reviewed(self, hypotheses: Hypotheses) -> Hypotheses:
        """Return the hypotheses with all their rows linearised anew, from several headings where none is known."""
        if not len(hypotheses):
            return hypotheses
        unsure = hypotheses_of.heading_sigma(hypotheses) > _KNOWN_HEADING_RAD
        copies = np.concatenate([np.flatnonzero(~unsure), *(np.flatnonzero(unsure) for _ in range(HEADINGS + 1))])
        trial = hypotheses.take(copies)
        turned = np.repeat(np.arange(-1, HEADINGS), int(unsure.sum()))
        headings = np.concatenate([np.full(int((~unsure).sum()), -1), turned])
        trial = evolve(trial, parameters=hypotheses_of.with_heading(trial, headings))
        rows, owner = hypotheses_of.joined(trial.track, self._rows.track)
        part = self._rows.take(rows)
        for _ in range(_REVIEW_STEPS):
            trial = fit.moved(fit.with_rows(trial.cleared(), part, owner, self._light_time))
        trial = fit.with_rows(trial.cleared(), part, owner, self._light_time)
        evidence = np.nan_to_num(fit.log_evidence(trial), nan=-np.inf)
        order = np.lexsort((-evidence, copies))
        best = order[np.append(True, np.diff(copies[order]) != 0)]
        return trial.take(best)

    def _claim(self, hypotheses: Hypotheses) -> bool:
        """Give early rays that belong to no track to tracks that explain them; return whether there were any."""
        if not self._pool or not len(hypotheses):
            return False
        likely = hypotheses_of.likeliest(hypotheses)
        pool = Rays.concatenate(self._pool)
        owner = np.full(len(pool), -1, dtype=np.int64)
        nearest = np.full(len(pool), _CLAIM_SIGMA**2)
        spread = fit.covariance(likely, self._watch.bias_sigma_rad)
        for place in range(len(likely)):
            rows = single(int(likely.track[place]), pool)
            mine = np.full(len(pool), place)
            expected, slope = fit.linearised(likely, rows, mine, self._light_time)
            total = slope @ spread[place] @ slope.transpose(0, 2, 1)
            total = total + np.square(rows.sigma_rad)[:, None, None] * np.eye(2)
            distance = np.sum(expected * np.linalg.solve(total, expected[:, :, None])[:, :, 0], axis=1)
            closer = distance < nearest
            owner[closer], nearest[closer] = likely.track[place], distance[closer]
        taken = np.flatnonzero(owner >= 0)
        self._rows = Rows.concatenate([self._rows, averaged(owner[taken], pool.take(taken))])
        left = pool.take(np.flatnonzero(owner < 0))
        self._pool = [left] if len(left) else []
        return bool(len(taken))

    def _mark_ends(self, tick_s: float) -> None:
        """Note the last light of tracks, and the end where a burning target would hardly have been missed so often."""
        hypotheses, watch = self._hypotheses, self._watch
        last = np.stack([self._last_s[number] for number in hypotheses.track.tolist()])
        chance = watch.chance[:, CLASS_TYPE[hypotheses.kind]].T
        known = np.isfinite(last)
        silent = np.maximum(np.floor((tick_s - np.where(known, last, tick_s)) / watch.period_s), 0.0)
        ended = np.where(known, silent * np.log1p(-chance), 0.0).sum(axis=1) < _SILENCE_LOG
        travel_s = self._travel_s(hypotheses)
        emitted = np.where(known, last - travel_s, np.nan)
        after = watch.period_s * (1.0 / chance - 0.5)
        sigma = watch.period_s * np.sqrt((1.0 - chance) / chance**2 + 1.0 / 12.0)
        # A sensor that lost sight of the target earlier than the others says nothing of its end.
        recent = emitted > np.nanmax(emitted, axis=1)[:, None] - 8.0 * sigma
        self._hypotheses = evolve(
            hypotheses,
            end_s=np.where(ended[:, None] & recent, emitted + after, np.nan),
            end_sigma_s=np.broadcast_to(sigma, emitted.shape).copy(),
            last_s=np.nanmax(emitted, axis=1),
        )

    def _travel_s(self, hypotheses: Hypotheses) -> FloatArray:
        """Return how long light takes from tracks to sensors, (n, sensors), s, by each pair's last row."""
        travel = np.zeros((len(hypotheses), len(self._watch.period_s)))
        if not self._light_time:
            return travel
        ground = geodetic_to_ecef(*hypotheses.anchors.places(hypotheses.parameters), 0.0)
        origin = {
            (track, sensor): where
            for track, sensor, where in zip(
                self._rows.track.tolist(), self._rows.sensor.tolist(), self._rows.origin_ecef_m, strict=True
            )
        }
        for row, track in enumerate(hypotheses.track.tolist()):
            for sensor in range(travel.shape[1]):
                where = origin.get((track, sensor))
                if where is not None:
                    travel[row, sensor] = np.linalg.norm(where - ground[row]) / SPEED_OF_LIGHT_M_S
        return travel

    def _told(self, followed: Tracks, tick_s: float) -> Tracks:
        """Return the estimates of all tracks with a fit; of the others, what the stereo filter tells."""
        ready = self._hypotheses
        if not len(ready):
            return followed
        told = report(ready, hypotheses_of.probability(ready), tick_s, self._watch.bias_sigma_rad, self._forces)
        sound = np.isfinite(told.state).all(axis=1) & np.isfinite(told.state_covariance).all(axis=(1, 2))
        told = told.take(sound)
        rest = followed.take(~np.isin(followed.track, told.track))
        every = Tracks.concatenate([told, rest])
        return every.take(np.argsort(every.track, kind="stable"))


def boost_profile_tracker(config: "BoostProfileConfig", context: TrackerContext) -> ProfileTracker:
    """Return the tracker `boost-profile`."""
    from opir_core.builtin.configs import StereoFilterConfig
    from opir_core.tracking.stereo_tracker import stereo_filter

    following = StereoFilterConfig(cadence_s=config.cadence_s, association=config.association)
    return ProfileTracker(config, context, stereo_filter(following, context))
