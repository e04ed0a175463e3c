"""What a user types, and what comes of it: files, tables, messages, exit codes."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from json_lines import json_lines
from opir_photons.detection.confirmation import false_confirmation_probability, gate_radius_cells
from repository import EXAMPLES, TEST_SCENES

import opir_core
from opir_core.cli.main import main

FIRST_LIGHT = str(EXAMPLES / "first_light.yaml")
PACIFIC = str(TEST_SCENES / "pacific_test_range.yaml")
#: All its three targets burn by then.
SHORT = (PACIFIC, "--set", "duration_s=80")


def process(folder, *words, **environment):
    """Run the command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "opir_core", *words],
        cwd=folder,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_command_has_one_thread_for_linear_algebra_unless_the_user_says_otherwise(
    monkeypatch, capsys
):
    monkeypatch.setattr(os, "environ", {**os.environ, "OMP_NUM_THREADS": "4"})
    os.environ.pop("OPENBLAS_NUM_THREADS", None)
    monkeypatch.setattr(sys, "argv", ["opir", "plugins"])
    assert main() == 0
    capsys.readouterr()
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "4"


@pytest.fixture
def opir(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command in this process."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        capsys.readouterr()
        try:
            code = main(list(words))
        except SystemExit as ended:
            code = ended.code
        reported = capsys.readouterr()
        return subprocess.CompletedProcess(words, code, reported.out, reported.err)

    return run


@pytest.fixture(scope="module")
def pacific(
    tmp_path_factory,
):
    """Return the folder of a run in a process of its own, and what it said."""
    folder = tmp_path_factory.mktemp("pacific")
    return folder, process(folder, "run", *SHORT, PYTHONHASHSEED="42")


@pytest.mark.slow
def test_a_run_writes_events_truth_and_manifest_and_says_so(
    pacific,
):
    folder, done = pacific
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    events = json_lines(folder / "events.jsonl")
    manifest = json.loads((folder / "events.manifest.json").read_text(encoding="utf-8"))
    truth = json_lines(folder / "events.truth.jsonl")
    assert manifest["counts"]["detections"] == len(events)
    assert {row["target_id"] for row in truth if row["record"] == "target"} == {"T1", "T2", "T3"}
    assert [row["detection_id"] for row in truth if row["record"] == "detection"] == [
        event["detection_id"] for event in events
    ]
    assert {event["sensor_type"] for event in events} == {"DSP", "SBIRS-GEO", "NEXTGEN-GEO"}
    assert all(
        name in done.stdout
        for name in ("events.jsonl", "events.truth.jsonl", "events.manifest.json")
    )


@pytest.mark.slow
def test_a_run_says_first_who_saw_what_and_where_it_goes(
    pacific,
):
    folder, done = pacific
    truth = {
        row["target_id"]: row
        for row in json_lines(folder / "events.truth.jsonl")
        if row["record"] == "target"
    }
    ids = {
        row["detection_id"]: row["target_id"]
        for row in json_lines(folder / "events.truth.jsonl")
        if "detection_id" in row
    }
    answers = dict(line.split(": ", 1) for line in done.stdout.splitlines()[2 : 2 + len(truth)])
    detections = {}
    for event in json_lines(folder / "events.jsonl"):
        detections.setdefault(ids[event["detection_id"]], event["sensor_id"])
    for name, row in truth.items():
        reported = answers[f"{name} ({row['type']})"]
        assert reported.startswith(f"first seen by {detections[name]} after ")
        # In mid-burn an intercontinental missile may as well be a space launch: then the answer is
        # one of both.
        answers_for = {"ICBM": "(ICBM|SLV)"}.get(row["type"], row["type"])
        assert re.search(rf"; (tracker|detections): {answers_for}\b", reported)
        if "from" in reported:
            north, east = re.search(r"from ([\d.]+) N ([\d.]+) [EW]", reported).groups()
            assert float(north) == pytest.approx(row["launch"]["lat_deg"], abs=0.02)
            assert float(east) == pytest.approx(abs(row["launch"]["lon_deg"]), abs=0.02)
    assert done.stdout.index(f"{name} (") < done.stdout.index("sensor ")


def test_many_targets_are_answered_in_few_lines(tmp_path, opir):
    scene = tmp_path / "raid.yaml"
    target = {
        "type": "SRBM",
        "launch": {"lat_deg": 10.0, "lon_deg": 120.0},
        "aim": {"lat_deg": 12.0, "lon_deg": 121.0},
    }
    hidden = {
        **target,
        "launch": {"lat_deg": 10.0, "lon_deg": -60.0},
        "aim": {"lat_deg": 12.0, "lon_deg": -61.0},
    }
    targets = [{"id": f"T{number}", **(target if number else hidden)} for number in range(9)]
    sensors = [{"model": "DSP", "id": "D", "orbital_slot_deg": 120.0}]
    head = {"scene": "raid", "epoch": "2026-04-01T12:00:00Z", "duration_s": 60, "seed": 1}
    head["detection"] = "constant"
    scene.write_text(json.dumps({**head, "sensors": sensors, "targets": targets}), encoding="utf-8")
    reported = opir("run", str(scene), "--sink", "null").stdout.splitlines()[2:9]
    assert reported[0] == "T0 (SRBM): not detected: the Earth is in the way throughout the burn"
    assert [line.partition(" ")[0] for line in reported[1:6]] == ["T1", "T2", "T3", "T4", "T5"]
    assert reported[6] == "... and 3 more targets"


@pytest.mark.slow
def test_a_terminal_sees_progress_and_the_table_stays_clean(tmp_path, pacific):
    result, reference = os.openpty()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "opir_core", "run", *SHORT],
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=reference,
            text=True,
            check=False,
            env={**os.environ, "TERM": "xterm"},
        )
        os.close(reference)
        shown = os.read(result, 65536).decode()
    finally:
        os.close(result)
    assert done.returncode == 0, shown
    assert "pacific-test-range" in shown
    assert done.stdout == pacific[1].stdout


def test_events_hold_no_truth(pacific):
    events = pacific[0] / "events.jsonl"
    assert '"T1"' not in events.read_text(encoding="utf-8")
    assert not {"target_id", "range_m", "probability", "emission_s"} & set(json_lines(events)[0])


def test_a_manifest_is_enough_to_repeat_the_run(tmp_path, opir):
    opir("run", FIRST_LIGHT, "--seed", "11", "--set", "sensors[0].scan_period_ms=250", "--quiet")
    manifest = json.loads((tmp_path / "events.manifest.json").read_text(encoding="utf-8"))
    repeat = opir_core.simulate(opir_core.scene_from_mapping(manifest["scene"]))
    assert repeat.manifest["scene_hash"] == manifest["scene_hash"]
    assert repeat.manifest["counts"] == manifest["counts"]


def test_settings_reach_the_run(tmp_path, opir):
    done = opir(
        "run", FIRST_LIGHT, "--out", "a.jsonl", "--truth", "t.jsonl", "--manifest", "m.json", "--seed", "11",
        "--set", "sensors[0].scan_period_ms=1000", "--json",
    )  # fmt: skip
    reported = json.loads(done.stdout)
    assert reported["files"] == {"truth": "t.jsonl", "manifest": "m.json"}
    assert json.loads((tmp_path / "m.json").read_text(encoding="utf-8"))["seed"] == 11
    assert reported["sensors"][0]["looks"] < 300
    assert not (tmp_path / "events.jsonl").exists()


@pytest.mark.slow
def test_quiet_into_memory_prints_and_writes_nothing(tmp_path):
    done = process(tmp_path, "run", FIRST_LIGHT, "--tracker", "none", "--sink", "memory", "--quiet")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert list(tmp_path.iterdir()) == []


def test_events_on_standard_output_leave_the_summary_to_standard_error(tmp_path):
    done = process(tmp_path, "run", FIRST_LIGHT, "--out", "-")
    assert all(json.loads(line)["sensor_id"] == "DSP-1" for line in done.stdout.splitlines())
    assert "first-light" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_reader_that_goes_away_ends_the_run_quietly(tmp_path):
    command = f"{sys.executable} -m opir_core run {FIRST_LIGHT} --out - --quiet | head -1"
    done = subprocess.run(
        command, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert json.loads(done.stdout)["detection_id"]
    assert "Traceback" not in done.stderr


def test_validate_says_good_or_all_that_is_wrong(opir):
    valid = opir("validate", PACIFIC)
    assert (valid.returncode, valid.stderr) == (0, "")
    invalid = opir(
        "validate", PACIFIC, "--set", "targets[0].launch.lat_deg=134.7", "--set", "sed=3"
    )
    assert invalid.returncode == 2
    assert "targets[0].launch.lat_deg: 134.7 is outside [-90, 90]" in invalid.stderr
    assert "seed" in invalid.stderr


def test_an_aim_out_of_reach_says_what_the_class_reaches(opir):
    done = opir("validate", FIRST_LIGHT, "--set", "targets[0].type=SRBM")
    assert done.returncode == 2
    assert done.stderr.startswith(f"opir: {FIRST_LIGHT}: 1 problem")
    assert "targets[0].aim" in done.stderr
    assert "SRBM" in done.stderr
    assert " km" in done.stderr


def test_explain_tells_pairs_and_what_is_skipped(opir):
    reported = json.loads(opir("explain", PACIFIC, "--json").stdout)
    assert reported["pairs"]
    assert reported["skipped"]
    assert {row["reason"] for row in reported["skipped"]} <= {
        "the Earth is in the way throughout the burn",
        "outside the field of regard throughout the burn",
        "no scan falls into the burn before the scene ends",
    }
    assert any("geometry" in line for line in reported["not_computed"])
    text = opir("explain", PACIFIC)
    assert text.returncode == 0
    assert "skipped because" in text.stdout
    assert reported["noise"] == []
    light = ("--set", "detection=snr", "--set", "sensors[0].preset=paper")
    noisy = json.loads(opir("explain", PACIFIC, *light, "--json").stdout)["noise"]
    rates = {row["sensor_id"]: row["per_scan"] for row in noisy}
    # DSP: 8.73 exceedances of 5 standard deviations a scan, of which the gates of the two scans
    # before confirm few.
    radius = gate_radius_cells([1, 2], 0.2, 56e-6, 35_786e3, 8000.0)
    confirmed = false_confirmation_probability(2.8665e-7, 2, radius)
    assert max(rates.values()) == pytest.approx(8.73 * confirmed, rel=1e-3)


@pytest.mark.slow
def test_aligned_scans_on_ignitions_are_warned_of(tmp_path, opir):
    aligned = ("--set", "sensors[0].preset=paper")
    done = process(tmp_path, "run", FIRST_LIGHT, *aligned)
    assert done.returncode == 0
    assert "DSP-1" in done.stderr
    assert "set scan_phase: random" in done.stderr
    assert process(tmp_path, "run", FIRST_LIGHT, *aligned, "--quiet").stderr == ""
    reported = process(tmp_path, "explain", FIRST_LIGHT, *aligned)
    assert reported.stdout.rstrip().splitlines()[-1] == f"warning: {done.stderr.strip()}"
    assert reported.stderr == ""
    assert "warning" not in opir("explain", FIRST_LIGHT).stdout


LATE = (
    "--set",
    "sensors[0].reporting={downlink: {mean_s: 2}, processing: {mean_s: 5, sigma_s: 1.5}}",
)


def test_a_run_tells_the_latency_of_its_reports_if_any(opir):
    prompt = opir("run", FIRST_LIGHT)
    delayed = opir("run", FIRST_LIGHT, *LATE)
    assert "end to end" not in prompt.stdout
    head, row = (delayed.stdout.splitlines()[number] for number in (7, 8))
    assert head.split("  ")[:2] == ["target", "type"]
    assert head.index("end to end s") > head.index("latency s")
    first_s, report_s = map(float, row.split()[3:5])
    assert f"after {first_s:.3f} s, reported after {report_s:.3f} s" in delayed.stdout
    assert "reported after" not in prompt.stdout
    assert first_s + 2.0 < report_s < first_s + 2.0 + 5.0 + 4 * 1.5
    events = json_lines(Path("events.jsonl"))
    assert len(events) == 750
    reports = [str(event["reported_at"]) for event in events]
    assert reports == sorted(reports)
    assert reports[-1] > max(str(event["timestamp"]) for event in events)


def test_explain_tells_each_sensor_s_latency_and_the_order_of_tracking(opir):
    reported = opir(
        "explain",
        FIRST_LIGHT,
        *LATE,
        "--set",
        "tracking_order=report",
        "--set",
        "tracking_lag_s=9.5",
    )
    assert reported.returncode == 0, reported.stderr
    rows = reported.stdout.splitlines()
    place = next(
        number for number, row in enumerate(rows) if row.startswith("sensor  reports after s")
    )
    assert rows[place + 1].split("  ")[0] == "DSP-1"
    assert rows[place + 1].endswith("downlink 2, processing 5 ± 1.5")
    assert "tracking in the order of report, 9.500 s after the ticks" in rows
    prompt = opir("explain", FIRST_LIGHT)
    assert "not computed: reporting latency (reports are at the times of looks)" in prompt.stdout
    plain = json.loads(opir("explain", FIRST_LIGHT, "--json").stdout)
    assert plain["reporting"] == [{"sensor_id": "DSP-1", "mean_s": 0, "sigma_s": 0.0, "stages": []}]
    assert plain["tracking"] == {"order": "observation", "lag_s": None}


def test_plugins_are_listed_with_their_versions(opir):
    rows = json.loads(opir("plugins", "--json").stdout)
    assert {row["distribution"] for row in rows} >= {
        "opir-core",
        "opir-dsp",
        "opir-sbirs",
        "opir-nextgen",
    }
    assert "NEXTGEN-GEO" in opir("plugins").stdout


def test_a_plugin_that_is_not_allowed_is_named(opir, monkeypatch):
    monkeypatch.setenv("OPIR_PLUGINS", "dsp")
    done = opir("run", PACIFIC)
    assert done.returncode == 3
    assert "SBIRS-GEO" in done.stderr
    assert "OPIR_PLUGINS" in done.stderr


def test_schema_is_printed(opir):
    schema = json.loads(opir("schema", "detection").stdout)
    assert list(schema["properties"])[:9] == [
        "detection_id", "timestamp", "sensor_id", "sensor_type", "orbital_slot", "target_type", "launch_point",
        "impact_point", "confidence",
    ]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("run", "nowhere.yaml"), 2, "nowhere.yaml"),
        (("run", FIRST_LIGHT, "--tracker", "psychic"), 3, "psychic"),
        (("run", FIRST_LIGHT, "--out", "no/such/folder/events.jsonl"), 5, "no/such/folder"),
        (("run", FIRST_LIGHT, "--out", "/dev/full"), 5, "/dev/full"),
        (("run", FIRST_LIGHT, "--truth", "no/such/folder/t.jsonl"), 5, "no/such/folder"),
        (("run", FIRST_LIGHT, "--manifest", "no/such/folder/m.json"), 5, "no/such/folder"),
        (("serve-tea",), 2, "serve-tea"),
        ((), 2, "COMMAND"),
    ],
)
def test_what_cannot_be_done_is_one_message_and_an_exit_code(opir, words, code, message):
    done = opir(*words)
    assert done.returncode == code, done.stderr
    assert message in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_hash_seeds_change_no_byte(tmp_path, pacific):
    process(tmp_path, "run", *SHORT, "--quiet", PYTHONHASHSEED="0")
    for name in ("events.jsonl", "events.truth.jsonl", "events.manifest.json"):
        assert (tmp_path / name).read_bytes() == (pacific[0] / name).read_bytes()
