"""`opir track`: lines of sight from files of others are tracked as if the run that made them had
been opir's.
"""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import main, run_command
from json_lines import json_lines
from read_files import read, refusal

from opir_core import load_run

SCENE = """scene: two-eyes
epoch: "2026-04-01T12:00:00Z"
duration_s: 70
seed: 4
sensors:
  - {model: SBIRS-GEO, id: WEST, orbital_slot_deg: -135.0, scan_period_ms: 500}
  - {model: SBIRS-GEO, id: EAST, orbital_slot_deg: -100.0, scan_period_ms: 500}
tracker: kepler-arc
targets:
  - {id: T1, type: ICBM, launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 10}, aim: {lat_deg: 9, lon_deg: 167.7}}
"""
SENSORS = "".join(
    line for line in SCENE.splitlines(True) if not re.search("two-eyes|targets|ICBM", line)
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with a run of two sensors, `events.jsonl`, and its angles as `run.tdm`."""
    where = tmp_path_factory.mktemp("run")
    (where / "scene.yaml").write_text(SCENE)
    (where / "sensors.yaml").write_text(SENSORS)
    run_command("run {} -q --out {}", where / "scene.yaml", where / "events.jsonl")
    words = ["--to", "tdm", "--set", "objects=targets", "--out", str(where / "run.tdm")]
    assert main(["export", str(where / "events.jsonl"), *words]) == 0
    return where


#: The sensors of a run looked throughout its scene: tables of its events do not say so.
WATCHED = ("--watched", "throughout")


@pytest.fixture
def track(tmp_path, capsys):
    """Return a function that tracks a file and returns the tracks' rows, or with an exit code the
    errors.
    """

    def tracked(path, sensors, *words, code=0):
        capsys.readouterr()
        out = tmp_path / "tracked.jsonl"
        assert (
            main(["track", str(path), "--sensors", str(sensors), "--out", str(out), *words]) == code
        )
        answer = capsys.readouterr()
        return answer.err if code else states_of(out)

    return tracked


def states_of(events):
    lines = events.with_suffix(".tracks.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    return np.array([[row["time_s"], row["track_id"], *row["position_ecef_m"]] for row in rows])


def seconds_between(start, end):
    start, end = (np.datetime64(text.removesuffix("Z"), "ns") for text in (start, end))
    return (end - start) / np.timedelta64(1, "s")


def events_of(folder):
    return json_lines(folder / "events.jsonl")


def table_of(rows, names, delimiter=","):
    head = delimiter.join(names)
    return "\n".join([head, *(delimiter.join(map(str, row)) for row in rows), ""])


def same(tracks, expected, metres=1e-6):
    assert tracks.shape == expected.shape
    assert len(tracks) > 20
    np.testing.assert_array_equal(tracks[:, :2], expected[:, :2])
    np.testing.assert_allclose(tracks[:, 2:], expected[:, 2:], rtol=0.0, atol=metres)


def test_events_are_tracked_as_in_the_run_that_made_them(track, folder):
    # Events have angles to 1e-7 degrees: at 36 000 km some centimetres, times the geometry of two
    # lines of sight.
    same(
        track(folder / "events.jsonl", folder / "scene.yaml"),
        states_of(folder / "events.jsonl"),
        metres=5.0,
    )


def test_a_table_gives_the_same_tracks_as_events(track, folder, tmp_path):
    rows = events_of(folder)
    names = ["timestamp", "sensor_id", "azimuth_deg", "elevation_deg", "line_of_sight_sigma_urad"]
    places = ["sensor_x_ecef_m", "sensor_y_ecef_m", "sensor_z_ecef_m"]
    cells = [[*(row[name] for name in names), *row["sensor_position_ecef_m"]] for row in rows]
    (tmp_path / "own.csv").write_text(table_of(cells, [*names, *places]))
    same(
        track(tmp_path / "own.csv", folder / "sensors.yaml", *WATCHED),
        track(folder / "events.jsonl", folder / "sensors.yaml"),
    )


@pytest.mark.parametrize("ending", ["jsonl", "csv"])
def test_the_order_of_lines_changes_no_track(track, folder, tmp_path, ending):
    """A log may be of several sensors, one after the other, or of late reports."""
    lines = (folder / "events.jsonl").read_text().splitlines(True)
    if ending == "csv":
        names = [
            "timestamp",
            "sensor_id",
            "azimuth_deg",
            "elevation_deg",
            "line_of_sight_sigma_urad",
        ]
        lines = table_of(
            [[json.loads(line)[name] for name in names] for line in lines], names
        ).splitlines(True)
    head, rows = (lines[:1], lines[1:]) if ending == "csv" else ([], lines)
    order = np.random.default_rng(3).permutation(len(rows))
    (tmp_path / f"ordered.{ending}").write_text("".join([*head, *rows]))
    (tmp_path / f"shuffled.{ending}").write_text("".join([*head, *(rows[row] for row in order)]))
    ordered, shuffled = (
        track(tmp_path / f"{name}.{ending}", folder / "scene.yaml")
        for name in ("ordered", "shuffled")
    )
    same(shuffled, ordered, metres=0.0)


def test_other_units_names_and_delimiters_give_the_same_tracks(track, folder, tmp_path):
    cells = []
    for row in events_of(folder):
        since_s = seconds_between("2026-04-01T11:59:00Z", row["timestamp"])
        angles = [
            repr(math.radians(row[name])).replace(".", ",")
            for name in ("azimuth_deg", "elevation_deg")
        ]
        x, y, z = (repr(value * 1e-3).replace(".", ",") for value in row["sensor_position_ecef_m"])
        cells.append(
            [row["sensor_id"].lower(), f"{since_s:.6f}".replace(".", ","), *angles, x, y, z]
        )
    names = [
        "satellite",
        "T",
        "AZ",
        "EL",
        "sensor_x_ecef_km",
        "sensor_y_ecef_km",
        "sensor_z_ecef_km",
    ]
    (tmp_path / "own.csv").write_text("\ufeff" + table_of(cells, names, ";"), encoding="utf-8")
    words = [
        "--columns",
        "sensor_id=satellite,time_s=T,azimuth_rad=AZ,elevation_rad=EL",
        "--start-s",
        "-60",
    ]
    words += ["--rename", "west=WEST", "--rename", "east=EAST"]
    # Times to a microsecond and radians back to degrees: as much as the rounding of events.
    tracks = track(tmp_path / "own.csv", folder / "sensors.yaml", *WATCHED, *words)
    same(tracks, track(folder / "events.jsonl", folder / "sensors.yaml"), metres=1.0)


@pytest.mark.parametrize("angles", ["azel", "radec"])
def test_a_tracking_data_message_gives_the_same_tracks(track, folder, tmp_path, angles):
    words = [
        "--to",
        "tdm",
        "--set",
        "objects=targets",
        "--set",
        f"angles={angles}",
        "--out",
        str(tmp_path / "run.tdm"),
    ]
    assert main(["export", str(folder / "events.jsonl"), *words]) == 0
    same(
        track(tmp_path / "run.tdm", folder / "scene.yaml", *WATCHED),
        track(folder / "events.jsonl", folder / "scene.yaml"),
        metres=5.0,
    )


def test_an_exported_table_of_detections_gives_the_same_tracks(track, folder, tmp_path):
    run_command("export {} --to csv --out {}", folder / "events.jsonl", tmp_path / "tables")
    tracks = track(tmp_path / "tables" / "detections.csv", folder / "scene.yaml", *WATCHED)
    # Angles of the table went through radians.
    same(tracks, track(folder / "events.jsonl", folder / "scene.yaml"), metres=0.01)


@pytest.mark.parametrize("is_export", [True, False])
def test_parquet_gives_the_same_tracks(track, folder, tmp_path, is_export):
    path = tmp_path / "detections.parquet"
    if is_export:
        run_command("export {} --to parquet --out {}", folder / "events.jsonl", tmp_path)
    else:
        run_command("run {} -q --out {}", folder / "scene.yaml", path)
    # Without an epoch of their own: the column of dates counts, not the seconds of the scene beside
    # it.
    tracks = track(path, folder / "sensors.yaml", *WATCHED)
    ids = [
        json.loads(line)["detection_id"]
        for line in (tmp_path / "tracked.jsonl").read_text().splitlines()
    ]
    assert ids == [row["detection_id"] for row in events_of(folder)]
    same(tracks, track(folder / "events.jsonl", folder / "sensors.yaml"), metres=0.05)


def test_what_is_tracked_is_read_back_and_scored_as_the_run(track, folder, tmp_path, capsys):
    track(folder / "events.jsonl", folder / "scene.yaml")
    tracked = load_run(tmp_path / "tracked.jsonl")
    run = load_run(folder / "events.jsonl")
    np.testing.assert_array_equal(tracked.truth.target, run.truth.target)
    np.testing.assert_allclose(tracked.truth.range_m, run.truth.range_m, rtol=0.0, atol=1e3)
    assert [file["path"] for file in tracked.manifest["files"]] == [str(folder / "events.jsonl")]
    figures = []
    for events in (tmp_path / "tracked.jsonl", folder / "events.jsonl"):
        capsys.readouterr()
        run_command("score {}", events)
        figures.append(
            [
                line
                for line in capsys.readouterr().out.splitlines()
                if not line.startswith("time per")
            ]
        )
    assert figures[0] == figures[1]


def test_targets_that_a_table_names_are_its_truth(track, folder, tmp_path):
    rows = events_of(folder)
    names = ["timestamp", "sensor_id", "azimuth_deg", "elevation_deg", "target"]
    cells = [
        [*(row[name] for name in names[:4]), "T1" if place % 2 else "decoy"]
        for place, row in enumerate(rows)
    ]
    (tmp_path / "own.csv").write_text(table_of(cells, names))
    track(tmp_path / "own.csv", folder / "scene.yaml")
    target = load_run(tmp_path / "tracked.jsonl").truth.target
    assert np.count_nonzero(target == 0) == len(rows) // 2
    assert np.count_nonzero(target == -1) == -(-len(rows) // 2)


def test_names_of_constellations_stand_for_a_file_of_sensors(track, folder, tmp_path):
    rows = events_of(folder)
    names = ["timestamp", "sensor_id", "azimuth_deg", "elevation_deg"]
    cells = [
        [
            row["timestamp"],
            {"WEST": "X", "EAST": "Y"}[row["sensor_id"]],
            *(row[n] for n in names[2:]),
        ]
        for row in rows
    ]
    (tmp_path / "own.csv").write_text(table_of(cells, names))
    message = track(tmp_path / "own.csv", "SBIRS-GEO", code=2)
    assert "line 2: its sensor 'X', of" in message
    assert "is none of --sensors" in message


def test_sensors_alone_begin_before_the_first_detection(track, folder, tmp_path):
    (tmp_path / "bare.yaml").write_text(
        "sensors:\n" + "".join(line for line in SENSORS.splitlines(True) if "model" in line)
    )
    tracks = track(folder / "events.jsonl", tmp_path / "bare.yaml", "--tracker", "kepler-arc")
    scene = json.loads((tmp_path / "tracked.manifest.json").read_text())["scene"]
    start = min(row["timestamp"] for row in events_of(folder))
    lead_s = seconds_between(scene["epoch"], start)
    assert 60.0 <= lead_s < 61.0
    assert tracks[-1, 0] == scene["duration_s"]


@pytest.mark.parametrize(
    ("text", "words", "reported"),
    [
        (
            "time_s,sensor_id,azimuth_deg,elevation_deg\n1,WEST,1,-86\n",
            ["--set", "duration_s=-1"],
            "duration_s",
        ),
        (
            "time_s,sensor_id,azimuth_deg,elevation_deg\n1775044830,WEST,1,-86\n",
            [],
            "line 2: its times, 2082-07-01T00:00:30Z to 2082-07-01T00:00:30Z, and the scene",
        ),
        (
            "timestamp,sensor_id,azimuth_deg,elevation_deg\n2026-04-02T12:00:01Z,WEST,1,-86\n",
            [],
            "have nothing in common; set the scene's epoch",
        ),
        (
            "timestamp,sensor_id,azimuth_deg,elevation_deg\nnoon,WEST,1,-86\n",
            [],
            "line 2: timestamp is 'noon', no date",
        ),
        (
            "time_s,sensor_id,azimuth_deg,elevation_deg\n1,WEST,1,\n",
            [],
            "line 2: elevation_deg is empty",
        ),
        (
            "time_s,sensor_id,azimuth_deg,elevation_deg\n1,WEST,1,-186\n",
            [],
            "elevation_deg is -186.0, beyond 90 deg",
        ),
        (
            "time_s,sensor_id,los_x_ecef,los_y_ecef,los_z_ecef\n1,WEST,0,0,0\n",
            [],
            "line 2: its line of sight has no dir",
        ),
        ("time_s,sensor,brightness\n1,WEST,3\n", [], "is of no format that is read"),
        (
            '{"timestamp": 5, "sensor_id": "WEST", "azimuth_deg": 1, "elevation_deg": -86}\n',
            [],
            "line 1: timestamp is 5, no date",
        ),
        (
            "time_s,azimuth_deg,elevation_deg\n1,1,-86\n",
            [],
            "line 2: has no sensor_id, and --sensors has several",
        ),
    ],
)
def test_what_cannot_be_tracked_is_reported_with_its_place(
    track, folder, tmp_path, text, words, reported
):
    (tmp_path / "own.csv").write_text(text)
    assert reported in track(tmp_path / "own.csv", folder / "sensors.yaml", *words, code=2)


def test_angles_from_another_axis_give_a_warning(folder, tmp_path, capsys):
    rows = events_of(folder)
    names = ["timestamp", "sensor_id", "azimuth_deg", "elevation_deg"]
    cells = [
        [row["timestamp"], row["sensor_id"], row["azimuth_deg"], -row["elevation_deg"]]
        for row in rows
    ]
    (tmp_path / "own.csv").write_text(table_of(cells, names))
    words = ["--sensors", str(folder / "sensors.yaml"), "--out", str(tmp_path / "t.jsonl")]
    assert main(["track", str(tmp_path / "own.csv"), *words]) == 0
    warnings = capsys.readouterr().err.splitlines()
    assert any("WEST leads past the Earth; are angles in other units" in line for line in warnings)
    assert main(["track", str(folder / "events.jsonl"), *words]) == 0
    assert "warning" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("2026-04-01T12:00:00Z", 1_775_044_800.0),
        ("2026-04-01 12:00:00.250", 1_775_044_800.25),
        ("2026-091T12:00:00", 1_775_044_800.0),
        ("2026-04-01T14:00:00+02:00", 1_775_044_800.0),
        ("2026-04-01T12:00Z", 1_775_044_800.0),
    ],
)
def test_dates_are_read_to_the_nanosecond(text, seconds):
    table = read("gpx", TRACK.format(text), 0)
    assert table.time_s[0] == round(seconds * 1e3) * 1_000_000 * 1e-9


@pytest.mark.parametrize(
    "text", ["2026-02-30T00:00:00", "2026-04-01", "2026-04-01T25:00:00Z", "x", "2026-000T12:00:00"]
)
def test_what_is_no_date_is_refused(text):
    assert f"line 1: time is '{text}', " in refusal("gpx", TRACK.format(text))


TRACK = (
    '<gpx><trk><trkpt lat="1" lon="2"><ele>3</ele><time>{}</time></trkpt>'
    '<trkpt lat="1" lon="2"><ele>3</ele><time>2026-04-01T13:00:00Z</time></trkpt></trk></gpx>'
)


def test_the_input_is_not_overwritten(folder, tmp_path, capsys):
    copy = tmp_path / "events.jsonl"
    copy.write_bytes((folder / "events.jsonl").read_bytes())
    run_command("track {} --sensors {} --out {}", copy, folder / "scene.yaml", copy, code=2)
    assert "would overwrite" in capsys.readouterr().err
    assert copy.read_bytes() == (folder / "events.jsonl").read_bytes()
    assert not Path(tmp_path / "events.tracks.jsonl").exists()
