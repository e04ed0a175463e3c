"""How probable each hypothesis is for a particle, by where it comes down, or whether it stays in
orbit or glides.

The prior of a missile class is log-uniform in range between its limits. A class is the law of the
vehicles given such a range: the particle's weight times the density of the class over the density
of all boosts of that law at its range (the marginal law, kept in `vehicles.json`). A space launcher
reaches orbit if the burns that remain suffice, but for failures, which belong to `none`. A glider's
burn ends low and level.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from attrs import frozen
from opir_estimation import dot, law_parameters

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.plugin import Hypothesis
from opir_forecast.burning_on import RemainingBurns
from opir_forecast.vehicles import FAMILIES, VehicleModel

LAW = law_parameters("opir_forecast", "orbits")

EARTH_RADIUS_M = 6371e3

#: Groups of hypotheses of launches.
GROUPS = ("missile", "orbit", "glide", "none")

#: Tangent of the elevation of boosts that end level or descend.
LEVEL = 1e-3


@frozen(eq=False)
class Outcomes:
    """Weights of hypotheses of launches, and of `none`, for particles."""

    model: VehicleModel
    hypotheses: tuple[Hypothesis, ...]

    @cached_property
    def groups(self) -> FloatArray:
        """Return the prior weights (4,) of `GROUPS`; 0 for groups without a hypothesis."""
        shares = self.model.data["groups"]
        return np.array([shares[group] if self.columns(group) else 0.0 for group in GROUPS])

    @property
    def odd(self) -> float:
        """Return the prior weight of vehicles of known classes whose stages are unlike those of
        their family.
        """
        return float(self.model.data["odd_vehicles"] * float(self.groups[:3].sum()))

    @cached_property
    def families(self) -> FloatArray:
        """Return the prior weights (families,) of the families; those of missiles fly gliders
        too.
        """
        missile, orbit, glide, none = self.groups.tolist()
        weights = {"missile": missile + glide, "space": orbit, "none": none + self.odd}
        return np.array([weights[family] for family in FAMILIES])

    @cached_property
    def prior(self) -> FloatArray:
        """Return the probabilities (H,) of the hypotheses given a launch, before anything is known
        of it.
        """
        prior = np.zeros(len(self.hypotheses))
        for group, share in zip(GROUPS, self.groups.tolist(), strict=True):
            columns = self.columns(group)
            even = np.full(len(columns), 1.0 / max(len(columns), 1))
            prior[columns] = share * (self.unknown_range if group == "missile" else even)
        return prior / prior.sum()

    def by_reports(self, log_likelihood: FloatArray) -> FloatArray:
        """Return the probabilities (n, H) of the hypotheses given a launch, by their prior and the
        log likelihoods (n, H) of sensors' reports.
        """
        share = np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True)) * self.prior
        return share / share.sum(axis=1, keepdims=True)

    def columns(self, group: str) -> list[int]:
        """Return the numbers of the hypotheses of a group."""
        return [
            number for number, hypothesis in enumerate(self.hypotheses) if hypothesis.group == group
        ]

    @cached_property
    def _ranges(self) -> tuple[FloatArray, FloatArray]:
        """Return the limits (classes, 2) of the missiles' ranges, m, and the shares (classes,) of
        their priors.
        """
        missiles = [self.hypotheses[number] for number in self.columns("missile")]
        limits = np.array([_limits_m(missile) for missile in missiles]).reshape(-1, 2)
        classes = self.model.data["classes"]
        return limits, np.array([classes.get(missile.name, 1.0) for missile in missiles])

    def missiles(self, range_m: FloatArray) -> FloatArray:
        """Return the densities (p, classes) of missile classes at ranges (p,), over that of all
        boosts; 0 at nan.

        Ranges are log-uniform between the least and the greatest; classes that cover a range share
        it.
        """
        limits, priors = self._ranges
        inside = (range_m[:, None] >= limits[:, 0]) & (range_m[:, None] <= limits[:, 1])
        share = np.where(inside, priors, 0.0)
        span = np.log(limits[:, 1].max() / limits[:, 0].min())
        share /= np.maximum(share.sum(axis=1, keepdims=True), 1e-9) * span
        return share * np.exp(-self._log_marginal(range_m))[:, None]

    def _log_marginal(self, range_m: FloatArray) -> FloatArray:
        """Return the log densities (p,) of all boosts at ranges (p,)."""
        marginal = self.model.data["marginal"]
        log_m = np.log(np.maximum(np.nan_to_num(range_m), 1.0))
        nodes = np.log(1e3 * np.array(marginal["range_km"]))
        return np.interp(log_m, nodes, np.log(marginal["density"]))

    def climbing(self, range_m: FloatArray, angle_rad: FloatArray) -> FloatArray:
        """Return the density (p,) of missiles that end their boosts at an elevation over that of
        all boosts.

        They end them near the elevation of the arc of least energy, lofted or depressed: the
        logarithm of the ratio of tangents is normal, but for a share of any. 1 without a range.
        """
        law = self.model.data["elevation"]
        mean, sigma, climb = self.model.data["marginal"]["elevation"]
        log = log_elevation(range_m, angle_rad)
        missile = np.exp(-0.5 * np.square(log / law["sigma"])) / law["sigma"]
        marginal = climb / sigma * np.exp(-0.5 * np.square((log - mean) / sigma))
        share = (1.0 - law["any"]) * missile / np.maximum(marginal, 1e-3) + law["any"]
        return np.where(np.isnan(range_m), 1.0, share)

    @property
    def unknown_range(self) -> FloatArray:
        """Return the densities (classes,) of missile classes, over that of all boosts, where the
        range is unknown.
        """
        _, priors = self._ranges
        return priors / priors.sum()

    def gliding(
        self, height_m: FloatArray, angle_rad: FloatArray, speed_m_s: FloatArray
    ) -> FloatArray:
        """Return the density (p,) of ends of burns for gliders, over that of all boosts."""
        glides = is_glide(self.model, height_m, angle_rad, speed_m_s)
        return np.where(glides, 1.0 / self.model.data["marginal"]["glide"], 0.0)

    def reaching(self, state: FloatArray, burns: RemainingBurns) -> FloatArray:
        """Return the probability (p,) that the burns suffice for an orbit, over that of all space
        launchers.
        """
        needed = _needed_speed(state, burns.burn_s.sum(axis=1))
        sigma = LAW.speed_error * needed + LAW.least_error_m_s
        score = np.clip(2.0 * (burns.ideal_speed_m_s - needed) / sigma, -50.0, 50.0)
        reach: FloatArray = 1.0 / (1.0 + np.exp(-score))
        return reach / self.model.data["marginal"]["orbit"]


def _needed_speed(state: FloatArray, burn_s: FloatArray) -> FloatArray:
    """Return the speed (p,), m/s, that a state (p, 6) lacks for an orbit, gravity losses of burns
    included.
    """
    radius, climb, level = _climb_and_level(state)
    orbit = np.maximum(radius, EARTH_RADIUS_M + LAW.lowest_m)
    circular = np.sqrt(EARTH_MU_M3_S2 / orbit)
    rise = np.sqrt(2.0 * 9.0 * np.maximum(orbit - radius, 0.0))
    lift = np.maximum(np.abs(rise - climb), 0.0) * (circular > level)
    gain = np.hypot(np.maximum(circular - level, 0.0), lift)
    loss = LAW.gravity_loss_m_s2 * burn_s * np.clip(1.0 - (level / circular) ** 2, 0.0, 1.0)
    return gain + np.minimum(loss, LAW.largest_loss * gain)


def _climb_and_level(state: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the radius, m, and the vertical and level speeds, m/s, (p,) of states (p, 6)."""
    position = state[:, :3]
    velocity = state[:, 3:6]
    radius = np.sqrt(dot(position, position))
    climb = dot(position, velocity) / radius
    return radius, climb, np.sqrt(np.maximum(dot(velocity, velocity) - climb * climb, 0.0))


def is_glide(
    model: VehicleModel, height_m: FloatArray, angle_rad: FloatArray, speed_m_s: FloatArray
) -> BoolArray:
    """Whether burns (p,) end as low, as level and as fast as those of gliders."""
    law = model.data["glide"]
    low, high = np.multiply(law["height_km"], 1e3)
    down, up = np.radians(law["angle_deg"])
    is_low = (height_m > low) & (height_m < high)
    is_level = (angle_rad > down) & (angle_rad < up)
    return is_low & is_level & (speed_m_s > law["least_m_s"])


def log_elevation(range_m: FloatArray, angle_rad: FloatArray) -> FloatArray:
    """Return the logarithms (p,) of tangents of elevations over those of the arcs of least energy
    over ranges, m.

    The latter are at (π - ψ) / 4, with ψ the angle of the range (Bate, Mueller and White,
    Fundamentals of Astrodynamics, 1971, 6.2). A descent counts as level.
    """
    swept = np.minimum(np.nan_to_num(range_m, nan=1e6) / EARTH_RADIUS_M, 0.99 * np.pi)
    return np.log(np.maximum(np.tan(angle_rad), LEVEL) / np.tan(0.25 * (np.pi - swept)))


def _limits_m(hypothesis: Hypothesis) -> tuple[float, float]:
    """Return the least and the largest range of a class."""
    assert hypothesis.target_class is not None
    profiles = hypothesis.target_class.profiles
    shortest = min(profile.minimum_range_m for profile in profiles)
    return max(shortest, 50e3), max(profile.maximum_range_m for profile in profiles)


def hypothesis_log_likelihood(
    types: FloatArray, hypotheses: Sequence[Hypothesis], names: Sequence[str]
) -> FloatArray:
    """Return the log likelihoods (n, hypotheses) of sensors' reports from those of true types (n,
    types), `names`.

    A class is reported like the type that it resembles; without a launch, like any of them.
    """
    total = np.logaddexp.reduce(types, axis=1, keepdims=True) - np.log(types.shape[1])
    columns = [
        names.index(hypothesis.target_class.resembles) if hypothesis.target_class else len(names)
        for hypothesis in hypotheses
    ]
    return np.concatenate([types, total], axis=1)[:, columns]
