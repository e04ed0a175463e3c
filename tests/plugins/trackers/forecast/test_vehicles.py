"""The law of stages: against the normal law of all rows at once, and the marginal law of ranges
that the wheel keeps."""

import numpy as np
import pytest
from opir_trackers.forecast.marginals import marginal_of
from opir_trackers.forecast.present_burn import present_burns
from opir_trackers.forecast.vehicles import BURN, GAP, MISSILE, NONE, SPACE, STAGES, vehicle_model


def joint(family: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (16,) and covariance (16, 16) of the rows of four stages, by the definition of
    the model.
    """
    model = vehicle_model()
    upper = (np.arange(STAGES) > 0).astype(int)
    mean = model.median_log[family, upper].ravel()
    sigma = model.sigma[family, upper].ravel()
    correlation = np.zeros((16, 16))
    for row in range(4):
        block = np.full((STAGES, STAGES), model.coupling[family, row])
        np.fill_diagonal(block, 1.0)
        correlation[row::4, row::4] = block
    return mean, correlation * np.outer(sigma, sigma)


@pytest.mark.parametrize("family", [MISSILE, SPACE, NONE])
@pytest.mark.parametrize("done", [1, 2, 3])
def test_the_next_stage_given_earlier_ones_is_that_of_the_joint_normal_law(
    family: int, done: int
) -> None:
    model = vehicle_model()
    mean, covariance = joint(family)
    rng = np.random.default_rng(done)
    logs = np.full((1, STAGES, 4), np.nan)
    logs[0, :done] = (mean + rng.normal(size=16) * np.sqrt(np.diag(covariance))).reshape(STAGES, 4)[
        :done
    ]
    known = model.given(logs)
    here = slice(0, 4 * done)
    there = slice(4 * done, 4 * done + 4)
    gain = np.linalg.solve(covariance[here, here], covariance[here, there]).T
    away = logs[0, :done].ravel() - mean[here]
    found = model.law(
        np.array([family]), np.array([done]), known.total[:, family], known.number[:, family]
    )
    assert found[0][0] == pytest.approx(mean[there] + gain @ away)
    assert found[1][0] ** 2 == pytest.approx(
        np.diag(covariance[there, there] - gain @ covariance[here, there])
    )
    log = (
        -0.5 * away @ np.linalg.solve(covariance[here, here], away)
        - 0.5 * np.linalg.slogdet(covariance[here, here])[1]
    )
    # A tenth of the records is of no use: then they are those of anything.
    broad = joint(NONE)
    off = logs[0, :done].ravel() - broad[0][here]
    other = (
        -0.5 * off @ np.linalg.solve(broad[1][here, here], off)
        - 0.5 * np.linalg.slogdet(broad[1][here, here])[1]
    )
    assert known.log_evidence[0, family] == pytest.approx(np.logaddexp(log, np.log(0.1) + other))


def test_unknown_rows_say_nothing_and_hot_staging_says_that_it_comes_again() -> None:
    model = vehicle_model()
    logs = np.full((2, STAGES, 4), np.nan)
    logs[:, 0] = model.median_log[MISSILE, 0]
    logs[0, 0, GAP] = np.nan
    logs[1, 0, GAP] = -np.inf
    known = model.given(logs)
    assert known.number[:, MISSILE, GAP].tolist() == [0.0, 0.0]
    assert known.number[:, MISSILE, BURN].tolist() == [1.0, 1.0]
    assert known.hot[1, MISSILE] > model.hot[MISSILE] == known.hot[0, MISSILE]


def test_the_evidence_of_a_burn_is_the_density_of_forces_and_growths_of_its_law() -> None:
    """Boosts are drawn by the law, seen at one time: those near a force and growth, counted,
    against the evidence.
    """
    model = vehicle_model()
    rng = np.random.default_rng(6)
    count = 2_000_000
    since = 40.0
    mean, sigma = (
        part[0]
        for part in model.law(np.array([0]), np.array([0]), np.zeros((1, 4)), np.zeros((1, 4)))
    )
    burn, first, ratio, _ = np.exp(mean[:, None] + sigma[:, None] * rng.normal(size=(4, count)))
    rate = (1.0 - 1.0 / ratio) / burn
    on = burn > since
    force = (first / (1.0 - rate * since))[on]
    growth = (rate / (1.0 - rate * since))[on]
    for there in ((30.0, 0.014), (22.0, 0.008), (45.0, 0.022)):
        near = (np.abs(force - there[0]) < 1.5) & (np.abs(growth - there[1]) < 0.001)
        density = np.count_nonzero(near) / count / (3.0 * 0.002)
        found = present_burns(
            np.array([there[0]]), np.array([there[1]]), np.array([since]), (mean[None], sigma[None])
        )
        # The normalisation (2 π)^(3/2) is the same for all families, and left out.
        assert np.exp(found.log_evidence[0]) * (2.0 * np.pi) ** -1.5 == pytest.approx(
            density, rel=0.1
        )
        left = np.sort(burn[on][near])
        shares = np.array([0.1, 0.5, 0.9])
        drawn = found.burn_s(np.zeros(3, dtype=np.int64), shares)
        assert drawn == pytest.approx(np.quantile(left, shares), rel=0.04)


@pytest.mark.slow
def test_the_marginal_law_of_ranges_is_that_of_fresh_flights() -> None:
    model = vehicle_model()
    found = marginal_of(model, 20000, 7)
    kept = model.data["marginal"]
    assert found["range_km"] == kept["range_km"]
    # 20 000 boosts: 4 % of a density of 0.2 in kernels of 0.2.
    assert found["density"] == pytest.approx(kept["density"], rel=0.25)
    assert found["elevation"] == pytest.approx(kept["elevation"], rel=0.1)
    assert found["glide"] == pytest.approx(kept["glide"], rel=0.15)
    assert found["orbit"] == pytest.approx(kept["orbit"], rel=0.05)
