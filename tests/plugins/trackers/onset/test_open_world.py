"""Fires and launches before the whole tracker: a fire is a source that stands, a launch is found
among fires.
"""

import numpy as np
import pytest
from opir_scoring.containments import nees

import opir_core as opir
from opir_core.geometry import geodetic_to_ecef

FIRES = [(33.5, 55.2), (34.0, 56.0), (36.0, 52.0)]
SCENE = {
    "scene": "fires",
    "epoch": "2026-04-01T03:00:00Z",
    "duration_s": 75,
    "seed": 2,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 40.0},
        {"model": "SBIRS-GEO", "id": "S2", "orbital_slot_deg": 90.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "SRBM",
            "launch": {"lat_deg": 33.0, "lon_deg": 55.0, "time_s": 5.0},
            "aim": {"lat_deg": 36.5, "lon_deg": 55.0},
        }
    ],
    "detection": "snr",
    "classification": "spectral",
    "background": "earth",
    "tracker": "imm",
    "sources": [
        {
            "id": "fires",
            "model": "fires",
            "at": [{"lat_deg": lat, "lon_deg": lon} for lat, lon in FIRES],
        },
    ],
}


@pytest.fixture(scope="module")
def tracks():
    return opir.simulate(opir.scene_from_mapping(SCENE)).tracks


def by_track(tracks):
    return [
        tracks.take(np.flatnonzero(tracks.track == number)) for number in np.unique(tracks.track)
    ]


@pytest.mark.slow
def test_fires_are_sources_that_stand_and_the_launch_is_found(tracks):
    launches = [one for one in by_track(tracks) if one.probability_launch[-1] > 0.5]
    sources = [one for one in by_track(tracks) if one.probability_launch[-1] <= 0.5]
    assert len(launches) == 1
    assert len(sources) == len(FIRES)
    (launch,) = launches
    reported = launch.tick_s[launch.probability_launch > 0.95]
    assert reported.min() < 5.0 + 20.0
    # What it is unlike of all known boosts varies with the forecast; that it flies is not revoked.
    assert np.all(launch.probability_launch[launch.tick_s >= reported.min()] > 0.9)
    assert np.isfinite(launch.launch[-1]).all()
    assert len(launch.impact_regions[-1])
    for source in sources:
        assert source.probability_launch.max() < 0.05
        assert np.isnan(source.launch).all()
        assert np.isnan(source.impact).all()
        assert not any(source.impact_regions)
        assert source.type_probability[-1, -1] > 0.95


@pytest.mark.slow
def test_false_alarms_make_no_tracks():
    """Two scanners with 17 false alarms a scan: some repeat within a gate, and what they make is
    noise.
    """
    more = {"preset": "heritage", "confirmation_detections": 1, "confirmation_scans": 1}
    sensors = [
        {"model": "DSP", "id": f"D{slot}", "orbital_slot_deg": slot, **more}
        for slot in (20.0, 70.0)
    ]
    fire = [
        {"id": "fires", "model": "fires", "at": [{"lat_deg": FIRES[0][0], "lon_deg": FIRES[0][1]}]}
    ]
    changes = {"sensors": sensors, "targets": [], "sources": fire, "duration_s": 300}
    found = opir.simulate(opir.scene_from_mapping({**SCENE, **changes})).tracks
    assert len(np.unique(found.track)) == 1
    assert found.hypothesis_probability[-1, 1] > 0.99


@pytest.mark.slow
def test_every_report_has_the_whole_table(tracks):
    table = tracks.hypothesis_probability
    assert table.shape == (
        len(tracks),
        len(opir.compile_plan(opir.scene_from_mapping(SCENE)).hypotheses),
    )
    assert table.sum(axis=1) == pytest.approx(np.ones(len(tracks)))
    assert np.all(
        tracks.probability_missile + tracks.probability_orbit <= tracks.probability_launch + 1e-12
    )
    assert tracks.type_probability.sum(axis=1) == pytest.approx(np.ones(len(tracks)))


@pytest.mark.slow
def test_fires_are_where_they_are(tracks):
    degrees = np.radians(np.array(FIRES))
    true = geodetic_to_ecef(degrees[:, 0], degrees[:, 1], np.zeros(len(FIRES)))
    squares = []
    for source in by_track(tracks):
        if source.probability_launch[-1] > 0.5:
            continue
        away = source.state[:, :3] - true[:, None]
        nearest = int(np.argmin(np.linalg.norm(away[:, -1], axis=1)))
        off = np.concatenate([away[nearest], source.state[:, 3:]], axis=1)
        squares.append(nees(off[-1:], source.state_covariance[-1:])[0])
        assert np.linalg.norm(source.state[-1, 3:]) < 1.0
    # Three positions of three degrees of freedom each; the velocities are next to nothing. χ²₉ is
    # within with 99.8 %.
    assert 1.15 < sum(squares) < 28.0


def aircraft(path, place, course_rad, speed_m_s, climb_m_s):
    """Write two minutes of an aircraft that gains 0.5 m/s a second on its course, as a table of
    positions; its path.
    """
    time_s = np.arange(0.0, 121.0)
    along = (speed_m_s + 0.25 * time_s) * time_s / 6.371e6
    lat = np.radians(place[0]) + along * np.cos(course_rad)
    lon = np.radians(place[1]) + along * np.sin(course_rad) / np.cos(lat)
    rows = geodetic_to_ecef(lat, lon, 4000.0 + climb_m_s * time_s)
    table = np.column_stack([time_s, rows, np.ones(len(time_s))])
    head = "time_s,x_ecef_m,y_ecef_m,z_ecef_m,is_burning"
    np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.3f")
    return str(path)


@pytest.mark.slow
def test_lightning_and_aircraft_are_no_launches(tmp_path):
    """Flashes of 0.15 to 0.7 s at 6 to 14 km, and climbing aircraft as bright as a missile."""
    rng = np.random.default_rng(71)
    flashes = []
    for begin_s in rng.uniform(2.0, 138.0, 60).tolist():
        end_s = begin_s + rng.uniform(0.15, 0.7)
        place = {"lat_deg": rng.uniform(20.0, 45.0), "lon_deg": rng.uniform(40.0, 80.0)}
        light = {"height_m": rng.uniform(6e3, 14e3), "temperature_k": 15e3, "area_m2": 20.0}
        flashes.append({**place, **light, "start_s": begin_s, "end_s": end_s})
    targets = []
    for number in range(4):
        place = rng.uniform(20.0, 45.0), rng.uniform(40.0, 80.0)
        motion = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(180.0, 280.0), rng.uniform(0.0, 120.0)
        file = aircraft(tmp_path / f"{number}.csv", place, *motion)
        targets.append(
            {"id": f"A{number}", "model": "table", "type": "SRBM", "file": file, "start_s": 5.0}
        )
    sources = [{"id": "lightning", "model": "flares", "at": flashes}]
    changes = {"targets": targets, "sources": sources, "classification": "paper", "duration_s": 140}
    tracks = opir.simulate(opir.scene_from_mapping({**SCENE, **changes})).tracks
    assert len(np.unique(tracks.track)) > 20
    assert tracks.probability_launch.max() < 0.5
