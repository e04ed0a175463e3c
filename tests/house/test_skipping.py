"""A scene pays only for what it names: what it does not name is not imported, not called, and
allocates nothing.
"""

import json
import sys
import tempfile
from functools import cache
from pathlib import Path

import pytest
from repository import ROOT

sys.path.insert(0, str(ROOT))
from benchmarks.skipping import ADDED, FILLED, PARTS, SAME, Use, used
from opir_core.host.host import Host
from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.simulation.explanation import explained
from opir_core.simulation.run import run_of_plan

#: Parts that no word of a scene run by `opir run` names.
NEVER = (
    "opir_readers",
    "opir_report",
    "opir_coverage",
    "opir_bench",
    "opir_paper",
    "opir_scoring",
    "opir_export",
    "opir_http",
    "opir_displays",
    "opir_kafka",
    "opir_studies",
    "opir_sbirs",
    "opir_nextgen",
    "opir_leo",
)


@cache
def run_of(words):
    """Return the modules, calls and bytes of a run, and its events, without their numbers in the
    file.
    """
    with tempfile.TemporaryDirectory() as folder:
        result = used(words, Path(folder))
        lines = Path(folder, "events.jsonl").read_text(encoding="utf-8").splitlines()
    return result, [json.loads(line) for line in lines]


def measured(event):
    """Return the fields of an event that no tracker fills."""
    filled = {"track_id", "launch_point", "impact_point"}
    return {key: value for key, value in event.items() if key not in filled}


#: Scenes with radiometry are followed call by call, which takes seconds.
PLAIN_OR_SLOW = [
    pytest.param(part, id=part.name, marks=pytest.mark.slow if part.beside else ())
    for part in PARTS
]


@pytest.mark.slow
@pytest.mark.parametrize("part", PLAIN_OR_SLOW)
def test_what_a_scene_does_not_name_is_not_imported_called_or_allocated(part):
    run, _ = run_of(part.beside)
    result = Use.of(part.modules, run)
    assert result.calls == 0
    assert part.shared or result == Use(0, 0, 0)
    assert not {name for name in run["modules"] if name.split(".")[0] in NEVER}


@pytest.mark.slow
def test_a_plain_scene_needs_no_special_functions():
    run, _ = run_of(())
    assert "scipy" not in run["modules"]


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS, ids=[part.name for part in PARTS])
def test_what_a_scene_names_is_called_and_changes_no_other_events(part):
    run, events = run_of((*part.beside, *part.words))
    assert Use.of(part.modules, run).calls > 0
    bare_events = run_of(part.beside)[1]
    if part.events == SAME:
        assert events == bare_events
    elif part.events == FILLED:
        assert [measured(event) for event in events] == [measured(event) for event in bare_events]
        assert any(event["track_id"] is not None for event in events)
    elif part.events == ADDED:
        ids = {event["detection_id"] for event in bare_events}
        assert [event for event in events if event["detection_id"] in ids] == bare_events
        assert len(events) > len(bare_events)
    else:
        assert events != bare_events


def test_the_work_of_a_plan_is_counted_with_what_it_skips_and_why():
    sensors = [
        {"model": "DSP", "id": f"S{slot}", "orbital_slot_deg": float(slot)}
        for slot in (-135, 45, -60)
    ]
    launch = {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0}
    mapping = {
        "scene": "skipped",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 120,
        "sensors": sensors,
        "targets": [
            {"id": "T", "type": "ICBM", "launch": launch, "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}
        ],
    }
    host = Host.discover(["dsp"])
    plan = compile_plan(scene_from_mapping(mapping, host=host), host)
    work = explained(plan)["work"]
    assert work == run_of_plan(plan).summary["work"]
    assert work["pairs"] == 3
    assert work["pairs_skipped"] == {"behind_earth": 1}
    assert (
        work["looks"] == work["looks_visible_throughout"] + work["looks_tested_for_visibility"] > 0
    )
    assert json.loads(json.dumps(work)) == work
