"""FilterPy's extended Kalman filter on a boost, as its users would put it together, behind opir's
tracker protocol.
"""

import numpy as np
from opir_estimation import LinesOfSight, earth_rotated, emission_s, tangent_axes, triangulated
from opir_trackers.imm.report import earth_fixed

from opir_core.interfaces.records import Tracks

#: How fast the acceleration wanders, m/s²/√s, and how surely the filter starts: m, m/s, m/s².
NOISE = 2.0
START_SIGMA = np.repeat([2e3, 500.0, 30.0], 3)


class FilterPyTracker:
    """One target whose detections are all there are: nearly constant acceleration, inertial, one
    update a look.
    """

    def __init__(self, cadence_s=1.0):
        self.cadence_s = cadence_s
        self._filter = None
        self._time_s = 0.0

    def associate(self, detections):
        """Return track 0 for all detections once there is one."""
        return np.full(len(detections), -1 if self._filter is None else 0, dtype=np.int64)

    def step(self, tick_s, detections):
        """Take in the detections one by one and return the estimate at the tick."""
        rays = LinesOfSight.of(detections)
        if self._filter is None and len(np.unique(rays.sensor)) > 1:
            self._begin(rays)
        if self._filter is None:
            return Tracks.empty()
        for row in range(len(rays)):
            self._take_in(rays, row)
        self._predict(tick_s)
        return self._tracks(tick_s)

    def _begin(self, rays):
        from filterpy.kalman import ExtendedKalmanFilter

        looks = rays.take(np.unique(rays.sensor, return_index=True)[1])
        group = np.zeros(len(looks), dtype=np.int64)
        place = triangulated(
            group, 1, looks.origin_ecef_m, looks.direction_ecef, looks.sigma_rad
        ).position_m
        self._time_s = float(looks.time_s.min())
        inertial = earth_rotated(place, np.full(1, self._time_s))[0]
        self._filter = ExtendedKalmanFilter(9, 2)
        self._filter.x = np.concatenate(
            [inertial, np.cross([0.0, 0.0, 7.292115e-5], inertial), np.zeros(3)]
        )
        self._filter.P = np.diag(START_SIGMA**2)

    def _predict(self, time_s):
        step = time_s - self._time_s
        self._time_s = time_s
        powers = np.array([[1.0, step, step**2 / 2.0], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
        gain = np.array(
            [abs(step) ** 2.5 / np.sqrt(20.0), abs(step) ** 1.5 / np.sqrt(3.0), abs(step) ** 0.5]
        )
        self._filter.F = np.kron(powers, np.eye(3))
        self._filter.Q = NOISE**2 * np.kron(np.outer(gain, gain), np.eye(3))
        self._filter.predict()

    def _take_in(self, rays, row):
        separation = (
            earth_rotated(rays.origin_ecef_m[[row]], rays.time_s[[row]])[0] - self._filter.x[:3]
        )
        left_s = emission_s(rays.time_s[[row]], np.array([np.sqrt(separation @ separation)]), True)
        origin = earth_rotated(rays.origin_ecef_m[[row]], left_s)[0]
        frame = tangent_axes(earth_rotated(rays.direction_ecef[[row]], left_s))[0]
        self._predict(float(left_s[0]))

        def seen(state):
            local = frame @ (state[:3] - origin)
            return local[:2] / local[2]

        def slope(state):
            local = frame @ (state[:3] - origin)
            part = (frame[:2] - (local[:2] / local[2])[:, None] * frame[2]) / local[2]
            return np.concatenate([part, np.zeros((2, 6))], axis=1)

        self._filter.R = np.eye(2) * rays.sigma_rad[row] ** 2
        self._filter.update(np.zeros(2), slope, seen)

    def _tracks(self, tick_s):
        unknown = np.full((1, 6, 6), np.nan)
        state, covariance = earth_fixed(
            self._filter.x[None, :6], self._filter.P[None, :6, :6], tick_s
        )
        return Tracks(
            tick_s=np.full(1, tick_s),
            track=np.zeros(1, dtype=np.int64),
            state=state,
            state_covariance=covariance,
            launch=unknown[:, 0, :3],
            launch_covariance=unknown[:, :3, :3],
            impact=unknown[:, 0, :3],
            impact_covariance=unknown[:, :3, :3],
            type_probability=np.full((1, 4), 0.25),
        )
