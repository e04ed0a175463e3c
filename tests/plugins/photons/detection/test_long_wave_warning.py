"""A DSP of the paper, which sees no launch before the Earth, is warned of; that of the record, the
default, is not.
"""

from typing import Any

import pytest
from snr_scene import joined, scene, windows_of

import opir_core as opir
from opir_core.simulation import plan_warnings
from opir_core.simulation.explanation import explained

DAY = "2026-04-01T22:00:00Z"
NIGHT = "2026-04-01T10:00:00Z"
SKY = {"atmosphere": "lowtran", "background": "earth", "epoch": DAY}
DSP = {"model": "DSP", "id": "D", "orbital_slot_deg": -140.0}


def warned(plan: opir.Plan) -> list[str]:
    return [words for words in plan_warnings(plan) if "preset: heritage" in words]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "is_warned", "sees"),
    [
        ({"preset": "paper"}, True, False),
        ({}, False, True),
        ({"preset": "heritage"}, False, True),
        ({"preset": "paper", "bands": {"MWIR": [4.2, 4.45]}}, False, True),
    ],
    ids=["paper", "default", "heritage", "own band"],
)
@pytest.mark.parametrize("epoch", [DAY, NIGHT], ids=["day", "night"])
def test_the_warned_sensor_detects_no_launch(
    epoch: str, changes: Any, is_warned: bool, sees: bool
) -> None:
    plan = opir.compile_plan(scene([{**DSP, **changes}], duration_s=100, **{**SKY, "epoch": epoch}))
    assert len(warned(plan)) == is_warned
    truth = joined(windows_of(plan, [100.0]))[1]
    assert (truth.target >= 0).any() == sees


def test_blind_sensors_are_warned_of() -> None:
    plan = opir.compile_plan(scene([{"constellation": "DSP", "preset": "paper"}], "I", **SKY))
    (line,) = warned(plan)
    assert line.startswith("detection: DSP-1 and 3 more: this DSP is the paper's (LWIR, 0.2 s)")
    assert "\n" not in line
    assert "by day or by night" in line
    assert line in explained(plan)["warnings"]


@pytest.mark.parametrize(
    "changes",
    [
        {"background": "none"},
        {"detection": "constant", "background": "none", "atmosphere": "clear"},
    ],
    ids=str,
)
def test_without_a_background_nothing_hides_a_launch(changes: Any) -> None:
    assert not warned(
        opir.compile_plan(scene([{**DSP, "preset": "paper"}], "I", **{**SKY, **changes}))
    )


def test_nobody_is_warned_of_noise_that_is_given() -> None:
    given = {**DSP, "preset": "paper", "focal_plane": None, "nei_w_m2": 1e-14}
    assert not warned(opir.compile_plan(scene([given], **SKY)))
