"""Two tracks that each hold one sensor's rays of the other's target are put right."""

import numpy as np
from opir_trackers.association import AssociationModel
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import candidates, gated
from opir_trackers.imm.ghosts import Slice, without_ghosts

from opir_core.estimation.lines_of_sight import LinesOfSight, tangent_axes
from opir_core.estimation.motion import BOOST, COAST, Motion
from opir_core.flight.forces import Forces
from opir_core.geometry import eci_to_ecef

KEPLER = Forces(zonal=())
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([10.0, 80.0])])
SIGMA_RAD = 2e-5


def seen(states: np.ndarray, motion: Motion) -> tuple[LinesOfSight, np.ndarray]:
    """Return one second of looks of two sensors at two targets in free flight, and whose each ray is."""
    rng, parts, whose = np.random.default_rng(2), [], []
    for scan in range(1, 11):
        for sensor, origin in enumerate(SENSORS_M):
            time_s = np.full(2, 0.1 * scan)
            apart = eci_to_ecef(motion.propagated(states, time_s)[:, :3], time_s) - origin
            axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
            error = SIGMA_RAD * rng.normal(size=(2, 2))
            direction = axes[:, 2] + axes[:, 0] * error[:, :1] + axes[:, 1] * error[:, 1:]
            direction /= np.linalg.norm(direction, axis=1)[:, None]
            index = np.full(2, sensor, dtype=np.int32)
            parts.append(
                LinesOfSight(time_s, index, np.full(2, scan), np.tile(origin, (2, 1)), direction, np.full(2, SIGMA_RAD))
            )
            whose.append(np.arange(2))
    return LinesOfSight.concatenate(parts), np.concatenate(whose)


def test_an_exchange_of_one_sensors_rays_is_undone_and_a_right_assignment_left_alone() -> None:
    motion = Motion(COAST, 0.0, KEPLER)
    first = np.array([4.2e6, 3.9e6, 3.2e6, -1500.0, 2500.0, 5000.0])
    states = np.stack([first, first + np.array([2500.0, -1500.0, 1500.0, 5.0, 0.0, -5.0])])
    rays, whose = seen(states, motion)
    filter_ = ImmFilter(Motion(BOOST, 1.0, KEPLER), motion, np.inf, np.inf)
    sigma = np.repeat([3000.0, 50.0, 20.0, 0.5], 3)
    root = np.tile(np.diag(1.0 / sigma), (2, 1, 1))
    middle = np.tile(states.mean(axis=0), (2, 1))
    none = np.zeros((2, 6))
    bank = ModeEstimates(
        np.tile([0.0, 1.0], (2, 1)),
        np.concatenate([middle, none], axis=1),
        root,
        middle,
        root[:, :COAST, :COAST].copy(),
        np.ones((2, 3)),
    )
    bank = filter_.predicted(bank, 1.0)
    outlook = filter_.predicted_measurements(bank, 1.0)
    pairs = gated(outlook, rays, *candidates(outlook, rays, 1.0, 5.0, False), 5.0, False)
    assert len(pairs) == 2 * len(rays), "every ray may be either's"
    known = Slice(filter_, AssociationModel(np.array([0.9, 0.9]), 100.0), False, bank, 1.0, rays)
    right = pairs.track == whose[pairs.line]
    ghostly = np.where(rays.sensor[pairs.line] == 0, ~right, right)
    assert np.array_equal(without_ghosts(known, pairs, right), right)
    put_right = without_ghosts(known, pairs, ghostly)
    assert np.array_equal(put_right, right) or np.array_equal(put_right, ~right), "which track is which is free"
