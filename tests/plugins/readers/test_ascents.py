"""Kinematic space launches: burns and gaps, orbits, boosters that land, and scenes with them."""

from itertools import pairwise

import numpy as np
import pytest
from attrs import evolve
from opir_readers import ascents
from opir_readers.ascents import legs_of
from opir_readers.configs import AscentConfig

import opir_core as opir
from opir_core.constants import EARTH_MU_M3_S2 as MU, EARTH_ROTATION_RAD_S
from opir_core.errors import SceneError
from opir_core.geometry import ecef_to_geodetic

OMEGA = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
SITE = {"lat_deg": 28.6, "lon_deg": -80.6}


def flight(**settings):
    return legs_of(AscentConfig(**SITE, **settings))


@pytest.mark.parametrize(
    "settings",
    [{}, {"gap_s": 8.0, "azimuth_deg": 180.0}, {"flight": "booster", "flies_back": False}],
)
def test_legs_join_without_a_jump_in_place_or_speed(settings):
    for leg, following in pairwise(flight(**settings)):
        assert following.time_s[0] == pytest.approx(leg.time_s[-1], abs=1e-9)
        np.testing.assert_allclose(following.position_m[0], leg.position_m[-1], atol=1e-6)
        np.testing.assert_allclose(following.velocity_m_s[0], leg.velocity_m_s[-1], atol=1e-6)


@pytest.mark.parametrize("settings", [{}, {"flight": "booster", "flies_back": False}])
def test_velocities_are_the_slopes_of_positions(settings):
    for leg in flight(**settings):
        middle = (leg.position_m[2:] - leg.position_m[:-2]) / (leg.time_s[2:] - leg.time_s[:-2])[
            :, None
        ]
        assert np.abs(middle - leg.velocity_m_s[1:-1]).max() < 1.0


@pytest.mark.parametrize(
    ("altitude_km", "azimuth_deg"), [(200.0, 90.0), (300.0, 45.0), (250.0, 190.0)]
)
def test_the_second_burn_ends_in_a_circular_orbit(altitude_km, azimuth_deg):
    legs = flight(orbit_altitude_km=altitude_km, azimuth_deg=azimuth_deg)
    place = legs[2].position_m[-1]
    way = legs[2].velocity_m_s[-1]
    radius = np.linalg.norm(place)
    inertial = way + np.cross(OMEGA, place)
    assert radius == pytest.approx(6_378_137.0 + altitude_km * 1e3, abs=200.0)
    assert np.linalg.norm(inertial) == pytest.approx(np.sqrt(MU / radius), abs=2.0)
    # In orbit it keeps its distance, on a two-body arc.
    assert np.ptp(np.linalg.norm(legs[3].position_m, axis=1)) < 20e3


def test_a_gap_is_a_free_fall():
    """Half of the second difference of position is the acceleration, less rotation's: gravity
    alone.
    """
    gap = flight()[1]
    step = gap.time_s[1] - gap.time_s[0]
    fall = np.diff(gap.position_m, 2, axis=0) / step**2
    place = gap.position_m[1:-1]
    way = gap.velocity_m_s[1:-1]
    turning = -np.cross(OMEGA, np.cross(OMEGA, place)) - 2.0 * np.cross(OMEGA, way)
    pull = -MU * place / np.linalg.norm(place, axis=1)[:, None] ** 3
    np.testing.assert_allclose(fall, pull + turning, atol=1e-3)


@pytest.mark.slow
def test_a_booster_lands_where_it_started():
    legs = flight(flight="booster")
    start = legs[0].position_m[0]
    end = legs[-1].position_m[-1]
    assert [leg.burns for leg in legs] == [True, False, True, False, True, False, True, False]
    assert np.linalg.norm(end - start) < 10e3
    heights_m = np.concatenate([ecef_to_geodetic(leg.position_m).height_m for leg in legs])
    assert abs(heights_m[-1]) < 50.0
    assert np.linalg.norm(legs[-1].velocity_m_s[-1]) < 1e-6
    assert heights_m.max() < 300e3


def scene(**settings):
    return opir.scene_from_mapping(
        {
            "scene": "ascent",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 540,
            "seed": 1,
            "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": -90.0}],
            "targets": [{"id": "T", "model": "ascent", **SITE, "time_s": 5.0, **settings}],
            "outputs": [],
        }
    )


def test_an_ascent_is_seen_while_it_burns_and_dark_between():
    plan = opir.compile_plan(scene())
    looks_s = opir.Engine(plan).advance(plan.end_ns).detections.time_s
    gap = (looks_s > 166.5) & (looks_s < 175.5)
    assert len(looks_s) > 100
    assert not gap.any()
    assert looks_s.max() > 400.0
    (reported,) = plan.targets.truth()
    assert reported["burnout_s"] == pytest.approx(5.0 + 160.0 + 11.0 + 360.0)
    assert len(reported["gaps_s"]) == 1


def test_what_has_no_solution_is_refused(monkeypatch):
    with pytest.raises(ValueError, match="none"):
        ascents._solved(lambda x: x * x + 10.0, np.array([3.0]), "none")
    monkeypatch.setattr(ascents, "LAW", evolve(ascents.LAW, most_m_s2=10.0))
    with pytest.raises(SceneError, match=r"targets\[0\].*more than 10 m/s²"):
        opir.compile_plan(scene())
