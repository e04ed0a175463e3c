"""Search volumes over time as ellipsoids of CZML, and as figures of studies."""

import json
from functools import cache

import numpy as np
import pytest
from attrs import evolve
from czml3 import Document
from exported_runs import exported
from opir_export import search_volumes
from opir_testing import MetricContract, stub_estimates
from repository import EXAMPLES
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from study_metrics import figures_of

import opir_core as opir

SITE = {"lat_deg": 10.0, "lon_deg": 38.0, "mask_deg": -10.0}
STATE = (5.2e6, 4.1e6, 1.2e6, -500.0, 2.0e3, 5.0e3)


def flying_run():
    """Return a run with a track whose standard deviations differ, and one that still burns."""
    turn = Rotation.from_euler("xyz", [20.0, 40.0, 60.0], degrees=True).as_matrix()
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = turn @ np.diag([300.0, 2000.0, 900.0]) ** 2 @ turn.T
    covariance[3:, 3:] = np.diag([9.0, 1.0, 4.0])
    tracks = stub_estimates(
        2,
        track=[0, 1],
        tick_s=[40.0, 40.0],
        state=STATE,
        state_covariance=covariance,
        probability_burning=[0.01, 0.9],
    )
    scene = opir.load_scene(EXAMPLES / "first_light.yaml", overrides=["duration_s=11"])
    return evolve(opir.simulate(scene), tracks=tracks.freeze()), covariance[:3, :3]


def test_ellipsoids_of_czml_hold_95_percent_of_the_cue_at_each_time(tmp_path):
    run, first_m2 = flying_run()
    settings = "search_volumes=true", "step_s=30", "regions=none"
    (path,) = exported(run, "czml", tmp_path / "run.czml", *settings)
    packets = json.loads(path.read_text())
    Document.model_validate({"packets": packets})
    (packet,) = [each for each in packets if each["id"].startswith("search/")]
    assert packet["id"] == "search/0"
    samples = [packet["position"]["cartesian"], packet["ellipsoid"]["radii"]["cartesian"]]
    place, radii = (np.reshape(each, (-1, 4)) for each in samples)
    turns = np.reshape(packet["orientation"]["unitQuaternion"], (-1, 5))
    assert (place[:, 0] == radii[:, 0]).all()
    assert (place[:, 0] == turns[:, 0]).all()
    assert len(place) > 5
    assert (np.sum(turns[1:, 1:] * turns[:-1, 1:], axis=1) > 0.9).all(), "it turns over"
    axes = Rotation.from_quat(turns[:, 1:]).as_matrix()
    squares_m2 = radii[:, 1:] ** 2 / chi2.ppf(0.95, 3)
    covariance_m2 = axes @ (squares_m2[:, :, None] * axes.transpose(0, 2, 1))
    assert covariance_m2[0] == pytest.approx(first_m2, rel=1e-4, abs=10.0)
    lat, lon = np.radians([SITE["lat_deg"], SITE["lon_deg"]])
    east = [-np.sin(lon), np.cos(lon), 0.0]
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    local = np.array([east, north, np.cross(east, north)])
    for row in (1, 3):
        (cue, _) = search_volumes(run, **SITE, horizon_s=place[row, 0])
        expected_m2 = local.T @ np.array(cue.volume.covariance_m2) @ local
        assert covariance_m2[row] == pytest.approx(expected_m2, rel=1e-3, abs=100.0)
        assert place[row, 1:] == pytest.approx(cue.volume.position_ecef_m, abs=5.0)


def test_a_map_has_no_search_volumes_unless_they_are_asked_for(tmp_path):
    (path,) = exported(flying_run()[0], "czml", tmp_path / "run.czml")
    assert "search/" not in path.read_text()


def test_a_run_whose_tracks_all_may_burn_says_that_it_has_no_volumes(tmp_path, caplog):
    run, _ = flying_run()
    burning = evolve(run, tracks=run.tracks.take([1]))
    (path,) = exported(burning, "czml", tmp_path / "run.czml", "search_volumes=true")
    assert "search/" not in path.read_text()
    assert "no track has an estimate without a burn" in caplog.text


class TestSearchVolume(MetricContract):
    name = "search_volume"

    @classmethod
    def block(cls):
        return {"lat_deg": 20.0, "lon_deg": -140.0}


@cache
def burnt_out_run():
    aim = "targets[0].aim={lat_deg: 20.0, lon_deg: -160.0}"
    overrides = ["duration_s=230", "outputs=[]", "targets[0].type=IRBM", aim, "tracker=imm"]
    return opir.simulate(opir.load_scene(EXAMPLES / "first_light.yaml", overrides=overrides))


@pytest.mark.slow
def test_figures_of_a_study_are_those_of_the_cue_and_the_truth():
    run = burnt_out_run()
    site = {"lat_deg": 20.0, "lon_deg": -140.0, "mask_deg": -10.0, "horizon_s": 60.0}
    figures = figures_of("search_volume", run, **site)
    (volume,) = [cue.volume for cue in search_volumes(run, **site) if cue.volume]
    assert figures["searched"] == 1.0
    assert figures["search_volume_km3"] == pytest.approx(volume.ellipsoid_m3 / 1e9)
    semi_axes_m = np.radians([volume.semi_major_deg, volume.semi_minor_deg]) * volume.range_m
    assert figures["search_area_km2"] == pytest.approx(np.pi * np.prod(semi_axes_m) / 1e6)
    assert figures["search_inside"] in (0.0, 1.0)
    far = figures_of("search_volume", run, **{**site, "at": "SRBM", "probability": 0.9999})
    assert far["searched"] == 0.0
    assert np.isnan(far["search_volume_km3"])
