"""The state at burnout, by a posterior over all looks of the last part of a burn.

The filter must follow whatever may begin at any time: its process noise is that of the least regular
boost, and a stage may begin at each step. Once a burn is over, its looks say how regular it was, and
that no stage has begun in its last seconds. So the path is fitted as a whole: position and velocity
at its start, the force along the velocity of one stage or of two, and errors of the force along and
across the velocity, of unknown sizes. Given these sizes, the time of staging and the course of the
velocity's direction all of this is linear and Gaussian, so posterior and evidence are closed forms
(Rasmussen and Williams, "Gaussian Processes for Machine Learning", 2006, 2.7 and 5.4). Sizes and
times are summed over. Inertial frame; units m, s.
"""

from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_estimation.assignment import group_sums
from opir_estimation.directions import dot, matvec
from opir_estimation.filter.burn_modes import NewStage
from opir_estimation.filter.thrust import Thrust, air_velocity
from opir_estimation.lines_of_sight import AngleMeasurements


@frozen
class BurnEndLaw:
    """Priors and grids of the posterior over a burn."""

    #: Looks of this time before the last one count, s.
    memory_s: float = 80.0

    #: A shorter burn, s, or one of fewer looks stays as the filter has it.
    least_s: float = 10.0
    least_looks: int = 8

    #: Least burn of a stage, s, and median and standard deviation of the logarithm of that of later
    #: stages, as in the law of vehicles (`opir_forecast/vehicles.json`).
    stage_s: float = 12.0
    later_s: float = 65.0
    later_sigma: float = 0.45

    #: Steps of the force, of its errors, and of the time of staging, s; looks within a step of the
    #: force count as one.
    force_step_s: float = 1.0
    error_step_s: float = 4.0
    staging_step_s: float = 4.0

    #: Sizes of the errors of the force along and across the velocity, as shares of the motion
    #: model's, equally probable: how regular a boost is, is not known before.
    along: tuple[float, ...] = (0.1, 1.0)
    across: tuple[float, ...] = (0.3, 1.0, 3.0)

    #: In the last seconds of a burn errors across are at least of this size with this probability,
    #: else as before: what was regular may be steered before it is cut off, and few looks are left to
    #: show it. Notional: the class profiles of `ballistic` are so steered, gravity turns are not.
    late_s: float = 16.0
    late_across: float = 3.0
    late_share: float = 0.2

    #: Standard deviation of the angle between thrust and velocity at the first look, rad: what the
    #: law of boosts has at 100 to 400 m/s (`docs/design/pitch_over.py`).
    tilt_rad: float = 0.15

    #: Ratios of the last to the first acceleration of stages, log-uniform, and how many stand for
    #: them.
    growth: tuple[float, float] = (1.3, 6.0)
    growths: int = 9

    #: Standard deviations of position, m, and velocity, m/s, at the start.
    start_m: float = 30e3
    start_m_s: float = 3e3

    #: Looks farther than this from a first fit, in standard deviations, are outliers.
    gate: float = 4.5


LAW = BurnEndLaw()

#: Looks of this time before burnout count, s.
BURN_MEMORY_S = LAW.memory_s

#: Position, velocity and specific force.
_END = 9


class BurnEnd(NamedTuple):
    """Position, velocity and specific force at the last look of a burn, at `time_s`: mean (9,) and
    covariance (9, 9).
    """

    time_s: float
    mean: FloatArray
    covariance: FloatArray


def burn_end(
    looks: AngleMeasurements,
    reference_s: FloatArray,
    reference: FloatArray,
    prior: "BurnPrior",
) -> BurnEnd | None:
    """Return the state at the last of the looks (n,) of one target in a burn; None of a short burn,
    or where sensors contradict one another in most of the looks.

    `reference` (m, 9) are states at ascending times (m,), about which the path is linearised.
    """
    first_s = max(prior.ignition_s, looks.time_s.max(initial=-np.inf) - LAW.memory_s)
    looks = looks.take((looks.time_s >= first_s).nonzero()[0])
    if not _are_enough(looks):
        return None
    grid = _Grid.over(looks.time_s)
    path = _Path.through(grid, reference_s, reference, prior.motion)
    path = _Fit.of(path, _Bins.of(path, looks), prior).path
    likely = looks.take(_likely(path, looks))
    if _are_enough(likely) and len(likely) < len(looks):
        # The first fit has been drawn towards the outliers.
        path = _Fit.of(path, _Bins.of(path, likely), prior).path
        likely = looks.take(_likely(path, looks))
    return _Fit.of(path, _Bins.of(path, likely), prior).end if _are_enough(likely) else None


def _are_enough(looks: AngleMeasurements) -> bool:
    """Return whether looks tell the end of a burn."""
    return len(looks) >= LAW.least_looks and bool(np.ptp(looks.time_s) >= LAW.least_s)


def _likely(path: "_Path", looks: AngleMeasurements) -> IntArray:
    """Return the looks within the gate of a path."""
    residual, _ = looks.residuals(path.positions(looks.time_s))
    return (dot(residual, residual) < LAW.gate**2).nonzero()[0]


class _Grid(NamedTuple):
    """Middles (k,) of equal steps from a start to an end, s."""

    start_s: float
    end_s: float
    time_s: FloatArray

    @classmethod
    def over(cls, time_s: FloatArray) -> "_Grid":
        """Return the grid over the span of times (n,)."""
        start_s = float(time_s.min())
        end_s = float(time_s.max())
        steps = int(np.ceil((end_s - start_s) / LAW.force_step_s))
        return cls(start_s, end_s, start_s + (end_s - start_s) * (np.arange(steps) + 0.5) / steps)

    @property
    def step_s(self) -> float:
        """The length of a step."""
        return (self.end_s - self.start_s) / len(self.time_s)

    @property
    def walks(self) -> tuple[FloatArray, FloatArray]:
        """The times (e,) at which a random walk of unit density steps, and its steps (k, e), √s."""
        count = max(round((self.end_s - self.start_s) / LAW.error_step_s), 1)
        begun_s = np.linspace(self.start_s, self.end_s, count, endpoint=False)
        root_s = np.sqrt((self.end_s - self.start_s) / count)
        return begun_s, root_s * (self.time_s[:, None] > begun_s)

    def moved(self, time_s: FloatArray) -> FloatArray:
        """Return what accelerations in each step have added to positions at times (n,), (n, k),
        s².
        """
        since_s = np.maximum(time_s[:, None] - self.time_s + 0.5 * self.step_s, 0.0)
        acting_s = np.minimum(since_s, self.step_s)
        return acting_s * (since_s - 0.5 * acting_s)

    @property
    def ends(self) -> FloatArray:
        """What accelerations in each step add to position, velocity and acceleration at the end,
        (3, k).
        """
        count = len(self.time_s)
        velocity = np.full(count, self.step_s)
        return np.stack([self.moved(np.array([self.end_s]))[0], velocity, np.eye(count)[-1]])


class _Path(NamedTuple):
    """A path: position and velocity (6,) at its start, and gravity and specific force (k, 3) in the
    steps of a grid.
    """

    grid: _Grid
    start: FloatArray
    gravity: FloatArray
    force: FloatArray

    @classmethod
    def through(cls, grid: _Grid, time_s: FloatArray, state: FloatArray, motion: Thrust) -> "_Path":
        """Return the path from the first of states (m, 9) at times (m,), with their forces."""
        start = _interpolated(np.array([grid.start_s]), time_s, state)[0, :6]
        states = _interpolated(grid.time_s, time_s, state)
        return cls(grid, start, motion.fall.gravity(states[:, :3]), states[:, 6:9])

    def positions(self, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) at times (n,)."""
        since_s = (time_s - self.grid.start_s)[:, None]
        moved = self.grid.moved(time_s).dot(self.gravity + self.force)
        return self.start[:3] + since_s * self.start[3:] + moved

    @property
    def states(self) -> FloatArray:
        """The positions and velocities (k, 6) at the middles of steps."""
        gain = self.grid.step_s * (self.gravity + self.force)
        velocity = self.start[3:] + np.cumsum(gain, axis=0) - 0.5 * gain
        return np.concatenate([self.positions(self.grid.time_s), velocity], axis=1)

    @property
    def axes(self) -> FloatArray:
        """Unit vectors (3, k, 3) along the velocity through the air and across it."""
        velocity = air_velocity(self.states)
        along = velocity / np.sqrt(dot(velocity, velocity) + 1.0)[:, None]
        apart = np.eye(3)[np.argmin(np.abs(along.sum(axis=0)))]
        side = np.cross(along, apart)
        side /= np.sqrt(dot(side, side))[:, None]
        return np.stack([along, side, np.cross(along, side)])


def _interpolated(at_s: FloatArray, time_s: FloatArray, rows: FloatArray) -> FloatArray:
    return np.stack([np.interp(at_s, time_s, column) for column in rows.T], axis=1)


class _Bins(NamedTuple):
    """Looks in bins (b,), whitened: `rows` (b, 3, 3) times the position at `time_s` (b,) is `aim`
    (b, 3) but for unit noise.
    """

    time_s: FloatArray
    rows: FloatArray
    aim: FloatArray

    @classmethod
    def of(cls, path: _Path, looks: AngleMeasurements) -> "_Bins":
        """Return the looks (n,), those of a step together: the offset from a path hardly changes in
        it.
        """
        time_s = looks.time_s
        steps = ((time_s - path.grid.start_s) / LAW.force_step_s).astype(np.int64)
        _, group = np.unique(steps, return_inverse=True)
        products = _products(*looks.residuals(path.positions(time_s)))
        sums = group_sums(group, products).reshape(-1, 3, 4)
        # A lone sensor sees nothing along its line.
        variance, axes = np.linalg.eigh(sums[:, :, :3])
        sharp = np.sqrt(np.maximum(variance, 1e-12 * variance[:, -1:]))
        turned = axes.mT
        rows = sharp[:, :, None] * turned
        middle_s = np.bincount(group, time_s) / np.bincount(group)
        offset = matvec(turned, sums[:, :, 3]) / sharp
        return cls(middle_s, rows, offset + matvec(rows, path.positions(middle_s)))


def _products(residual: FloatArray, slope: FloatArray) -> FloatArray:
    """Return the products (n, 12) of whitened Jacobians (n, 2, 3) with themselves and residuals
    (n, 2).
    """
    columns = np.concatenate([slope, residual[:, :, None]], axis=2)
    return (slope.mT @ columns).reshape(-1, 12)


class BurnPrior(NamedTuple):
    """The motion model of a burn, the law of a new stage, and the time of ignition, s."""

    motion: Thrust
    stage: NewStage
    ignition_s: float

    def errors(self, path: _Path) -> tuple[FloatArray, FloatArray]:
        """Return unit errors of the force along, (k, e), and across the velocity, (k, e + 1),
        m/s²: random walks, across from any tilt at the start.

        Where a program keeps a tilt, a Gauss–Markov process would lead back to none after the last
        look that shows it.
        """
        begun_s, walks = path.grid.walks
        velocity = air_velocity(path.states)
        density = self.motion.across_share(dot(velocity, velocity))
        steps = walks * np.interp(begun_s, path.grid.time_s, density)
        tilts = np.concatenate([np.full((len(steps), 1), LAW.tilt_rad), steps], axis=1)
        force = np.sqrt(dot(path.force, path.force))[:, None]
        return self.motion.noise_m_s2 * walks, force * tilts

    def stagings_s(self, grid: _Grid) -> FloatArray:
        """Return the times (t,) of staging that a burn may have, after that of none: the
        ignition.
        """
        earliest_s = max(self.ignition_s + LAW.stage_s, grid.start_s + LAW.staging_step_s)
        times_s = np.arange(earliest_s, grid.end_s - LAW.stage_s, LAW.staging_step_s)
        return np.concatenate([[self.ignition_s], times_s])

    def log_weights(self, stagings_s: FloatArray, end_s: float) -> FloatArray:
        """Return the log prior weights (t,) of none and the other stagings, of a burn with an end: a
        stage that began a few seconds ago would not be over.
        """
        burn_s = np.maximum(end_s - stagings_s, LAW.least_s)
        score = np.log(burn_s / LAW.later_s) / LAW.later_sigma
        log = np.log(LAW.staging_step_s / self.stage.every_s) - 0.5 * score * score
        log[0] = 0.0
        return log

    def forces(self, grid: _Grid, staging_s: float) -> FloatArray:
        """Return mean and components (k, 7) of the force along the velocity, m/s², of a burn with a
        staging at a time.
        """
        ignition_s = min(self.ignition_s, grid.start_s)
        after = self._stage_force(grid, staging_s, grid.end_s)
        before = self._stage_force(grid, ignition_s, staging_s)
        mean = before[:, :1] + after[:, :1]
        return np.concatenate([mean, before[:, 1:], after[:, 1:]], axis=1)

    def _stage_force(self, grid: _Grid, start_s: float, end_s: float) -> FloatArray:
        """Return mean and components (k, 4) of the force of a stage, 0 outside of it."""
        share = (grid.time_s - start_s) / max(end_s - start_s, 1e-9)
        burns = (share >= 0.0) & (share < 1.0)
        shapes = _stage_shapes(self.stage.force_m_s2, self.stage.force_sigma_m_s2)
        nodes = np.linspace(0.0, 1.0, len(shapes))
        return _interpolated(share, nodes, shapes) * burns[:, None]


@cache
def _stage_shapes(force_m_s2: float, sigma_m_s2: float) -> FloatArray:
    """Return mean and three components (101, 4) of the force of a stage by the share of its burn.

    With constant thrust and mass flow the acceleration is A / (1 - (1 - 1/g) s), where g is the
    growth. A is normal, g log-uniform. The first component is A's, the others are the principal ones
    of the covariance by g, which leave less than a hundredth of it.
    """
    share = np.linspace(0.0, 1.0, 101)
    growth = np.geomspace(*LAW.growth, LAW.growths)[:, None]
    shape = 1.0 / (1.0 - (1.0 - 1.0 / growth) * share)
    mean = shape.mean(axis=0)
    spread = np.hypot(force_m_s2, sigma_m_s2) / np.sqrt(LAW.growths) * (shape - mean)
    _, size, axis = np.linalg.svd(spread, full_matrices=False)
    return np.stack([force_m_s2 * mean, sigma_m_s2 * mean, *(size[:2, None] * axis[:2])], axis=1)


class _DesignColumns(NamedTuple):
    """What unknowns (p,) do: to whitened looks (3 b, p), and to the state at the end (9, p)."""

    looks: FloatArray
    end: FloatArray

    @classmethod
    def of(cls, bins: _Bins, responses: FloatArray) -> "_DesignColumns":
        """Return the columns of responses (b + 3, 3, p): of positions at looks, and of position,
        velocity and force at the end.
        """
        count = len(bins.time_s)
        size = responses.shape[2]
        looks = (bins.rows @ responses[:count]).reshape(-1, size)
        return cls(looks, responses[count:].reshape(_END, size))

    @classmethod
    def of_forces(
        cls, grid: _Grid, bins: _Bins, force: FloatArray, axis: FloatArray
    ) -> "_DesignColumns":
        """Return the columns of forces (k, p) along axes (k, 3)."""
        weights = np.concatenate([grid.moved(bins.time_s), grid.ends])
        parts = [weights @ (force * component[:, None]) for component in axis.T]
        return cls.of(bins, np.stack(parts, axis=1))

    @classmethod
    def of_start(cls, grid: _Grid, bins: _Bins) -> "_DesignColumns":
        """Return the columns of position and velocity at the start."""
        span_s = grid.end_s - grid.start_s
        since_s = np.concatenate([bins.time_s - grid.start_s, [span_s, 1.0, 0.0]])
        stays = np.concatenate([np.ones(len(bins.time_s) + 1), [0.0, 0.0]])
        factors = np.stack([stays, since_s], axis=1)
        return cls.of(bins, np.kron(factors[:, None], np.eye(3)))

    @classmethod
    def of_gravity(cls, path: _Path, bins: _Bins) -> "_DesignColumns":
        """Return the column of gravity, which is no specific force."""
        weights = np.concatenate([path.grid.moved(bins.time_s), path.grid.ends])
        weights[-1] = 0.0
        return cls.of(bins, (weights @ path.gravity)[:, :, None])

    @classmethod
    def beside(cls, parts: "list[_DesignColumns]") -> "_DesignColumns":
        """Return the columns of all unknowns."""
        return cls(*(np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True)))


#: Axes of the errors of the force: those across the velocity come first.
_ORDER = (1, 2, 0)


class _Unknowns(NamedTuple):
    """The unknowns of a burn about a path: position and velocity at its start, and forces along axes
    (3, k, 3).

    `errors` are those of the force (k, e), one for each of the axes in `_ORDER`; `stages` are mean and
    six components of the force along the velocity for each staging, (k, t, 7).
    """

    axes: FloatArray
    errors: tuple[FloatArray, ...]
    stages: FloatArray

    @classmethod
    def of(cls, path: _Path, prior: BurnPrior, stagings_s: FloatArray) -> "_Unknowns":
        """Return the unknowns of a path."""
        along, across = prior.errors(path)
        stages = [prior.forces(path.grid, time_s) for time_s in stagings_s.tolist()]
        return cls(path.axes, (across, across, along), np.stack(stages, axis=1))

    @property
    def sizes(self) -> FloatArray:
        """The standard deviations (s, p) of start and errors, for sizes of these along and across,
        and across late.
        """
        start = [LAW.start_m] * 3 + [LAW.start_m_s] * 3
        across, _, along = (error.shape[1] for error in self.errors)
        late = min(round(LAW.late_s / LAW.error_step_s), across - 1)
        courses = product(LAW.across, (0.0, LAW.late_across))
        tilts = [
            [1.0, *[size] * (across - 1 - late), *[max(size, least)] * late]
            for size, least in courses
        ]
        return np.array(
            [[*start, *tilt, *tilt, *[size] * along] for size, tilt in product(LAW.along, tilts)]
        )

    @property
    def log_weights(self) -> FloatArray:
        """The log prior weights (s,) of the sizes."""
        late = np.log([1.0 - LAW.late_share, LAW.late_share])
        return np.tile(late, len(LAW.along) * len(LAW.across))

    def columns(
        self, path: _Path, bins: _Bins
    ) -> tuple[_DesignColumns, _DesignColumns, _DesignColumns]:
        """Return the columns of start and errors, of stages, and of all that is fixed."""
        grid = path.grid
        start = _DesignColumns.of_start(grid, bins)
        errors = [
            _DesignColumns.of_forces(grid, bins, error, self.axes[axis])
            for axis, error in zip(_ORDER, self.errors, strict=True)
        ]
        stages = self.stages.reshape(len(self.stages), -1)
        gravity = _DesignColumns.of_gravity(path, bins)
        parts = zip(gravity, start, strict=True)
        fixed = _DesignColumns(*(fall + part @ path.start[:, None] for fall, part in parts))
        staged = _DesignColumns.of_forces(grid, bins, stages, self.axes[0])
        return _DesignColumns.beside([start, *errors]), staged, fixed

    def path(self, path: _Path, staging: int, staged: FloatArray, others: FloatArray) -> _Path:
        """Return the path of a staging with values of stages (6,) and of start and errors (p,)."""
        ends = np.cumsum([6, *(error.shape[1] for error in self.errors)])
        start, *values = np.split(others, ends[:-1])
        stage = self.stages[:, staging]
        force = (stage[:, :1] + stage[:, 1:] @ staged[:, None]) * self.axes[0]
        for axis, error, value in zip(_ORDER, self.errors, values, strict=True):
            force = force + (error @ value)[:, None] * self.axes[axis]
        return path._replace(start=path.start + start, force=force)


class _Reduced(NamedTuple):
    """Least squares of stages with all other unknowns summed out, for sizes of errors (s,) and
    stagings (t,).

    `products` (s, t, 7, 7) are those of aim and stages, `lever` (s, t, 6, 9) is what stages do to
    the end, `weights` (s, t, p, 7) are the other unknowns by aim and stages; `end` (s, 9, p) is what
    these do to the end, `own` (s, 9, 9) its covariance by them alone, `log` (s,) the logarithm of
    their determinant.
    """

    products: FloatArray
    lever: FloatArray
    weights: FloatArray
    end: FloatArray
    own: FloatArray
    log: FloatArray

    @classmethod
    def of(
        cls, columns: _DesignColumns, sizes: FloatArray, stages: FloatArray, reach: FloatArray
    ) -> "_Reduced":
        """Return the sums over unknowns (p,) of unit variance times sizes (s, p).

        `stages` (m, t, 7) are aim and stages at whitened looks, `reach` (t, 7, 9) is what they do to
        the end.
        """
        end = sizes[:, None] * columns.end
        looks = sizes[:, :, None] * columns.looks.T
        gram = (looks @ columns.looks) * sizes[:, None] + np.eye(sizes.shape[1])
        cross = looks @ stages.reshape(len(stages), -1)
        solved = np.linalg.solve(gram, np.concatenate([cross, end.mT], axis=2))
        width = cross.shape[2]
        shape = (*sizes.shape, *stages.shape[1:])
        weights = solved[:, :, :width].reshape(shape).transpose(0, 2, 1, 3)
        squares = stages.transpose(1, 2, 0) @ stages.transpose(1, 0, 2)
        products = squares - cross.reshape(shape).transpose(0, 2, 3, 1) @ weights
        lever = reach[:, 1:] - (end[:, None] @ weights[:, :, :, 1:]).mT
        log = np.linalg.slogdet(gram)[1]
        return cls(products, lever, weights, end, end @ solved[:, :, width:], log)


class _Posteriors(NamedTuple):
    """Posteriors for sizes of errors (s,) and stagings (t,): log evidence (s, t), values of stages
    (s, t, 6) and of the other unknowns (s, t, p), means (s, t, 9) and covariances (s, t, 9, 9) of
    the end.
    """

    log_evidence: FloatArray
    staged: FloatArray
    others: FloatArray
    mean: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, reduced: _Reduced, sizes: FloatArray, reach: FloatArray) -> "_Posteriors":
        """Return the posteriors of unknowns of sizes (s, p); `reach` (t, 7, 9) is the fixed part of
        the end, and what stages do to it.
        """
        products = reduced.products
        inner = products[:, :, 1:, 1:] + np.eye(products.shape[2] - 1)
        right = np.concatenate([products[:, :, 1:, :1], reduced.lever], axis=3)
        found = np.linalg.solve(inner, right)
        staged = found[:, :, :, 0]
        explained = np.sum(staged * products[:, :, 1:, 0], axis=2)
        log = products[:, :, 0, 0] - explained + np.linalg.slogdet(inner)[1]
        others = reduced.weights[:, :, :, 0] - matvec(reduced.weights[:, :, :, 1:], staged)
        mean = reach[:, 0] + matvec(reach[:, 1:].mT, staged)
        mean = mean + matvec(reduced.end[:, None], others)
        covariance = reduced.own[:, None] + reduced.lever.mT @ found[:, :, :, 1:]
        evidence = -0.5 * (log + reduced.log[:, None])
        return cls(evidence, staged, sizes[:, None] * others, mean, covariance)


class _Fit(NamedTuple):
    """The posterior of a burn: its end, and the likeliest path."""

    end: BurnEnd
    path: _Path

    @classmethod
    def of(cls, path: _Path, bins: _Bins, prior: BurnPrior) -> "_Fit":
        """Return the fit of looks in bins about a path."""
        stagings_s = prior.stagings_s(path.grid)
        unknowns = _Unknowns.of(path, prior, stagings_s)
        found = _posteriors(unknowns, path, bins)
        log_weights = unknowns.log_weights[:, None] + prior.log_weights(stagings_s, path.grid.end_s)
        share = _shares(found.log_evidence + log_weights)
        best = np.unravel_index(np.argmax(share), share.shape)
        fitted = unknowns.path(path, int(best[1]), found.staged[best], found.others[best])
        gravity = prior.motion.fall.gravity(fitted.states[:, :3])
        return cls(_mixed(path.grid.end_s, share, found), fitted._replace(gravity=gravity))


def _shares(log: FloatArray) -> FloatArray:
    """Return probabilities that add up to one, by their logarithms but for a constant."""
    share = np.exp(log - log.max())
    return share / share.sum()


def _posteriors(unknowns: _Unknowns, path: _Path, bins: _Bins) -> _Posteriors:
    """Return the posteriors of unknowns by looks in bins about a path."""
    sizes = unknowns.sizes
    columns, staged, fixed = unknowns.columns(path, bins)
    shape = unknowns.stages.shape[1:]
    stages = staged.looks.reshape(-1, *shape)
    stages[:, :, 0] = (bins.aim.ravel() - fixed.looks[:, 0])[:, None] - stages[:, :, 0]
    reach = staged.end.reshape(-1, *shape).transpose(1, 2, 0)
    reach[:, 0] += fixed.end[:, 0]
    return _Posteriors.of(_Reduced.of(columns, sizes, stages, reach), sizes, reach)


def _mixed(end_s: float, share: FloatArray, found: _Posteriors) -> BurnEnd:
    """Return the moments of posteriors with probabilities (s, t)."""
    mean = np.tensordot(share, found.mean, 2)
    apart = found.mean - mean
    covariances = found.covariance + apart[..., :, None] * apart[..., None, :]
    covariance = np.tensordot(share, covariances, 2)
    return BurnEnd(end_s, mean, 0.5 * (covariance + covariance.T))
