"""Cues: a line for each track, with a volume or the reason why it has none."""

import json
import re
from functools import cache

import msgspec
import numpy as np
import pytest
from attrs import evolve
from command_line import main, run_command
from exported_runs import exported
from opir_export import search_volumes
from opir_testing import stub_estimates
from repository import EXAMPLES, ROOT

import opir_core

SITE = ("lat_deg=0", "lon_deg=10")
FIELDS = {"lat_deg": 0.0, "lon_deg": 10.0}
#: A coast above the equator, 10° west of the site: over it after two minutes.
COAST = (6.8e6, 0.0, 0.0, 500.0, 7.0e3, 0.0)
UNKNOWN = (np.nan,) * 6


@cache
def bare_run():
    scene = opir_core.load_scene(EXAMPLES / "first_light.yaml", overrides=["duration_s=11"])
    return opir_core.simulate(scene)


def run_of(**columns):
    """Return a run with a track of a row each, or those of `track`."""
    count = len(next(iter(columns.values())))
    defaults = {
        "track": np.arange(count),
        "tick_s": 100.0,
        "state": COAST,
        "state_covariance": np.diag([1e6] * 3 + [100.0] * 3),
        "probability_burning": 0.0,
    }
    return evolve(bare_run(), tracks=stub_estimates(count, **(defaults | columns)).freeze())


def test_every_track_has_a_line_and_a_reason(tmp_path):
    away = (-6.8e6, 0.0, 0.0, 100.0, 0.0, 0.0)
    overhead = (*(7.0e6 * np.array([np.cos(0.17), np.sin(0.17), 0.0])), 0.0, 0.0, 0.0)
    run = run_of(
        state=[COAST, away, overhead, COAST, COAST, UNKNOWN],
        probability_burning=[0.04, 0.0, 0.0, 0.05, np.nan, 0.0],
    )
    (path,) = exported(run, "cues", tmp_path / "c.jsonl", *SITE, "at=first", "mask_deg=30")
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    assert [row["track_id"] for row in rows] == list(range(6))
    reasons = ["rises", "not in view", "in view", *["may still burn"] * 2, "no state"]
    assert [row["reason"] for row in rows] == reasons
    assert [row["volume"] is not None for row in rows] == [True, False, True, *[False] * 3]
    assert all(row.keys() == rows[0].keys() for row in rows)
    assert search_volumes(run, **FIELDS, at="first", mask_deg=30.0)[0].volume == msgspec.convert(
        rows[0]["volume"], type(search_volumes(run, **FIELDS, mask_deg=30.0)[0].volume)
    )


@pytest.mark.parametrize(
    ("at", "event_s"),
    [("first", 100.0), ("burnout", 130.0), ("launch", 110.0), ("IRBM", 120.0), ("SRBM", None)],
)
def test_events_are_the_first_rows_that_have_them(at, event_s):
    types = np.zeros((4, 4))
    types[:, 1] = [0.0, 0.5, 0.95, 0.99]
    run = run_of(
        tick_s=[100.0, 110.0, 120.0, 130.0],
        track=[3] * 4,
        probability_burning=[1.0, 0.9, 0.05, 0.049],
        probability_launch=[0.9, 0.91, 0.92, 0.93],
        type_probability=types,
    )
    (cue,) = search_volumes(run, **FIELDS, at=at, mask_deg=30.0)
    assert cue.event_s == event_s
    reasons = {"burnout": "rises", "SRBM": "no event"}
    assert cue.reason == reasons.get(at, "may still burn")


def test_a_late_report_leaves_less_time_or_shows_what_is_already_in_view():
    run = run_of(tick_s=[100.0] * 3, available_s=[100.0, 110.0, 230.0])
    early, later, last = search_volumes(run, **FIELDS, mask_deg=30.0)
    assert early.volume.time_s == pytest.approx(later.volume.time_s, abs=1e-3)
    assert early.volume.react_s == pytest.approx(later.volume.react_s + 10.0, abs=1e-3)
    assert early.volume.elevation_deg == pytest.approx(30.0, abs=1e-3)
    assert (last.reason, last.volume.time_s, last.volume.react_s) == ("in view", 230.0, 0.0)


def test_a_horizon_is_the_time_of_the_volume():
    run = run_of(tick_s=[100.0] * 2, available_s=[103.0] * 2)
    cue = search_volumes(run, **FIELDS, mask_deg=30.0, horizon_s=150.0)[0]
    assert (cue.reason, cue.volume.time_s, cue.volume.react_s) == ("in view", 250.0, 147.0)
    below = search_volumes(run, **FIELDS, mask_deg=30.0, horizon_s=1.0)[0]
    assert (below.reason, below.volume) == ("not in view", None)


def test_what_has_come_down_is_not_in_view():
    fall = (6.38e6, 1.11e6, 0.0, -1e3, 0.0, 0.0)
    for settings in ({}, {"horizon_s": 3000.0}):
        (cue,) = search_volumes(run_of(state=[fall], available_s=[3000.0]), **FIELDS, **settings)
        assert cue.reason == "not in view"


def test_a_run_without_a_tracker_has_one_clear_message(tmp_path, capsys):
    events = tmp_path / "events.jsonl"
    scene = EXAMPLES / "first_light.yaml"
    run_command("run {} --set duration_s=11 --out {} --quiet", scene, events)
    words = ["--to", "cues", "--set", "lat_deg=0", "--set", "lon_deg=10"]
    assert main(["export", str(events), *words]) == 2
    message = capsys.readouterr().err
    assert "the run of first-light" in message
    assert "has no tracks: run it with a tracker" in message
    assert main(["export", str(events), "--to", "cues"]) == 2
    assert "lat_deg: is missing" in capsys.readouterr().err


def test_a_tracker_without_tracks_gives_no_lines(tmp_path):
    scene = opir_core.load_scene(
        EXAMPLES / "first_light.yaml",
        overrides=["duration_s=11", "tracker=imm", "detection=never"],
    )
    (path,) = exported(opir_core.simulate(scene), "cues", tmp_path / "c.jsonl", *SITE)
    assert path.read_bytes() == b""


def test_the_page_has_every_field():
    (cue,) = search_volumes(run_of(state=[COAST]), **FIELDS)
    page = (ROOT / "docs" / "how-to" / "export.md").read_text(encoding="utf-8")
    section = page.partition("## Cues to other sensors")[2].partition("\n## ")[0]
    table = " ".join(line.split("|")[1] for line in section.splitlines() if line.startswith("|"))
    fields = {*cue.__struct_fields__, *cue.volume.__struct_fields__}
    assert fields <= set(re.findall(r"`(\w+)`", table))
