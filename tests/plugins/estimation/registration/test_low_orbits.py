"""Low orbits: a second sensor sees a target first where a lone one has left it open by tens of
kilometres.
"""

import numpy as np
import pytest

import opir_core as opir


@pytest.mark.slow
def test_perfect_low_sensors_have_no_bias() -> None:
    changes = [
        "sensors=[{constellation: LEO-MEDIUM, line_of_sight_sigma_urad: 0}]",
        "tracker=imm",
        "outputs=[]",
    ]
    scene = opir.load_scene(
        "tests/scenes/pacific_test_range.yaml", overrides=[*changes, "duration_s=100"]
    )
    rows = [row for row in opir.simulate(scene).summary["sensors"] if row["detections"]]
    assert len(rows) > 2
    assert np.abs([row["health"]["bias_rad"] for row in rows]).max() < 1e-6
    assert np.max([row["health"]["bias_sigma_rad"] for row in rows]) < 1e-6
