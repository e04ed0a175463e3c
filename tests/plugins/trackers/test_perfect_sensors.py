"""Sensors without error: what limits a track is then the motion, and each launch still has one
track.
"""

import numpy as np
import pytest
from opir_estimation import LinesOfSight
from opir_estimation.lines_of_sight import LEAST_SIGMA_M

import opir_core as opir


def run_of(sensors: str, duration_s: float) -> opir.Run:
    changes = [f"sensors=[{{{sensors}, line_of_sight_sigma_urad: 0}}]", "tracker=imm", "outputs=[]"]
    scene = opir.load_scene(
        "tests/scenes/pacific_test_range.yaml", overrides=[*changes, f"duration_s={duration_s}"]
    )
    return opir.run_of_plan(opir.compile_plan(scene))


def test_the_least_error_of_a_line_is_a_metre_at_the_ground_below_the_sensor() -> None:
    for sensors in ("constellation: LEO-MEDIUM", "constellation: SBIRS-GEO"):
        seen = run_of(sensors, 70.0).detections
        height_m = np.linalg.norm(seen.sensor_ecef_m, axis=1) - 6378137.0
        assert len(seen)
        assert LinesOfSight.of(seen).sigma_rad * height_m == pytest.approx(LEAST_SIGMA_M, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensors", ["constellation: LEO-MEDIUM", "constellation: SBIRS-GEO", "constellation: DSP"]
)
def test_each_launch_has_one_track(sensors: str) -> None:
    run = run_of(sensors, 150.0)
    launches = np.unique(run.truth.target[run.truth.target >= 0])
    tracks = run.tracks.take(np.flatnonzero(run.tracks.tick_s == run.tracks.tick_s.max()))
    assert len(np.unique(run.tracks.track)) == len(launches)
    assert np.isfinite(tracks.state).all()


def test_the_first_report_of_an_expected_launch_has_its_launch_point() -> None:
    """Where launches are more frequent than fires, a track is probably one from its first lines
    on.
    """
    expected = (
        "tracker={model: imm, hypotheses: {launches_per_day: 10000.0, ground_sources_per_day:"
        " 10.0}}"
    )
    changes = ["sensors=[{constellation: SBIRS-GEO}]", expected, "outputs=[]", "duration_s=30"]
    tracks = opir.simulate(opir.load_scene("examples/first_light.yaml", overrides=changes)).tracks
    assert tracks.probability_launch[0] > 0.9
    assert np.isfinite(tracks.launch[0]).all()
