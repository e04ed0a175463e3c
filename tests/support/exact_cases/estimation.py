"""References of maps, anomalies, aimed speeds, sums of log-likelihoods and square-root updates."""

import mpmath as mp
import numpy as np
from opir_estimation import square_root
from opir_photons.classification.gaussian_mixture import Components, Mixture, log_shares, log_sum

from exact_cases import draws
from exact_cases.measure import Case, dot, norm
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.aiming import hitting_speed_m_s
from opir_core.geometry import AzimuthalEquidistant, great_circle_m, unit_vectors
from opir_core.orbits.elements import mean_anomaly_rad

RADIUS = mp.mpf(6378137)


def direction(place):
    """Return the unit vector of a latitude and longitude."""
    (sine, cosine), (east, forward) = ((mp.sin(angle), mp.cos(angle)) for angle in place)
    return [cosine * forward, cosine * east, sine]


def great_circle(start, end):
    a = direction(start)
    b = direction(end)
    # By half angles: exact between near points and between opposite ones.
    return (
        2
        * RADIUS
        * mp.atan2(norm([x - y for x, y in zip(a, b, strict=True)]), norm([*map(mp.fadd, a, b)]))
    )


def places(rng, n):
    """Return pairs of places: any, near ones, and almost opposite ones; poles among them."""
    start = np.stack([draws.latitudes(rng, n), draws.angles(rng, n)], axis=1)
    off = draws.log_uniform(rng, n, 1e-12, 1.0)[:, None] * rng.normal(size=(n, 2))
    opposite = (rng.random(n) < 0.3)[:, None]
    end = np.where(opposite, start * [-1.0, 1.0] + [0.0, np.pi], start) + off
    return start, np.clip(end, [-0.5 * np.pi, -np.inf], [0.5 * np.pi, np.inf])


def mapped(rng, n):
    """Return centres of maps, and points on them (n, 2), m: also those at a pole."""
    centre = np.stack([rng.uniform(-1.57, 1.57, n), rng.uniform(-np.pi, np.pi, n)], axis=1)
    point = draws.log_uniform(rng, n, 1e-3, 1e7)[:, None] * rng.normal(size=(n, 2))
    to_pole = (0.5 * np.pi - centre[:, 0]) * 6378137.0 + draws.log_uniform(rng, n, 1e-6, 1e3)
    at_pole = rng.random(n) < 0.4
    return centre, np.where(at_pole[:, None], np.stack([np.zeros(n), to_pole], axis=1), point)


def _latitudes(centre, point):
    charts = (AzimuthalEquidistant.about(up) for up in unit_vectors(centre))
    return np.array(
        [chart.places(place[None])[0, 0] for chart, place in zip(charts, point, strict=True)]
    )


def latitude(centre, point):
    angle = norm(point) / RADIUS
    up = direction(centre)
    east = [-mp.sin(centre[1]), mp.cos(centre[1]), mp.mpf(0)]
    north = [
        -mp.sin(centre[0]) * mp.cos(centre[1]),
        -mp.sin(centre[0]) * mp.sin(centre[1]),
        mp.cos(centre[0]),
    ]
    forward = [
        (point[0] * e + point[1] * n) / norm(point) for e, n in zip(east, north, strict=True)
    ]
    x, y, z = (mp.cos(angle) * u + mp.sin(angle) * a for u, a in zip(up, forward, strict=True))
    return mp.atan2(z, mp.hypot(x, y))


def anomaly(true, eccentricity):
    half = true / 2
    eccentric = 2 * mp.atan2(
        mp.sqrt(1 - eccentricity) * mp.sin(half), mp.sqrt(1 + eccentricity) * mp.cos(half)
    )
    return eccentric - eccentricity * mp.sin(eccentric)


def hitting_speed(start, end, gamma, psi):
    below = mp.cos(gamma) * (start / end * mp.cos(gamma) - mp.cos(gamma + psi))
    return mp.sqrt(mp.mpf(EARTH_MU_M3_S2) / start * (1 - mp.cos(psi)) / below)


def log_values(rng, n):
    """Return logarithms (n, 5): of sizes from 1e-12 to 1e6, apart by as much, or by nothing."""
    size = draws.log_uniform(rng, n, 1e-12, 1e6)[:, None]
    return (
        rng.normal(size=(n, 1)) * draws.log_uniform(rng, n, 1.0, 1e6)[:, None]
        + size * rng.normal(size=(n, 5)),
    )


def exact_log_sum(values):
    largest = max(values)
    return largest + mp.log(mp.fsum(mp.exp(value - largest) for value in values))


def looks(rng, n):
    """Return signals, variances, counts, means and covariances of two bands and a count, dark and
    bright.
    """
    size = draws.log_uniform(rng, n, 1e-6, 1e9)[:, None]
    root = rng.normal(size=(n, 3, 3)) * draws.log_uniform(rng, n, 1e-3, 1.0)[:, None, None]
    root[:, :2] *= size[:, :, None]
    noise = np.square(
        size * draws.log_uniform(rng, n, 1e-6, 1e2)[:, None] * rng.uniform(0.5, 1.0, (n, 2))
    )
    mean = np.concatenate(
        [size * rng.uniform(0.1, 1.0, (n, 2)), rng.uniform(1.0, 100.0, (n, 1))], axis=1
    )
    signal = mean[:, :2] + size * draws.log_uniform(rng, n, 1e-6, 1e2)[:, None] * rng.normal(
        size=(n, 2)
    )
    # A singular covariance has no density of the count: it has a share of its own.
    covariance = root @ root.transpose(0, 2, 1)
    covariance[:, 2, 2] += 1.0
    return (
        signal,
        np.maximum(noise, 1e-9),
        rng.uniform(1.0, 200.0, n),
        mean,
        covariance.reshape(n, 9),
    )


def _log_densities(*columns):
    result = []
    for signal, variance, count, mean, covariance in zip(*columns, strict=True):
        mixture = Mixture.of([[Components(np.zeros(1), mean[None], covariance.reshape(1, 3, 3))]])
        result.append(
            mixture.log_densities(
                np.zeros(1, dtype=np.int64), signal[None], variance[None], np.array([count])
            )
        )
    return tuple(np.array([density[component][0, 0] for density in result]) for component in (0, 1))


def log_densities(signal, variance, count, mean, covariance):
    """Return ln p(signal) and ln p(count | signal) of a normal distribution, signals in noise."""
    total = mp.matrix([covariance[3 * k : 3 * k + 3] for k in range(3)])
    total = (total + total.T) / 2
    for k in range(2):
        total[k, k] += variance[k]
    off = [y - m for y, m in zip([*signal, count], mean, strict=True)]

    def log_normal(size):
        block = total[:size, :size]
        solved = list(mp.lu_solve(block, mp.matrix(off[:size])))
        return -(dot(off[:size], solved) + mp.log(mp.det(block)) + size * mp.log(2 * mp.pi)) / 2

    return log_normal(2), log_normal(3) - log_normal(2)


def steps(rng, n):
    """Return roots of information, inverses of transitions and roots of noise, 9 numbers each:
    hardly any, and much.
    """
    root = np.triu(rng.normal(size=(n, 3, 3)))
    root[:, [0, 1, 2], [0, 1, 2]] = draws.log_uniform(rng, 3 * n, 0.1, 10.0).reshape(n, 3)
    back = np.eye(3) + np.triu(rng.normal(size=(n, 3, 3)), 1)
    noise = draws.log_uniform(rng, n, 1e-6, 1e9)[:, None, None] * rng.normal(size=(n, 3, 3))
    return tuple(matrix.reshape(n, 9) for matrix in (root, back, noise))


def _updated(root, back, noise):
    result = square_root.time_update(*(matrix.reshape(-1, 3, 3) for matrix in (root, back, noise)))
    return square_root.covariance(result).reshape(-1, 9)


def updated(root, back, noise):
    """Return the covariance after a step: F P Fᵀ + L Lᵀ."""
    r, b, side = (
        mp.matrix([matrix[3 * k : 3 * k + 3] for k in range(3)]) for matrix in (root, back, noise)
    )
    carried = (r * b) ** -1
    return list(carried * carried.T + side * side.T)


def update_condition(root, back, _noise):
    """Return that of the information before the step, which orthogonal updates keep."""
    carried = mp.matrix([root[3 * k : 3 * k + 3] for k in range(3)]) * mp.matrix(
        [back[3 * k : 3 * k + 3] for k in range(3)]
    )
    return [mp.mnorm(carried, "f") * mp.mnorm(carried**-1, "f")]


CASES = (
    Case("geometry.sphere.great_circle_m", places, great_circle_m, great_circle),
    Case("geometry.sphere.AzimuthalEquidistant.places", mapped, _latitudes, latitude, scale=(1.0,)),
    Case(
        "orbits.elements.mean_anomaly_rad",
        lambda r, n: (
            draws.log_uniform(r, n, 1e-12, 3.1),
            draws.uniform(r, n, 0.0, 0.99, (0.0, 0.999999)),
        ),
        lambda true, e: np.array(
            [mean_anomaly_rad(*row) for row in zip(true.tolist(), e.tolist(), strict=True)]
        ),
        anomaly,
    ),
    Case(
        "flight.aiming.hitting_speed_m_s",
        lambda r, n: (
            r.uniform(6.3e6, 6.6e6, n),
            r.uniform(6.2e6, 6.3e6, n),
            r.uniform(0.01, 1.5, n),
            draws.log_uniform(r, n, 1e-9, 3.0),
        ),
        hitting_speed_m_s,
        hitting_speed,
    ),
    Case("classification.log_sum", log_values, log_sum, exact_log_sum),
    Case(
        "classification.log_shares",
        log_values,
        log_shares,
        lambda values: [each - exact_log_sum(values) for each in values],
    ),
    Case("classification.Mixture.log_densities", looks, _log_densities, log_densities, share=0.3),
    Case(
        "estimation.square_root.time_update",
        steps,
        _updated,
        updated,
        condition=update_condition,
        share=0.3,
    ),
)
