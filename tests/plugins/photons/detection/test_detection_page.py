"""The tables of docs/explanation/detection.md: rates of noise by threshold, chances of classes when
calibrated.
"""

import re
from typing import Any

import numpy as np
import pytest
from opir_photons.environment import REFERENCE_TARGET
from repository import ROOT

import opir_core as opir
from opir_core import Host
from opir_core.plugin import SignatureContext

PAGE = (ROOT / "docs" / "explanation" / "detection.md").read_text(encoding="utf-8")
SENSORS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")
OWN = {"DSP": {"preset": "paper"}}
PROFILES = {
    "SRBM": "SRBM",
    "IRBM": "IRBM",
    "ICBM, solid": "ICBM_solid",
    "ICBM, liquid": "ICBM_liquid",
}


def shown(row: str) -> list[float]:
    """Return the numbers of a row of a table, without what stands in brackets."""
    line = next(line for line in PAGE.splitlines() if line.startswith(f"| {row} |"))
    cells = re.sub(r"\(.*?\)", "", line).split("|")[2:-1]
    return [float(cell.replace(" ", "")) for cell in cells]


def assembled(detection: dict[str, Any], **settings: Any) -> Any:
    place = {"orbital_slot_deg": 0.0, **settings}
    sensors = [{"model": model, "id": model, **OWN.get(model, {}), **place} for model in SENSORS]
    scene = {
        "scene": "page",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 1.0,
        "sensors": sensors,
        "targets": [],
    }
    return opir.compile_plan(
        opir.scene_from_mapping({**scene, "detection": detection, "outputs": []})
    )


@pytest.mark.parametrize("row", ["4", "5", "6", "5, M = 1"])
def test_noise_is_as_often_as_the_page_says(row: str) -> None:
    settings = {"confirmation_detections": 1} if "M = 1" in row else {}
    plan = assembled({"model": "snr"}, threshold_sigma=float(row[0]), **settings)
    periods_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in plan.sensors])
    assert shown(row) == pytest.approx(
        plan.detection.rate_per_scan * 86_400.0 / periods_s, rel=0.03
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROFILES)
def test_calibrated_sensors_see_classes_as_the_page_says(kind: str) -> None:
    plan = assembled({"model": "snr", "calibrate": "paper"})
    plume = Host.discover().component("opir_signature_models", "plume")
    result = []
    for sensor, receiver in zip(plan.sensors, plan.detection.receivers, strict=True):
        context = SignatureContext(
            bands=sensor.bands,
            ids=("T",),
            paths=("",),
            types=("ICBM",),
            profiles=(PROFILES[kind],),
            burn_time_s=np.array([REFERENCE_TARGET.burn_s]),
        )
        place = (
            np.array([REFERENCE_TARGET.time_s]),
            np.array([REFERENCE_TARGET.altitude_m]),
            np.array([0.5 * np.pi]),
        )
        signatures = plume.build([plume.config()], context)
        rows = np.zeros(1, dtype=np.int32)
        intensity = np.array(
            [signatures.intensity_w_sr(band, rows, *place)[0] for band in range(len(sensor.bands))]
        )
        noise = receiver.nei_w_m2
        snr = (intensity / 3.6e7**2 / noise)[None, :]
        log_hit, _ = receiver.rule.log_chances(snr, receiver.slopes(snr, noise[None, :], None))
        result.append(float(np.exp(log_hit[0])))
    assert shown(kind) == pytest.approx(result, rel=0.05)
