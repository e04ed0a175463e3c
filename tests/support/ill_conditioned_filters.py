"""Ill-conditioned filtering problems, and their solution in 50 digits.

A case is a two-body path seen by sensors under conditions that ruin covariances: almost no
baseline, almost no noise, almost no prior knowledge, a very long time, rays in one line, the
antimeridian, the poles. The linear problem of every slice (transition, noise, whitened rows) is
handed to the reference as the float64 numbers it is: so the reference says what the filter would
have found had it not rounded.
"""

from typing import NamedTuple

import mpmath
import numpy as np
from opir_estimation import (
    BOOST,
    COAST,
    AngleMeasurements,
    Motion,
    square_root,
    tangent_axes,
    taylor_positions,
    taylor_weights,
)
from opir_estimation.filter.iterated_update import Mode, updated
from opir_estimation.filter.measurement_updates import measurement_update

from opir_core.flight.forces import Forces

DIGITS = 50
KEPLER = Forces(zonal=())
RADIUS_M = 6378137.0
GEO_M = 42164e3


class Case(NamedTuple):
    """One problem: the mode's size, sensors (k, 3), start (6,), noise of looks and motion, prior
    deviations, times.
    """

    name: str
    size: int
    sensors_m: np.ndarray
    start: np.ndarray
    sigma_rad: float
    noise: float
    prior: np.ndarray
    rate_hz: float
    slice_s: float
    slices: int
    seed: int


class Sample(NamedTuple):
    """One moment of a case: how the filter's estimate compares with the reference's."""

    condition: float
    smallest: float
    covariance_error: float
    drift: float
    asymmetry: float


def geostationary(*longitudes_deg):
    angle = np.radians(longitudes_deg)
    return GEO_M * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)


def launch(latitude_deg, longitude_deg, height_m=150e3):
    """Return a state that climbs northward, or towards the pole's other side."""
    latitude = np.radians(latitude_deg)
    longitude = np.radians(longitude_deg)
    up = np.array(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    north = np.array(
        [
            -np.sin(latitude) * np.cos(longitude),
            -np.sin(latitude) * np.sin(longitude),
            np.cos(latitude),
        ]
    )
    return np.concatenate([(RADIUS_M + height_m) * up, 2500.0 * up + 5500.0 * north])


CLOSE = geostationary(10.0, 10.5)
WIDE = geostationary(10.0, 70.0)
DIFFUSE = np.repeat([np.sqrt(1e9), 1e4, 1e3, 1e2], 3)
USUAL = np.repeat([1e3, 1e2, 10.0, 1.0], 3)
#: A sensor straight above the path: its rays run along the direction of flight.
ABOVE = launch(35.0, 55.0)[:3] * (GEO_M / (RADIUS_M + 150e3))


def cases(each=10):
    """Yield ten families of `each` cases."""
    for k in range(each):
        mid = launch(30.0 + k, 40.0)
        size = (BOOST, COAST)[k % 2]
        yield Case("half a degree apart", size, CLOSE, mid, 2e-5, 0.1, USUAL, 10.0, 1.0, 25, k)
        yield Case("a nanoradian of noise", size, WIDE, mid, 1e-9, 0.1, USUAL, 10.0, 1.0, 25, k)
        yield Case("prior variance 1e9 m²", size, WIDE, mid, 2e-5, 0.1, DIFFUSE, 10.0, 1.0, 25, k)
        yield Case("all three at once", size, CLOSE, mid, 1e-9, 0.0, DIFFUSE, 10.0, 1.0, 25, k)
        line = np.stack([ABOVE, ABOVE * (1.0 + 1e-3 * (k + 1))])
        yield Case(
            "sensors in one line",
            size,
            line,
            launch(35.0, 55.0),
            2e-5,
            0.1,
            USUAL,
            10.0,
            1.0,
            25,
            k,
        )
        yield Case(
            "one sensor, no prior", size, WIDE[:1], mid, 2e-5, 0.1, DIFFUSE, 10.0, 1.0, 25, k
        )
        across = geostationary(179.9, -179.9)
        yield Case(
            "antimeridian",
            size,
            across,
            launch(20.0, 179.999 + 1e-4 * k),
            1e-9,
            0.1,
            DIFFUSE,
            10.0,
            1.0,
            25,
            k,
        )
        pole = launch(90.0 - 1e-7 * k, 0.0)
        yield Case("pole", size, WIDE, pole, 1e-8, 0.1, DIFFUSE, 10.0, 1.0, 25, k)
        yield Case("no noise of motion", size, CLOSE, mid, 1e-8, 0.0, USUAL, 20.0, 1.0, 40, k)
        yield Case("steps of 0.05 s", size, CLOSE, mid, 1e-9, 0.01, DIFFUSE, 20.0, 0.05, 40, k)


def an_hour(seed=0):
    """Return 20 looks a second of two sensors for an hour, on a path that stays up that long."""
    start = np.array([8.0e6, 0.0, 0.0, 0.0, 5.5e3, 5.5e3])
    return Case("20 Hz for an hour", COAST, CLOSE, start, 1e-9, 0.0, DIFFUSE, 20.0, 1.0, 3600, seed)


def samples(case, every=1):
    """Return how the filter compares with 50 digits after every n-th slice."""
    rng = np.random.default_rng(case.seed)
    motion = Motion(case.size, case.noise, KEPLER)
    truth = np.concatenate([case.start, np.zeros(case.size - 6)])[None]
    sigma = case.prior[: case.size]
    mean = truth + rng.normal(size=truth.shape) * np.minimum(
        sigma, np.repeat([1e3, 1e2, 10.0, 1.0], 3)[: case.size]
    )
    root = np.diag(1.0 / sigma)[None]
    reference = Reference(root[0])
    result = []
    for number in range(1, case.slices + 1):
        step = np.array([case.slice_s])
        truth = motion.propagated(truth, step)
        predicted = motion.propagated(mean, step)
        back = motion.transition(0.5 * (mean[:, :3] + predicted[:, :3]), -step)
        noise = motion.noise_root(step)
        mean = predicted
        root = square_root.time_update(root, back, noise)
        reference.move(back[0], None if noise is None else noise[0])
        sights = looks(case, motion, truth, rng)
        previous = mean
        start_root = root
        (update,) = updated([Mode(motion, mean, root)], 0.0, sights, rounds=4)
        mean = update.mean
        root = update.root
        # The last point of linearisation is where the filter would have stopped: one more step from
        # it changes nothing.
        mean, root, rows = one_more(motion, previous, start_root, mean, sights)
        reference.take_in(rows, previous[0], mean[0])
        if number % every == 0 or number == case.slices:
            result.append(reference.compared(root[0]))
    return result


def looks(case, motion, truth, rng):
    """Return the looks of a slice that ends at time 0, each sensor's at its own instants."""
    count = max(1, round(case.rate_hz * case.slice_s))
    sensors = len(case.sensors_m)
    time_s = np.repeat(-case.slice_s * np.arange(count) / count, sensors)
    origin = np.tile(case.sensors_m, (count, 1))
    place = taylor_positions(
        np.repeat(motion.taylor(truth), len(time_s), axis=0), taylor_weights(time_s)
    )
    separation = place - origin
    axes = tangent_axes(separation / np.linalg.norm(separation, axis=1)[:, None])
    angles = rng.normal(size=(len(time_s), 2)) * case.sigma_rad
    whitener = np.tile(np.eye(2) / case.sigma_rad, (len(time_s), 1, 1))
    return AngleMeasurements(
        np.zeros(len(time_s), dtype=np.int64), time_s, origin, axes, angles, whitener
    )


def one_more(
    motion,
    before,
    root,
    point,
    sights,
):
    """Return the update linearised at a point, and its rows [H | residual + H point]."""
    path = np.repeat(motion.taylor(point), len(sights), axis=0)
    weight = taylor_weights(sights.time_s)
    residual, slope = sights.residuals(taylor_positions(path, weight))
    blocks = motion.size // 3
    rows = (slope[:, :, None, :] * weight[:, None, :blocks, None]).reshape(
        2 * len(sights), motion.size
    )
    total = np.concatenate([rows, residual.reshape(-1, 1)], axis=1)
    owed = (root[0] @ (before - point)[0])[None]
    updated, step, _ = measurement_update(root, owed, total[None])
    return (
        point + step,
        updated,
        np.concatenate([total, np.broadcast_to(step, (len(total), motion.size))], axis=1),
    )


class Reference:
    """The same estimate in 50 digits: its covariance or information, and how far off the filter's
    mean is.
    """

    def __init__(self, root):
        mpmath.mp.dps = DIGITS
        self.size = len(root)
        exact = mpmath.matrix(root.tolist())
        self.information = exact.T * exact
        self.off = mpmath.zeros(self.size, 1)

    def move(self, back, noise):
        exact = mpmath.matrix(back.tolist())
        self.information = exact.T * self.information * exact
        self.off = mpmath.lu_solve(exact, self.off)
        if noise is not None:
            side = mpmath.matrix(noise.tolist())
            self.information = (self.information**-1 + side * side.T) ** -1

    def take_in(self, rows, before, mean):
        """Take in rows [H | residual at the point | step to the filter's mean]."""
        slope = mpmath.matrix(rows[:, : self.size].tolist())
        residual = mpmath.matrix(rows[:, [self.size]].tolist())
        step = mpmath.matrix(rows[0, self.size + 1 :].tolist())
        prior = mpmath.matrix(before.tolist()) - mpmath.matrix(mean.tolist()) + self.off
        pull = self.information * prior + slope.T * (residual - slope * step)
        self.information = self.information + slope.T * slope
        self.off = mpmath.lu_solve(self.information, pull)

    def compared(self, root):
        """Return how a root of information compares: errors are of P against the reference, in its
        own directions.
        """
        upper = mpmath.cholesky(self.information).T
        # R_ref⁻ᵀ (Rᵀ R) R_ref⁻¹ is the identity where nothing was lost.
        factor = mpmath.matrix(root.tolist()) * upper**-1
        ratio = np.array((factor.T * factor).tolist(), dtype=np.float64)
        values = np.linalg.svd(root, compute_uv=False)
        covariance = square_root.covariance(root[None])[0]
        drift = float((self.off.T * self.information * self.off)[0])
        return Sample(
            condition=float((values[0] / values[-1]) ** 2),
            smallest=float(values[0] ** -2.0),
            covariance_error=float(np.abs(np.linalg.eigvalsh(0.5 * (ratio + ratio.T)) - 1.0).max()),
            drift=drift,
            asymmetry=float(np.abs(covariance - covariance.T).max()),
        )
