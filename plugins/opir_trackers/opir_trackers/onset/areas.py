"""Prior rates by the area in which a track is first seen.

A rate of an area counts what appears within it. A rate that the area does not name is as dense there
as in view, so its share is that of the area in the view.
"""

from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_trackers.configs import AreaConfig, HypothesesConfig
from opir_trackers.onset.motion_priors import VIEW_M2
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.onset.posterior import GroupPosterior


@frozen(eq=False)
class AreaPosteriors:
    """The posteriors of a tracker's settings: `posteriors` of what is first seen in no area, and in
    each of the `areas`.
    """

    areas: tuple[AreaConfig, ...]
    posteriors: tuple[GroupPosterior, ...]

    @classmethod
    def of(
        cls, config: HypothesesConfig, clutter_per_sr: FloatArray, detection_probability: FloatArray
    ) -> "AreaPosteriors":
        """Return the posteriors for clutter densities and detection probabilities (sensors,)."""
        sensors = (clutter_per_sr, detection_probability)
        posteriors = [GroupPosterior.of(config, *sensors)]
        for area in config.areas:
            share = area.surface_m2 / VIEW_M2
            shares = {name: share * per_day for name, per_day in config.rates().items()}
            within = GroupPosterior.of(config, *sensors, {**shares, **area.rates})
            posteriors.append(evolve(within, log_rate=within.log_rate - np.log(share)))
        return cls(config.areas, tuple(posteriors))

    def begun(self, position_m: FloatArray, time_s: float, first_s: FloatArray) -> MotionStatistics:
        """Return the statistics of tracks without lines, at inertial positions (n, 3) at a time,
        first seen at `first_s` (n,).
        """
        prior = self.posteriors[0].prior
        motion = MotionStatistics.fresh(position_m, time_s, first_s, prior)
        if not self.areas:
            return motion
        point = ecef_to_geodetic(motion.reference_m)
        latitude_deg = np.degrees(point.latitude_rad)
        longitude_deg = np.degrees(point.longitude_rad)
        area = np.zeros(len(first_s), dtype=np.int64)
        for number, config in enumerate(self.areas, 1):
            area[_is_within(config, latitude_deg, longitude_deg, first_s)] = number
        priors = np.array([posterior.prior for posterior in self.posteriors])
        return evolve(motion, area=area, probability=priors[area])

    def assessed(
        self, statistics: MotionStatistics, time_s: float, step_s: float, **columns: Any
    ) -> MotionStatistics:
        """Return the statistics with new probabilities: `GroupPosterior.assessed` by areas, with its
        `columns` (n,) of tracks.
        """
        if not self.areas:
            return self.posteriors[0].assessed(statistics, time_s, step_s=step_s, **columns)
        for number in np.unique(statistics.area).tolist():
            rows = (statistics.area == number).nonzero()[0]
            of_rows = {name: column[rows] for name, column in columns.items()}
            within = statistics.take(rows)
            result = self.posteriors[number].assessed(within, time_s, step_s=step_s, **of_rows)
            if result is not within:
                statistics = statistics.with_rows(rows, result)
        return statistics


def _is_within(
    area: AreaConfig, latitude_deg: FloatArray, longitude_deg: FloatArray, time_s: FloatArray
) -> BoolArray:
    """Return whether places (n,) at times (n,) are within an area."""
    is_between = (latitude_deg >= area.south_deg) & (latitude_deg < area.north_deg)
    is_between &= (longitude_deg - area.west_deg) % 360.0 < area.width_deg
    return is_between & (time_s >= area.start_s) & (time_s < area.end_s)
