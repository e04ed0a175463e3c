"""`imm`'s boost along the velocity on drawn flights: smaller errors, and honest ones."""

import numpy as np
import pytest
from drawn_flights import GEO_M, SLOTS_RAD, flown
from opir_estimation import (
    BOOST,
    COAST,
    AngleMeasurements,
    Dynamics,
    ImmFilter,
    ModeEstimates,
    Motion,
    NewStage,
    Thrust,
    tangent_axes,
)
from opir_trackers.configs import ThrustConfig
from opir_trackers.track_priors import stage_of

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.forces import Forces
from opir_core.geometry import ecef_to_eci

FREE = Forces()
SIGMA_RAD = 2e-5
FLIGHTS = 40
TICKS_S = np.arange(10.0, 66.0)


class Watched:
    """Drawn SRBMs, ignited at 5 s, and looks at them: where they are, and what two sensors see at
    10 Hz, P_d 0.8.
    """

    def __init__(self, seed: int) -> None:
        self.flown = flown("SRBM", FLIGHTS, seed, "smooth")
        rng = np.random.default_rng(seed)
        parts = []
        time_s = np.tile(np.arange(5.1, TICKS_S[-1], 0.1), FLIGHTS)
        row = np.repeat(np.arange(FLIGHTS), len(time_s) // FLIGHTS)
        for slot in SLOTS_RAD:
            seen = (rng.random(len(row)) < 0.8) & (time_s > self.flown.start_s[row])
            seen &= time_s < self.flown.burnout_s[row]
            track = row[seen]
            when = time_s[seen]
            origin = ecef_to_eci(
                GEO_M * np.tile([np.cos(slot), np.sin(slot), 0.0], (len(when), 1)), when
            )
            line = self.places(track, when) - origin
            axes = tangent_axes(line / np.linalg.norm(line, axis=1)[:, None])
            sharp = np.tile(np.eye(2) / SIGMA_RAD, (len(when), 1, 1))
            parts.append(
                (track, when, origin, axes, SIGMA_RAD * rng.normal(size=(len(when), 2)), sharp)
            )
        columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
        order = np.argsort(columns[1], kind="stable")
        self.looks = AngleMeasurements(*(column[order] for column in columns))

    def places(self, row: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """Return inertial positions (n, 3)."""
        return ecef_to_eci(self.flown.at(row, time_s)[0], time_s)

    def states(self, row: np.ndarray, time_s: float) -> np.ndarray:
        """Return inertial states (n, 6)."""
        when = np.full(len(row), time_s)
        speed = (self.places(row, when + 0.05) - self.places(row, when - 0.05)) / 0.1
        return np.concatenate([self.places(row, when), speed], axis=1)


def errors(
    watched: Watched,
    boost: Dynamics,
    rate: np.ndarray,
    sigma: np.ndarray,
    stage: NewStage | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return each flight's mean NEES / 6 (n,), and all errors of speed (m,), from 20 s after
    ignition to burnout.
    """
    filter_ = ImmFilter(boost, Motion(COAST, 0.01, FREE), np.inf, np.inf, stage=stage)
    every = np.arange(FLIGHTS)
    burnout = watched.flown.burnout_s
    place = watched.places(every, np.full(FLIGHTS, TICKS_S[0] - 1.0))
    up = place / np.linalg.norm(place, axis=1)[:, None]
    speed = np.cross([0.0, 0.0, EARTH_ROTATION_RAD_S], place)
    mean = np.concatenate([place, speed, 20.0 * up, np.tile(rate, (FLIGHTS, 1))], axis=1)
    root = np.tile(
        np.diag(1.0 / np.concatenate([np.repeat([20e3, 300.0], 3), sigma])), (FLIGHTS, 1, 1)
    )
    coast = mean[:, :COAST], root[:, :COAST, :COAST]
    bank = ModeEstimates(
        np.tile([1.0, 0.0], (FLIGHTS, 1)), mean, root, *coast, np.zeros((FLIGHTS, 3))
    )
    squares = [[] for _ in every]
    off = []
    before = 0
    for tick_s in TICKS_S:
        cut = int(np.searchsorted(watched.looks.time_s, tick_s + 1e-9))
        bank = filter_.updated(
            filter_.predicted(bank, 1.0), tick_s, watched.looks.take(slice(before, cut)), 1.0
        )
        before = cut
        live = np.flatnonzero((burnout > tick_s + 0.1) & (tick_s >= 25.0))
        state, covariance = filter_.moments(bank)
        error = state[live] - watched.states(live, tick_s)
        square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance[live]), error) / 6.0
        off += np.linalg.norm(error[:, 3:], axis=1).tolist()
        for flight, value in zip(live, square, strict=True):
            squares[flight].append(value)
    return np.array([np.mean(values) for values in squares if values]), np.array(off)


@pytest.mark.slow
def test_thrust_along_the_velocity_errs_less_than_any_jerk_and_says_so() -> None:
    watched = Watched(3)
    usual = ThrustConfig()
    thrust = Thrust(
        np.radians(usual.tilt_deg), usual.tilt_s, usual.noise_m_s2, usual.growth_noise_per_s, FREE
    )
    square, off = errors(
        watched, thrust, np.array([0.01]), np.array([10.0, 10.0, 10.0, 0.01]), stage_of(usual)
    )
    _, other = errors(watched, Motion(BOOST, 0.3, FREE), np.zeros(3), np.repeat([20.0, 0.5], 3))
    assert np.sqrt(np.mean(off**2)) < 0.92 * np.sqrt(np.mean(other**2))
    wide = 3.3 * square.std(ddof=1) / np.sqrt(len(square))
    assert square.mean() + wide > 0.75, "no wider than need be, 99.9 %"
    assert square.mean() - wide < 1.1, "nor surer than it is"


def test_rays_of_a_target_say_that_it_burns_where_no_sensor_sees_it_cold() -> None:
    watched = Watched(4)
    odds = []
    mean = np.concatenate(
        [watched.states(np.arange(FLIGHTS), 20.0), np.full((FLIGHTS, 6), 0.1)], axis=1
    )
    root = np.tile(np.diag(1.0 / np.repeat([1e3, 100.0, 10.0, 0.5], 3)), (FLIGHTS, 1, 1))
    bank = ModeEstimates(
        np.full((FLIGHTS, 2), 0.5),
        mean,
        root,
        mean[:, :COAST],
        root[:, :COAST, :COAST],
        np.ones((FLIGHTS, 3)),
    )
    cuts = np.searchsorted(watched.looks.time_s, [19.5, 20.0])
    for chance in (1.0, 0.01):
        filter_ = ImmFilter(
            Motion(BOOST, 0.3, FREE),
            Motion(COAST, 0.01, FREE),
            150.0,
            1000.0,
            coast_detection=chance,
        )
        weight = filter_.updated(bank, 20.0, watched.looks.take(slice(*cuts)), 0.5).weight
        odds.append(weight[:, 0] / weight[:, 1])
    assert np.allclose(odds[1] / odds[0], 100.0)
