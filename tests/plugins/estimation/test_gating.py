"""Gates of a crowd: no ray that passes one is missed, and few are looked at in vain."""

import numpy as np
import pytest
from opir_estimation import (
    BOOST,
    LinesOfSight,
    PredictedMeasurements,
    candidates,
    earth_rotated,
    gated,
)

COUNT = 60
END_S = 5000.0
GATE = 4.5
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in (0.2, 1.7)])


def crowd(east: float) -> PredictedMeasurements:
    """Return tracks within 100 km, all flying east, or west, in the inertial frame."""
    rng = np.random.default_rng(12)
    derivative = np.zeros((COUNT, 5, 3))
    up = earth_rotated(
        np.array([[np.cos(0.6) * np.cos(0.9), np.cos(0.6) * np.sin(0.9), np.sin(0.6)]]),
        np.array([END_S]),
    )[0]
    aside = np.array([-up[1], up[0], 0.0]) / np.hypot(up[0], up[1])
    derivative[:, 0] = 6.6e6 * up + rng.uniform(-5e4, 5e4, (COUNT, 3))
    derivative[:, 1] = east * aside + 30.0 * rng.normal(size=(COUNT, 3))
    derivative[:, 2] = -9.0 * up
    side = np.repeat([300.0, 30.0, 3.0, 0.1], 3)[:, None] * np.eye(BOOST)
    return PredictedMeasurements(END_S, derivative, np.tile(side, (COUNT, 1, 1)))


def rays_at(outlook: PredictedMeasurements, span_s: float) -> LinesOfSight:
    """Return ten looks of each sensor in a span at all tracks, and as many anywhere about them."""
    rng = np.random.default_rng(13)
    looks = np.arange(20)
    time_s = np.repeat(END_S - span_s + span_s * (looks + 1) / 20.0, 2 * COUNT)
    sensor = np.repeat(looks % 2, 2 * COUNT).astype(np.int32)
    track = np.tile(np.repeat(np.arange(COUNT), 2), 20)
    place = outlook.positions(track, time_s - 0.125)
    place[1::2] += rng.uniform(-1e5, 1e5, place[1::2].shape)
    apart = earth_rotated(place, -(time_s - 0.125)) - SENSORS_M[sensor]
    direction = apart / np.linalg.norm(apart, axis=1)[:, None] + 2e-5 * rng.normal(size=apart.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    sigma = np.full(len(time_s), 2e-5)
    return LinesOfSight(
        time_s, sensor, np.repeat(looks // 2, 2 * COUNT), SENSORS_M[sensor], direction, sigma
    )


@pytest.mark.parametrize("east_m_s", [7000.0, -7000.0])
@pytest.mark.parametrize(("light_time", "span_s"), [(True, 1.0), (False, 1.0), (True, 3.0)])
def test_candidates_are_all_that_pass_and_few_more(
    east_m_s: float, light_time: bool, span_s: float
) -> None:
    outlook = crowd(east_m_s)
    rays = rays_at(outlook, span_s)
    track, ray = candidates(outlook, rays, span_s, GATE, light_time)
    found = gated(outlook, rays, track, ray, GATE, light_time)
    every = divmod(np.arange(COUNT * len(rays)), len(rays))
    brute = gated(outlook, rays, *every, GATE, light_time)
    assert np.array_equal(found.track, brute.track)
    assert np.array_equal(found.line, brute.line)
    assert np.array_equal(found.distance, brute.distance)
    assert len(found) > COUNT * 10
    assert len(track) < 4 * len(found)
