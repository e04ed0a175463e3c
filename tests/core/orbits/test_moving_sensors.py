"""Moving sensors in the engine: results do not depend on windows, and sensors are where their
orbits say.
"""

import math

import numpy as np
import pytest
from attrs import fields
from hypothesis import given, strategies as st
from opir_testing import CertainDetection, VerticalTargets, stub_plan, stub_scene, stub_sensor

from examples import examples
from opir_core import Detections, Engine
from opir_core.orbits import (
    MovingOrbit,
    circular_elements,
    highly_elliptical_elements,
    slot_elements,
)
from opir_core.orbits.orbit_models import SPAN_S, TwoBodyMotion

#: A burn across the seam of two spans.
IGNITION_S = SPAN_S - 15.0
END_NS = round((SPAN_S + 20.0) * 1e9)
ORBITS = {
    "leo": circular_elements(1.2e6, 0.9, -0.1, argument_of_latitude_rad=-1.5),
    "slot": slot_elements(0.2, inclination_rad=0.1),
    "molniya": highly_elliptical_elements(2.0, 0.74, 0.5),
}


def plan_of(names):
    sensors = [
        stub_sensor(
            name,
            orbital_slot_deg=None,
            orbit=MovingOrbit(TwoBodyMotion(ORBITS[name])),
            field_of_regard_half_angle_rad=math.pi / 2,
        )
        for name in names
    ]
    rng = np.random.default_rng(7)
    start_s = IGNITION_S + rng.uniform(0.0, 5.0, 12)
    targets = VerticalTargets(
        rng.uniform(-40, 60, 12), rng.uniform(-60, 60, 12), start_s, start_s + 25.0
    )
    scene = stub_scene(duration_s=END_NS * 1e-9)
    return stub_plan(
        sensors,
        targets,
        [f"T{n}" for n in range(12)],
        scene,
        detection=CertainDetection(0.7, False),
    )


def detections(plan, edges_ns) -> Detections:
    engine = Engine(plan)
    return Detections.concatenate([engine.advance(edge).detections for edge in edges_ns])


@examples(10)
@given(st.lists(st.integers(round(IGNITION_S * 1e9), END_NS - 1), max_size=8, unique=True))
def test_windows_cut_anywhere_give_the_same_bytes(cuts):
    expected, cut = (detections(plan_of(ORBITS), [*sorted(c), END_NS]) for c in ([], cuts))
    assert len(expected) > 200
    for column in fields(Detections):
        values = (getattr(rows, column.name).tobytes() for rows in (cut, expected))
        assert len(set(values)) == 1, column.name


@pytest.mark.parametrize("name", ORBITS)
def test_another_sensor_changes_nothing(name):
    expected = detections(plan_of([name]), [END_NS])
    together = detections(plan_of(ORBITS), [END_NS])
    rows = np.flatnonzero(together.sensor == list(ORBITS).index(name))
    for column in ("time_ns", "sensor_ecef_m", "line_of_sight_ecef"):
        assert getattr(together, column)[rows].tobytes() == getattr(expected, column).tobytes()


def test_detections_are_made_from_where_the_orbit_is():
    plan = plan_of(ORBITS)
    rows_of_all = detections(plan, [END_NS])
    for number, elements in enumerate(ORBITS.values()):
        rows = np.flatnonzero(rows_of_all.sensor == number)
        exact = TwoBodyMotion(elements).position_ecef_m(rows_of_all.time_s[rows])
        assert len(rows)
        assert rows_of_all.sensor_ecef_m[rows] == pytest.approx(exact, rel=0.0, abs=1e-3)
