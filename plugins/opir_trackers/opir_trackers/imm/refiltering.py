"""States anew from a kept stretch of directions, where a pairing has changed.

The stretch starts from a wide prior about a cubic through the crossings of its directions; a track
that began within the stretch starts as any new track does. From there it is filtered in steps to
the present.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import (
    COAST,
    FAR_M,
    Gaussian,
    ImmFilter,
    LinesOfSight,
    ModeEstimates,
    earth_rotated,
    gated,
)

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, SPEED_OF_LIGHT_M_S
from opir_trackers.association import hard_measurements
from opir_trackers.configs import ImmConfig
from opir_trackers.initiation import TrackCandidates
from opir_trackers.pairing import Directions, intersections
from opir_trackers.track_priors import prior_estimates


@frozen
class RefilteringLaw:
    """How a stretch of directions is filtered."""

    #: Length of a step of the stretch, s: its directions move little off the Taylor series of the
    #: path.
    step_s: float = 2.0

    #: Standard deviations of position, m, velocity, m/s, and force, m/s², about the cubic at the
    #: start of the stretch.
    sigmas: tuple[float, float, float] = (3e3, 300.0, 20.0)

    #: A track whose first line came within this time before its stretch, s, begins there.
    young_s: float = 5.0

    #: Instants that a cubic needs; else the track starts as a new one.
    least_instants: int = 8

    #: A gate that all directions pass.
    gate: float = 1e9


LAW = RefilteringLaw()


class Refiltering(NamedTuple):
    """The filter, whether light takes time, and the settings of the tracker."""

    filter: ImmFilter
    light_time: bool
    config: ImmConfig


class DirectionSums(NamedTuple):
    """Normal equations (n, instants, 12) of tracks' directions about a point `centre` (3,)."""

    sums: FloatArray
    centre: FloatArray


def refiltered(
    models: Refiltering,
    directions: Directions,
    track: IntArray,
    crossings: DirectionSums,
    estimates_before: ModeEstimates,
    begun_s: FloatArray,
    now_s: float,
) -> ModeEstimates:
    """Return the estimates at `now_s` of tracks (n,) from their kept directions.

    `track` (m,) is that of each direction; of `estimates_before` the mode probabilities and rates
    stay; `begun_s` (n,) are the first detections.
    """
    prior = _Priors.of(models, np.unique(directions.time_s), crossings, begun_s)
    start_s = float(prior.instants[0]) - LAW.step_s
    estimates = estimates_before
    ends_s = np.arange(start_s + LAW.step_s, now_s - 1e-6, LAW.step_s).tolist()
    for end_s in [*ends_s, now_s]:
        estimates = models.filter.predicted_open(estimates, end_s - start_s)
        entering = np.flatnonzero((prior.first_s > start_s) & (prior.first_s <= end_s))
        if len(entering):
            estimates = estimates.put(entering, prior.at(entering, end_s))
        is_due = (directions.time_s > start_s) & (directions.time_s <= end_s)
        # Tracks that have not entered have no looks.
        rows = np.flatnonzero(is_due & (prior.first_s[track] <= end_s))
        path = models.filter.predicted_measurements(estimates, end_s)
        lines = _lines(directions.take(rows))
        pairs = gated(path, lines, track[rows], np.arange(len(rows)), LAW.gate, models.light_time)
        looks = hard_measurements(pairs)
        estimates = models.filter.updated(estimates, end_s, looks, end_s - start_s)
        start_s = end_s
    rate = estimates_before.detection_rate
    return evolve(estimates, weight=estimates_before.weight, detection_rate=rate)


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
    """Starts of tracks (n,), at crossings (n, instants, 3), in ECEF, where `is_crossing` (n,
    instants).
    """

    crossing_m: FloatArray
    is_crossing: BoolArray
    instants: FloatArray
    first_s: FloatArray
    begun_s: FloatArray
    models: Refiltering

    @classmethod
    def of(
        cls,
        models: Refiltering,
        instants: FloatArray,
        crossings: DirectionSums,
        begun_s: FloatArray,
    ) -> "_Priors":
        """Return the starts of tracks whose first detections were at times (n,)."""
        position_m = intersections(crossings.sums) + crossings.centre
        is_crossing = crossings.sums[..., 11] > 1.5
        first_s = instants[np.argmax(is_crossing, axis=1)]
        return cls(position_m, is_crossing, instants, first_s, begun_s, models)

    def at(self, rows: IntArray, time_s: float) -> ModeEstimates:
        """Return the prior of tracks `rows` at a time."""
        start = np.argmax(self.is_crossing[rows], axis=1)
        candidates = TrackCandidates(
            self.crossing_m[rows, start], self.first_s[rows], np.full(len(rows), 2)
        )
        estimates = prior_estimates(candidates, time_s, self.models.config)
        is_old = self.begun_s[rows] < self.first_s[rows] - LAW.young_s
        is_long = self.is_crossing[rows].sum(axis=1) >= LAW.least_instants
        for number in np.flatnonzero(is_long & is_old).tolist():
            row = np.array([number])
            cubic = self._cubic(int(rows[number]), time_s)
            estimates = estimates.put(row, _about(cubic, estimates.take(row)))
        return estimates

    def _cubic(self, row: int, time_s: float) -> FloatArray:
        """Return the coefficients (4, 3) of a cubic through a track's crossings, of the time since
        `time_s`.
        """
        selected = np.flatnonzero(self.is_crossing[row])
        delay_s = FAR_M / SPEED_OF_LIGHT_M_S * self.models.light_time
        emitted_s = (self.instants - delay_s)[selected]
        path = earth_rotated(self.crossing_m[row, selected], emitted_s)
        powers = np.vander(emitted_s - time_s, 4, increasing=True)
        return np.linalg.lstsq(powers, path, rcond=None)[0].astype(np.float64)


def _about(cubic: FloatArray, prior: ModeEstimates) -> ModeEstimates:
    """Return the prior of one track about a cubic (4, 3) of the time since."""
    place = cubic[0]
    force = 2.0 * cubic[2] + EARTH_MU_M3_S2 * place / np.sqrt(place @ place) ** 3
    mean = prior.boost_mean.copy()
    mean[0, :9] = np.concatenate([place, cubic[1], force])
    sigma = np.append(np.repeat(LAW.sigmas, 3), 1.0 / prior.boost_root[0, -1, -1])
    root = np.diag(1.0 / sigma)[None]
    coast = Gaussian(mean[:, :COAST].copy(), root[:, :COAST, :COAST].copy())
    return ModeEstimates(prior.weight, mean, root, *coast, prior.detection_rate)
