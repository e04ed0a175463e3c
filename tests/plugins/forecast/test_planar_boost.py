"""Boosts in a plane: what is computed for vehicles that still burn, and only for these."""

from typing import Any

import numpy as np
import pytest
from boost_law import MISSILE, MODEL
from opir_forecast.burning_on import Steering, drawn_steering
from opir_forecast.planar_boost import PlanarBoost, drawn_stages


@pytest.fixture
def boost() -> PlanarBoost:
    stages = drawn_stages(MODEL, MISSILE, 40, np.random.default_rng(3))
    unguided = np.full(40, np.nan)
    return PlanarBoost(
        stages, drawn_steering(40, MODEL.data, 3), unguided, np.stack([unguided] * 3)
    )


def test_only_vehicles_that_burn_or_will_are_steered(
    boost: PlanarBoost, monkeypatch: pytest.MonkeyPatch
) -> None:
    steered: list[int] = []
    leads = Steering.leads

    def counted(self: Steering, time_s: Any) -> Any:
        steered.append(len(time_s))
        return leads(self, time_s)

    monkeypatch.setattr(Steering, "leads", counted)
    for time_s in (1.0, float(np.median(boost.over_s)) + 1e-3, float(boost.over_s.max()) + 1.0):
        steered.clear()
        force = boost.force(boost.at_rest(), time_s)
        assert sum(steered) == np.count_nonzero(time_s < boost.over_s)
        assert not force[:, time_s >= boost.over_s].any()
    assert boost.force(boost.at_rest(), 0.5 * float(boost.over_s.min())).any()
