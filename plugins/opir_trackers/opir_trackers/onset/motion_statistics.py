"""Sufficient statistics of the lines of sight of tracks, for the likelihood of any slow motion.

A line of sight with the angular error σ bounds the position p of its source, relative to a
reference point near it at the range R in the direction u, by the quadratic form (p - d)ᵀ W (p - d),
with W = (I - u uᵀ) / (σ R)² and d where the line crosses the plane through the reference point
across u. (With u along the line itself, p would gain by moving towards the sensor, where all its
lines meet.) For p a polynomial of the time τ since the first detection, all lines of a track enter
through the sums of W τᵏ, W d τᵏ and dᵀ W d. The frame is fixed to the Earth, where sources stand
still; a constant pointing bias moves none.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from attrs import evolve, frozen
from opir_estimation import LinesOfSight, dot, earth_rotated, taylor_weights

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_core.interfaces import Columns

#: Groups of hypotheses that motion distinguishes, columns of `MotionStatistics.probability`.
NOISE, GROUND, BOLIDE, LAUNCH, NONE = range(5)

#: Coefficients of a motion: position, velocity, acceleration, jerk. Sums of twice as many powers
#: are needed but one.
ORDERS = 4
_POWERS = 2 * ORDERS - 1

#: i + j and i! of the coefficients i and j of a motion.
_SUM_OF_ORDERS = np.add.outer(np.arange(ORDERS), np.arange(ORDERS))
FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0])

#: A cubic leaves out a snap of 0.03 m/s⁴: 30 m/s² that grow by 3 % a second; notional. A term s τ⁴
#: / 24 differs from its best cubic over [0, T] by at most s T⁴ / 24 / 128 (Chebyshev).
_LEFT_OUT = 0.03 / (24.0 * 128.0)

#: Information of a prior of any motion: 1000 km, 100 km/s, 10 km/s², 10 km/s³.
_ANY_MOTION = np.diag(np.repeat([1e6, 1e5, 1e4, 1e4], 3) ** -2.0)

#: Where the lines of two sensors meet at an angle δ, the determinant of the information of a place
#: is sin² δ / 32 of its trace cubed: this at one degree.
_ONE_WAY = 1e-5

#: Lines that are as many numbers, two each, as twice the coefficients: what is decided on fewer is
#: summed further, as they alone say how a slow scanner's target moves.
_FEW_LINES = 3 * ORDERS
#: Ages, s, at which a decided launch is asked again: what still burns then has gained speed and
#: height that nothing else does.
ASKED_AGAIN_S = (30.0, 60.0)

#: The columns that are sums over lines.
_PLACES = ("static_information", "static_pull")
_SUMS = ("information", "pull", "misfit", "lines", "noise_log", *_PLACES)

#: The columns with those of places of all lines before the statistics began anew.
_LABEL_PLACES = ("label_information", "label_pull")


@frozen(eq=False, repr=False)
class MotionStatistics(Columns):
    """Statistics of tracks, one row each, and the latest probabilities of their groups.

    `area` (n,) is the number of the area in which they were first seen, 0 for none.

    `reference_m` (n, 3) in ECEF, its `height_m` (n,) and local `axes` (n, 3, 3), rows east, north
    and up; `epoch_s` (n,) is the time of the first detection. Of lines with the weight that the
    horizon of a cubic leaves them: `information` (n, 7, 3, 3), `pull` (n, 4, 3) and `misfit` (n,)
    in local axes, number of `lines`, and `noise_log` (n,), the log likelihood of the lines as false
    alarms over that of lines without error. Of all lines: `static_information` (n, 3, 3) and
    `static_pull` (n, 3). `probability` (n, 5) is over the groups; `is_decided` rows keep theirs.
    """

    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = MappingProxyType(
        {
            "reference_m": (3,),
            "axes": (3, 3),
            "information": (_POWERS, 3, 3),
            "pull": (ORDERS, 3),
            "static_information": (3, 3),
            "static_pull": (3,),
            "label_information": (3, 3),
            "label_pull": (3,),
            "carried": (5,),
            "probability": (5,),
        }
    )

    reference_m: FloatArray
    height_m: FloatArray
    axes: FloatArray
    epoch_s: FloatArray
    information: FloatArray
    pull: FloatArray
    misfit: FloatArray
    lines: FloatArray
    noise_log: FloatArray
    static_information: FloatArray
    static_pull: FloatArray
    label_information: FloatArray
    label_pull: FloatArray
    carried: FloatArray
    probability: FloatArray
    is_decided: BoolArray
    has_shared: BoolArray
    area: IntArray

    @classmethod
    def fresh(
        cls, position_m: FloatArray, time_s: float, epoch_s: FloatArray, prior: FloatArray
    ) -> "MotionStatistics":
        """Return the statistics of tracks without lines, at inertial positions (n, 3) then, with
        probabilities (5,).

        `epoch_s` (n,) are the times of their first detections.
        """
        count = len(position_m)
        sums = {
            name: np.zeros((count, *cls.row_shapes.get(name, ())))
            for name in (*_SUMS, *_LABEL_PLACES, "carried")
        }
        reference_m = earth_rotated(position_m, np.full(count, -time_s))
        return cls(
            reference_m=reference_m,
            height_m=ecef_to_geodetic(reference_m).height_m,
            axes=local_axes(reference_m),
            epoch_s=epoch_s,
            **sums,
            probability=np.tile(prior, (count, 1)),
            is_decided=np.zeros(count, dtype=np.bool_),
            has_shared=np.zeros(count, dtype=np.bool_),
            area=np.zeros(count, dtype=np.int64),
        )

    @property
    def stands(self) -> BoolArray:
        """Return for which tracks (n,) a ground source is the likeliest."""
        return self.probability.argmax(axis=1) == GROUND

    @property
    def has_begun_anew(self) -> BoolArray:
        """Return which tracks (n,) have lines from before their statistics began anew."""
        return self.label_information[:, 0, 0] > 0.0

    @property
    def lack_range(self) -> BoolArray:
        """Return of which tracks (n,) all lines go the same way: those of one sensor that stands."""
        place = self.static_information
        east, north, up = place.transpose(1, 2, 0)
        determinant = east[0] * (north[1] * up[2] - north[2] * up[1])
        determinant -= east[1] * (north[0] * up[2] - north[2] * up[0])
        determinant += east[2] * (north[0] * up[1] - north[1] * up[0])
        return determinant <= _ONE_WAY * self._sharpness() ** 3

    @property
    def may_stand(self) -> BoolArray:
        """Return which tracks (n,) have lines and are not decided to be anything that moves."""
        has_lines = self.static_information[:, 0, 0] + self.label_information[:, 0, 0] > 0.0
        return has_lines & (~self.is_decided | self.stands)

    @property
    def are_noise(self) -> BoolArray:
        """Return which tracks (n,) are probably false alarms."""
        return self.probability[:, NOISE] > 0.5

    @property
    def are_none(self) -> BoolArray:
        """Return which tracks (n,) are probably neither noise nor on the ground nor launches."""
        return self.probability[:, BOLIDE] + self.probability[:, NONE] > 0.5

    @property
    def are_few(self) -> BoolArray:
        """Return which moving tracks (n,) have so few lines that these are summed to the last."""
        return (self.lines < _FEW_LINES) & ~self.stands

    def horizon_s(self) -> FloatArray:
        """Return the time (n,), s, up to which a cubic describes a boost to within the error of the
        lines' mean.
        """
        sharp = 0.5 * self._sharpness()
        return (_LEFT_OUT * np.sqrt(np.maximum(sharp, 1e-12))) ** -0.25

    def _sharpness(self) -> FloatArray:
        """Return the traces (n,) of the information of places."""
        place = self.static_information
        return place[:, 0, 0] + place[:, 1, 1] + place[:, 2, 2]

    def with_lines(
        self,
        owner: IntArray,
        lines: LinesOfSight,
        log_clutter: FloatArray,
        probability: FloatArray | None = None,
    ) -> "MotionStatistics":
        """Return the statistics with the lines (m,) of rows `owner`, -1 for none.

        `log_clutter` (sensors,) is the log density of false alarms over the detection probability;
        `probability` (m,) are those that lines are their owners', by default 1. Of what is decided
        to move nothing more is taken in once it has enough lines, but for launches that are asked
        again.
        """
        last_s = float(lines.time_s.max(initial=-np.inf))
        is_open = ~self.is_decided | self.stands | self.are_few | self.are_launches(last_s)
        if True not in is_open:
            return self
        rows = np.append(is_open, False)[owner].nonzero()[0]
        if not len(rows):
            return self
        rows = rows[owner[rows].argsort(kind="stable")]
        track = owner[rows]
        owned = np.ones(len(rows)) if probability is None else probability[rows]
        terms = self._terms(track, lines.take(rows), log_clutter, owned)
        return self._with_sums(track, terms)

    def _with_sums(self, track: IntArray, terms: Mapping[str, FloatArray]) -> "MotionStatistics":
        """Return the statistics with the terms of lines of tracks (m,), in order, added."""
        starts = np.flatnonzero(np.diff(track, prepend=-1))
        changed = {}
        for name, term in terms.items():
            column = getattr(self, name).copy()
            sums = np.add.reduceat(term, starts, axis=0)
            column[track[starts]] += sums.reshape(-1, *column.shape[1:])
            changed[name] = column
        return evolve(self, **changed)

    def _terms(
        self,
        track: IntArray,
        lines: LinesOfSight,
        log_clutter: FloatArray,
        probability: FloatArray,
    ) -> dict[str, FloatArray]:
        """Return the terms (m, ...) of each column that is a sum over lines, of rows `track`
        (m,).
        """
        since_s = lines.time_s - self.epoch_s[track]
        share = self._share_of_cubic(track, since_s) * probability
        weight, foot, square = _line_terms(lines, self.reference_m[track], self.axes[track])
        pull = np.sum(weight * foot[:, None, :], axis=2)
        weight = weight.reshape(-1, 9)
        known = probability[:, None]
        powers = share[:, None] * since_s[:, None] ** np.arange(_POWERS)
        sums = np.array([square, np.ones(len(track)), _noise_log(lines, log_clutter)])
        # No clutter has the log density -inf.
        sums = np.multiply(share, sums, where=share > 0.0, out=np.zeros_like(sums))
        return {
            "information": powers[:, :, None] * weight[:, None, :],
            "pull": powers[:, :ORDERS, None] * pull[:, None, :],
            "misfit": sums[0],
            "lines": sums[1],
            "noise_log": sums[2],
            "static_information": known * weight,
            "static_pull": known * pull,
        }

    def _share_of_cubic(self, track: IntArray, since_s: FloatArray) -> FloatArray:
        """Return the weights (m,) that the horizon of a cubic leaves lines of rows `track` (m,) at
        times since the first detections; none of what is decided to stand.
        """
        # The error of a cubic grows as τ⁴; its variance adds to that of the lines' mean, the same
        # at the horizon.
        share = 1.0 / (1.0 + (since_s / self.horizon_s()[track]) ** 8)
        settled = self.is_decided & self.stands
        return np.where(settled[track], 0.0, share)

    def restarted(
        self, rows: IntArray, time_s: float, *, adds_up: bool = True
    ) -> "MotionStatistics":
        """Return the statistics with those of some rows begun anew at a time, without lines.

        The lines so far say where the row stands, with those before them or, if these do not
        `adds_up`, in their place.
        """
        changed = {name: getattr(self, name).copy() for name in (*_SUMS, *_LABEL_PLACES)}
        for name, place in zip(_PLACES, _LABEL_PLACES, strict=True):
            before = changed[place][rows] if adds_up else 0.0
            changed[place][rows] = before + changed[name][rows]
        for name in _SUMS:
            changed[name][rows] = 0.0
        epoch_s = self.epoch_s.copy()
        epoch_s[rows] = time_s
        return evolve(self, epoch_s=epoch_s, **changed)

    def with_rows(self, rows: IntArray, others: "MotionStatistics") -> "MotionStatistics":
        """Return the statistics with those of some rows (k,) replaced by others (k,)."""
        order = np.arange(len(self))
        order[rows] = len(self) + np.arange(len(rows))
        return MotionStatistics.concatenate([self, others]).take(order)

    def moved_on(
        self, before: "MotionStatistics", position_m: FloatArray, time_s: float
    ) -> "MotionStatistics":
        """Return the statistics about where what moves is, inertial positions (n, 3) at a time, where
        they have begun anew since `before`: about a point far behind, no line is linear.
        """
        rows = ((self.epoch_s > before.epoch_s) & ~self.stands).nonzero()[0]
        if not len(rows):
            return self
        anew = MotionStatistics.fresh(
            position_m[rows], time_s, self.epoch_s[rows], self.probability[0]
        )
        kept = ("carried", "probability", "has_shared", "area")
        known = {name: getattr(self, name)[rows] for name in kept}
        return self.with_rows(rows, evolve(anew, **known, **self.take(rows)._labels_about(anew)))

    def _labels_about(self, other: "MotionStatistics") -> dict[str, Any]:
        """Return the columns of places of lines before the statistics began anew, about the points
        of others (n,).
        """
        turn = other.axes @ self.axes.mT
        shift = _components(other.axes, self.reference_m - other.reference_m)
        information = turn @ self.label_information @ turn.mT
        pull = _components(turn, self.label_pull) + _components(information, shift)
        return {"label_information": information, "label_pull": pull}

    def are_unlike_any_motion(self) -> BoolArray:
        """Return which tracks (n,) have lines that no cubic explains: some of them are of something
        else.

        Chance gives a misfit of 2 a line, and biases of two sensors less than the remainder up to
        3.5 standard deviations; 12 degrees of freedom exceed 30 in 0.3 % of cases.
        """
        information, pull, misfit = self.of_motion()
        fitted = np.linalg.solve(information + _ANY_MOTION, pull[:, :, None])[:, :, 0]
        least = misfit - np.sum(pull * fitted, axis=1)
        return least > 6.0 * self.lines + 30.0

    def of_motion(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return information (n, 12, 12), pull (n, 12) and misfit (n,) of the coefficients of a
        cubic.

        These are position, velocity, acceleration and jerk in local axes about the point at height
        0 below the reference point.
        """
        count = len(self.misfit)
        size = 3 * ORDERS
        blocks = (
            self.information[:, _SUM_OF_ORDERS]
            / FACTORIALS[:, None, None, None]
            / FACTORIALS[:, None, None]
        )
        information = blocks.transpose(0, 1, 3, 2, 4).reshape(count, size, size)
        pull = (self.pull / FACTORIALS[:, None]).reshape(count, size)
        raised = self.height_m[:, None] * information[:, 2]
        misfit = self.misfit + self.height_m * (2.0 * pull[:, 2] + raised[:, 2])
        return information, pull + raised, misfit

    def first_motion(self, axes: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return how one track moves at its first detection, by the cubic that fits its lines best.

        A point at height 0 (3,) in ECEF, position from there and velocity (4,) along axes (2, 3) in
        ECEF, and their covariance (4, 4).
        """
        information, pull, _ = self.of_motion()
        covariance = np.linalg.inv(information[0] + _ANY_MOTION)
        rows = np.zeros((4, covariance.shape[0]))
        rows[:2, :3] = rows[2:, 3:6] = axes @ self.axes[0].T
        point = self.reference_m[0] - self.height_m[0] * self.axes[0, 2]
        return point, rows @ covariance @ pull[0], rows @ covariance @ rows.T

    def moved(
        self, since_s: FloatArray, lift: FloatArray, growth: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return states (n, 6), ECEF position and velocity over the ground, and covariances (n, 6,
        6), at times since the first detections (n,), by the cubics that fit the lines best.

        `lift` and `growth` (2, n) are prior means upwards, and standard deviations on each axis, of
        acceleration, m/s², and jerk, m/s³.
        """
        information, pull = self._of_burn(lift, growth)
        covariance = np.linalg.inv(information + _ANY_MOTION)
        rows = self._state_of_cubic(since_s)
        state = (rows @ (covariance @ pull[:, :, None]))[:, :, 0]
        state[:, :3] += self.reference_m - self.height_m[:, None] * self.axes[:, 2]
        return state, rows @ covariance @ rows.mT

    def _of_burn(self, lift: FloatArray, growth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the information and pull of `of_motion` with the priors of `moved`."""
        information, pull, _ = self.of_motion()
        for order, (mean, sigma) in ((2, lift), (3, growth)):
            axes = range(3 * order, 3 * order + 3)
            information[:, axes, axes] += (sigma**-2.0)[:, None]
            pull[:, axes[2]] += mean / sigma**2
        return information, pull

    def _state_of_cubic(self, since_s: FloatArray) -> FloatArray:
        """Return the matrices (n, 6, 12) that take the coefficients of cubics to ECEF position and
        velocity at times since the first detections (n,).
        """
        count = len(since_s)
        weight = taylor_weights(since_s)[:, :ORDERS]
        share = np.zeros((count, 2, ORDERS))
        share[:, 0] = weight
        share[:, 1, 1:] = weight[:, :-1]
        turned = self.axes.mT
        rows = share[:, :, None, :, None] * turned[:, None, :, None, :]
        return rows.reshape(count, 6, 3 * ORDERS)

    def are_launches(self, time_s: float) -> BoolArray:
        """Return which tracks (n,) are launches that are asked again: the lines are theirs alone."""
        is_launch = self.probability.argmax(axis=1) == LAUNCH
        is_alone = self.is_decided & is_launch & ~self.has_shared
        return is_alone & (time_s - self.epoch_s < ASKED_AGAIN_S[-1] + 1.0)

    def stand_among_others(self, rare: float) -> BoolArray:
        """Return which tracks (n,) share lines, and likeliest stand: a launch is less probable than
        `rare`.
        """
        return self.has_shared & self.stands & (self.probability[:, LAUNCH] < rare)

    def sharing(self, rows: IntArray) -> "MotionStatistics":
        """Return the statistics of tracks of which some rows share lines."""
        has_shared = self.has_shared.copy()
        has_shared[rows] = True
        return evolve(self, has_shared=has_shared)

    def of_labels(self) -> "MotionStatistics":
        """Return the statistics with the places of the lines before they began anew, where they
        have.
        """
        has_begun = self.has_begun_anew
        places = self.label_information, self.static_information
        pulls = self.label_pull, self.static_pull
        return evolve(
            self,
            static_information=np.where(has_begun[:, None, None], *places),
            static_pull=np.where(has_begun[:, None], *pulls),
        )

    def of_all_lines(self) -> "MotionStatistics":
        """Return the statistics with the places of the lines before and after they began anew."""
        return evolve(
            self,
            static_information=self.static_information + self.label_information,
            static_pull=self.static_pull + self.label_pull,
        )

    def inertial_places(
        self, grounds: FloatArray, wide_m: float, time_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return `static_estimates` in the inertial frame at a time."""
        position, covariance = self.static_estimates(grounds, wide_m)
        turn = earth_rotated(np.eye(3), np.full(3, time_s)).T
        return position @ turn.T, turn @ covariance @ turn.T

    def static_estimates(self, grounds: FloatArray, wide_m: float) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 3) in ECEF of sources that stand on the ground, and covariances (n,
        3, 3).

        They are moments of the mixture over kinds of ground, rows (k, 3) of a share, and mean and
        standard deviation of the height, m; the standard deviation of places is `wide_m`, m.
        """
        local, covariance = _mixture(*self._places_by_ground(grounds, wide_m))
        turned = self.axes.mT
        position_m = self.reference_m + np.sum(turned * local[:, None, :], axis=2)
        return position_m, turned @ covariance @ self.axes

    def _places_by_ground(
        self, grounds: FloatArray, wide_m: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return weights (n, k, 1), local places (n, k, 3) and covariances (n, k, 3, 3) of sources
        that stand, by kind of ground.
        """
        share, mean_m, sigma_m = grounds.T
        precision = sigma_m**-2.0
        information = np.repeat(self.static_information[:, None], len(grounds), axis=1)
        information[..., [0, 1], [0, 1]] += wide_m**-2.0
        information[..., 2, 2] += precision
        pull = np.repeat(self.static_pull[:, None], len(grounds), axis=1)
        raised = mean_m - self.height_m[:, None]
        pull[..., 2] += precision * raised
        inverse = np.linalg.inv(information).astype(np.float64, copy=False)
        place = np.sum(inverse * pull[..., None, :], axis=3)
        fit = np.sum(pull * place, axis=2) - precision * np.square(raised)
        fit = fit + np.log(np.linalg.det(inverse))
        weight = share / sigma_m * np.exp(0.5 * (fit - fit.max(axis=1, keepdims=True)))
        weight = weight / weight.sum(axis=1, keepdims=True)
        return weight[..., None], place, inverse


def _mixture(
    weight: FloatArray, place: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the moments (n, 3) and (n, 3, 3) of mixtures of k components with weights (n, k,
    1).
    """
    mean = np.sum(weight * place, axis=1)
    offset = place - mean[:, None]
    spread = covariance + offset[..., :, None] * offset[..., None, :]
    return mean, np.sum(weight[..., None] * spread, axis=1)


def _line_terms(
    lines: LinesOfSight, reference_m: FloatArray, axes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return W (m, 3, 3), 1/m², d (m, 3), m, and dᵀ W d (m,) of lines, in local axes about
    reference points (m, 3).
    """
    view = reference_m - lines.origin_ecef_m
    square = dot(view, view)
    unit = view / np.sqrt(square)[:, None]
    # The point of the line in the plane through the reference point across the view.
    depth = square / dot(view, lines.direction_ecef)
    offset = depth[:, None] * lines.direction_ecef - view
    along = _components(axes, unit)
    foot = _components(axes, offset)
    scale = 1.0 / (np.square(lines.sigma_rad) * square)
    weight = scale[:, None, None] * (np.eye(3) - along[:, :, None] * along[:, None, :])
    return weight, foot, scale * dot(foot, foot)


def _components(axes: FloatArray, vector: FloatArray) -> FloatArray:
    return np.sum(axes * vector[:, None, :], axis=2)


def _noise_log(lines: LinesOfSight, log_clutter: FloatArray) -> FloatArray:
    """Return the log likelihood (m,) of lines as false alarms over that of detections without
    error.
    """
    return log_clutter[lines.sensor] + np.log(2.0 * np.pi * np.square(lines.sigma_rad))
