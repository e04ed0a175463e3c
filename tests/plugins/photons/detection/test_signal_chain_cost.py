"""What the chain from light to probability costs beside the engine, in counts."""

from typing import Any

import pytest
from opir_photons.detection import snr

import opir_core as opir
from opir_core import plan_windows
from opir_core.interfaces import Columns
from opir_core.simulation.summary import Tally

SCENE: dict[str, Any] = {
    "scene": "chain",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "seed": 1,
    "outputs": [],
    "detection": {"model": "snr"},
    "targets": [
        {
            "id": "I",
            "type": "ICBM",
            "launch": {"lat_deg": 5.0, "lon_deg": -150.0, "time_s": 2.0},
            "aim": {"lat_deg": -50.0, "lon_deg": -110.0},
        }
    ],
    "sensors": [
        {
            "model": model,
            "id": f"{model}-{slot:g}",
            "orbital_slot_deg": slot,
            "confirmation_detections": 1,
        }
        for model in ("SBIRS-GEO", "NEXTGEN-GEO")
        for slot in (-150.0, -140.0, -120.0, -110.0)
    ],
}


def test_noise_is_worked_out_once_a_kind_of_sensor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """It is an integral of the sensor's rule, dearer than all else that a satellite's receiver is
    compiled from.
    """
    asked = []
    own = snr.noise_chance
    monkeypatch.setattr(
        snr, "noise_chance", lambda receiver: asked.append(receiver) or own(receiver)
    )
    opir.compile_plan(opir.scene_from_mapping(SCENE))
    assert len(asked) == 2


def test_windows_are_summed_without_copies(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A window has two dozen columns, of which five are counted."""
    plan = opir.compile_plan(opir.scene_from_mapping(SCENE))
    (window,) = plan_windows(plan)
    assert (window.truth.target < 0).any()
    assert (window.truth.target >= 0).any()
    tally = Tally(plan)
    monkeypatch.setattr(
        Columns, "take", lambda *_: pytest.fail("columns that are not counted were copied")
    )
    tally.count(window)
    counts = tally.counts()
    assert counts["detections"] == len(window.detections)
    assert counts["noise_detections"] == int((window.truth.target < 0).sum())


@pytest.mark.slow
def test_a_focal_plane_adds_few_evaluations_to_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """Noise with structure is nearly as smooth along a track as without: at most twice as many
    looks are evaluated.
    """
    evaluated: dict[str, int] = {}
    own = snr.SnrDetection.response
    for name in ("without", "notional"):
        sensors = [
            {**sensor, **({} if name == "without" else {"focal_plane": name})}
            for sensor in SCENE["sensors"]
        ]
        rows: list[int] = []

        def counted(model: Any, exposures: Any, rows: list[int] = rows, **changes: Any) -> Any:
            rows.append(len(exposures))
            return own(model, exposures, **changes)

        with monkeypatch.context() as patch:
            patch.setattr(snr.SnrDetection, "response", counted)
            scene = {**SCENE, "sensors": sensors, "atmosphere": "lowtran", "background": "earth"}
            list(plan_windows(opir.compile_plan(opir.scene_from_mapping(scene))))
        evaluated[name] = sum(rows)
    assert 0 < evaluated["notional"] < 2.0 * evaluated["without"]
