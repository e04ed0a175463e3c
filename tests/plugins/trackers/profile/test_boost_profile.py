"""The tracker `boost-profile`: errors as covariances say, by one sensor and two, and what it promises of a scene."""

import numpy as np
import pytest
from attrs import evolve
from class_flights import PRIORS, bank_after, flights, lines_of_sight, watch_of
from opir_trackers.profile import fit
from opir_trackers.profile import flight as profile_flight
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import BURN, LIFT, SIZE, SPEED, TURN_EAST, TURN_NORTH, fitted
from opir_trackers.profile.hypotheses import probability
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.rows import axes_about
from opir_trackers.profile.strain import OffModelFilters

from opir_core import simulate
from opir_core.planning.plan import compile_plan
from opir_core.scene.reading import scene_from_mapping
from opir_core.scene.scene import TARGET_TYPES
from opir_core.scoring.consistency import nees, on_normal_scale


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


def told(kind, runs, seed, ticks, biases_rad=0.0, sensors=2, priors=PRIORS):
    """Return the truth and what is told of it at some ticks, and four seconds after all burns have ended."""
    truth = flights(kind, runs, seed)
    track, rays = lines_of_sight(truth, 2e-5, seed, biases_rad=biases_rad, sensors=sensors)
    fitting = Fitting(priors, watch_of(sensors, bias_sigma_rad=biases_rad), True)
    bank, cut, found = OffModelFilters.empty(sensors), 0, []
    last = int(rays.time_s[-1] + 4.0) if ticks is None else ticks[-1]
    for tick in range(1, last + 1):
        end = int(np.searchsorted(rays.time_s, tick))
        bank = fitting.stepped(bank, float(tick), track[cut:end], rays.take(slice(cut, end)))
        cut = end
        if tick == last or tick in (ticks or ()):
            likely = probability(bank.hypotheses)
            found.append(report(bank.hypotheses, likely, float(tick), Basis(priors, "kepler")))
    return truth, found


def true_values(truth, tick_s):
    """Return true states at a tick, impacts, and whether the burn goes on."""
    family, none = fit.family_of(truth, PRIORS), np.zeros((len(truth), SIZE, SIZE))
    ends, slope = profile_flight.burnouts(family, none)
    state = profile_flight.states(family, none, tick_s, ends, slope)
    return state.mean, profile_flight.impacts(ends, slope, none, "kepler").mean, family.burnout_s > tick_s


@pytest.mark.slow
@pytest.mark.parametrize("biases_rad", [0.0, 6e-5])
def test_errors_of_states_are_what_their_covariances_say(biases_rad):
    truth, found = told("SRBM", 30, 7, (35, 50), biases_rad)
    for each in found:
        state, _, burning = true_values(truth, float(each.tick_s[0]))
        values = nees(each.state - state, each.state_covariance)[burning]
        # The mean of n values of six degrees of freedom wanders by √(12/n); 3.3 of them is 99.9 %.
        assert abs(values.mean() - 6.0) < 3.3 * np.sqrt(12.0 / len(values))


@pytest.mark.slow
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
    fitting = Fitting(PRIORS.take(truth.kind[:1]), watch_of(sensors, 0.05, chance), True)
    bank = bank_after(fitting, track, rays, tick_s)
    found = report(bank.hypotheses, probability(bank.hypotheses), float(tick_s), Basis(fitting.priors, "kepler"))
    return nees(found.state - true_values(truth, float(tick_s))[0], found.state_covariance)


#: The largest of six of χ² of six degrees of freedom is above this with a chance of 0.1 %.
LARGEST_OF_SIX = 26.7


@pytest.mark.slow
def test_one_sensor_finds_the_side_of_a_flight_that_pitches_over_after_it_was_split():
    # The pitch starts 17 s after the launch: a second after the split, and where the class's median is 8 s.
    values = nees_of(late_flights("IRBM", 6, lift=2.6, speed=2.0), 45, sensors=1, chance=0.92)
    assert values.max() < LARGEST_OF_SIX


@pytest.mark.slow
def test_a_fit_settles_where_the_pitch_starts_after_the_reference_time_of_the_lean():
    truth = late_flights("SRBM", 6, lift=2.0, burn=1.3, speed=0.6)
    after_s = int(fit.family_of(truth, PRIORS).burnout_s[0]) + 5
    assert nees_of(truth, after_s, sensors=2, chance=0.85).max() < LARGEST_OF_SIX


@pytest.mark.slow
def test_impact_ellipses_hold_the_truth():
    truth, (found,) = told("SRBM", 30, 11, None)
    _, impact, _ = true_values(truth, float(found.tick_s[0]))
    away = profile_flight.on_ground(impact, found.impact)
    values = nees(away[:, :2], found.impact_covariance[:, :2, :2])
    assert abs(values.mean() - 2.0) < 3.3 * np.sqrt(4.0 / 30)
    # 30 draws that are held with 95 %: fewer than 24 are a case of one in a thousand.
    assert np.count_nonzero(values < 5.99) >= 24


@pytest.mark.slow
def test_impact_ellipses_hold_what_they_say_while_the_end_of_the_burn_is_open():
    # Told of the class: of flights of one class alone no posterior over three is right.
    truth, (found,) = told("IRBM", 60, 5, (65,), priors=PRIORS.take([TARGET_TYPES.index("IRBM")]))
    _, impact, burning = true_values(truth, 65.0)
    away = profile_flight.on_ground(impact, found.impact)[:, :2]
    usual = nees(away, found.impact_covariance[:, :2, :2])[burning]
    values = on_normal_scale(usual, found.impact_sigmas[burning])
    assert len(values) > 50
    # The ellipse that would hold half of a normal distribution holds far more; 3.3 σ is 99.9 %.
    half, wanders = np.log(4.0), 3.3 * np.sqrt(0.25 / len(values))
    assert np.mean(usual <= half) > 0.5 + wanders
    assert abs(np.mean(values <= half) - 0.5) < wanders
    assert np.mean(values <= 5.99) > 0.95 - 3.3 * np.sqrt(0.95 * 0.05 / len(values))


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


@pytest.mark.slow
def test_an_impact_that_could_be_anywhere_is_not_told():
    tracker = {"model": "boost-profile", "impacts_in_burn": True}
    near, far = (
        simulate(scene(duration_s=20.0, tracker={**tracker, "largest_impact_km": limit})).tracks
        for limit in (50.0, 20000.0)
    )
    assert np.isnan(near.impact[-1]).all()
    assert np.isfinite(far.impact[-1]).all()
    assert 2.448 * np.sqrt(np.linalg.eigvalsh(far.impact_covariance[-1, :2, :2])[-1]) > 50e3


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_what_older_looks_say_fades_when_new_ones_drift_and_not_before():
    truth = flights("IRBM", 12, 5)
    track, rays = lines_of_sight(truth, 2e-5, 5)
    fading = []
    for bend_rad_s in (0.0, 2e-6):
        fitting, bank, cut = Fitting(PRIORS, watch_of(2), True), OffModelFilters.empty(2), 0
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
