"""Where false alarms come from: directions uniform over the solid angle of a field of view about
nadir.
"""

import numpy as np
import pytest

from opir_core.simulation.false_alarms import _directions

#: Sensors over the poles, where no direction is east, and elsewhere.
PLACES_M = [
    (0.0, 0.0, 4.2e7),
    (0.0, 0.0, -4.2e7),
    (-0.0, 0.0, 7e6),
    (4.2e7, 0.0, 0.0),
    (1e-300, 0.0, 7e6),
    (3e6, -4e6, 5e6),
]


@pytest.mark.parametrize("place", PLACES_M, ids=str)
def test_directions_turn_evenly_about_nadir_also_over_a_pole(
    place: tuple[float, float, float],
) -> None:
    turns = 8
    edge = 0.01
    at_m = np.tile(place, (turns, 1))
    radius_m = np.full(turns, np.hypot(np.hypot(*place[:2]), place[2]))
    draws = np.column_stack(
        [np.zeros(turns), np.linspace(0.1, 1.0, turns), np.arange(turns) / turns]
    )
    units = _directions(at_m, radius_m, np.full(turns, edge), draws)
    nadir = -at_m / radius_m[:, None]
    assert np.linalg.norm(units, axis=1) == pytest.approx(np.ones(turns), abs=1e-15)
    fall = 1.0 - (units * nadir).sum(axis=1)
    assert fall == pytest.approx(edge * draws[:, 1], abs=1e-15)
    across = units - (1.0 - fall)[:, None] * nadir
    across /= np.linalg.norm(across, axis=1)[:, None]
    steps = (across * np.roll(across, -1, axis=0)).sum(axis=1)
    assert steps == pytest.approx(np.full(turns, np.cos(2.0 * np.pi / turns)), abs=1e-12)
