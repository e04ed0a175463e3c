"""Pairs that the coarse grid leaves out are never visible, and leaving them out changes no bit of
the plan.
"""

from collections.abc import Callable

import numpy as np
import pytest
from attrs import fields, frozen
from hypothesis import given, settings, strategies as st

import opir_core as opir
from opir_core import Plan, compile_plan
from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.geometry import WGS84, elevation_rad, geodetic_to_ecef, grazing_height_m
from opir_core.planning import pair_compiler
from opir_core.planning.hidden_pairs import CoarseGrid, surely_hidden

#: The fine guards of height, m, and of angle times distance, m.
GUARD_M = 25.0


@frozen
class Circle:
    """A circular orbit seen from the rotating Earth: a radius, an inclination, the longitude of a
    node, a phase.
    """

    radius_m: float
    inclination_rad: float
    node_rad: float
    phase_rad: float

    def __call__(self, time_s: FloatArray) -> FloatArray:
        angle = self.phase_rad + np.sqrt(EARTH_MU_M3_S2 / self.radius_m**3) * time_s
        x = np.cos(angle)
        y = np.sin(angle) * np.cos(self.inclination_rad)
        turned = self.node_rad - EARTH_ROTATION_RAD_S * time_s
        across = np.stack(
            [x * np.cos(turned) - y * np.sin(turned), x * np.sin(turned) + y * np.cos(turned)]
        )
        return self.radius_m * np.stack(
            [*across, np.sin(angle) * np.sin(self.inclination_rad)], axis=1
        )


@frozen
class Climb:
    """A target that climbs from a place near the ground and accelerates along a direction: ECEF, SI
    units.
    """

    lat_rad: float
    lon_rad: float
    height_m: float
    acceleration_m_s2: FloatArray
    end_s: float

    def __call__(self, time_s: FloatArray) -> FloatArray:
        start = geodetic_to_ecef(self.lat_rad, self.lon_rad, self.height_m)
        # At constant velocity beyond its ends, as the paths of pairs are.
        within = np.clip(time_s, 0.0, self.end_s)
        beyond = np.maximum(time_s - self.end_s, 0.0) * self.end_s
        return (
            start
            + 0.5 * within[:, None] ** 2 * self.acceleration_m_s2
            + beyond[:, None] * self.acceleration_m_s2
        )


angles = st.floats(-np.pi, np.pi)
circles = st.builds(Circle, st.floats(6.65e6, 4.5e7), st.floats(0.0, np.pi), angles, angles)
climbs = st.builds(
    Climb,
    st.floats(-1.5, 1.5),
    angles,
    st.floats(-400.0, 3e4),
    st.tuples(*[st.floats(-25.0, 25.0)] * 3).map(np.array),
    st.floats(1.0, 300.0),
)


def is_hidden(sensor: Callable[[FloatArray], FloatArray], target: Climb, is_moving: bool) -> bool:
    """Return whether the coarse grid leaves out a pair, without light time."""
    grid = CoarseGrid.over(np.array([0.0]), np.array([target.end_s]))
    return bool(
        surely_hidden(grid, sensor(grid.time_s), target(grid.time_s), np.array([is_moving]))[0]
    )


def never_visible(sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> BoolArray:
    """Return which lines of sight are behind the Earth by more than the guards of the fine grid."""
    low = elevation_rad(target_ecef_m, sensor_ecef_m)
    distance_m = np.linalg.norm(target_ecef_m - sensor_ecef_m, axis=1)
    deep = grazing_height_m(sensor_ecef_m, target_ecef_m) < -GUARD_M
    hidden: BoolArray = deep & (low < -1.5 * GUARD_M / distance_m)
    return hidden


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(circles, climbs, st.booleans())
def test_pairs_that_are_left_out_are_never_visible(
    circle: Circle, target: Climb, is_moving: bool
) -> None:
    place = circle(np.zeros(1))
    sensor = circle if is_moving else lambda time_s: np.broadcast_to(place, (len(time_s), 3))
    time_s = np.linspace(-1.0, target.end_s + 1.0, 500)
    seen_m = sensor(time_s)
    target_m = target(time_s)
    if is_hidden(sensor, target, is_moving):
        assert never_visible(seen_m, target_m).all()


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(circles, climbs)
def test_a_target_opposite_to_its_sensor_is_left_out(circle: Circle, target: Climb) -> None:
    across = -target(np.zeros(1)) / np.linalg.norm(target(np.zeros(1)))
    low_m = target(np.linspace(0.0, target.end_s, 50))
    stays = np.linalg.norm(low_m, axis=1).min() > WGS84.polar_radius_m
    neighbours = np.linalg.norm(low_m - low_m[0], axis=1).max() < 5e5
    if stays and neighbours:
        assert is_hidden(
            lambda time_s: np.repeat(circle.radius_m * across, len(time_s), axis=0), target, False
        )


@pytest.mark.parametrize(("height_km", "climb_m_s2"), [(300.0, 30.0), (35786.0, 30.0)])
def test_a_rise_between_two_coarse_points_is_kept(height_km: float, climb_m_s2: float) -> None:
    """Grid points alone would all be hidden: the acceleration is what the chords leave out."""
    sensor_m = np.array([[6378137.0 + 1e3 * height_km, 0.0, 0.0]])
    for beyond_deg in np.arange(0.0, 5.0, 0.05):
        edge = np.arccos(6378137.0 / sensor_m[0, 0]) + np.radians(beyond_deg)
        up = np.array([np.cos(edge), np.sin(edge), 0.0])
        target = Climb(0.0, edge, 0.0, climb_m_s2 * up, 60.0)
        time_s = np.linspace(0.0, 60.0, 500)
        place = np.repeat(sensor_m, len(time_s), axis=0)
        fixed = lambda time_s: np.repeat(sensor_m, len(time_s), axis=0)  # noqa: E731
        if not never_visible(place, target(time_s)).all():
            assert not is_hidden(fixed, target, False)


@pytest.mark.parametrize("is_moving", [True, False])
def test_hidden_steps_of_targets_and_moving_sensors(
    is_moving: bool,
) -> None:
    """Sensor and target change sides: hidden at both times, but not if one of them is a little
    late.
    """
    grid = CoarseGrid.over(np.array([0.0]), np.array([4.0]))
    assert len(grid.time_s) == 2
    sides_m = np.array([[6.4e6, 0.0, 0.0], [-6.4e6, 0.0, 0.0]])
    assert (
        bool(surely_hidden(grid, -7.0 * sides_m, sides_m, np.array([is_moving]))[0])
        is not is_moving
    )


SENSORS = (
    [{"constellation": "SBIRS-GEO"}],
    [{"constellation": "HEO-MOLNIYA"}],
    [{"constellation": "LEO-WIDE"}],
)


@pytest.mark.slow
@pytest.mark.parametrize("light_time", [True, False])
@pytest.mark.parametrize("sensors", SENSORS)
def test_leaving_pairs_out_changes_no_bit_of_the_plan(
    sensors: list[dict[str, object]], light_time: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = opir.scene_from_mapping(
        {
            "scene": "hidden",
            "epoch": "2026-04-01T00:00:00Z",
            "duration_s": 400.0,
            "light_time": light_time,
            "sensors": sensors,
            "targets": [
                {
                    "id": f"T{number}",
                    "type": "ICBM",
                    "launch": {
                        "lat_deg": 17.0 * number - 70.0,
                        "lon_deg": 97.0 * number % 360.0 - 180.0,
                        "time_s": 3.7,
                    },
                    "aim": {
                        "lat_deg": 35.0 - 8.5 * number,
                        "lon_deg": (97.0 * number + 250.0) % 360.0 - 180.0,
                    },
                }
                for number in range(9)
            ],
        }
    )
    compiled = compile_plan(scene)
    left_out = []
    monkeypatch.setattr(
        pair_compiler,
        "surely_hidden",
        lambda grid, *_: left_out.append(1) or np.zeros(len(grid.first), np.bool_),
    )
    assert_same(compiled, compile_plan(scene))
    assert left_out


def assert_same(first_run: Plan, second_run: Plan) -> None:
    for actual, expected in (
        (first_run.pairs, second_run.pairs),
        (first_run.sightlines, second_run.sightlines),
    ):
        for column in fields(type(actual)):
            np.testing.assert_array_equal(
                getattr(actual, column.name), getattr(expected, column.name)
            )


def test_hidden_pairs_are_not_sampled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a sensor over the other side, no point of the fine grid is computed."""
    target = {
        "id": "T",
        "type": "ICBM",
        "launch": {"lat_deg": 0.0, "lon_deg": 0.0, "time_s": 1.0},
        "aim": {"lat_deg": 30.0, "lon_deg": 50.0},
    }
    scene = opir.scene_from_mapping(
        {
            "scene": "antipode",
            "epoch": "2026-04-01T00:00:00Z",
            "duration_s": 300.0,
            "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 180.0}],
            "targets": [target],
        }
    )
    rows: list[int] = []
    margins_of = pair_compiler.Margins.of
    monkeypatch.setattr(
        pair_compiler.Margins,
        "of",
        lambda *arguments: rows.append(len(arguments[2])) or margins_of(*arguments),
    )
    plan = compile_plan(scene)
    assert plan.pairs.blocked.tolist() == [int(pair_compiler.Blocked.BEHIND_EARTH)]
    assert sum(rows) == 0
