"""Type probabilities from the reports of sensors."""

import numpy as np
import pytest
from opir_trackers.imm.report import type_log_likelihoods, type_posterior

from opir_core.scene.scene import REPORTED_TYPES
from opir_core.testing.doubles import stub_sensor


def test_each_sensor_counts_once_for_the_type() -> None:
    confusion = {
        "ICBM": {"ICBM": 0.8, "IRBM": 0.1, "SRBM": 0.02, "UNKNOWN": 0.08},
        "IRBM": {"ICBM": 0.12, "IRBM": 0.72, "SRBM": 0.08, "UNKNOWN": 0.08},
        "SRBM": {"ICBM": 0.03, "IRBM": 0.1, "SRBM": 0.77, "UNKNOWN": 0.1},
    }
    evidence = type_log_likelihoods(
        [stub_sensor("A", confusion=confusion), stub_sensor("B", confusion=confusion), stub_sensor()]
    )
    unknown = REPORTED_TYPES.index("UNKNOWN")
    told = type_posterior(np.array([[0, -1, -1], [0, 0, 2], [-1, unknown, -1]]), evidence)
    assert told[0] == pytest.approx(np.array([0.8, 0.12, 0.03, 0.0]) / 0.95)
    assert told[1] == pytest.approx(np.array([0.64, 0.0144, 0.0009, 0.0]) / 0.6553)
    assert told[2].tolist() == [0.0, 0.0, 0.0, 1.0]
