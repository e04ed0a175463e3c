"""A motion model from outside: a force of constant direction that grows with the mass burnt."""

import numpy as np
from attrs import frozen
from opir_estimation import MotionModel

from opir_core.plugin import TrackerPart, hookimpl, number


@frozen(kw_only=True)
class StraightConfig:
    noise_m_s2: float = number(default=2.0, unit="m/s²/√s", above=0.0, help="of the force, an axis")


class Straight(MotionModel):
    def __init__(self, forces, noise_m_s2):
        super().__init__(forces)
        self.noise_m_s2 = noise_m_s2

    def force_rate(self, state):
        return state[:, 9:] * state[:, 6:9]

    def noise_root(self, step_s, state):
        root = np.zeros((len(state), 10, 4))
        root[:, range(6, 9), range(3)] = self.noise_m_s2 * np.sqrt(np.abs(step_s))[:, None]
        root[:, 9, 3] = 1e-3 * np.sqrt(np.abs(step_s))
        return root


def straight(config, context):
    return Straight(context.forces, config.noise_m_s2)


@hookimpl
def opir_tracker_parts():
    parts = {"config": StraightConfig, "build": straight, "state_size": 10, "reads": ()}
    yield TrackerPart(name="straight", summary="constant direction", role="motion", **parts)
