"""Impact: first descent through a height, by event, under any forces."""

import numpy as np
import pytest
from attrs import evolve
from free_flights import EXPONENTIAL, flights
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core.flight import (
    Drag,
    Forces,
    ImpactReason,
    impact,
    impact_states_eci,
    kepler_impact,
    propagate,
)
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef

pytestmark = pytest.mark.filterwarnings("error")

MODELS = {
    "kepler": "kepler",
    "j2": Forces(),
    "us76": Forces(drag=Drag(2000.0)),
    "exp": Forces(drag=Drag(2000.0, EXPONENTIAL)),
}
HIGH_M = 6378137.0 + 500e3
NUMERICAL = [name for name in MODELS if name != "kepler"]


def shots(count, seed=0):
    speed_m_s = 1500.0, 7200.0
    return flights(count, seed, angle_deg=(20.0, 60.0), speed_m_s=speed_m_s, height_m=(60e3, 300e3))


@pytest.mark.parametrize("name", list(MODELS))
def test_without_a_height_it_is_that_of_the_ellipsoid(name):
    states, at_zero = (
        impact_states_eci(*shots(3), *height, forces=MODELS[name]) for height in ((), (0.0,))
    )
    assert np.array_equal(states.position_m, at_zero.position_m)


@pytest.mark.slow
@pytest.mark.parametrize("height_m", [-3000.0, 0.0, 30e3, 150e3])
@pytest.mark.parametrize("name", list(MODELS))
def test_impacts_are_on_the_height_and_on_the_arc(name, height_m):
    position, velocity = shots(60)
    states = impact_states_eci(position, velocity, height_m, MODELS[name], tolerance_m=1e-6)
    hit = states.reason == ImpactReason.IMPACT
    assert hit.sum() >= 30
    point = states.position_m[hit]
    speed = states.velocity_m_s[hit]
    assert np.abs(ecef_to_geodetic(point).height_m - height_m).max() <= 1e-6
    start = position[hit], velocity[hit]
    end = propagate(*start, states.duration_s[hit], MODELS[name], tolerance_m=1e-6)
    np.testing.assert_allclose(point, end[0], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(speed, end[1], rtol=0.0, atol=1e-6)
    assert ((speed * point).sum(axis=1) < 0.0).all()


@pytest.mark.parametrize("name", list(MODELS))
def test_an_impact_is_the_first(name):
    """Nowhere between start and impact is the arc at or below the height, sampled."""
    position, velocity = shots(10, seed=2)
    duration, _ = impact(position, velocity, 10e3, MODELS[name])
    fraction = np.linspace(0.0, 1.0, 60)[:-1, np.newaxis]
    on_the_way, _ = propagate(
        position, velocity, fraction * duration, MODELS[name], tolerance_m=1e-2
    )
    assert ecef_to_geodetic(on_the_way).height_m.min() > 10e3


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", [1e-1, 1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("height_m", [0.0, 40e3])
def test_without_oblateness_it_is_the_closed_form(tolerance_m, height_m):
    start = shots(200, seed=3)
    round_field = Forces(gravity=evolve(Forces().gravity, j2=0.0))
    duration, point = impact(*start, height_m, round_field, tolerance_m=tolerance_m)
    exact_duration, exact_point = kepler_impact(*start, height_m)
    assert np.linalg.norm(point - exact_point, axis=1).max() <= max(tolerance_m, 2e-6)
    assert np.abs(duration - exact_duration).max() <= max(1e-3 * tolerance_m, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("name", NUMERICAL)
def test_errors_stay_within_the_tolerance(name, tolerance_m):
    start = shots(150, seed=4)
    exact, point = (
        impact(*start, 0.0, MODELS[name], tolerance_m=tolerance)[1]
        for tolerance in (1e-8, tolerance_m)
    )
    assert np.linalg.norm(point - exact, axis=1).max() <= tolerance_m


def test_thin_air_is_no_air():
    position, velocity = shots(20, seed=5)
    _, with_drag = impact(position, velocity, 0.0, Forces(drag=Drag(1e15)))
    _, without = impact(position, velocity)
    assert np.linalg.norm(with_drag - without, axis=1).max() <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("name", NUMERICAL)
def test_results_do_not_depend_on_the_company(name):
    def states(*columns):
        return impact_states_eci(*columns, MODELS[name])

    rows = ([3], [59, 0, 31], list(range(1, 60, 2)))
    assert_rows_independent(states, *shots(60, seed=6), np.linspace(0.0, 50e3, 60), rows=rows)


@pytest.mark.parametrize("name", list(MODELS))
@pytest.mark.parametrize(
    ("start", "within_s", "reason"),
    [
        ([[HIGH_M, 0.0, 0.0], [0.0, 7.6e3, 0.0]], 7200.0, ImpactReason.NO_DESCENT),
        ([[HIGH_M, 0.0, 0.0], [12e3, 0.0, 0.0]], 7200.0, ImpactReason.NO_DESCENT),
        ([[np.nan, 0.0, 0.0], [0.0, 7.6e3, 0.0]], 7200.0, ImpactReason.NOT_FINITE),
        ([[HIGH_M, 0.0, 0.0], [0.0, 3e3, 0.0], np.nan], 7200.0, ImpactReason.NOT_FINITE),
        ([[HIGH_M, 0.0, 0.0], [0.0, 3e3, 0.0]], 7200.0, ImpactReason.IMPACT),
        ([[HIGH_M, 0.0, 0.0], [0.0, 3e3, 0.0]], 10.0, ImpactReason.NO_DESCENT),
    ],
)
def test_reasons_for_no_impact(name, start, within_s, reason):
    states = impact_states_eci(*start, forces=MODELS[name], within_s=within_s)
    assert states.reason == reason
    for column in states[:3]:
        assert np.isnan(column).all() == (reason != ImpactReason.IMPACT)


def test_drag_ends_below_the_air_model():
    states = impact_states_eci(
        [6378137.0 + 1e3, 0.0, 0.0], [-300.0, 0.0, 0.0], -6e3, MODELS["us76"]
    )
    assert states.reason == ImpactReason.BELOW_AIR


@pytest.mark.parametrize("name", list(MODELS))
@pytest.mark.parametrize("latitude", [0.0, 0.7, np.pi / 2])
def test_a_start_on_the_ground(name, latitude):
    ground = geodetic_to_ecef(latitude, 0.3, 0.0)
    normal = geodetic_to_ecef(latitude, 0.3, 1.0) - ground
    rising, _ = impact(ground, 500.0 * normal, 0.0, MODELS[name])
    falling, point = impact(ground, -500.0 * normal, 0.0, MODELS[name])
    assert 30.0 < rising < 120.0
    assert falling == pytest.approx(0.0, abs=1e-8)
    np.testing.assert_allclose(point, ground, rtol=0.0, atol=1e-5)


@pytest.mark.parametrize("height_m", [4e3, 5.0])
@pytest.mark.parametrize("name", list(MODELS))
def test_a_start_below_the_height_first_rises_through_it(name, height_m):
    start = [6378137.0, 0.0, 0.0], [2500.0, 300.0, 100.0]
    duration, point = impact(*start, height_m, MODELS[name])
    at_ground, _ = impact(*start, 0.0, MODELS[name])
    assert 20.0 < duration < at_ground
    assert ecef_to_geodetic(point).height_m == pytest.approx(height_m, abs=1e-6)


@pytest.mark.parametrize("name", list(MODELS))
def test_a_start_below_that_descends_has_come_down(name):
    """From 50 m below the ground an arc would fly through the Earth, and come out 2 034 s later."""
    start, up = (geodetic_to_ecef(0.5, 1.0, height) for height in (-50.0, -49.0))
    velocity = np.array([[-300.0, 2000.0], [-1e-3, 0.0], [-300.0, 7500.0]])
    along = np.cross([0.0, 0.0, 1.0], start)
    velocity = velocity[:, :1] * (up - start) + velocity[:, 1:] * along / np.linalg.norm(along)
    states = impact_states_eci(start, velocity, 0.0, MODELS[name])
    assert np.all(states.reason == ImpactReason.IMPACT)
    assert np.all(states.duration_s == 0.0)
    np.testing.assert_allclose(states.position_m, np.tile(start, (3, 1)), atol=2e-9)
    np.testing.assert_allclose(states.velocity_m_s, velocity, atol=1e-9)
    deep = start * (1.0 - 20e3 / 6378e3)
    assert impact(deep, velocity[0], 0.0, MODELS[name])[0] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kepler", "j2", "us76"])
@pytest.mark.parametrize("depth_m", [-50.0, -0.5, -0.01, 0.01, 0.5, 50.0])
def test_only_a_perigee_below_the_height_is_an_impact(name, depth_m):
    """Grazing arcs: the sign of the perigee's depth decides, however shallow."""
    start = np.array([6378137.0 + 400e3, 0.0, 0.0]), np.array([0.0, 7600.0, 0.0])
    times = np.linspace(100.0, 3000.0, 400)
    for _ in range(4):
        arc, _ = propagate(*start, times, MODELS[name], tolerance_m=1e-6)
        heights = ecef_to_geodetic(arc).height_m
        lowest = times[np.argmin(heights)]
        spread = times[1] - times[0]
        times = np.linspace(lowest - spread, lowest + spread, 400)
    settings = {"within_s": 4000.0, "tolerance_m": 1e-6}
    states = impact_states_eci(*start, heights.min() + depth_m, MODELS[name], **settings)
    assert (states.reason == ImpactReason.IMPACT) == (depth_m > 0.0)


@examples(40)
@given(
    st.floats(0.0, 90.0),
    st.floats(0.0, 5.0),
    st.floats(1.0, 11e3),
    st.floats(-90.0, 90.0),
    st.sampled_from(NUMERICAL),
)
def test_no_shot_warns_and_every_impact_is_on_the_ground(
    latitude, height_exponent, speed, angle, name
):
    latitude, angle = np.radians([latitude, angle])
    start = geodetic_to_ecef(latitude, 1.0, 10.0**height_exponent)
    normal = geodetic_to_ecef(latitude, 1.0, 10.0**height_exponent + 1.0) - start
    velocity = speed * (np.sin(angle) * normal + np.cos(angle) * np.cross([0.6, 0.0, 0.8], normal))
    states = impact_states_eci(
        start, velocity, 0.0, MODELS[name], within_s=5000.0, tolerance_m=1e-3
    )
    if states.reason == ImpactReason.IMPACT:
        assert abs(ecef_to_geodetic(states.position_m).height_m) <= 1e-6
        assert states.duration_s >= 0.0
    else:
        assert states.reason == ImpactReason.NO_DESCENT


def test_heights_and_limits_broadcast():
    position, velocity = shots(3)
    duration, point = impact(position, velocity, np.array([[0.0], [10e3]]), MODELS["j2"])
    assert duration.shape == (2, 3)
    assert point.shape == (2, 3, 3)
    assert (duration[1] < duration[0]).all()
    assert impact(position[0], velocity[0])[0].shape == ()
