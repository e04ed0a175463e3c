"""What a target model builds wrongly is a `ModelError` that names it, never an error of the core or
all the memory.
"""

import numpy as np
import pytest

from opir_core import simulate
from opir_core.errors import ModelError
from opir_core.plugin import Host, TargetModel, Trajectories, hookimpl
from opir_core.reading import scene_from_mapping


def places(time_s):
    position = np.empty((len(time_s), 3))
    position[:] = [-5e6, 3e6, 3e6]
    position[:, 2] += 10.0 * time_s
    return position


class Drawn(Trajectories):
    """Two targets; `changes` replace attributes, `spoil` changes the positions that are
    returned.
    """

    def __init__(self, spoil=None, **changes):
        self.type_code = np.zeros(2, dtype=np.uint8)
        self.ignition_s = np.full(2, 5.0)
        self.burnout_s = np.full(2, 65.0)
        self._spoil = spoil or (lambda position: position)
        for name, value in changes.items():
            setattr(self, name, value)

    def position_ecef_m(self, target, time_s):
        return self._spoil(places(time_s))

    def truth(self):
        return [{"id": "A"}, {"id": "B"}]


def run_with(trajectories):
    class Plugin:
        @hookimpl
        def opir_target_models(self):
            yield TargetModel(
                name="drawn", summary="two", build=lambda configs, context: trajectories
            )

    host = Host.of(Plugin())
    scene = {
        "scene": "broken",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 90.0,
        "sensors": [{"model": "generic-scanner", "id": "S", "orbital_slot_deg": -170.0}],
        "targets": [{"id": "A", "model": "drawn"}, {"id": "B", "model": "drawn"}],
    }
    return simulate(scene_from_mapping(scene, host=host), host=host)


def test_the_trajectories_as_they_should_be_run():
    assert len(run_with(Drawn()).detections) > 0
    assert len(run_with(Drawn(lambda position: position.astype(np.float32))).detections) > 0


@pytest.mark.parametrize(
    ("spoil", "reported"),
    [
        (
            lambda position: position[:-1],
            "positions as float64 of shape (5, 3) for 6 times; floats of shape (6, 3)",
        ),
        (lambda position: position.T, "positions as float64 of shape (3, 6) for 6 times"),
        (lambda position: position[:, :2], "positions as float64 of shape (6, 2) for 6 times"),
        (lambda position: None, "positions as None for 6 times"),
        (lambda position: position.tolist(), "positions as a list for 6 times"),
        (lambda position: position.astype(object), "positions as object of shape (6, 3)"),
        (
            lambda position: position * np.inf,
            "a position inf m from the Earth's centre during a burn",
        ),
        (
            lambda position: position * np.nan,
            "a position nan m from the Earth's centre during a burn",
        ),
        (
            lambda position: position * 1e-3,
            "a position 6557.46 m from the Earth's centre during a burn; positions are in",
        ),
        (lambda position: position * 1e6, "a position 6.55746e+12 m from the Earth's centre"),
        (lambda position: position[99], "position_ecef_m raised IndexError"),
    ],
)
def test_wrong_positions_are_reported_with_their_owner(spoil, reported):
    with pytest.raises(ModelError) as caught:
        run_with(Drawn(spoil))
    assert str(caught.value).startswith("targets[0]: the target model 'drawn' of plugin Plugin")
    assert reported in str(caught.value)
    assert "`opir check drawn` shows what is required" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "reported"),
    [
        (
            {"burnout_s": np.full(2, np.inf)},
            "A burning from 5 to inf s; a burn ends after it begins",
        ),
        ({"burnout_s": np.array([65.0, 1e12])}, "B burning from 5 to 1e+12 s"),
        ({"burnout_s": np.full(2, 1.0)}, "A burning from 5 to 1 s"),
        ({"end_s": None}, "end_s as None; 2 times from burnout on are required"),
        ({"end_s": np.full(3, 70.0)}, "end_s as (3,); 2 times"),
        ({"end_s": np.full(2, 60.0)}, "end_s as (2,); 2 times from burnout on are required"),
        (
            {"glow_end_s": np.zeros(3)},
            "glow_end_s as (3,); 2 times from burnout to end_s are required",
        ),
        ({"glow_end_s": np.full(2, 1e6)}, "glow_end_s as (2,); 2 times from burnout to end_s"),
        ({"burns_s": np.zeros((2, 2))}, "burns_s as (2, 2); (2, k, 2) is required"),
        ({"class_names": ["ICBM"]}, "class_names ['ICBM']; 2 names are required"),
        ({"warnings": None}, "warnings as None; a list of problems is required"),
    ],
)
def test_wrong_columns_are_reported_with_their_owner(changes, reported):
    with pytest.raises(ModelError) as caught:
        run_with(Drawn(**changes))
    assert reported in str(caught.value)


def test_a_row_missing_only_in_long_answers_is_reported():
    with pytest.raises(
        ModelError, match=r"returned positions as \(\d+, 3\) for \d+ times; \(\d+, 3\) is required"
    ):
        run_with(Drawn(lambda position: position[:-1] if len(position) > 50 else position))
