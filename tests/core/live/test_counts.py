"""Counts of a live run: what each sensor has detected, and when last."""

import numpy as np
from opir_testing import VerticalTargets, stub_plan, stub_scene, stub_sensor

from opir_core.live.status import Counts


def test_a_sensor_without_detections_has_no_last_detection() -> None:
    target = VerticalTargets(*(np.array([value]) for value in (0.0, 5.0, 1.0, 9.0)))
    plan = stub_plan([stub_sensor("A", 0.0), stub_sensor("B", 10.0)], target, ["T1"], stub_scene())
    counts = Counts.of(2)
    assert [sensor.last_detection_s for sensor in counts.sensors(plan, {})] == [None, None]
    counts.last_ns[1] = 0
    assert [sensor.last_detection_s for sensor in counts.sensors(plan, {})] == [None, 0.0]
