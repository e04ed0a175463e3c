"""What the stereo filter tells of its tracks at a tick."""

import numpy as np

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.records import FloatArray, Tracks
from opir_core.tracking.rays import turned
from opir_core.tracking.switching_filter import Bank, SwitchingFilter
from opir_core.tracking.upkeep import Roster


def estimates(filter_: SwitchingFilter, bank: Bank, roster: Roster, time_s: float) -> Tracks:
    """Return the tracks of a bank at its time; what the filter does not estimate is nan."""
    count = len(bank)
    state, covariance = filter_.moments(bank)
    state, covariance = earth_fixed(state, covariance, time_s)
    return Tracks(
        tick_s=np.full(count, time_s),
        track=roster.number,
        state=state,
        state_covariance=covariance,
        launch=np.full((count, 3), np.nan),
        launch_covariance=np.full((count, 2, 2), np.nan),
        impact=np.full((count, 3), np.nan),
        impact_covariance=np.full((count, 2, 2), np.nan),
        type_probability=np.full((count, 4), np.nan),
    )


def earth_fixed(state: FloatArray, covariance: FloatArray, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return inertial states (n, 6) and covariances (n, 6, 6) in ECEF, the velocity relative to the turning Earth."""
    turn = turned(np.eye(3), np.full(3, -time_s)).T
    spin = EARTH_ROTATION_RAD_S * np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = turn
    change[3:, :3] = turn @ spin
    moved = change @ covariance @ change.T
    return np.sum(change * state[:, None, :], axis=2), 0.5 * (moved + moved.transpose(0, 2, 1))
