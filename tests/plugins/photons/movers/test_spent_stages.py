"""Stages that a launch of the scene drops: when, which, and what is refused."""

from typing import Any

import numpy as np
import pytest

import opir_core as opir


def planned(kind: str, aim: tuple[float, float], duration_s: float = 600.0, **block: Any) -> Any:
    scene = {
        "scene": "stages",
        "epoch": "2026-03-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": 4,
        "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 160.0}],
        "targets": [
            {
                "id": "T",
                "type": kind,
                "launch": {"lat_deg": 20.0, "lon_deg": 140.0, "time_s": 10.0},
                "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
            }
        ],
        "sources": [{"id": "spent", "model": "spent_stages", "launch": "T"} | block],
        "detection": {"model": "snr"},
        "outputs": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene))


def releases_s(plan: Any) -> list[float]:
    return plan.targets.ignition_s[1:].tolist()


def test_stages_share_a_single_burn_and_the_last_one_stays():
    plan = planned("ICBM", (45.0, -140.0), stages=4)
    burn_s = plan.targets.burnout_s[0] - 10.0
    assert releases_s(plan) == pytest.approx([10.0 + burn_s * k / 4 for k in (1, 2, 3)])
    assert [row["type"] for row in plan.targets.truth()[1:]] == ["spent stage"] * 3


def test_a_glider_leaves_its_booster():
    plan = planned("HGV", (45.0, -140.0))
    assert releases_s(plan)[-1] == pytest.approx(plan.targets.burnout_s[0])
    kept = planned("HGV", (45.0, -140.0), drops_last=False)
    assert releases_s(kept) == releases_s(plan)[:-1]


def test_what_is_dropped_after_the_scene_is_not_there():
    whole, cut = (planned("ICBM", (45.0, -140.0), time_s, stages=4) for time_s in (600.0, 120.0))
    assert releases_s(cut) == [time_s for time_s in releases_s(whole) if time_s < 120.0]


def test_a_stage_is_seen_while_its_nozzle_glows():
    plan = planned("ICBM", (45.0, -140.0))
    window = opir.Engine(plan).advance(plan.end_ns)
    seen_s = window.detections.time_s[window.truth.target == 1] - releases_s(plan)[0]
    assert len(seen_s) > 10
    assert np.all(seen_s > 0.0)


@pytest.mark.parametrize(
    ("kind", "aim", "block", "words"),
    [
        ("ICBM", (45.0, -140.0), {"launch": "t"}, "'t' is no target; the nearest is 'T'"),
        ("ICBM", (45.0, -140.0), {"stages": 1}, "'T' drops no stage within the scene"),
        ("SRBM", (22.0, 141.0), {}, "unless drops_last: true"),
    ],
)
def test_what_drops_nothing_is_refused(kind, aim, block, words):
    with pytest.raises(opir.OpirError, match=words):
        planned(kind, aim, **block)


def test_a_launch_that_cannot_fly_is_told_once():
    with pytest.raises(opir.OpirError) as caught:
        planned("SRBM", (60.0, 141.0))
    assert str(caught.value).count("the aim point is") == 1
    assert "spent" not in str(caught.value)
