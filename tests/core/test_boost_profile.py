"""The tracker `boost-profile`: its family and fit against closed forms and truth, and what it promises of a scene."""

import numpy as np
import pytest
from attrs import evolve
from profile_flights import GEO_M, PRIORS, flights, lines_of_sight, watch_of

from opir_core import simulate
from opir_core.flight.aiming import aim
from opir_core.flight.profiles import PROFILES_BY_TYPE, boost_profile, boost_profiles
from opir_core.geometry import Geodetic
from opir_core.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees
from opir_core.tracking.configs import BoostProfileConfig
from opir_core.tracking.profile import fit
from opir_core.tracking.profile import flight as profile_flight
from opir_core.tracking.profile.bank import Fitting
from opir_core.tracking.profile.coordinates import fitted, natural
from opir_core.tracking.profile.end import Silence, ends_of
from opir_core.tracking.profile.family import BURN, LIFT, SIZE, SPEED, TURN_EAST, TURN_NORTH, Anchors, Family, Priors
from opir_core.tracking.profile.hypotheses import probability
from opir_core.tracking.profile.priors import priors_of
from opir_core.tracking.profile.report import report
from opir_core.tracking.profile.rows import axes_about, compressed, normal_points, single
from opir_core.tracking.profile.strain import Bank
from opir_core.tracking.profile.windows import windowed
from opir_core.tracking.rays import Rays


def scene(**settings):
    return scene_from_mapping(
        {
            "scene": "profiles",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 45.0,
            "seed": 5,
            "sensors": [
                {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0},
                {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -90.0},
            ],
            "targets": [
                {
                    "id": "T1",
                    "type": "SRBM",
                    "launch": {"lat_deg": 36.73, "lon_deg": -110.57, "time_s": 2.0},
                    "aim": {"lat_deg": 39.0, "lon_deg": -110.0},
                }
            ],
            "tracker": "boost-profile",
            **settings,
        }
    )


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
                *np.ones(7),
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
    rays = Rays(time_s, unused.astype(np.int32), unused, origin, origin, np.full(count, sigma_rad))
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


def silence(last, until, chance=0.5, period=0.1):
    return Silence(*(np.array([[value]]) for value in (last, until, chance)), np.array([period]))


def test_an_end_that_may_be_any_time_after_the_last_light_is_a_truncated_lognormal():
    from scipy.integrate import quad
    from scipy.stats import norm, truncnorm

    start, mean, sigma, last = 4.0, np.log(96.0), 0.08, 104.0
    found = ends_of(np.array([start]), np.array([mean]), np.array([sigma**2]), silence(last, last))
    law = truncnorm((np.log(last - start) - mean) / sigma, np.inf, loc=mean, scale=sigma)
    assert found.mean == pytest.approx(law.mean(), abs=2e-4)
    assert found.variance == pytest.approx(law.var(), rel=0.01)
    assert np.exp(found.evidence) == pytest.approx(norm.sf(np.log(last - start), mean, sigma), rel=0.01)
    # Three nodes are exact for polynomials of the fifth degree.
    there = found.mean + np.sqrt(found.variance) * found.nodes[0]
    for power in range(6):
        exact = quad(lambda x, n=power: (x - mean) ** n * law.pdf(x), law.ppf(0.0), law.ppf(1.0 - 1e-12))[0]
        assert np.sum(found.weights[0] * (there - mean) ** power) == pytest.approx(exact, rel=0.02)


def test_silence_ends_a_burn_within_a_geometric_number_of_looks():
    last, until = np.full((1, 2), 104.0), np.full((1, 2), 110.0)
    both = Silence(last, until, np.full((1, 2), 0.5), np.full(2, 0.1))
    start, sigma = np.zeros(1), np.array([0.04])
    found = ends_of(start, np.log([104.0]), sigma, both)
    missed = np.arange(60)
    weight = 0.25**missed
    expected = np.sum(weight * (missed + 0.5) * 0.1) / weight.sum()
    assert np.exp(found.mean) - 104.0 == pytest.approx(expected, rel=0.02)
    far = ends_of(start, np.log([300.0]), sigma, both)
    assert far.evidence < found.evidence - 10.0


@pytest.mark.parametrize("period", [0.05, 0.2])
def test_a_look_at_the_tick_is_not_missed_before_it_comes(period):
    # The looks at 104.0 and 105.0, and those between: of the last, at the tick, nothing is known at the tick.
    start, mean, sigma = np.zeros(1), np.log([104.0]), np.array([0.04])
    seen = ends_of(start, mean, sigma, silence(105.0 - period, 105.0, 0.95, period))
    fresh = ends_of(start, mean, sigma, silence(105.0 - period, 105.0 - period, 0.95, period))
    assert seen.evidence == pytest.approx(fresh.evidence, abs=1e-9)
    assert seen.mean == pytest.approx(fresh.mean, abs=1e-9)


@pytest.mark.parametrize("period", [0.05, 0.1])
def test_many_missed_looks_leave_an_end_between_the_last_light_and_the_next_look(period):
    both = Silence(np.full((1, 2), 104.0), np.full((1, 2), 110.0), np.full((1, 2), 0.98), np.full(2, period))
    found = ends_of(np.zeros(1), np.log([104.0]), np.array([0.04]), both)
    # Even over the period; the edge of that is known to half a cell of the quadrature, a twelfth of the period.
    assert np.exp(found.mean) - 104.0 == pytest.approx(0.5 * period, rel=0.05)
    assert np.sqrt(found.variance) * 104.0 == pytest.approx(period / np.sqrt(12.0), rel=0.05)


def test_a_sensor_that_fails_does_not_end_a_burn_that_another_sees():
    both = Silence(np.array([[50.0, 90.0]]), np.array([[90.0, 90.0]]), np.full((1, 2), 0.8), np.full(2, 0.1))
    found = ends_of(np.zeros(1), np.log([120.0]), np.array([0.0069]), both)
    assert np.exp(found.mean) == pytest.approx(120.0, abs=0.5)


def told(kind, runs, seed, ticks, biases_rad=0.0, sensors=2, priors=PRIORS):
    """Return the truth and what is told of it at some ticks, and four seconds after all burns have ended."""
    truth = flights(kind, runs, seed)
    track, rays = lines_of_sight(truth, 2e-5, seed, biases_rad=biases_rad, sensors=sensors)
    fitting = Fitting(priors, watch_of(sensors, bias_sigma_rad=biases_rad), True)
    bank, cut, found = Bank.empty(sensors), 0, []
    last = int(rays.time_s[-1] + 4.0) if ticks is None else ticks[-1]
    for tick in range(1, last + 1):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        cut = end
        if tick == last or tick in (ticks or ()):
            likely = probability(bank.hypotheses)
            found.append(report(bank.hypotheses, likely, float(tick), priors, "kepler", np.inf))
    return truth, found


def true_values(truth, tick_s):
    """Return true states at a tick, impacts, and whether the burn goes on."""
    family, none = fit.family_of(truth, PRIORS), np.zeros((len(truth), SIZE, SIZE))
    ends, slope = profile_flight.burnouts(family, none)
    state = profile_flight.states(family, none, tick_s, ends, slope)
    return state.mean, profile_flight.impacts(ends, slope, none, "kepler").mean, family.burnout_s > tick_s


@pytest.mark.parametrize("biases_rad", [0.0, 6e-5])
def test_errors_of_states_are_what_their_covariances_say(biases_rad):
    truth, found = told("SRBM", 30, 7, (35, 50), biases_rad)
    for each in found:
        state, _, burning = true_values(truth, float(each.tick_s[0]))
        values = nees(each.state - state, each.state_covariance)[burning]
        # The mean of n values of six degrees of freedom wanders by √(12/n); 3.3 of them is 99.9 %.
        assert abs(values.mean() - 6.0) < 3.3 * np.sqrt(12.0 / len(values))


def test_one_sensor_alone_is_as_sure_as_it_may_be():
    truth, found = told("SRBM", 30, 3, (30, 45), sensors=1, priors=PRIORS.take([TARGET_TYPES.index("SRBM")]))
    for each in found:
        state, _, burning = true_values(truth, float(each.tick_s[0]))
        values = nees(each.state - state, each.state_covariance)[burning]
        assert abs(values.mean() - 6.0) < 3.3 * np.sqrt(12.0 / len(values))
        # Most of what is in doubt is along the line of sight: kilometres, where two sensors leave 300 m.
        assert np.median(np.sqrt(np.trace(each.state_covariance[:, :3, :3], axis1=1, axis2=2))) > 1e3


def late_flights(kind, copies, **away):
    """Return a flight several times over that is so many of the prior's standard deviations from the type's middle."""
    number, columns = TARGET_TYPES.index(kind), {"speed": SPEED, "burn": BURN, "lift": LIFT}
    prior, truth = PRIORS.take(np.full(copies, number)), flights(kind, copies, 1)
    x = np.zeros((copies, SIZE))
    x[:, TURN_EAST], x[:, TURN_NORTH] = -0.68 * prior.turn_rad, -0.73 * prior.turn_rad
    for name, sigmas in away.items():
        x[:, columns[name]] = sigmas * getattr(prior, f"{name}_sigma")
    anchors = {name: np.repeat(getattr(truth, f"anchor_{name}_rad")[0], copies) for name in ("latitude", "longitude")}
    there = {f"anchor_{name}_rad": value for name, value in anchors.items()}
    return evolve(truth, parameters=fitted(x, prior), **there)


def nees_of(truth, tick_s, sensors, chance):
    """Return the NEES at a tick of flights of one type, seen by like, sharp sensors."""
    track, rays = lines_of_sight(truth, 1e-5, 1, sensors=sensors, period_s=0.05, chance=chance)
    fitting, bank, cut = (
        Fitting(PRIORS.take(truth.kind[:1]), watch_of(sensors, 0.05, chance), True),
        Bank.empty(sensors),
        0,
    )
    for tick in range(1, tick_s + 1):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        cut = end
    found = report(bank.hypotheses, probability(bank.hypotheses), float(tick_s), fitting.priors, "kepler", np.inf)
    return nees(found.state - true_values(truth, float(tick_s))[0], found.state_covariance)


#: The largest of six of χ² of six degrees of freedom is above this with a chance of 0.1 %.
LARGEST_OF_SIX = 26.7


def test_one_sensor_finds_the_side_of_a_flight_that_pitches_over_after_it_was_split():
    # The pitch starts 17 s after the launch: a second after the split, and where the class's median is 8 s.
    values = nees_of(late_flights("IRBM", 6, lift=2.6, speed=2.0), 45, sensors=1, chance=0.92)
    assert values.max() < LARGEST_OF_SIX


def test_a_fit_settles_where_the_pitch_starts_after_the_reference_time_of_the_lean():
    truth = late_flights("SRBM", 6, lift=2.0, burn=1.3, speed=0.6)
    after_s = int(fit.family_of(truth, PRIORS).burnout_s[0]) + 5
    assert nees_of(truth, after_s, sensors=2, chance=0.85).max() < LARGEST_OF_SIX


def test_windows_of_a_line_add_up_to_one():
    straight = evolve(fit.blank(1, 1), kind=np.array([2]), spread=np.diag([1.0] * 3 + [1.0, 0.1] + [1.0] * 5)[None])
    split = windowed(straight, PRIORS)
    lean = np.linspace(-0.6, 0.6, 41)
    along, middle, narrow = split.window[::2, :2], split.window[::2, 2], split.window[::2, 3]
    assert np.abs(along[:, 0]) == pytest.approx(1.0)
    curves = np.exp(-0.5 * narrow[:, None] * np.square(lean - middle[:, None])) * fit.SPACING / np.sqrt(2.0 * np.pi)
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
    told = report(climbing, np.ones(5), 10.0, PRIORS, "kepler", np.inf)
    family = fit.family_of(truth, PRIORS)
    assert np.all(family.start_s + family.courses.lift * family.courses.burn_s > 10.0)
    # Metres a second in every direction, of about a hundred upwards.
    assert np.linalg.eigvalsh(told.state_covariance[:, 3:, 3:])[:, 0].min() > 1.0


def test_a_target_whose_heading_is_unknown_may_lean_in_every_direction():
    sigma = np.array([50.0, 50.0, 3.0, 0.3, 0.3, 0.02, 0.2, 0.2, 0.15, 0.3])
    straight = evolve(fit.blank(1, 2), spread=np.diag(np.square(sigma))[None])
    told = report(straight, np.ones(1), 8.0, PRIORS, "kepler", np.inf)
    assert np.linalg.eigvalsh(told.state_covariance[:, 3:, 3:])[:, 0].min() > 1.0


def test_impact_ellipses_hold_the_truth():
    truth, (found,) = told("SRBM", 30, 11, None)
    _, impact, _ = true_values(truth, float(found.tick_s[0]))
    away = profile_flight.on_ground(impact, found.impact)
    values = nees(away[:, :2], found.impact_covariance[:, :2, :2])
    assert abs(values.mean() - 2.0) < 3.3 * np.sqrt(4.0 / 30)
    # 30 draws that are held with 95 %: fewer than 24 are a case of one in a thousand.
    assert np.count_nonzero(values < 5.99) >= 24


def test_a_scene_is_tracked_to_launch_and_impact():
    run = simulate(scene(duration_s=75.0))
    last = run.tracks.take(np.flatnonzero(run.tracks.tick_s == 75.0))
    assert len(last) == 1
    assert np.degrees(last.launch[0, :2]) == pytest.approx([36.73, -110.57], abs=0.02)
    assert last.launch[0, 2] == pytest.approx(2.0, abs=2.0)
    assert last.type_probability[0].argmax() == 2
    assert np.degrees(last.impact[0, :2]) == pytest.approx([39.0, -110.0], abs=0.15)
    assert np.linalg.eigvalsh(last.state_covariance).min() > 0.0
    assert np.linalg.eigvalsh(last.impact_covariance).min() > 0.0


def test_an_impact_that_could_be_anywhere_is_not_told():
    near, far = (
        simulate(scene(duration_s=20.0, tracker={"model": "boost-profile", "largest_impact_km": limit})).tracks
        for limit in (50.0, 20000.0)
    )
    assert np.isnan(near.impact[-1]).all()
    assert np.isfinite(far.impact[-1]).all()
    assert 2.448 * np.sqrt(np.linalg.eigvalsh(far.impact_covariance[-1, :2, :2])[-1]) > 50e3


def test_the_end_of_the_burn_is_told_within_its_covariance():
    told = scene(duration_s=90.0)
    truth = compile_plan(told).targets.truth()[0]
    burnout = [*truth["burnout"]["position_ecef_m"], *truth["burnout"]["velocity_ecef_m_s"], truth["burnout_s"]]
    last = simulate(told).tracks.take(slice(-1, None))
    away, spread = last.burnout[0] - burnout, last.burnout_covariance[0]
    assert away @ np.linalg.solve(spread, away) < 24.3  # 99.9 % of chi-square with seven degrees of freedom
    assert np.sqrt(np.diag(spread))[6] < 0.2
    for covariance in (spread, last.launch_covariance[0], last.impact_covariance[0]):
        assert np.linalg.eigvalsh(covariance).min() > 0.0


def test_windows_change_no_byte():
    long, short = (simulate(scene(duration_s=20.0), window_s=window_s) for window_s in (20.0, 3.7))
    assert len(long.tracks) > 10
    for name in ("state", "state_covariance", "launch", "impact", "impact_covariance", "type_probability"):
        assert getattr(long.tracks, name).tobytes() == getattr(short.tracks, name).tobytes()


def test_one_sensor_is_enough_and_says_how_little_it_knows():
    stereo, mono = (
        simulate(
            scene(
                duration_s=30.0,
                sensors=[{"model": "SBIRS-GEO", "id": id_, "orbital_slot_deg": slot} for id_, slot in sensors],
            )
        )
        for sensors in ((("A", -150.0), ("B", -90.0)), (("A", -150.0),))
    )
    spreads = [float(np.sqrt(np.trace(run.tracks.state_covariance[-1, :3, :3]))) for run in (stereo, mono)]
    assert spreads[0] < spreads[1]


def test_what_older_looks_say_fades_when_new_ones_drift_and_not_before():
    truth = flights("IRBM", 12, 5)
    track, rays = lines_of_sight(truth, 2e-5, 5)
    fading = []
    for bend_rad_s in (0.0, 2e-6):
        fitting, bank, cut = Fitting(PRIORS, watch_of(2), True), Bank.empty(2), 0
        late = np.maximum(rays.time_s - 40.0, 0.0)[:, None]
        turned = rays.direction_ecef + bend_rad_s * late**1.5 * axes_about(rays)[:, 0]
        bent = evolve(rays, direction_ecef=turned / np.linalg.norm(turned, axis=1)[:, None])
        for tick in range(1, 66):
            end = int(np.searchsorted(rays.time_s, tick))
            bank = fitting.stepped(bank, float(tick), track[cut:end], bent.take(slice(cut, end)))
            cut = end
        least = 1.0 / np.square(bank.rows.sigma_rad)
        fading.append(float(np.median(least[bank.rows.time_s < 35.0])))
    assert fading[1] < 0.3 * fading[0]
