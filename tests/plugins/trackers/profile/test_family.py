"""The parts of `boost-profile` against closed forms: the family and its priors, normal points, windows."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import GEO_M, PRIORS, flights, lines_of_sight
from hypothesis import given
from hypothesis import strategies as st
from opir_trackers.configs import BoostProfileConfig
from opir_trackers.profile import fit
from opir_trackers.profile.family import (
    BURN,
    LIFT,
    PITCH,
    REFERENCE,
    SIZE,
    SPEED,
    TURN_EAST,
    TURN_NORTH,
    Anchors,
    Family,
    Priors,
    fitted,
    natural,
    priors_of,
)
from opir_trackers.profile.fit import SPACING
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.rows import compressed, normal_points, single
from opir_trackers.profile.windows import windowed

from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.flight.aiming import aim
from opir_core.flight.boost import PROFILES_BY_TYPE, boost_profile, boost_profiles
from opir_core.geometry import Geodetic
from opir_core.scene.scene import TARGET_TYPES


@pytest.mark.parametrize("profile", boost_profiles().values(), ids=lambda profile: profile.name)
def test_the_family_holds_the_class_profiles(profile):
    far = 1.15 * profile.reference_range_m / 6.37e6
    flight = aim(Geodetic(0.6, -2.1, 0.0), Geodetic(0.6 - 0.5 * far, -2.1 + 0.8 * far, 0.0), 10.0, [profile])
    prior = Priors(
        *np.array(
            [
                profile.burn_time_s,
                profile.burnout_speed_m_s,
                profile.speed_shape,
                profile.pitch_exponent,
                profile.pitch_start_s / profile.burn_time_s,
                *np.ones(8),
            ]
        )[:, None]
    )
    x = np.zeros((1, SIZE))
    turn, azimuth = 0.5 * np.pi - flight.burnout_flight_path_angle_rad, flight.azimuth_rad
    x[:, TURN_EAST], x[:, TURN_NORTH] = turn * np.sin(azimuth), turn * np.cos(azimuth)
    x[:, SPEED] = np.log(flight.burnout_speed_m_s / profile.burnout_speed_m_s)
    family = Family.of(fitted(x, prior), Anchors(np.array([0.6]), np.array([-2.1]), np.array([10.0])), prior)
    row, time_s = np.zeros(60, dtype=np.int64), np.linspace(10.0, 10.0 + profile.burn_time_s, 60)
    ours, theirs = family.places(row, time_s), flight.path.state(row, time_s)
    assert np.abs(ours.position_m - theirs[0]).max() < 0.05
    assert np.abs(ours.velocity_m_s - theirs[1]).max() < 1e-4


@given(
    kind=st.sampled_from(TARGET_TYPES),
    burn=st.floats(-4.0, 4.0),
    pitch=st.floats(-3.0, 3.0),
    lift=st.floats(-6.0, 6.0),
)
def test_coordinates_go_there_and_back_for_burns_however_long_or_short(kind, burn, pitch, lift):
    prior = PRIORS.take(np.array([TARGET_TYPES.index(kind)]))
    x = np.zeros((1, SIZE))
    x[0, [TURN_EAST, TURN_NORTH, BURN, PITCH, LIFT]] = 0.3, -0.2, burn, pitch, lift
    there = fitted(x, prior)
    back = natural(there, prior)
    np.testing.assert_allclose(back.parameters, x, atol=1e-12)
    assert np.isfinite(back.lean_slope).all()
    assert 0.0 < back.lean[0] <= 1.0


@pytest.mark.parametrize("kind", TARGET_TYPES)
def test_a_burn_that_is_over_by_the_reference_time_has_turned_whole(kind):
    prior = PRIORS.take(np.array([TARGET_TYPES.index(kind)]))
    x = np.zeros((3, SIZE))
    x[:, BURN], x[:, LIFT] = np.log(REFERENCE) - np.array([1e-9, 1.0, 3.0]), 5.0
    found = natural(fitted(x, prior), prior)
    np.testing.assert_allclose(found.lean, 1.0, rtol=1e-12)
    np.testing.assert_allclose(found.lean_slope, 0.0, atol=1e-12)


@pytest.mark.parametrize("kind", TARGET_TYPES)
def test_priors_are_wide_enough_for_the_profiles_of_their_type(kind):
    prior = priors_of(BoostProfileConfig().priors).take([TARGET_TYPES.index(kind)])
    for profile in (boost_profile(name) for name in PROFILES_BY_TYPE[kind]):
        pairs = (
            (np.log(profile.burn_time_s / prior.burn_s), prior.burn_sigma),
            (np.log(profile.burnout_speed_m_s / prior.speed_m_s), prior.speed_sigma),
            (np.log(profile.speed_shape / prior.speed_shape), prior.shape_sigma),
            (np.log(profile.pitch_exponent / prior.pitch_exponent), prior.pitch_sigma),
            (np.log(profile.pitch_start_s / profile.burn_time_s / prior.lift), prior.lift_sigma),
            (0.5 * np.pi - profile.burnout_flight_path_angle_rad - prior.turn_rad, prior.turn_sigma_rad),
        )
        assert all(abs(float(away[0])) < 1.5 * float(sigma[0]) for away, sigma in pairs)


def test_slopes_are_central_differences():
    truth = flights("ICBM", 3, seed=1)
    row, time_s = np.repeat(np.arange(3), 12), np.tile(np.linspace(20.0, 260.0, 12), 3)
    slope = fit.family_of(truth, PRIORS).places(row, time_s).slope
    for index, step in enumerate([10.0, 10.0, 1e-3, *[1e-4] * 7]):
        ends = [
            fit.family_of(evolve(truth, parameters=truth.parameters + sign * step * np.eye(SIZE)[index]), PRIORS)
            .places(row, time_s)
            .position_m
            for sign in (1.0, -1.0)
        ]
        central = (ends[0] - ends[1]) / (2.0 * step)
        away = np.abs(slope[:, index] - central).max(axis=1)
        size = np.abs(central).max()
        assert away[time_s < 180.0].max() < 1e-4 * size
        # Beyond the burnout, at 181 to 211 s, paths go on about as they did.
        assert away.max() < 4e-3 * size


def rays_along_a_line(count, sigma_rad, seed):
    """Return rays of a sensor over the equator at a point that falls by 300 m in a second, and the point as a path."""
    rng = np.random.default_rng(seed)
    time_s = np.sort(rng.uniform(3.0, 4.0, count))

    def path(rows):
        away = rows.time_s[:, None] - 3.0
        return np.array([6.4e6, 1e5, 2e6]) + away * np.array([-300.0, 0.0, 100.0]) - 50.0 * away**2

    origin = np.tile([GEO_M, 0.0, 0.0], (count, 1))
    unused = np.zeros(count, dtype=np.int64)
    rays = LinesOfSight(time_s, unused.astype(np.int32), unused, origin, origin, np.full(count, sigma_rad))
    line = path(single(unused, rays)) - origin + rng.normal(size=(count, 3)) * sigma_rad * 3.6e7
    return evolve(rays, direction_ecef=line / np.linalg.norm(line, axis=1)[:, None]), path


def test_normal_points_keep_the_bend_and_leave_out_what_strays():
    rays, path = rays_along_a_line(40, 1e-9, 3)
    rays.direction_ecef[7] += [0.0, 1e-6, 0.0]
    rows = single(np.zeros(40, dtype=np.int64), rays)
    point = normal_points(rows, path, np.zeros(40, dtype=np.int64))
    assert len(point) == 1
    line = path(point) - point.origin_ecef_m
    line /= np.linalg.norm(line, axis=1)[:, None]
    # The ray that strays by a thousand deviations would move the mean by 2.5e-8 rad.
    assert np.abs(point.axes[0, 2] - line[0]).max() < 4.0 * 1e-9 / np.sqrt(39)
    # That there are strays makes each of the others a little less certain.
    assert 1.0 <= point.sigma_rad[0] / (1e-9 / np.sqrt(39)) < 1.1


def test_normal_points_of_a_long_flight_are_few_and_say_as_much():
    truth = flights("ICBM", 1, seed=4)
    track, rays = lines_of_sight(truth, 2e-5, seed=4)
    family = fit.family_of(truth, PRIORS)

    def path(rows):
        return family.places(np.zeros(len(rows), dtype=np.int64), rows.time_s).position_m

    rows = normal_points(single(track, rays), path, np.floor(rays.time_s).astype(np.int64))
    few = compressed(rows, float(rays.time_s[-1]) + 1.0, path)
    assert len(few) < 0.4 * len(rows)
    sums = []
    for each in (rows, few):
        each = each.take(np.argsort(each.time_s))
        owner = np.zeros(len(each), dtype=np.int64)
        whole = fit.with_rows(evolve(truth).cleared(), family, each, owner, np.ones(len(each)))
        solved = fit.solved(whole, PRIORS, np.zeros(2))
        sums.append(np.sqrt(np.diagonal(solved.spread, axis1=1, axis2=2))[0])
    assert sums[1] == pytest.approx(sums[0], rel=0.01)


def test_windows_of_a_line_add_up_to_one():
    straight = evolve(fit.blank(1, 1), kind=np.array([2]), spread=np.diag([1.0] * 3 + [1.0, 0.1] + [1.0] * 5)[None])
    split = windowed(straight, PRIORS, np.zeros(1, dtype=np.bool_))
    lean = np.linspace(-0.6, 0.6, 41)
    along, middle, narrow = split.window[::2, :2], split.window[::2, 2], split.window[::2, 3]
    assert np.abs(along[:, 0]) == pytest.approx(1.0)
    curves = np.exp(-0.5 * narrow[:, None] * np.square(lean - middle[:, None])) * SPACING / np.sqrt(2.0 * np.pi)
    assert curves.sum(axis=0) == pytest.approx(1.0, abs=0.01)


def test_natural_parameters_and_back():
    rng = np.random.default_rng(2)
    prior = PRIORS.take(rng.integers(0, 3, 20))
    truth = 0.2 * rng.normal(size=(20, SIZE))
    # Pitch starts of up to three times the median come after the reference time.
    truth[:, LIFT] = np.linspace(-0.3, 1.1, 20)
    there = fitted(truth, prior)
    assert natural(there, prior).parameters == pytest.approx(truth, abs=1e-12)
    slope = natural(there, prior).slope()
    for index in range(SIZE):
        step = 1e-6 * np.eye(SIZE)[index]
        ends = [natural(there + sign * step, prior).parameters for sign in (1.0, -1.0)]
        assert slope[:, :, index] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-7)


def test_a_target_that_still_climbs_straight_may_lean_already():
    truth = flights("ICBM", 5, 1)
    sigma = np.array([50.0, 50.0, 3.0, 0.3, 0.3, 0.02, 0.2, 0.2, 0.15, 0.3])
    climbing = evolve(truth, spread=np.tile(np.diag(np.square(sigma)), (5, 1, 1)))
    told = report(climbing, np.ones(5), 10.0, Basis(PRIORS, "kepler"))
    family = fit.family_of(truth, PRIORS)
    assert np.all(family.start_s + family.courses.lift * family.courses.burn_s > 10.0)
    # Metres a second in every direction, of about a hundred upwards.
    assert np.linalg.eigvalsh(told.state_covariance[:, 3:, 3:])[:, 0].min() > 1.0


def test_a_target_whose_heading_is_unknown_may_lean_in_every_direction():
    sigma = np.array([50.0, 50.0, 3.0, 0.3, 0.3, 0.02, 0.2, 0.2, 0.15, 0.3])
    straight = evolve(fit.blank(1, 2), spread=np.diag(np.square(sigma))[None])
    told = report(straight, np.ones(1), 8.0, Basis(PRIORS, "kepler"))
    assert np.linalg.eigvalsh(told.state_covariance[:, 3:, 3:])[:, 0].min() > 1.0
