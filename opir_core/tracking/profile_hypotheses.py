"""Hypotheses of a track's class, side by side: how probable they are, which rows are theirs, where fits set out."""

import numpy as np

from opir_core.geometry import intersection_with_ellipsoid
from opir_core.records import FloatArray, IntArray
from opir_core.tracking import profile_fit as fit
from opir_core.tracking.profile_family import SIZE, TURN_EAST, TURN_NORTH, Shapes
from opir_core.tracking.profile_fit import Hypotheses

#: Headings, evenly about the compass, from which a fit is tried while the direction of the turn is not known.
HEADINGS = 8


def probability(hypotheses: Hypotheses) -> FloatArray:
    """Return the probabilities (n,) of the classes of each track; hypotheses come sorted by track."""
    evidence = np.nan_to_num(fit.log_evidence(hypotheses), nan=-np.inf)
    _, row = np.unique(hypotheses.track, return_inverse=True)
    most = np.full(int(row.max(initial=-1)) + 1, -np.inf)
    np.maximum.at(most, row, evidence)
    share = np.exp(evidence - most[row])
    normalised: FloatArray = share / np.bincount(row, share)[row]
    return normalised


def likeliest(hypotheses: Hypotheses) -> Hypotheses:
    """Return the likeliest hypothesis of each track, by track."""
    order = np.lexsort((-probability(hypotheses), hypotheses.track))
    chosen = hypotheses.take(order)
    return chosen.take(np.append(True, np.diff(chosen.track) != 0)[: len(chosen)])


def joined(track: IntArray, of_rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs of rows and hypotheses of one track: rows (m,) and hypotheses (m,)."""
    order = np.argsort(of_rows, kind="stable")
    first, last = (np.searchsorted(of_rows[order], track, side) for side in ("left", "right"))
    count = last - first
    hypothesis = np.repeat(np.arange(len(track)), count)
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return order[np.repeat(first, count) + within], hypothesis


def heading_sigma(hypotheses: Hypotheses) -> FloatArray:
    """Return how well (n,) the direction of the turn is known, rad."""
    normal, _ = fit.system(hypotheses)
    spread = np.linalg.inv(normal)[:, TURN_EAST : TURN_NORTH + 1, TURN_EAST : TURN_NORTH + 1]
    turn = hypotheses.parameters[:, TURN_EAST : TURN_NORTH + 1]
    length = np.maximum(np.linalg.norm(turn, axis=1), 1e-3)
    across = np.stack([-turn[:, 1], turn[:, 0]], axis=1) / length[:, None]
    sigma: FloatArray = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", across, spread, across), 0.0)) / length
    return sigma


def with_heading(hypotheses: Hypotheses, heading: IntArray) -> FloatArray:
    """Return the parameters with the turn set to headings (n,), of `HEADINGS` about the compass; -1 leaves it."""
    parameters = hypotheses.parameters.copy()
    rows = np.flatnonzero(heading >= 0)
    azimuth = 2.0 * np.pi * heading[rows] / HEADINGS
    turn = Shapes.of(hypotheses.kind[rows]).turn_rad
    parameters[rows, TURN_EAST], parameters[rows, TURN_NORTH] = turn * np.sin(azimuth), turn * np.cos(azimuth)
    return parameters


def on_the_ground(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the point (3,) of the ellipsoid that a line of sight meets; where it misses, its nearest to the centre."""
    point = intersection_with_ellipsoid(origin_m, direction)
    nearest = origin_m - float(origin_m @ direction) * direction
    return np.asarray(point if np.isfinite(point).all() else nearest)


def blank(count: int, sensors: int) -> Hypotheses:
    """Return hypotheses of the first class, without rows, that stand at the middle of their priors."""
    whole, real = np.zeros(count, dtype=np.int64), np.zeros(count)
    return Hypotheses(
        track=whole,
        kind=whole,
        anchor_latitude_rad=real,
        anchor_longitude_rad=real,
        anchor_s=real,
        parameters=np.zeros((count, SIZE)),
        normal=np.zeros((count, SIZE, SIZE)),
        right=np.zeros((count, SIZE)),
        square=real,
        pull=np.zeros((count, sensors, SIZE, 2)),
        rows=whole,
        end_s=np.full((count, sensors), np.nan),
        end_sigma_s=np.ones((count, sensors)),
        last_s=np.full(count, -np.inf),
        log_prior=real,
    )
