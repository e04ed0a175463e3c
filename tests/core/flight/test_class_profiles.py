"""The generic target classes and which of them a target type flies."""

import math

import pytest

from opir_core.flight import boost_profile, boost_profiles
from opir_core.plugin import Ballistic
from opir_core.scene import core_target_class, core_target_classes


def test_boost_profiles_are_those_of_ballistic_classes():
    flown = [
        kind for kind in core_target_classes().values() if isinstance(kind.after_burnout, Ballistic)
    ]
    assert {profile.name for kind in flown for profile in kind.profiles} == set(boost_profiles())


def test_a_profile_holds_its_row_of_the_table():
    profile = boost_profile("ICBM_solid")
    assert profile.name == "ICBM_solid"
    assert (profile.burn_time_s, profile.pitch_start_s) == (170.0, 8.0)
    assert (profile.speed_shape, profile.pitch_exponent) == (1.5, 0.55)
    assert profile.burnout_speed_m_s == 6931.1
    assert profile.burnout_flight_path_angle_rad == math.radians(25.0)
    assert (profile.reference_range_m, profile.minimum_range_m, profile.maximum_range_m) == (
        1e7,
        5.5e6,
        1.6e7,
    )


def test_reference_ranges_lie_within_the_limits():
    for profile in boost_profiles().values():
        assert profile.minimum_range_m < profile.reference_range_m < profile.maximum_range_m


def test_an_unknown_profile_is_reported_with_the_known_ones():
    with pytest.raises(
        ValueError,
        match=r"no boost profile 'MIRV'; there are ICBM_liquid, ICBM_solid, IRBM, MRBM, SLBM, SRBM",
    ):
        boost_profile("MIRV")


@pytest.mark.parametrize(
    ("target_type", "range_km", "name"),
    [
        ("SRBM", 10, "SRBM"),
        ("SRBM", 5000, "SRBM"),
        ("IRBM", 500, "MRBM"),
        ("IRBM", 2999, "MRBM"),
        ("IRBM", 3001, "IRBM"),
        ("IRBM", 9000, "IRBM"),
        ("ICBM", 8000, "ICBM_liquid"),
        ("MRBM", 5000, "MRBM"),
        ("SLBM", 8000, "SLBM"),
    ],
)
def test_the_profile_of_a_class_goes_by_range(target_type, range_km, name):
    assert core_target_class(target_type).profile(range_km * 1e3).name == name


def test_another_burn_time_stretches_the_course():
    stretched = boost_profile("ICBM_liquid").with_burn_time(300.0)
    assert stretched.burn_time_s == 300.0
    assert stretched.pitch_start_s == pytest.approx(14.4)
    assert stretched.burnout_speed_m_s == boost_profile("ICBM_liquid").burnout_speed_m_s


@pytest.mark.parametrize("burn_time_s", [0.0, -1.0, math.nan, math.inf])
def test_a_burn_time_that_is_none_is_refused(burn_time_s):
    with pytest.raises(ValueError, match="burn time must be a positive number of seconds"):
        boost_profile("SRBM").with_burn_time(burn_time_s)
