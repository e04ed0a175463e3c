"""The tracker `boost-profile`: its family, its fit against closed forms and truth, and what it promises."""

import numpy as np
import pytest

from opir_core import simulate
from opir_core.flight.aiming import aim
from opir_core.flight.profiles import boost_profile
from opir_core.geometry import Geodetic
from opir_core.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.scoring.consistency import nees
from opir_core.tracking import profile_fit as fit
from opir_core.tracking.profile_family import (
    CLASSES,
    SIZE,
    SPEED,
    TURN_EAST,
    TURN_NORTH,
    Anchors,
    Shapes,
    drawn_out,
    paths,
)
from opir_core.tracking.profile_rows import averaged, single
from opir_core.tracking.rays import Rays

KIND = np.array([CLASSES.index("ICBM_liquid")])


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


def true_parameters(flight):
    """Return the parameters of a flight, counted from its own launch: the family holds what a scene launches."""
    nominal = Shapes.of(KIND)
    x = np.zeros((1, SIZE))
    turn, azimuth = 0.5 * np.pi - flight.burnout_flight_path_angle_rad, flight.azimuth_rad
    x[:, TURN_EAST], x[:, TURN_NORTH] = turn * np.sin(azimuth), turn * np.cos(azimuth)
    x[:, SPEED] = np.log(flight.burnout_speed_m_s / nominal.speed_m_s)
    return x


@pytest.fixture(scope="module")
def flight():
    launch, goal = Geodetic(0.6, -2.1, 0.0), Geodetic(0.16, 2.93, 0.0)
    return aim(launch, goal, 10.0, [boost_profile("ICBM_liquid")])


def anchors():
    return Anchors(np.array([0.6]), np.array([-2.1]), np.array([10.0]))


def test_the_family_holds_the_class_profiles(flight):
    path = paths(true_parameters(flight), anchors(), Shapes.of(KIND))
    row, time_s = np.zeros(60, dtype=np.int64), np.linspace(10.0, 260.0, 60)
    ours, theirs = path.state(row, time_s), flight.path.state(row, time_s)
    assert np.abs(ours[0] - theirs[0]).max() < 1e-5
    assert np.abs(ours[1] - theirs[1]).max() < 1e-7


def test_outside_the_burn_a_path_rests_and_goes_straight_on(flight):
    path = paths(true_parameters(flight), anchors(), Shapes.of(KIND))
    position, velocity = drawn_out(path, np.zeros(3, dtype=np.int64), np.array([0.0, 260.0, 262.0]))
    assert np.abs(position[0] - flight.path.state(np.zeros(1, dtype=np.int64), np.array([10.0]))[0]).max() < 1e-6
    assert position[2] - position[1] == pytest.approx(2.0 * velocity[1], rel=1e-9)


def rays_of(flight, rng, sigma_rad, period_s=0.5):
    """Return noisy rays of two geostationary sensors at a flight, by time."""
    time_s = np.repeat(np.arange(11.0, 259.0, period_s), 2)
    sensor = np.tile([0, 1], len(time_s) // 2)
    position, _ = flight.path.state(np.zeros(len(time_s), dtype=np.int64), time_s)
    longitude = np.radians([-150.0, -90.0])[sensor]
    origin = 4.2164e7 * np.stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1)
    line = position - origin
    unit = line / np.linalg.norm(line, axis=1)[:, None]
    noisy = unit + rng.normal(size=unit.shape) * sigma_rad
    noisy /= np.linalg.norm(noisy, axis=1)[:, None]
    scan = np.arange(len(time_s), dtype=np.int64)
    return Rays(time_s, sensor.astype(np.int32), scan, origin, noisy, np.full(len(time_s), sigma_rad))


def hypothesis(parameters):
    from opir_core.tracking.profile_hypotheses import blank as blank_hypotheses

    blank = blank_hypotheses(1, 2)
    place = anchors()
    for name, value in (
        ("kind", KIND),
        ("anchor_latitude_rad", place.latitude_rad),
        ("anchor_longitude_rad", place.longitude_rad),
        ("anchor_s", place.time_s),
        ("parameters", parameters),
    ):
        object.__setattr__(blank, name, value)
    return blank


def test_means_of_a_second_are_where_its_middle_is(flight):
    rays = rays_of(flight, np.random.default_rng(1), 1e-12, period_s=0.1)
    rows = averaged(np.zeros(len(rays), dtype=np.int64), rays)
    owner = np.zeros(len(rows), dtype=np.int64)
    seen, _ = fit.linearised(hypothesis(true_parameters(flight)), rows, owner, False)
    # A second's bend, a / 24 R: 3e-8 rad at 30 m/s², half of what one look of 20 urad in 10 000 would tell.
    assert np.abs(seen).max() < 1e-7
    assert rows.sigma_rad == pytest.approx(np.full(len(rows), 1e-12 / np.sqrt(10.0)), rel=0.12)


def test_slopes_are_central_differences(flight):
    truth = true_parameters(flight)
    rows = single(0, rays_of(flight, np.random.default_rng(2), 1e-6).take(slice(0, 400, 40)))
    owner = np.zeros(len(rows), dtype=np.int64)
    _, slope = fit.linearised(hypothesis(truth), rows, owner, True)
    for index, step in enumerate(fit.STEPS):
        ends = []
        for sign in (1.0, -1.0):
            moved = truth.copy()
            moved[0, index] += sign * step
            ends.append(fit.linearised(hypothesis(moved), rows, owner, True)[0])
        central = (ends[0] - ends[1]) / (2.0 * step)
        assert slope[:, :, index] == pytest.approx(central, rel=2e-2, abs=2e-3 * np.abs(central).max())


def test_errors_of_the_fit_are_what_its_covariance_says(flight):
    truth, values = true_parameters(flight), []
    for seed in range(12):
        rows = averaged(np.zeros(992, dtype=np.int64), rays_of(flight, np.random.default_rng(seed), 2e-5))
        owner = np.zeros(len(rows), dtype=np.int64)
        now = hypothesis(truth)
        for _ in range(3):
            now = fit.moved(fit.with_rows(now.cleared(), rows, owner, False))
        now = fit.with_rows(now.cleared(), rows, owner, False)
        spread = fit.covariance(now, np.zeros(2))
        values.append(nees((now.parameters - truth)[:, :6], spread[:, :6, :6])[0])
    # 12 samples of six degrees of freedom: the mean over 6 is within 0.55 to 1.6 in 99.9 % of cases; the truth stands
    # at the middle of the prior, which makes errors smaller than it allows for.
    assert 0.2 < np.mean(values) / 6.0 < 1.6


def test_a_scene_is_tracked_to_launch_and_impact():
    run = simulate(scene())
    last = run.tracks.take(np.flatnonzero(run.tracks.tick_s == 45.0))
    assert len(last) == 1
    assert np.degrees(last.launch[0, :2]) == pytest.approx([36.73, -110.57], abs=0.02)
    assert last.launch[0, 2] == pytest.approx(2.0, abs=2.0)
    assert last.type_probability[0].argmax() == 2
    assert np.linalg.eigvalsh(last.state_covariance).min() > 0.0
    assert np.linalg.eigvalsh(last.impact_covariance).min() > 0.0


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
