"""How probable each hypothesis is for a particle, by where it comes down, or whether it stays in
orbit or glides.

The prior of a missile class is log-uniform in range between its limits. A class is the law of the
vehicles given such a range: the particle's weight times the density of the class over the density
of all boosts of that law at its range (the marginal law, kept in `vehicles.json`). A space launcher
reaches orbit if the burns that remain suffice, but for failures, which are none of these. A
glider's burn ends low and level.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from attrs import field, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.estimation import dot
from opir_core.plugin import Hypothesis
from opir_trackers.forecast.burning_on import RemainingBurns
from opir_trackers.forecast.vehicles import FAMILIES, MISSILE, NONE, SPACE, VehicleModel

#: Lowest height of an orbit, m, and what gravity costs a burn of a second at half of the speed of
#: an orbit, m/s.
_ORBIT_M = 160e3
_LOSS_M_S2 = 3.0

#: Relative error of the needed speed.
_NEED_SIGMA = 0.08


@frozen(eq=False)
class Outcomes:
    """Weights of hypotheses of launches, and of `none`, for particles."""

    model: VehicleModel
    hypotheses: tuple[Hypothesis, ...]
    groups: FloatArray = field(init=False)

    def __attrs_post_init__(self) -> None:
        shares = self.model.data["groups"]
        present = {hypothesis.group for hypothesis in self.hypotheses}
        object.__setattr__(
            self,
            "groups",
            np.array(
                [shares[g] if g in present else 0.0 for g in ("missile", "orbit", "glide", "none")]
            ),
        )

    @property
    def odd(self) -> float:
        """Return the prior weight of vehicles of known classes whose stages are unlike those of
        their family.
        """
        odd: float = self.model.data["odd_vehicles"] * float(self.groups[:3].sum())
        return odd

    @cached_property
    def families(self) -> FloatArray:
        """Return the prior weights (families,) of the families; those of missiles fly gliders
        too.
        """
        missile, orbit, glide, none = self.groups.tolist()
        weights = np.zeros(len(FAMILIES))
        weights[MISSILE] = missile + glide
        weights[SPACE] = orbit
        weights[NONE] = none + self.odd
        return weights

    @cached_property
    def prior(self) -> FloatArray:
        """Return the probabilities (H,) of the hypotheses given a launch, before anything is known
        of it.
        """
        prior = np.zeros(len(self.hypotheses))
        for group, share in zip(
            ("missile", "orbit", "glide", "none"), self.groups.tolist(), strict=True
        ):
            columns = self.columns(group)
            if columns:
                own = (
                    self.unknown_range
                    if group == "missile"
                    else np.full(len(columns), 1.0 / len(columns))
                )
                prior[columns] = share * own
        return prior / prior.sum()

    def columns(self, group: str) -> list[int]:
        """Return the numbers of the hypotheses of a group."""
        return [number for number, one in enumerate(self.hypotheses) if one.group == group]

    @cached_property
    def _ranges(self) -> tuple[FloatArray, FloatArray]:
        """Return the limits (classes, 2) of the missiles' ranges, m, and the shares (classes,) of
        their priors.
        """
        missiles = [self.hypotheses[number] for number in self.columns("missile")]
        limits = np.array([_limits_m(one) for one in missiles]).reshape(-1, 2)
        priors = np.array([self.model.data["classes"].get(one.name, 1.0) for one in missiles])
        return limits, priors

    def missiles(self, range_m: FloatArray) -> FloatArray:
        """Return the densities (p, classes) of missile classes at ranges (p,), over that of all
        boosts; 0 at nan.

        Ranges are log-uniform between the least and the greatest; classes that cover a range share
        it.
        """
        limits, priors = self._ranges
        inside = (range_m[:, None] >= limits[:, 0]) & (range_m[:, None] <= limits[:, 1])
        share = np.where(inside, priors, 0.0)
        share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-9) * np.log(
            limits[:, 1].max() / limits[:, 0].min()
        )
        marginal = self.model.data["marginal"]
        nodes = np.log(1e3 * np.array(marginal["range_km"]))
        at = np.interp(
            np.log(np.maximum(np.nan_to_num(range_m), 1.0)), nodes, np.log(marginal["density"])
        )
        weights: FloatArray = share * np.exp(-at)[:, None]
        return weights

    def climbing(self, range_m: FloatArray, angle_rad: FloatArray) -> FloatArray:
        """Return the density (p,) of missiles that end their boosts at an elevation over that of
        all boosts.

        They end them near the elevation of the arc of least energy, lofted or depressed: the
        logarithm of the ratio of tangents is normal, but for a share of any. 1 without a range.
        """
        law = self.model.data["elevation"]
        (mean, sigma, climb) = self.model.data["marginal"]["elevation"]
        log = log_elevation(range_m, angle_rad)
        own = np.exp(-0.5 * np.square(log / law["sigma"])) / law["sigma"]
        every = climb / sigma * np.exp(-0.5 * np.square((log - mean) / sigma))
        share = (1.0 - law["any"]) * own / np.maximum(every, 1e-3) + law["any"]
        return np.where(np.isnan(range_m), 1.0, share)

    @property
    def unknown_range(self) -> FloatArray:
        """Return the densities (classes,) of missile classes, over that of all boosts, where the
        range is unknown.
        """
        _, priors = self._ranges
        share: FloatArray = priors / priors.sum()
        return share

    def gliding(
        self, height_m: FloatArray, angle_rad: FloatArray, speed_m_s: FloatArray
    ) -> FloatArray:
        """Return the density (p,) of ends of burns for gliders, over that of all boosts."""
        box = self.model.data["glide"]
        marginal = self.model.data["marginal"]
        low, high = np.multiply(box["height_km"], 1e3)
        steep = np.radians(box["angle_deg"])
        is_in = (
            (height_m > low) & (height_m < high) & (angle_rad > steep[0]) & (angle_rad < steep[1])
        )
        return np.where(is_in & (speed_m_s > box["least_m_s"]), 1.0 / marginal["glide"], 0.0)

    def reaching(self, state: FloatArray, burns: RemainingBurns) -> FloatArray:
        """Return the probability (p,) that the burns suffice for an orbit, over that of all space
        launchers.
        """
        radius = np.sqrt(dot(state[:, :3], state[:, :3]))
        climb = dot(state[:, :3], state[:, 3:6]) / radius
        level = np.sqrt(np.maximum(dot(state[:, 3:6], state[:, 3:6]) - climb * climb, 0.0))
        orbit = np.maximum(radius, EARTH_RADIUS_M + _ORBIT_M)
        circular = np.sqrt(EARTH_MU_M3_S2 / orbit)
        rise = np.sqrt(2.0 * 9.0 * np.maximum(orbit - radius, 0.0))
        gain = np.hypot(
            np.maximum(circular - level, 0.0),
            np.maximum(np.abs(rise - climb), 0.0) * (circular > level),
        )
        loss = (
            _LOSS_M_S2 * burns.burn_s.sum(axis=1) * np.clip(1.0 - (level / circular) ** 2, 0.0, 1.0)
        )
        need = gain + np.minimum(loss, 0.15 * gain)
        away = (burns.ideal_speed_m_s - need) / (_NEED_SIGMA * need + 30.0)
        reach: FloatArray = 1.0 / (1.0 + np.exp(-np.clip(2.0 * away, -50.0, 50.0)))
        return reach / self.model.data["marginal"]["orbit"]


EARTH_RADIUS_M = 6371e3


#: Tangent of the elevation of boosts that end level or descend.
LEVEL = 1e-3


def log_elevation(range_m: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the logarithms (p,) of tangents of elevations over those of the arcs of least energy
    over ranges, m.

    The latter are at (π - ψ) / 4, with ψ the angle of the range (Bate, Mueller and White,
    Fundamentals of Astrodynamics, 1971, 6.2). What descends counts as level.
    """
    swept = np.minimum(np.nan_to_num(range_m, nan=1e6) / EARTH_RADIUS_M, 0.99 * np.pi)
    return np.log(np.maximum(np.tan(angle_rad), LEVEL) / np.tan(0.25 * (np.pi - swept)))


def _limits_m(hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the least and the largest range of a class."""
    assert hypothesis.target_class is not None
    profiles = hypothesis.target_class.profiles
    least = min(profile.minimum_range_m for profile in profiles)
    return max(least, 50e3), max(profile.maximum_range_m for profile in profiles)


def hypothesis_log_likelihood(
    types: FloatArray, hypotheses: Sequence[Hypothesis], names: Sequence[str]
) -> FloatArray:
    """Return the log likelihoods (n, hypotheses) of sensors' reports from those of true types (n,
    types), `names`.

    A class is reported like the type that it resembles; what is no launch, like any of them.
    """
    columns = [
        types[:, names.index(one.target_class.resembles)]
        if one.target_class
        else np.logaddexp.reduce(types, axis=1) - np.log(types.shape[1])
        for one in hypotheses
    ]
    return np.stack(columns, axis=1)
