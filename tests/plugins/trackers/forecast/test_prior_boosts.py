"""Boosts of the prior: the rocket equation, SciPy's integrator, the stated limits, and independence of the presets."""

import numpy as np
import pytest
from opir_trackers.forecast.prior_boosts import (
    STAGES,
    BoostPrograms,
    acceleration,
    class_codes,
    prior_boosts,
    priors,
)
from scipy.integrate import solve_ivp

from opir_core.scene.scene import TARGET_TYPES

RADIUS_M, MU = 6378137.0, 3.986004418e14


def test_a_stage_gains_what_the_rocket_equation_says() -> None:
    """Over a burn T with growth c, the integral of A / (1 - c t) is -A ln(1 - c T) / c."""
    programs = prior_boosts().programs.take(np.arange(50))
    for row in range(50):
        one = programs.take(np.array([row]))
        times = np.linspace(0.0, float(one.burn_s[0, 0]) * (1.0 - 1e-9), 20001)
        sizes = acceleration(one, times[:, None])[0][:, 0]
        growth = one.growth_per_s[0, 0]
        gained = -one.acceleration_m_s2[0, 0] * np.log1p(-growth * one.burn_s[0, 0]) / growth
        assert np.trapezoid(sizes, times) == pytest.approx(gained, rel=1e-6)


def flown(program: BoostPrograms) -> float:
    """Return the range of a boost by another integrator, from the equations in polar coordinates."""
    burns = [
        (float(start), float(start + burn), float(size), float(growth))
        for start, burn, size, growth in zip(
            program.starts_s[0], program.burn_s[0], program.acceleration_m_s2[0], program.growth_per_s[0], strict=True
        )
        if burn > 0.0
    ]

    def rates(time_s: float, state: np.ndarray) -> list[float]:
        radius, _, climb, across = state
        size = sum(a / (1.0 - c * (time_s - one)) for one, two, a, c in burns if one <= time_s < two)
        speed = np.hypot(climb, across)
        angle = np.arctan2(climb, across) if time_s >= program.rise_s[0] and speed >= 1.0 else np.pi / 2
        angle -= float(program.leads(np.array([time_s]))[0])
        up, ahead = size * np.sin(angle), size * np.cos(angle)
        return [climb, across / radius, across**2 / radius - MU / radius**2 + up, ahead - climb * across / radius]

    def ground(_time_s: float, state: np.ndarray) -> float:
        return float(state[0]) - RADIUS_M

    ground.terminal, ground.direction = True, -1.0  # type: ignore[attr-defined]
    state, now = np.array([RADIUS_M, 0.0, 0.0, 0.0]), 0.0
    rise, over = float(program.rise_s[0]), float(program.over_s[0])
    edges = sorted({0.0, rise, rise + over, *(edge for burn in burns for edge in burn[:2])})
    for edge in [edge for edge in edges if 0.0 < edge <= burns[-1][1]]:
        state, now = solve_ivp(rates, (now, edge), state, rtol=1e-9, atol=1e-3, method="DOP853").y[:, -1], edge
    fall = solve_ivp(rates, (now, now + 8000.0), state, events=ground, rtol=1e-9, atol=1e-3, method="DOP853")
    return RADIUS_M * float(fall.y_events[0][0][1])


@pytest.mark.slow
def test_ranges_are_those_of_another_integrator() -> None:
    """Steps of 2 s: half within 2 %; steep boosts, which steps turn elsewhere, within the 30 % of the kernel."""
    prior = prior_boosts()
    rows = np.random.default_rng(4).choice(len(prior.range_m), 40, replace=False)
    ratio = [flown(prior.programs.take(rows[k : k + 1])) / prior.range_m[rows[k]] for k in range(40)]
    assert np.median(np.abs(np.log(ratio))) < 0.02
    assert np.quantile(np.abs(np.log(ratio)), 0.9) < 0.3


def test_boosts_are_within_the_stated_limits_and_of_all_kinds() -> None:
    prior, ranges = prior_boosts(), priors()
    used = prior.programs.burn_s > 0.0
    assert np.all(prior.range_m >= 1e3 * ranges["ranges_km"][0])
    assert np.all(prior.range_m <= 1e3 * ranges["ranges_km"][1])
    assert np.all(prior.programs.acceleration_m_s2[used] <= ranges["acceleration_m_s2"][1])
    assert np.all(prior.programs.gap_s <= ranges["gap_s"][1])
    assert set(used.sum(axis=1).tolist()) == set(range(1, STAGES + 1))
    # A gap follows every stage but the last, unless the next one starts hot.
    has_next = np.concatenate([used[:, 1:], np.zeros((len(used), 1), dtype=bool)], axis=1)
    assert not prior.programs.gap_s[~has_next].any()
    hot = prior.programs.gap_s[has_next] == 0.0
    sigma = np.sqrt(ranges["no_gap_probability"] * (1.0 - ranges["no_gap_probability"]) / len(hot))
    assert abs(hot.mean() - ranges["no_gap_probability"]) < 4.0 * sigma
    weight = np.exp(prior.log_weight)
    shares = [weight[prior.class_code == code].sum() / weight.sum() for code in range(len(TARGET_TYPES))]
    assert min(shares) > 0.1


def test_classes_by_range() -> None:
    names = [TARGET_TYPES[code] for code in class_codes(np.array([2e5, 9.99e5, 1.01e6, 5.4e6, 5.6e6, 1.2e7]))]
    assert names == ["SRBM", "SRBM", "IRBM", "IRBM", "ICBM", "ICBM"]


def test_instants_are_in_order_and_burn() -> None:
    prior = prior_boosts()
    assert np.all(np.diff(prior.time_s) >= 0.0)
    assert np.all(prior.features[:, 3] > 0.0)
    sizes, stage = acceleration(prior.programs.take(prior.boost[:500]), prior.time_s[:500])
    assert np.all(sizes > 0.0)
    assert np.array_equal(stage, prior.stage[:500])
