"""Runs of `kepler-arc` that differ in what no track can depend on: order, numbers, windows,
longitude.
"""

from typing import Any

import numpy as np
import pytest
from symmetric_scenes import BLIND, scene, simulated, turned
from tracks_alike import assert_alike, moved

import opir_core as opir

#: Fits end where a step changes nothing to 1e-8 of the state.
ROUNDING = 1e-6
MAPPING = scene("kepler-arc")


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return simulated(MAPPING)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"sensors": MAPPING["sensors"][::-1]}, id="sensors reversed"),
        pytest.param({"sensors": [BLIND, *MAPPING["sensors"]]}, id="a blind sensor first"),
        pytest.param({"targets": MAPPING["targets"][::-1]}, id="targets reversed"),
    ],
)
def test_order_changes_no_track(run: opir.Run, changes: dict[str, Any]) -> None:
    assert_alike(run.tracks, simulated({**MAPPING, **changes}).tracks, ROUNDING)


def test_windows_change_no_track(run: opir.Run) -> None:
    assert_alike(run.tracks, simulated(MAPPING, window_s=0.37).tracks, 0.0)


def test_a_scene_further_east_has_the_same_tracks_further_east(run: opir.Run) -> None:
    other = simulated(turned(MAPPING, 37.25))
    assert np.isfinite(run.tracks.impact[:, 0]).sum() > 20
    assert_alike(moved(run.tracks, turn_rad=np.radians(37.25)), other.tracks, ROUNDING)
