"""Type probabilities: from the reports of sensors, and from the forecast where there is one."""

import numpy as np
import pytest
from drawn_flights import flown
from opir_forecast.outcomes import Outcomes
from opir_forecast.vehicles import vehicle_model
from opir_testing.doubles import stub_sensor
from opir_trackers.imm.report import type_evidence, type_log_likelihoods
from tracked_flights import last_reported, usual

from opir_core.scene import core_hypotheses
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES, UNKNOWN_TYPE


def test_each_sensor_counts_once_for_the_type() -> None:
    confusion = {
        "ICBM": {"ICBM": 0.8, "IRBM": 0.1, "SRBM": 0.02, "UNKNOWN": 0.08},
        "IRBM": {"ICBM": 0.12, "IRBM": 0.72, "SRBM": 0.08, "UNKNOWN": 0.08},
        "SRBM": {"ICBM": 0.03, "IRBM": 0.1, "SRBM": 0.77, "UNKNOWN": 0.1},
    }
    sensors = [stub_sensor("A", confusion=confusion), stub_sensor("B", confusion=confusion)]
    table = type_log_likelihoods([*sensors, stub_sensor()])
    share = np.exp(type_evidence(np.array([[0, -1, -1], [0, 0, 2]]), table))
    share /= share.sum(axis=1, keepdims=True)
    assert share[0] == pytest.approx(np.array([0.8, 0.12, 0.03]) / 0.95)
    assert share[1] == pytest.approx(np.array([0.64, 0.0144, 0.0009]) / 0.6553)


@pytest.mark.slow
def test_targets_of_which_no_type_is_reported_have_that_of_their_range() -> None:
    reported = last_reported(flown("SRBM", 4, 5, "staged"), usual("SRBM"), 5, 6.0)
    # The burn is evidence for a missile: anything else is less probable than the prior has it, 0.2.
    prior = Outcomes(vehicle_model(), core_hypotheses()).prior
    no_missile = [each.reported_type == REPORTED_TYPES[UNKNOWN_TYPE] for each in core_hypotheses()]
    assert (reported.type_probability[:, UNKNOWN_TYPE] < prior[np.array(no_missile)].sum()).all()
    assert reported.type_probability.sum(axis=1) == pytest.approx(np.ones(4))
    # They still burn: each may go further, as a whole they do not.
    assert np.mean(reported.type_probability[:, TARGET_TYPES.index("SRBM")]) > 0.4
    assert (reported.type_probability[:, TARGET_TYPES.index("ICBM")] < 0.25).all()
