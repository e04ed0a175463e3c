"""The prior of a boost's climb, for estimates whose vertical velocity nobody observes."""

import numpy as np
import pytest
from opir_trackers.filter.climb import uncertain_climbs, with_climb_prior

from opir_core.estimation.square_root import covariance

SIZE = 10
ROTATION_M_S = 7.292115e-5 * 6.5e6


def burn(climb_m_s, speed_m_s, sigma_m_s):
    """Return mean and root of a burn over the equator, with its vertical velocity known to `sigma_m_s`."""
    mean = np.zeros((1, SIZE))
    mean[0, :6] = 6.5e6, 0.0, 0.0, climb_m_s, ROTATION_M_S, speed_m_s
    sigma = np.array([1e3] * 3 + [sigma_m_s, 20.0, 20.0] + [5.0] * 3 + [0.01])
    return mean, np.diag(1.0 / sigma)[None]


def uncertain(mean, root):
    """Return whether the climb of a burn is less known than before any look."""
    return len(uncertain_climbs(mean[:, :6], covariance(root)[:, :6, :6])) > 0


def test_a_climb_that_looks_have_shown_is_kept_whatever_the_prior():
    mean, root = burn(-500.0, 3000.0, 50.0)
    assert not uncertain(mean, root)
    after, held = with_climb_prior(mean, root)
    assert np.allclose(after, mean)
    assert covariance(held) == pytest.approx(covariance(root), rel=1e-9, abs=1e-9)


def test_an_unknown_climb_ends_at_the_spread_of_the_prior():
    mean, root = burn(0.0, 3000.0, 4000.0)
    assert uncertain(mean, root)
    after, held = with_climb_prior(mean, root)
    sigma = np.sqrt(covariance(held)[0, 3, 3])
    assert sigma == pytest.approx(0.9 * 1500.0, rel=0.02)
    # A variance that shrinks to a share moves the mean by the rest of the way.
    assert after[0, 3] == pytest.approx(1492.0 * (1.0 - (sigma / 4000.0) ** 2), rel=0.02)
    assert not uncertain(after, held * 1.01)


def test_the_place_is_no_better_known() -> None:
    """The error of the prior is the same at all times: from tick to tick it is no new look at the place."""
    mean, root = burn(0.0, 3000.0, 4000.0)
    root[0, 0, 3] = -root[0, 0, 0] * 10.0
    before, after = (covariance(each)[0] for each in (root, with_climb_prior(mean, root)[1]))
    assert after[:3, :3] == pytest.approx(before[:3, :3], rel=1e-9)
    ties = [each[0, 3] / np.sqrt(each[0, 0] * each[3, 3]) for each in (before, after)]
    assert ties[1] == pytest.approx(ties[0], rel=1e-3)


@pytest.mark.parametrize("climb_m_s", [-3000.0, 0.0, 4000.0])
def test_the_mean_moves_towards_the_prior_and_never_past_it(climb_m_s):
    mean, root = burn(climb_m_s, 3000.0, 3000.0)
    after = with_climb_prior(mean, root)[0][0, 3]
    assert min(climb_m_s, 1500.0) < after < max(climb_m_s, 1500.0)


def test_slow_boosts_climb_slowly():
    slow, fast = (with_climb_prior(*burn(0.0, speed_m_s, 4000.0))[0][0, 3] for speed_m_s in (100.0, 3000.0))
    assert 300.0 < slow < 700.0 < 1200.0 < fast
