"""How far is the thrust of a boost off its velocity, under the tracker's law of boosts, and for how
long?

python docs/design/pitch_over.py prints, by speed, the root mean square of the angle, its
correlation time, and the process-noise density that an Ornstein–Uhlenbeck process of these has, as
a share of the force, beside the filter's.
"""

from itertools import pairwise

import numpy as np
from opir_estimation.filter.thrust import across_share_at
from opir_forecast.burning_on import drawn_steering
from opir_forecast.vehicles import BURN, FORCE, MISSILE, RATIO, vehicle_model

COUNT = 4000
STEP_S = 0.25
LAG_S = 5.0
PULL_M_S2 = 9.8
EDGES_M_S = (50, 100, 150, 200, 300, 400, 600, 800, 1200, 1600, 2400)


def boosts(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds and angles (times, vehicles) of first stages over a flat Earth; nan once burnt
    out.
    """
    model = vehicle_model()
    rng = np.random.default_rng(seed)
    drawn = model.median_log[MISSILE, 0] + model.sigma[MISSILE, 0] * rng.normal(size=(COUNT, 4))
    burn_s, first, ratio = (np.exp(drawn[:, row]) for row in (BURN, FORCE, RATIO))
    steering = drawn_steering(COUNT, model.data, seed)
    ahead = np.zeros(COUNT)
    up = np.full(COUNT, 0.1)
    speeds = []
    angles = []
    for now in np.arange(0.0, 120.0, STEP_S):
        force = first / np.maximum(1.0 - (1.0 - 1.0 / ratio) * now / burn_s, 0.05)
        lead = steering.leads(np.full(COUNT, now))
        course = np.arctan2(up, ahead) - lead
        ahead = ahead + STEP_S * force * np.cos(course)
        up = up + STEP_S * (force * np.sin(course) - PULL_M_S2)
        speeds.append(np.hypot(ahead, up))
        angles.append(np.where((now < burn_s) & (first > 1.05 * PULL_M_S2), lead, np.nan))
    return np.array(speeds), np.array(angles)


def main() -> None:
    """Print the table."""
    speed, angle = boosts(1)
    lag = int(LAG_S / STEP_S)
    for low, high in pairwise(EDGES_M_S):
        here = (speed >= low) & (speed < high) & np.isfinite(angle)
        both = here[:-lag] & np.isfinite(angle[lag:])
        square = np.mean(angle[:-lag][both] ** 2)
        correlation_s = -LAG_S / np.log(np.mean(angle[:-lag][both] * angle[lag:][both]) / square)
        density = np.tan(np.sqrt(square)) * np.sqrt(2.0 / correlation_s)
        mine = across_share_at(
            np.tan(np.radians(2.0)) * np.sqrt(2.0 / 30.0), (0.5 * (low + high)) ** 2
        )
        print(
            f"{low:5d} to {high:5d} m/s: {np.degrees(np.sqrt(square)):4.1f}°, {correlation_s:5.1f}"
            f" s,"
            f" {density:.3f}, filter {mine:.3f}"
        )


if __name__ == "__main__":
    main()
