"""The names of random streams: a sensor's id, until its scans are numbered anew."""

import numpy as np
from attrs import evolve
from opir_testing import VerticalTargets, stub_plan, stub_scene, stub_sensor


def test_sensor_streams_are_named_by_id_and_generation():
    sensors = [stub_sensor("A", 0.0), stub_sensor("B", 10.0)]
    target = VerticalTargets(*(np.array([value]) for value in (0.0, 5.0, 1.0, 9.0)))
    plan = stub_plan(sensors, target, ["T1"], stub_scene())
    assert plan.sensor_names() == ["A", "B"]
    assert evolve(plan, scan_generations=(0, 2)).sensor_names() == ["A", "B@2"]
    assert set(plan.scan_names()) == set(plan.pair_names()) == {("A", "T1"), ("B", "T1")}
