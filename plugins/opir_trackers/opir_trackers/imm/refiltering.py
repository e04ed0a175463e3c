"""States anew from a kept stretch of directions, where a pairing has changed.

The stretch starts from a wide prior about a cubic through the crossings of its directions; a track
that began within the stretch starts as any new track does. From there it is filtered in steps to
the present.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, SPEED_OF_LIGHT_M_S
from opir_core.estimation import COAST
from opir_trackers.association import hard_measurements
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import gated
from opir_trackers.initiation import TrackCandidates
from opir_trackers.lines_of_sight import LinesOfSight, earth_rotated
from opir_trackers.pairing import Directions, intersections
from opir_trackers.track_priors import prior_estimates
from opir_trackers.triangulation import FAR_M

#: Length of a step of the stretch, s: its directions move little off the Taylor series of the path.
_STEP_S = 2.0

#: Standard deviations of position, m, velocity, m/s, and force, m/s², about the cubic at the start
#: of the stretch.
_PLACE_M = 3e3
_SPEED_M_S = 300.0
_FORCE_M_S2 = 20.0

#: A track whose first line came within this time before its stretch, s, begins there.
_FRESH_S = 5.0

#: Instants that a cubic needs; else the track starts as a new one.
_LEAST_INSTANTS = 8

#: A gate that all directions pass.
_EVERY = 1e9


def refiltered(
    filter_: ImmFilter,
    config: ImmConfig,
    directions: Directions,
    track: IntArray,
    sums: FloatArray,
    centre: FloatArray,
    before: ModeEstimates,
    begun_s: FloatArray,
    now_s: float,
    light_time: bool,
) -> ModeEstimates:
    """Return the estimates at `now_s` of tracks (n,) from their kept directions.

    `track` (m,) is that of each direction; `sums` (n, instants, 12) are the tracks' normal
    equations about `centre`; `before` are the old estimates, of which the mode probabilities and
    rates stay; `begun_s` (n,) the first detections.
    """
    instants = np.unique(directions.time_s)
    place = intersections(sums) + centre
    there = sums[..., 11] > 1.5
    first_s = instants[np.argmax(there, axis=1)]
    prior = _Priors(place, there, instants, first_s, begun_s, config, light_time)
    awake = float(instants[0]) - _STEP_S
    estimates = before
    for end_s in [*np.arange(awake + _STEP_S, now_s - 1e-6, _STEP_S).tolist(), now_s]:
        step_s = end_s - awake
        mine = np.flatnonzero((directions.time_s > awake) & (directions.time_s <= end_s))
        estimates = filter_.predicted_open(estimates, step_s)
        enter = np.flatnonzero((first_s > awake) & (first_s <= end_s))
        if len(enter):
            estimates = estimates.put(enter, prior.at(enter, end_s))
        # What has not entered is not looked at.
        mine = mine[first_s[track[mine]] <= end_s]
        path = filter_.predicted_measurements(estimates, end_s)
        pairs = gated(
            path,
            _lines(directions.take(mine)),
            track[mine],
            np.arange(len(mine)),
            _EVERY,
            light_time,
        )
        estimates = filter_.updated(estimates, end_s, hard_measurements(pairs), step_s)
        awake = end_s
    return evolve(estimates, weight=before.weight, detection_rate=before.detection_rate)


def _lines(directions: Directions) -> LinesOfSight:
    """Return kept directions as lines of sight."""
    scan = np.arange(len(directions))
    return LinesOfSight(
        directions.time_s,
        directions.sensor.astype(np.int32),
        scan,
        directions.origin_ecef_m,
        directions.direction_ecef,
        directions.sigma_rad,
    )


class _Priors(NamedTuple):
    """What tracks (n,) at places (n, instants, 3), in ECEF, where `there` (n, instants), start
    from.
    """

    place: FloatArray
    there: BoolArray
    instants: FloatArray
    first_s: FloatArray
    begun_s: FloatArray
    config: ImmConfig
    light_time: bool

    def at(self, rows: IntArray, time_s: float) -> ModeEstimates:
        """Return the prior of tracks `rows` at a time."""
        first = np.argmax(self.there[rows], axis=1)
        begins = TrackCandidates(self.place[rows, first], self.first_s[rows], np.full(len(rows), 2))
        estimates = prior_estimates(begins, time_s, self.config)
        emitted_s = self.instants - FAR_M / SPEED_OF_LIGHT_M_S * self.light_time
        old = self.begun_s[rows] < self.first_s[rows] - _FRESH_S
        for number in np.flatnonzero(
            (self.there[rows].sum(axis=1) >= _LEAST_INSTANTS) & old
        ).tolist():
            used = np.flatnonzero(self.there[rows[number]])
            path = earth_rotated(self.place[rows[number], used], emitted_s[used])
            powers = np.vander(emitted_s[used] - time_s, 4, increasing=True)
            fit = np.linalg.lstsq(powers, path, rcond=None)[0].astype(np.float64)
            one = np.array([number])
            estimates = estimates.put(
                one, _about(fit.astype(np.float64, copy=False), estimates.take(one))
            )
        return estimates


def _about(fit: FloatArray, prior: ModeEstimates) -> ModeEstimates:
    """Return the prior of one track about a cubic (4, 3) of the time since."""
    place = fit[0]
    force = 2.0 * fit[2] + EARTH_MU_M3_S2 * place / np.sqrt(place @ place) ** 3
    mean = prior.boost_mean.copy()
    mean[0, :3] = place
    mean[0, 3:6] = fit[1]
    mean[0, 6:9] = force
    sigma = np.append(
        np.repeat([_PLACE_M, _SPEED_M_S, _FORCE_M_S2], 3), 1.0 / prior.boost_root[0, -1, -1]
    )
    root = np.diag(1.0 / sigma)[None]
    return ModeEstimates(
        prior.weight,
        mean,
        root,
        mean[:, :COAST].copy(),
        root[:, :COAST, :COAST].copy(),
        prior.detection_rate,
    )
