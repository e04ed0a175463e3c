"""The comparison of events from two environments finds what differs, and only that."""

import importlib.util
import json
from typing import Any

import pytest
from repository import ROOT

EVENT: dict[str, Any] = {
    "detection_id": "a",
    "timestamp": "2026-04-01T12:00:00.000001Z",
    "bands": ["SWIR", "MWIR"],
    "snr": 12.5,
    "azimuth_deg": 30.0,
    "track_id": 3,
    "impact_point": None,
    "latitude_deg": 34.0,
    "launch_point": {
        "time": "2026-04-01T11:59:00.000100Z",
        "ellipse": {"semi_major_m": 5000.0, "semi_minor_m": 3000.0, "bearing_deg": 20.0},
    },
}


@pytest.fixture(scope="module")
def comparison():
    spec = importlib.util.spec_from_file_location("same_results", ROOT / ".ci" / "same_results.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def compared(comparison, folder, *others):
    """Return whether one event agrees with others."""
    reference = folder / "one.jsonl"
    two = folder / "two.jsonl"
    reference.write_text(f"{json.dumps(EVENT)}\n", encoding="utf-8")
    two.write_text("".join(f"{json.dumps(other)}\n" for other in others), encoding="utf-8")
    return comparison.same("scene", reference, two)


def ellipse(**changes):
    launch = EVENT["launch_point"]
    return {"launch_point": {**launch, "ellipse": {**launch["ellipse"], **changes}}}


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"snr": 12.52},
        {"azimuth_deg": 30.000000001},
        {"latitude_deg": 34.0002},
        {"launch_point": {**EVENT["launch_point"], "time": "2026-04-01T11:59:00.001000Z"}},
        ellipse(semi_minor_m=3000.09),
        ellipse(bearing_deg=20.002),
    ],
    ids=str,
)
def test_other_last_digits_are_the_same(comparison, tmp_path, change):
    assert compared(comparison, tmp_path, {**EVENT, **change})


@pytest.mark.parametrize(
    "change",
    [
        {"detection_id": "b"},
        {"timestamp": "2026-04-01T12:00:00.000002Z"},
        {"bands": ["SWIR"]},
        {"bands": ["MWIR", "SWIR"]},
        {"snr": 12.53},
        {"azimuth_deg": 30.000000003},
        {"track_id": 4},
        {"impact_point": {"lat_deg": 1.0}},
        {"latitude_deg": 34.0003},
        {"latitude_deg": None},
        {"one_more": None},
        {"launch_point": {**EVENT["launch_point"], "time": "2026-04-01T11:59:00.001200Z"}},
        ellipse(semi_minor_m=3000.11),
        ellipse(bearing_deg=20.003),
    ],
    ids=str,
)
def test_other_values_are_found(
    comparison,
    tmp_path,
    change,
    capsys,
):
    assert not compared(comparison, tmp_path, {**EVENT, **change})
    key = next(iter(change))
    assert f"event 1: {key}" in capsys.readouterr().out


@pytest.mark.parametrize("others", [(), (EVENT, EVENT)], ids=["missing", "one more"])
def test_another_number_of_events_is_found(comparison, tmp_path, others):
    assert not compared(comparison, tmp_path, *others)


def test_a_missing_key_is_found(comparison, tmp_path, capsys):
    assert not compared(
        comparison, tmp_path, {key: value for key, value in EVENT.items() if key != "track_id"}
    )
    assert "event 1: track_id is 3, and absent" in capsys.readouterr().out


def test_the_bearing_of_a_circle_is_arbitrary(comparison):
    round_one = {"semi_major_m": 300.0, "semi_minor_m": 300.0, "bearing_deg": 20.0}
    ((_, _, _, size),) = comparison.differences(
        "", round_one, {**round_one, "bearing_deg": 80.0}, {}
    )
    assert size == 0.0
