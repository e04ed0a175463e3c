"""Gravity turns on a sphere that share no code with opir."""

import numpy as np

MU = 3.986004418e14
RADIUS_M = 6378137.0
SPIN = np.array([0.0, 0.0, 7.292115e-5])


def flown(azimuth, kick, force, growth, until_s, latitude=0.7):
    """Return start (3,) and ECEF place, velocity and specific force (9,) of a gravity turn on a
    sphere.
    """
    up = np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    forward = np.cos(azimuth) * np.array([-np.sin(latitude), 0.0, np.cos(latitude)]) + np.sin(
        azimuth
    ) * np.array([0.0, 1.0, 0.0])
    place = RADIUS_M * up
    velocity = 1e-3 * up
    step = 0.05
    for time_s in np.arange(0.0, until_s, step):
        unit = up if time_s < 6.0 else velocity / np.linalg.norm(velocity)
        if 6.0 <= time_s < 16.0:
            lead = kick * np.sin(np.pi * (time_s - 6.0) / 10.0) ** 2
            unit = np.cos(lead) * unit + np.sin(lead) * forward
        push = force / (1.0 - growth * time_s) * unit
        pull = -MU * place / np.linalg.norm(place) ** 3 - 2.0 * np.cross(SPIN, velocity)
        velocity = velocity + step * (push + pull)
        place = place + step * velocity
    return RADIUS_M * up, np.concatenate([place, velocity, push])
