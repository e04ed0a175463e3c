"""The law of stages: against the normal law of all rows at once, and the marginal law of ranges
that the wheel keeps."""

import numpy as np
import pytest
from boost_law import BURN, GAP, MISSILE, MODEL, NONE, SPACE, STAGES
from opir_forecast.marginals import marginal_of
from opir_forecast.present_burn import present_burns


def joint(family: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean (16,) and covariance (16, 16) of the rows of four stages, by the definition of
    the model.
    """
    upper = (np.arange(STAGES) > 0).astype(int)
    mean = MODEL.median_log[family, upper].ravel()
    sigma = MODEL.sigma[family, upper].ravel()
    correlation = np.zeros((16, 16))
    for row in range(4):
        block = np.full((STAGES, STAGES), MODEL.coupling[family, row])
        np.fill_diagonal(block, 1.0)
        correlation[row::4, row::4] = block
    return mean, correlation * np.outer(sigma, sigma)


def log_density(family: int, rows: np.ndarray) -> float:
    """Return the log density of the first rows (m,) of a family's stages, without (2 π)^(-m/2)."""
    mean, covariance = joint(family)
    size = len(rows)
    residual = rows - mean[:size]
    covariance = covariance[:size, :size]
    square = residual @ np.linalg.solve(covariance, residual)
    return float(-0.5 * square - 0.5 * np.linalg.slogdet(covariance)[1])


@pytest.mark.parametrize("family", [MISSILE, SPACE, NONE])
@pytest.mark.parametrize("done", [1, 2, 3])
def test_the_next_stage_is_that_of_the_joint_normal_law(family: int, done: int) -> None:
    mean, covariance = joint(family)
    drawn = mean + np.random.default_rng(done).normal(size=16) * np.sqrt(np.diag(covariance))
    logs = np.full((1, STAGES, 4), np.nan)
    logs[0, :done] = drawn.reshape(STAGES, 4)[:done]
    law_of_next = MODEL.given(logs)
    past = slice(0, 4 * done)
    following = slice(4 * done, 4 * done + 4)
    gain = np.linalg.solve(covariance[past, past], covariance[past, following]).T
    scores = law_of_next.total[:, family], law_of_next.number[:, family]
    stage_mean, sigma = MODEL.law(np.array([family]), np.array([done]), *scores)
    assert stage_mean[0] == pytest.approx(mean[following] + gain @ (drawn - mean)[past])
    residual = covariance[following, following] - gain @ covariance[past, following]
    assert sigma[0] ** 2 == pytest.approx(np.diag(residual))
    # A tenth of the records is of no use: then they are those of anything.
    useless = np.log(0.1) + log_density(NONE, drawn[past])
    expected = np.logaddexp(log_density(family, drawn[past]), useless)
    assert law_of_next.log_evidence[0, family] == pytest.approx(expected)


def test_unknown_rows_do_not_count_and_hot_staging_comes_again() -> None:
    logs = np.full((2, STAGES, 4), np.nan)
    logs[:, 0] = MODEL.median_log[MISSILE, 0]
    logs[:, 0, GAP] = np.nan, -np.inf
    law_of_next = MODEL.given(logs)
    assert law_of_next.number[:, MISSILE, GAP].tolist() == [0.0, 0.0]
    assert law_of_next.number[:, MISSILE, BURN].tolist() == [1.0, 1.0]
    assert law_of_next.hot[1, MISSILE] > MODEL.hot[MISSILE] == law_of_next.hot[0, MISSILE]


@pytest.fixture(scope="module")
def burning() -> np.ndarray:
    """Return force, growth and burn time (3, n) of those of 2 000 000 drawn stages that burn after
    40 s.
    """
    count = 2_000_000
    (mean,), (sigma,) = MODEL.law(np.zeros(1, int), np.zeros(1, int), *np.zeros((2, 1, 4)))
    normal = np.random.default_rng(6).normal(size=(4, count))
    burn, force, ratio, _ = np.exp(mean[:, None] + sigma[:, None] * normal)
    rate = (1.0 - 1.0 / ratio) / burn
    mass = 1.0 - 40.0 * rate
    return np.stack([force / mass, rate / mass, burn])[:, burn > 40.0]


@pytest.mark.parametrize(("force", "growth"), [(30.0, 0.014), (22.0, 0.008), (45.0, 0.022)])
def test_the_evidence_of_a_burn_is_the_density_of_its_law(
    burning: np.ndarray, force: float, growth: float
) -> None:
    """Boosts are drawn by the law, seen at one time: those near a force and growth, counted,
    against the evidence.
    """
    is_near = (np.abs(burning[0] - force) < 1.5) & (np.abs(burning[1] - growth) < 0.001)
    density = np.count_nonzero(is_near) / 2_000_000 / (3.0 * 0.002)
    law = MODEL.law(np.zeros(1, int), np.zeros(1, int), *np.zeros((2, 1, 4)))
    result = present_burns(np.array([force]), np.array([growth]), np.array([40.0]), law)
    # The normalisation (2 π)^(3/2) is the same for all families, and left out.
    evidence = np.exp(result.log_evidence[0]) * (2.0 * np.pi) ** -1.5
    assert evidence == pytest.approx(density, rel=0.1)
    shares = np.array([0.1, 0.5, 0.9])
    quantiles = np.quantile(burning[2, is_near], shares)
    assert result.burn_s(np.zeros(3, dtype=np.int64), shares) == pytest.approx(quantiles, rel=0.04)


@pytest.mark.slow
def test_the_marginal_law_of_ranges_is_that_of_other_flights() -> None:
    marginal = marginal_of(MODEL, 20000, 7)
    stored = MODEL.data["marginal"]
    assert marginal["range_km"] == stored["range_km"]
    # 20 000 boosts: 4 % of a density of 0.2 in kernels of 0.2.
    tolerances = {"density": 0.25, "elevation": 0.1, "glide": 0.15, "orbit": 0.05}
    for name, tolerance in tolerances.items():
        assert marginal[name] == pytest.approx(stored[name], rel=tolerance)
