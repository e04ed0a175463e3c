"""The priors of the classes of boosts, from what a scene says of them."""

import math

import numpy as np

from opir_core.scene.scene import TARGET_TYPES
from opir_trackers.configs import BoostPriorsConfig
from opir_trackers.profile.family import Priors


def priors_of(config: BoostPriorsConfig) -> Priors:
    """Return the priors, one row a target type."""
    rows = []
    for kind in TARGET_TYPES:
        prior = getattr(config, kind)
        rows.append(
            (
                prior.burn_s,
                prior.speed_m_s,
                prior.speed_shape,
                prior.pitch_exponent,
                prior.pitch_start_share,
                math.radians(prior.turn_deg),
                prior.burn_sigma,
                prior.speed_sigma,
                prior.shape_sigma,
                prior.pitch_sigma,
                prior.start_sigma,
                math.radians(prior.turn_sigma_deg),
                config.hidden_s,
            )
        )
    return Priors(*np.array(rows, dtype=np.float64).T)
