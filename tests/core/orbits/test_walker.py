"""Walker patterns: how many, how spread, how symmetric."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, strategies as st

from examples import examples
from opir_core.orbits import OrbitConfig, WalkerConfig, elements_of, walker_pattern
from opir_core.orbits.orbit_models import TwoBodyMotion


@st.composite
def patterns(draw: st.DrawFn) -> tuple[int, int, int]:
    planes = draw(st.integers(1, 12))
    a_plane = draw(st.integers(1, 12))
    return planes * a_plane, planes, draw(st.integers(0, planes - 1))


def places(total, planes, phasing, **more):
    """Return the positions of all satellites in ECI at the scene epoch."""
    pattern = walker_pattern(total, planes, phasing, 1.2e6, 0.9, **more)
    return np.array([TwoBodyMotion(elements).state_eci(np.zeros(1))[0][0] for elements in pattern])


def turned(vectors, angle):
    x, y, z = vectors.T
    return np.stack(
        [math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y, z],
        axis=1,
    )


def same_set(a, b):
    """Return whether two sets of positions are the same, in whatever order."""
    distance = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=2)
    return bool((distance.min(axis=0) < 1e-3).all() and (distance.min(axis=1) < 1e-3).all())


@examples(20)
@given(patterns())
def test_a_delta_pattern_turned_by_a_plane_is_itself(numbers):
    total, planes, phasing = numbers
    pattern = places(total, planes, phasing)
    phased = places(
        total, planes, phasing, first_argument_of_latitude_rad=phasing * 2.0 * math.pi / total
    )
    moved = turned(phased, 2.0 * math.pi / planes)
    # Each plane, turned and moved, is the next, satellite by satellite; the last is the first, in
    # another order.
    a_plane = total // planes
    assert moved[: total - a_plane] == pytest.approx(pattern[a_plane:], rel=0.0, abs=1e-2)
    assert same_set(moved[total - a_plane :], pattern[:a_plane])


@examples(40)
@given(patterns(), st.booleans())
def test_every_plane_is_evenly_filled(numbers, star):
    total, planes, phasing = numbers
    pattern = walker_pattern(total, planes, phasing, 1.2e6, 0.9, star=star)
    assert len(pattern) == total
    a_plane = total // planes
    nodes = [elements.node_longitude_rad for elements in pattern[::a_plane]]
    step = (math.pi if star else 2.0 * math.pi) / planes
    assert all(later - earlier == pytest.approx(step) for earlier, later in pairwise(nodes))
    for plane in range(planes):
        latitudes = sorted(
            elements.mean_anomaly_rad
            for elements in pattern[plane * a_plane : (plane + 1) * a_plane]
        )
        assert np.diff([*latitudes, latitudes[0] + 2.0 * math.pi]) == pytest.approx(
            2.0 * math.pi / a_plane
        )


def test_galileo_is_24_3_1():
    # Walker 56 deg: 24/3/1 at 23 222 km, published for Galileo: planes 120 deg apart, 15 deg from
    # one to the next, and 17 turns in 10 sidereal days.
    pattern = walker_pattern(24, 3, 1, 23_222e3, math.radians(56.0))
    degrees = np.degrees(
        [(elements.node_longitude_rad, elements.mean_anomaly_rad) for elements in pattern]
    )
    assert degrees[[0, 1, 8, 16]] == pytest.approx(
        np.array([(0.0, 0.0), (0.0, 45.0), (120.0, 15.0), (240.0, 30.0)])
    )
    assert pattern[0].period_s == pytest.approx(10.0 / 17.0 * 86_164.1, rel=2e-4)


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ((24, 5, 0), "evenly"),
        ((0, 1, 0), "evenly"),
        ((24, 6, -1), r"phasing: -1 is not in \[0, 6\), the number of planes"),
        ((24, 6, 6), r"phasing: 6 is not in \[0, 6\), the number of planes"),
    ],
)
def test_impossible_patterns_are_refused(numbers, words):
    with pytest.raises(ValueError, match=words):
        walker_pattern(*numbers, 1e6, 1.0)


@pytest.mark.parametrize("kind", ["delta", "star"])
def test_a_scene_names_a_satellite_of_a_pattern(kind):
    pattern = walker_pattern(
        24,
        6,
        1,
        1.2e6,
        math.radians(53.0),
        star=kind == "star",
        first_node_longitude_rad=math.radians(10.0),
    )
    block = {
        "total": 24,
        "planes": 6,
        "phasing": 1,
        "kind": kind,
        "altitude_km": 1200.0,
        "inclination_deg": 53.0,
    }
    for number, elements in enumerate(pattern, start=1):
        config = WalkerConfig(**block, lon_asc_node_deg=10.0, satellite=number)
        assert elements_of(OrbitConfig(walker=config), 0) == elements
