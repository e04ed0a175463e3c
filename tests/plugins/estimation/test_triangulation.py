"""Where rays meet that do not meet: from one place, or side by side."""

import numpy as np
import pytest
from opir_estimation import triangulated


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("sigma_rad", [3e-8, 2e-5])
def test_rays_from_one_place_meet_nowhere_and_spoil_no_others(sigma_rad: float) -> None:
    """The second group is two satellites in one slot, and has no range from the first round on."""
    origin = 4.2164e7 * np.array(
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    )
    target = np.array([4.5e6, 4.5e6, 1e5])
    direction = target - origin
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    fixes = triangulated(np.array([0, 0, 1, 1]), 2, origin, direction, np.full(4, sigma_rad))
    assert fixes.position_m[0] == pytest.approx(target, rel=1e-9, abs=1e-3)
    assert np.isnan(fixes.position_m[1]).all()
