"""Why a run detects a target never: the words name the cause, and the factor is the ratio of
threshold to signal.
"""

import re
from typing import Any

import pytest

import opir_core as opir
from opir_core.simulation.undetected import undetected_text


def plan_of(scale: float = 1.0, slot_deg: float = -105.0, **changes: Any) -> Any:
    target = {
        "id": "T1",
        "type": "SRBM",
        "launch": {"lat_deg": 35.0, "lon_deg": -110.0, "time_s": 2.0},
        "aim": {"lat_deg": 38.0, "lon_deg": -108.0},
        "signature": {"model": "plume", "scale": scale},
    }
    scene = {
        "scene": "undetected",
        "epoch": "2026-04-01T20:00:00Z",
        "duration_s": 60.0,
        "seed": 1,
        "sensors": [
            {
                "model": "SBIRS-GEO",
                "id": "S",
                "orbital_slot_deg": slot_deg,
                **changes.pop("sensor", {}),
            }
        ],
        "targets": [target | changes.pop("target", {})],
        "detection": "snr",
        **changes,
    }
    return opir.compile_plan(opir.scene_from_mapping(scene))


def factor(scale: float) -> float:
    result = re.search(
        r"at best ([\d.]+) times below the threshold of 5.5 sigma, by S at",
        undetected_text(plan_of(scale), 0),
    )
    assert result is not None
    return float(result[1])


def test_half_the_light_doubles_the_shortfall() -> None:
    assert factor(5e-4) == pytest.approx(2.0 * factor(1e-3), rel=0.02)


def test_the_factor_is_what_the_light_is_to_be_multiplied_by() -> None:
    """Times the stated factor the best look is at the threshold: P_d is a half there, and next to
    it seldom more.
    """
    scale = 1e-3
    at_threshold = plan_of(scale * factor(scale))
    assert "by chance" in undetected_text(at_threshold, 0)
    assert (
        0.3 < float(re.findall(r"P_d at most ([\d.]+)", undetected_text(at_threshold, 0))[0]) < 0.7
    )


def test_where_nothing_looks_the_obstacle_is_named() -> None:
    assert (
        undetected_text(plan_of(slot_deg=70.0), 0) == "the Earth is in the way throughout the burn"
    )
    late = plan_of(target={"launch": {"lat_deg": 35.0, "lon_deg": -110.0, "time_s": 59.99}})
    assert undetected_text(late, 0) == "no scan falls into the burn before the scene ends"
    bolide = {"id": "B", "model": "bolides", "at": [{"lat_deg": 35.0, "lon_deg": 60.0}]}
    hidden = undetected_text(plan_of(sources=[bolide]), 1)
    assert hidden == "the Earth is in the way throughout the time of its light"
    narrow = plan_of(sensor={"field_of_regard_half_angle_deg": 2.0})
    assert undetected_text(narrow, 0) == "outside the field of regard throughout the burn"


def constant_text(chance: float, **settings: Any) -> str:
    sensor = {"detection_probability": {"SRBM": chance}, **settings}
    return undetected_text(plan_of(detection="constant", classification="paper", sensor=sensor), 0)


@pytest.mark.parametrize(("period_ms", "words"), [(100.0, r"5\d\d looks"), (6e4, "1 look")])
def test_a_probability_without_signals_is_given_as_it_is(period_ms: float, words: str) -> None:
    text = constant_text(0.25, scan_period_ms=period_ms)
    assert re.fullmatch(rf"by chance, in {words}: P_d at most 0.25, by S at [\d.]+ s", text)


def test_no_chance_at_all_is_not_called_chance() -> None:
    assert re.fullmatch(r"in 5\d\d looks: P_d at most 0, by S at [\d.]+ s", constant_text(0.0))
    assert undetected_text(plan_of(1e-9), 0).startswith(
        "more than 110 times below the threshold of 5.5 sigma, by S at"
    )


def test_a_veto_of_the_rule_over_bands_is_named() -> None:
    bounds = {"SWIR": [1e-9, 2e-9]}
    rule = {"spectral_discrimination": "dual-band-ratio", "plausible_ratios": bounds}
    assert "rejected by the sensor's rule over bands" in undetected_text(plan_of(sensor=rule), 0)


def test_flashes_too_short_to_confirm_are_explained() -> None:
    flash = {
        "lat_deg": 35.0,
        "lon_deg": -110.0,
        "start_s": 5.0,
        "end_s": 5.1,
        "temperature_k": 3000.0,
        "area_m2": 100.0,
    }
    sources = [{"id": "F", "model": "flares", "at": [flash]}]
    for needed, scans in ((2, 3), (4, 6)):
        sensor = {"confirmation_detections": needed, "confirmation_scans": scans}
        text = undetected_text(plan_of(sensor=sensor, sources=sources), 1)
        assert text == (
            f"too few looks: 1 by S, which reports after {needed} detections in {scans} successive"
            " scans"
        )
    alone = plan_of(sensor={"confirmation_detections": 1}, sources=sources)
    assert "too few looks" not in undetected_text(alone, 1)
