"""The fit of boost profiles: maximum a posteriori, by Gauss and Newton, recursive in time.

Each hypothesis (a track and a class) keeps the normal equations of all its rows, A x = b, linearised where it then
stood. A new row is linearised at the present estimate and added: that costs the row, not the history. From time to time
(`profile_tracker`) a hypothesis is reviewed: all rows are linearised anew.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.columns import Columns
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.flight.boost import BoostPath
from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.tracking.profile_family import (
    BURN,
    SIZE,
    START,
    TURN_EAST,
    TURN_NORTH,
    TURN_SIGMA_RAD,
    Anchors,
    Shapes,
    drawn_out,
    paths,
    prior_information,
)
from opir_core.tracking.profile_rows import Rows

#: Steps of the differences that make partial derivatives: m, s, rad, and shares.
STEPS = np.array([20.0, 20.0, 2e-3, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4])

#: The largest change of a parameter in one step.
LARGEST = np.array([60e3, 60e3, 10.0, 0.4, 0.4, 0.3, 0.1, 0.1, 0.1])

#: A turn shorter than this has no direction to speak of, rad.
_STRAIGHT = 1e-3


@frozen(eq=False)
class Hypotheses(Columns):
    """One row a track and class: the estimate and its normal equations.

    `normal` (n, 9, 9), `right` (n, 9) and `square` (n,) sum up the rows: Σ HᵀH, Σ Hᵀρ, Σ ρᵀρ with whitened rows
    ρ = H x; `pull` (n, sensors, 9, 2) is Σ Hᵀ/σ by sensor, through which its bias works; `rows` counts them.
    `end_s` and `end_sigma_s` (n, sensors) say when each sensor's detections stopped, nan while they go on; `last_s`
    (n,) when the last light that was detected left.
    """

    track: IntArray
    kind: IntArray
    anchor_latitude_rad: FloatArray
    anchor_longitude_rad: FloatArray
    anchor_s: FloatArray
    parameters: FloatArray
    normal: FloatArray
    right: FloatArray
    square: FloatArray
    pull: FloatArray
    rows: IntArray
    end_s: FloatArray
    end_sigma_s: FloatArray
    last_s: FloatArray
    log_prior: FloatArray

    @property
    def anchors(self) -> Anchors:
        """Return what the parameters count from."""
        return Anchors(self.anchor_latitude_rad, self.anchor_longitude_rad, self.anchor_s)

    def cleared(self) -> "Hypotheses":
        """Return the hypotheses without their rows."""
        return evolve(
            self,
            normal=np.zeros_like(self.normal),
            right=np.zeros_like(self.right),
            square=np.zeros_like(self.square),
            pull=np.zeros_like(self.pull),
            rows=np.zeros_like(self.rows),
        )


def tiled(hypotheses: Hypotheses) -> tuple[FloatArray, Anchors, Shapes]:
    """Return the estimates and, below them, each with one parameter moved by its step: 10 n of everything."""
    count = len(hypotheses)
    moved = np.repeat(hypotheses.parameters[None], SIZE + 1, axis=0)
    moved[np.arange(1, SIZE + 1), :, np.arange(SIZE)] += STEPS[:, None]
    again = np.tile(np.arange(count), SIZE + 1)
    return moved.reshape(-1, SIZE), hypotheses.anchors.take(again), Shapes.of(hypotheses.kind).take(again)


def with_rows(hypotheses: Hypotheses, rows: Rows, owner: IntArray, light_time: bool) -> Hypotheses:
    """Return the hypotheses with rows (m,) added, each to the hypothesis `owner`, linearised where that stands."""
    if not len(rows):
        return hypotheses
    expected, slope = linearised(hypotheses, rows, owner, light_time)
    per_sigma = 1.0 / rows.sigma_rad
    slope = slope * per_sigma[:, None, None]
    wanted = np.einsum("mij,mj->mi", slope, hypotheses.parameters[owner]) - expected * per_sigma[:, None]
    normal, right, square = hypotheses.normal.copy(), hypotheses.right.copy(), hypotheses.square.copy()
    pull, counted = hypotheses.pull.copy(), hypotheses.rows.copy()
    turned = slope.transpose(0, 2, 1)
    np.add.at(normal, owner, turned @ slope)
    np.add.at(right, owner, np.einsum("mij,mi->mj", slope, wanted))
    np.add.at(square, owner, np.sum(wanted * wanted, axis=1))
    np.add.at(pull, (owner, rows.sensor), turned * per_sigma[:, None, None])
    np.add.at(counted, owner, 1)
    return evolve(hypotheses, normal=normal, right=right, square=square, pull=pull, rows=counted)


def linearised(hypotheses: Hypotheses, rows: Rows, owner: IntArray, light_time: bool) -> tuple[FloatArray, FloatArray]:
    """Return the directions (m, 2) at which rows' hypotheses expect them, from the mean seen, and slopes (m, 2, 9)."""
    count = len(hypotheses)
    path = paths(*tiled(hypotheses))
    time_s = rows.time_s
    if light_time:
        position, _ = drawn_out(path, owner, time_s)
        time_s = time_s - np.linalg.norm(position - rows.origin_ecef_m, axis=1) / SPEED_OF_LIGHT_M_S
    seen = np.stack([_seen(path, owner + each * count, time_s, rows) for each in range(SIZE + 1)])
    slope = (seen[1:] - seen[0]).transpose(1, 2, 0) / STEPS
    return seen[0], slope


def _seen(path: BoostPath, row: IntArray, time_s: FloatArray, rows: Rows) -> FloatArray:
    position, _ = drawn_out(path, row, time_s)
    local = np.einsum("mij,mj->mi", rows.axes, position - rows.origin_ecef_m)
    seen: FloatArray = local[:, :2] / local[:, 2:]
    return seen


def system(hypotheses: Hypotheses) -> tuple[FloatArray, FloatArray]:
    """Return the whole normal equations (n, 9, 9), (n, 9): rows, priors and the ends of the burn."""
    normal, right = hypotheses.normal + prior_information(), hypotheses.right.copy()
    _add_turn(hypotheses, normal, right)
    _add_ends(hypotheses, normal, right)
    return normal, right


def _add_turn(hypotheses: Hypotheses, normal: FloatArray, right: FloatArray) -> None:
    """Add the prior of the turn's length, as it looks along its present direction."""
    turn = hypotheses.parameters[:, [TURN_EAST, TURN_NORTH]]
    length = np.linalg.norm(turn, axis=1)
    bent = np.flatnonzero(length > _STRAIGHT)
    along = np.zeros((len(bent), SIZE))
    along[:, [TURN_EAST, TURN_NORTH]] = turn[bent] / length[bent, None]
    nominal = Shapes.of(hypotheses.kind[bent]).turn_rad
    normal[bent] += along[:, :, None] * along[:, None, :] / TURN_SIGMA_RAD**2
    right[bent] += along * (nominal / TURN_SIGMA_RAD**2)[:, None]


def _add_ends(hypotheses: Hypotheses, normal: FloatArray, right: FloatArray) -> None:
    """Add when the burn ended: start + burn time is when detections stopped, or later while they go on."""
    burn_s = Shapes.of(hypotheses.kind).burn_s * np.exp(hypotheses.parameters[:, BURN])
    expected = hypotheses.anchor_s + hypotheses.parameters[:, START] + burn_s
    for sensor in range(hypotheses.end_s.shape[1]):
        ended = np.isfinite(hypotheses.end_s[:, sensor])
        _add_end(hypotheses, normal, right, ended, hypotheses.end_s[:, sensor] - expected, burn_s, sensor)
    short = expected < hypotheses.last_s
    _add_end(hypotheses, normal, right, short, hypotheses.last_s - expected, burn_s, None)


def _add_end(
    hypotheses: Hypotheses,
    normal: FloatArray,
    right: FloatArray,
    holds: BoolArray,
    missing_s: FloatArray,
    burn_s: FloatArray,
    sensor: int | None,
) -> None:
    rows = np.flatnonzero(holds)
    slope = np.zeros((len(rows), SIZE))
    slope[:, START], slope[:, BURN] = 1.0, burn_s[rows]
    sigma = np.full(len(rows), _SHORT_SIGMA_S) if sensor is None else hypotheses.end_sigma_s[rows, sensor]
    wanted = missing_s[rows] + np.sum(slope * hypotheses.parameters[rows], axis=1)
    normal[rows] += slope[:, :, None] * slope[:, None, :] / np.square(sigma)[:, None, None]
    right[rows] += slope * (wanted / np.square(sigma))[:, None]


#: How sharply a burn is held to last as long as its detections, s.
_SHORT_SIGMA_S = 0.1


def moved(hypotheses: Hypotheses) -> Hypotheses:
    """Return the hypotheses at the solution of their normal equations, no farther off than a step may go."""
    normal, right = system(hypotheses)
    step = scaled_solution(normal, right) - hypotheses.parameters
    return evolve(hypotheses, parameters=hypotheses.parameters + np.clip(step, -LARGEST, LARGEST))


def scaled_solution(normal: FloatArray, right: FloatArray) -> FloatArray:
    """Return the solutions (n, 9) of normal equations, whose diagonal is scaled to 1 first."""
    scale = 1.0 / np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    scaled = normal * scale[:, :, None] * scale[:, None, :]
    solution: FloatArray = np.linalg.solve(scaled, (right * scale)[:, :, None])[:, :, 0] * scale
    return solution


def covariance(hypotheses: Hypotheses, bias_sigma_rad: FloatArray) -> FloatArray:
    """Return the covariances (n, 9, 9) of the estimates, with what sensors' biases (sensors,) add (Schmidt).

    Where the rows fit worse than their errors say, the covariance grows by as much.
    """
    normal, _ = system(hypotheses)
    scale = 1.0 / np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    inverse = np.linalg.inv(normal * scale[:, :, None] * scale[:, None, :])
    spread = inverse * scale[:, :, None] * scale[:, None, :]
    spread *= misfit(hypotheses)[:, None, None]
    moved_by = spread[:, None] @ hypotheses.pull * bias_sigma_rad[None, :, None, None]
    spread = spread + np.einsum("nsik,nsjk->nij", moved_by, moved_by)
    even: FloatArray = 0.5 * (spread + spread.transpose(0, 2, 1))
    return even


def misfit(hypotheses: Hypotheses) -> FloatArray:
    """Return by how much (n,) the mean square residual exceeds what the errors explain; 1 where it does not."""
    freedom = np.maximum(2.0 * hypotheses.rows - SIZE, 1.0)
    # A mean of n squares wanders by √(2/n): only what is beyond three times that counts.
    excess = residual_square(hypotheses) / freedom - 3.0 * np.sqrt(2.0 / freedom)
    growth: FloatArray = np.maximum(excess, 1.0)
    return growth


def residual_square(hypotheses: Hypotheses) -> FloatArray:
    """Return the sums (n,) of squared whitened residuals of the rows at the estimate."""
    x = hypotheses.parameters
    bent = np.einsum("ni,nij,nj->n", x, hypotheses.normal, x)
    left: FloatArray = np.maximum(hypotheses.square - 2.0 * np.sum(hypotheses.right * x, axis=1) + bent, 0.0)
    return left


def log_evidence(hypotheses: Hypotheses) -> FloatArray:
    """Return the logarithms (n,) of the marginal likelihoods, by Laplace's approximation, up to a common constant."""
    normal, _ = system(hypotheses)
    x, shape = hypotheses.parameters, Shapes.of(hypotheses.kind)
    prior = np.einsum("ni,ij,nj->n", x, prior_information(), x)
    length = np.hypot(x[:, TURN_EAST], x[:, TURN_NORTH])
    prior = prior + np.square((length - shape.turn_rad) / TURN_SIGMA_RAD)
    scale = np.sqrt(np.diagonal(normal, axis1=1, axis2=2))
    _, log = np.linalg.slogdet(normal / scale[:, :, None] / scale[:, None, :])
    ends = np.nansum(np.square(_end_misses(hypotheses)), axis=1)
    determinant = log + 2.0 * np.log(scale).sum(axis=1)
    evidence: FloatArray = hypotheses.log_prior - 0.5 * (residual_square(hypotheses) + prior + ends + determinant)
    return evidence


def _end_misses(hypotheses: Hypotheses) -> FloatArray:
    """Return by how many standard deviations (n, sensors + 1) burns end beside what was seen of it."""
    burn_s = Shapes.of(hypotheses.kind).burn_s * np.exp(hypotheses.parameters[:, BURN])
    expected = hypotheses.anchor_s + hypotheses.parameters[:, START] + burn_s
    stopped = (hypotheses.end_s - expected[:, None]) / hypotheses.end_sigma_s
    short = np.maximum(hypotheses.last_s - expected, 0.0) / _SHORT_SIGMA_S
    return np.concatenate([stopped, short[:, None]], axis=1)
