"""Dark gaps between burns: no look sees a plume there, looks on both sides do, and sensors that
follow bodies go on.
"""

import json
from itertools import pairwise

import numpy as np
import pytest
from cold_nozzles import silence_nozzles
from opir_photons.environment import make_environment
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline

from opir_core import Engine, compile_plan, run_of_plan, simulate
from opir_core.cli.main import main
from opir_core.live.changes import launch_change, without_finished_targets
from opir_core.planning import Looks
from opir_core.reading import scene_from_mapping
from opir_core.simulation.explanation import explained

MU = 3.986004418e14
WHIRL = 7.292115e-5
C = 299_792_458.0
START_S = 12.0
OUT_S = 52.3
RELIT_S = 59.1
BURNOUT_S = 101.7
NAMES = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s,is_burning"


def thrust(t):
    return 24.0 if t < OUT_S - START_S else 0.0 if t < RELIT_S - START_S else 31.0


def rates(t, state):
    """Return the right side of a gravity turn in axes that do not rotate, with the thrust along a
    tilted vertical.
    """
    place = state[:3]
    speed = state[3:]
    up = place / np.linalg.norm(place)
    way = up + 0.02 * t * np.array([-up[1], up[0], 0.0])
    pull = -MU * place / np.linalg.norm(place) ** 3 + thrust(t) * way / np.linalg.norm(way)
    return np.concatenate([speed, pull])


def turned(vectors, t):
    """Return vectors (n, 3) in axes that have turned with the Earth for t (n,) s."""
    cosine = np.cos(WHIRL * t)
    sine = np.sin(WHIRL * t)
    x, y, z = vectors.T
    return np.stack([cosine * x + sine * y, cosine * y - sine * x, z], axis=1)


def flown():
    """Return times since scene start, ECEF positions and velocities of two burns, a gap between
    them and a coast.
    """
    edges = np.array([START_S, OUT_S, RELIT_S, BURNOUT_S, BURNOUT_S + 200.0]) - START_S
    place = 6378137.0 * np.array([np.cos(-2.6), np.sin(-2.6), 0.05])
    state = np.concatenate([place, WHIRL * np.array([-place[1], place[0], 0.0])])
    times = []
    states = []
    for begin, end in pairwise(edges):
        step_times_s = np.append(np.arange(begin, end, 2.0), end)
        inside = 1e-9 * (end - begin)
        piece = solve_ivp(
            lambda t, y, low=begin + inside, high=end - inside: rates(min(max(t, low), high), y),
            (begin, end),
            state,
            method="DOP853",
            rtol=1e-11,
            atol=1e-6,
            t_eval=step_times_s,
        )
        times.append(step_times_s)
        states.append(piece.y.T)
        state = piece.y[:, -1]
    time = np.concatenate(times)
    state = np.concatenate(states)
    position = turned(state[:, :3], time)
    velocity = turned(state[:, 3:], time) - WHIRL * np.stack(
        [-position[:, 1], position[:, 0], 0.0 * time], axis=1
    )
    return time + START_S, position, velocity


@pytest.fixture(scope="module")
def flight():
    return flown()


def file_of(path, flight, *, has_gap=True):
    """Write a table whose changes of stage stand twice; without a gap it burns throughout the
    boost.
    """
    time, position, velocity = flight
    dark = has_gap & (time >= OUT_S) & (time < RELIT_S)
    # The first of two equal times ends what is before it.
    first_value = np.append(np.diff(time) == 0.0, False)
    burning = ~dark & (time < BURNOUT_S)
    burning[first_value] = ~burning[np.flatnonzero(first_value) + 1]
    rows = np.column_stack([time, position, velocity, burning])
    path.write_text(
        "\n".join([NAMES, *(",".join(map(repr, row)) for row in rows.tolist())]), encoding="utf-8"
    )
    return {"id": "T", "model": "table", "type": "IRBM", "file": str(path)}


GRAVITY_TURN = {
    "id": "G",
    "model": "gravity-turn",
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
SENSOR = {
    "model": "NEXTGEN-GEO",
    "id": "N",
    "orbital_slot_deg": -150.0,
    "scan_period_ms": 37.0,
    "confirmation_detections": 1,
    "field_of_regard_half_angle_deg": 12.0,
}


def scene(*targets, sensors=(SENSOR,), **settings):
    return scene_from_mapping(
        {
            "scene": "dark",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 400.0,
            "sensors": list(sensors),
            "targets": list(targets),
            "tracker": "none",
            "detection": "always",
            "outputs": [],
            **settings,
        }
    )


def looks_s(run, row=0):
    """Return the times of the looks that detected a target, s."""
    return np.sort(run.detections.time_ns[run.truth.target == row]) * 1e-9


def strictly_between(time_s, low, high):
    return (time_s > low) & (time_s < high)


def test_a_table_with_a_gap_loses_the_looks_in_the_gap(tmp_path, flight):
    dark = simulate(scene(file_of(tmp_path / "gap.csv", flight), light_time=False))
    uncut = simulate(
        scene(file_of(tmp_path / "whole.csv", flight, has_gap=False), light_time=False)
    )
    complete = looks_s(uncut)
    assert np.count_nonzero(strictly_between(complete, OUT_S, RELIT_S)) > 150
    assert np.diff(complete).max() == pytest.approx(0.037, abs=1e-9)
    assert looks_s(dark).tolist() == complete[~strictly_between(complete, OUT_S, RELIT_S)].tolist()
    assert complete.max() <= BURNOUT_S < complete.max() + 0.037


def test_light_time_shifts_the_looks_of_burns(tmp_path, flight):
    look_times_s = looks_s(simulate(scene(file_of(tmp_path / "gap.csv", flight))))
    time, position, velocity = flight
    sensor = 42_164_169.6 * np.array([np.cos(np.radians(-150.0)), np.sin(np.radians(-150.0)), 0.0])
    _, rows = np.unique(time, return_index=True)
    course = CubicHermiteSpline(time[rows], position[rows], velocity[rows])
    looks = look_times_s[0] + 0.037 * np.arange(
        round((look_times_s[-1] - look_times_s[0]) / 0.037) + 1
    )
    emission_s = looks - 0.12
    for _ in range(6):
        emission_s = looks - np.linalg.norm(course(emission_s) - sensor, axis=1) / C
    burns = (
        (emission_s >= START_S)
        & ~strictly_between(emission_s, OUT_S, RELIT_S)
        & (emission_s <= BURNOUT_S)
    )
    assert 150 < np.count_nonzero(~burns) < 200
    np.testing.assert_allclose(look_times_s, looks[burns], rtol=0.0, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("detection", ["always", "snr"])
def test_a_staged_boost_is_dark_between_its_stages(detection):
    plan = compile_plan(scene(GRAVITY_TURN, detection=detection))
    run = run_of_plan(plan)
    truth = plan.targets.truth()[0]
    emission_s = run.truth.emission_time_s
    assert len(truth["gaps_s"]) == 2
    for (out, relit), former, changed in zip(
        truth["gaps_s"], truth["stages"], truth["stages"][1:], strict=False
    ):
        assert (former["burnout_s"], changed["ignition_s"]) == (out, relit)
        assert not strictly_between(emission_s, out, relit).any()
        for low in (out - 2.0, relit):
            assert np.count_nonzero(strictly_between(emission_s, low, low + 2.0)) > 10
    assert run.summary["targets"][0]["burnout_s"] == truth["stages"][-1]["burnout_s"]


FOLLOWER = {**SENSOR, "id": "F", "follows_bodies": True}


def test_a_sensor_that_follows_bodies_sees_the_body_in_gaps(tmp_path, flight, monkeypatch):
    silence_nozzles(monkeypatch)
    target = file_of(tmp_path / "gap.csv", flight)
    run = simulate(scene(target, sensors=[SENSOR, FOLLOWER], light_time=False))
    gap = strictly_between(run.detections.time_ns * 1e-9, OUT_S, RELIT_S)
    assert np.unique(run.detections.sensor[gap]).tolist() == [1]
    plan = compile_plan(scene(target, sensors=[FOLLOWER], light_time=False))
    environment = make_environment(plan)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposures = plan.look_geometry().exposures(looks.pair, looks.scan)
    # Above the air that heats bodies.
    everywhere = np.full(len(exposures), 2.5e5)
    still = np.full(len(exposures), 0.5 * np.pi)
    watts = environment.intensities_w_sr([0], exposures, everywhere, still)[0]
    body = watts[strictly_between(exposures.emission_time_s, BURNOUT_S, 1e4)]
    assert body.min() == body.max()
    dark = strictly_between(exposures.emission_time_s, OUT_S, RELIT_S)
    assert np.unique(watts[dark]).tolist() == [body[0]]
    burns = strictly_between(exposures.emission_time_s, START_S, OUT_S - 1e-9)
    assert watts[burns][50:].min() > 1e3 * body[0]


def test_the_plume_steps_with_the_stages_and_rises_anew(tmp_path, flight):
    plan = compile_plan(
        scene(file_of(tmp_path / "gap.csv", flight), detection="snr", light_time=False)
    )
    environment = make_environment(plan)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposures = plan.look_geometry().exposures(looks.pair, looks.scan)
    since = np.where(
        exposures.time_s < RELIT_S, exposures.time_s - START_S, exposures.time_s - RELIT_S
    )
    still = np.full(len(exposures), 0.5 * np.pi)
    watts = environment.intensities_w_sr([0], exposures, np.full(len(exposures), 1e4), still)[0]
    burns = ~strictly_between(exposures.time_s, OUT_S - 1e-9, RELIT_S)
    scale = np.where(exposures.time_s < RELIT_S, 1.0, 0.3) * -np.expm1(-since / 1.0)
    peak = watts[burns].max()
    np.testing.assert_allclose(watts[burns], peak * scale[burns], rtol=1e-12)


@pytest.mark.slow
def test_burns_stand_with_their_targets_in_any_company(tmp_path, flight):
    table = file_of(tmp_path / "gap.csv", flight)
    ballistic = {**{key: GRAVITY_TURN[key] for key in ("type", "launch", "aim")}, "id": "B"}
    targets = compile_plan(scene(GRAVITY_TURN, ballistic, table)).targets
    assert targets.burns_s.shape == (3, 3, 2)
    assert np.isfinite(targets.burns_s[:, :, 0]).sum(axis=1).tolist() == [3, 1, 2]
    assert np.nanmin(targets.burns_s, axis=(1, 2)).tolist() == targets.ignition_s.tolist()
    assert np.nanmax(targets.burns_s, axis=(1, 2)).tolist() == targets.burnout_s.tolist()
    dark = targets.is_dark(
        np.array([2, 2, 2, 1], dtype=np.int32), np.array([OUT_S, 55.0, RELIT_S, 55.0])
    )
    assert dark.tolist() == [False, True, False, False]


def test_a_launch_added_to_a_running_scene_keeps_its_gaps(tmp_path, flight):
    table = file_of(tmp_path / "gap.csv", flight)
    ballistic = {**{key: GRAVITY_TURN[key] for key in ("type", "launch", "aim")}, "id": "B"}
    plan = compile_plan(scene(ballistic))
    engine = launch_change(plan, table, 0, 0).engine
    batch = Engine(compile_plan(scene(ballistic, table))).advance(plan.end_ns)
    live = engine.advance(plan.end_ns)
    assert live.detections.time_ns.tobytes() == batch.detections.time_ns.tobytes()
    remaining = without_finished_targets(engine.plan, 110_000_000_000).targets
    assert (remaining.ids, remaining.burns_s.shape) == (("B",), (1, 2, 2))


def test_gaps_are_explained(tmp_path, flight, capsys):
    target = file_of(tmp_path / "gap.csv", flight)
    plan = compile_plan(scene(target))
    assert explained(plan)["dark"] == [{"target_id": "T", "start_s": OUT_S, "stop_s": RELIT_S}]
    assert plan.targets.truth()[0]["gaps_s"] == [[OUT_S, RELIT_S]]
    path = tmp_path / "scene.yaml"
    path.write_text(
        "scene: s\nepoch: 2026-04-01T12:00:00Z\nduration_s: 200\nsensors: [{constellation: DSP}]\n"
        f"targets: [{json.dumps(target)}]\n",
        encoding="utf-8",
    )
    assert main(["explain", str(path)]) == 0
    assert ["T", "52.300", "59.100"] in [
        line.split() for line in capsys.readouterr().out.splitlines()
    ]
