"""Free flights by chance, and the forces that tests of propagation let act on them."""

import numpy as np

from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces

ALL_ZONALS = Forces(zonal=("j2", "j3", "j4"))
EXPONENTIAL = ExponentialAtmosphere(1.225, 7200.0)
MODELS = {
    "j2": Forces(),
    "j2+j3+j4": ALL_ZONALS,
    "us76": Forces(drag=Drag(800.0)),
    "exp": Forces(drag=Drag(800.0, EXPONENTIAL)),
}


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def flights(
    count, seed=0, *, angle_deg=(20.0, 45.0), speed_m_s=(6300.0, 7200.0), height_m=(150e3, 300e3)
):
    """Return states shortly after burnout, all over the Earth; by default they fly for 20 to 45
    minutes.
    """
    random = np.random.default_rng(seed)
    up = unit(random.normal(size=(count, 3)))
    along = unit(np.cross(up, random.normal(size=(count, 3))))
    angle = np.radians(random.uniform(*angle_deg, (count, 1)))
    speed = random.uniform(*speed_m_s, (count, 1))
    height = random.uniform(*height_m, (count, 1))
    return up * (6371e3 + height), speed * (np.sin(angle) * up + np.cos(angle) * along)
