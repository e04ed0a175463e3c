"""What a notebook shows of scenes, plans, windows and columns: one line each, whatever their
size.
"""

import numpy as np
import pytest
from repository import EXAMPLES

import opir_core
from opir_core import DetectionTruth
from opir_core.interfaces import Columns, names_of
from opir_core.plugin import Detections, Tracks


@pytest.fixture(scope="module")
def scene() -> opir_core.Scene:
    return opir_core.load_scene(EXAMPLES / "first_light.yaml", overrides=["duration_s=20"])


def test_a_scene_and_its_plan(scene: opir_core.Scene) -> None:
    assert repr(scene) == "<Scene first-light: 1 sensor, 1 target, tracker none, 20 s, seed 1>"
    plan = opir_core.compile_plan(scene)
    assert repr(plan) == "<Plan of first-light: 1 sensor, 1 target, 1 pair, 20 s, seed 1>"


def test_a_window_and_its_columns(scene: opir_core.Scene) -> None:
    (window,) = opir_core.windows(scene, window_s=20.0)
    count = len(window.detections)
    assert (
        repr(window)
        == f"<Window from 0 to 20 s: {window.looks} looks, {count} detections, 0 rows of tracks>"
    )
    shown = "target, emission_time_s, range_m, target_elevation_sine, probability"
    assert repr(window.truth) == f"<DetectionTruth: {count} rows of {shown}>"
    assert "line_of_sight_ecef[3]" in repr(window.detections)


@pytest.mark.parametrize("record", [Detections, DetectionTruth, Tracks])
def test_columns_without_rows(record: type[Columns]) -> None:
    assert repr(record.empty()).startswith(f"<{record.__name__}: 0 rows of ")


def test_one_row_and_columns_of_matrices() -> None:
    empty = Tracks.empty()
    shown = repr(
        Tracks(*(np.zeros((1, *getattr(empty, name).shape[1:])) for name in names_of(Tracks)))
    )
    assert shown.startswith("<Tracks: 1 row of tick_s, track, state[6], state_covariance[6, 6], ")


@pytest.mark.parametrize("wrong", ["scene.yaml", {"scene": "x"}, None])
@pytest.mark.parametrize(
    "use",
    [opir_core.compile_plan, opir_core.simulate, lambda scene: list(opir_core.windows(scene))],
)
def test_an_invalid_scene_argument_is_refused(use: object, wrong: object) -> None:
    with pytest.raises(
        TypeError,
        match=r"a scene is needed, not (a str|a dict|None): load_scene reads one from a file",
    ):
        use(wrong)
