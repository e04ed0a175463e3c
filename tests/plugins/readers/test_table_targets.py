"""Targets whose trajectories are tables of states: read, interpolated, refused, and flown through
whole scenes.
"""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
from opir_readers import csv_table
from read_files import read, refusal
from repository import TEST_SCENES

from opir_core import compile_plan, load_scene, scene_from_mapping, simulate
from opir_core.errors import SceneError
from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef_state
from opir_core.plugin import Host, TargetContext, TargetModel

EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"

OEM = """CCSDS_OEM_VERS = 2.0
COMMENT made up
CREATION_DATE = 2026-04-01T00:00:00
ORIGINATOR = TEST
META_START
OBJECT_NAME = ONE
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = {frame}
TIME_SYSTEM = UTC
START_TIME = 2026-04-01T12:00:00.000
STOP_TIME = 2026-04-01T13:00:00.000
META_STOP
{states}
"""


def arc(time_s):
    """Return a two-body arc over the Pacific, in ECEF; its inertial axes are those of ECEF at time
    0.
    """
    start = np.array([[-5.6e6, -2.6e6, 2.9e6], [1500.0, -5200.0, 2600.0]])
    states = propagate_kepler(
        np.tile(start[0], (len(time_s), 1)), np.tile(start[1], (len(time_s), 1)), time_s
    )
    return eci_to_ecef_state(*states, time_s)


def csv_text(time_s, *, velocity=True, burning=None):
    position, speed = arc(time_s)
    names = ["time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m"]
    columns = [time_s, *position.T]
    if velocity:
        names += ["vx_ecef_m_s", "vy_ecef_m_s", "vz_ecef_m_s"]
        columns += [*speed.T]
    if burning is not None:
        names.append("is_burning")
        columns.append(burning)
    rows = [",".join(repr(float(value)) for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(["# made up", ",".join(names), *rows, ""])


def oem_text(time_s, frame="ITRF2014"):
    position, speed = arc(time_s)
    epoch = np.datetime64("2026-04-01T12:00:00.000000")
    rows = [
        f"{epoch + np.timedelta64(round(t * 1e6), 'us')} "
        + " ".join(repr(float(v)) for v in (*p / 1e3, *s / 1e3))
        for t, p, s in zip(time_s, position, speed, strict=True)
    ]
    return OEM.format(frame=frame, states="\n".join(rows))


def flown(folder, text, **settings):
    """Return the targets of a scene with one table, and its truth."""
    path = folder / "table.txt"
    path.write_text(text, encoding="utf-8")
    target = {"id": "T", "model": "table", "type": "IRBM", "file": str(path), **settings}
    scene = {
        "scene": "table",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 900.0,
        "sensors": [{"constellation": "DSP"}],
        "targets": [target],
    }
    targets = compile_plan(scene_from_mapping(scene)).targets
    return targets, targets.truth()[0]


def largest_error_m(targets, first_s, last_s):
    time_s = np.linspace(first_s, last_s, 5001)
    position = targets.position_ecef_m(np.zeros(len(time_s), np.int32), time_s)
    return np.linalg.norm(position - arc(time_s)[0], axis=1).max()


@pytest.mark.parametrize(("velocity", "step_s"), [(True, 20.0), (False, 5.0), (True, 60.0)])
def test_between_states_it_is_the_arc_that_they_are_of(tmp_path, velocity, step_s):
    targets, truth = flown(tmp_path, csv_text(np.arange(0.0, 601.0, step_s), velocity=velocity))
    error_m = largest_error_m(targets, 0.0, 600.0)
    assert error_m <= 0.02
    assert error_m <= truth["interpolation_error_m"] + truth["tolerance_m"]


def test_close_states_do_not_amplify_the_rounding_of_times(tmp_path):
    """The last of states 5 s apart comes 0.25 s after the one before; its time is rounded to 1 ms,
    3 m of flight.
    """
    exact = np.append(np.arange(0.0, 101.0, 5.0), 100.2504)
    rounded = np.round(exact, 3)
    lines = csv_text(exact).splitlines()
    head = lines[:2]
    rows = [line.partition(",")[2] for line in lines[2:]]
    text = "\n".join(
        [*head, *(f"{time!r},{row}" for time, row in zip(rounded.tolist(), rows, strict=True))]
    )
    targets, _ = flown(tmp_path, text)
    assert largest_error_m(targets, 0.0, 95.0) <= 0.02
    assert largest_error_m(targets, 95.0, 100.25) <= 3.5


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6, 7])
def test_few_states_are_enough_for_short_flights(tmp_path, count):
    targets, _ = flown(tmp_path, csv_text(np.linspace(0.0, 10.0, count)))
    assert largest_error_m(targets, 0.0, 10.0) <= 0.02


def test_an_oem_is_the_arc_too(tmp_path):
    targets, truth = flown(tmp_path, oem_text(np.arange(0.0, 601.0, 30.0)))
    assert largest_error_m(targets, 0.0, 600.0) <= 0.02
    assert truth["states"] == 21
    assert truth["sha256"] == hashlib.sha256((tmp_path / "table.txt").read_bytes()).hexdigest()


def test_a_kink_between_stretches_is_kept(tmp_path):
    """A time that stands twice parts two stretches; no polynomial reaches from one into the
    other.
    """
    time_s = np.array([0.0, 10.0, 20.0, 20.0, 30.0, 40.0])
    height = np.where(np.arange(6) < 3, time_s * 100.0, 2000.0 + (time_s - 20.0) * 5000.0)
    rows = [
        f"{t!r},{6.4e6 + h!r},0,0" for t, h in zip(time_s.tolist(), height.tolist(), strict=True)
    ]
    targets, _ = flown(tmp_path, "\n".join(["time_s,x_ecef_m,y_ecef_m,z_ecef_m", *rows]))
    time_s = np.array([0.0, 5.0, 19.0, 20.0, 21.0, 40.0])
    expected = np.where(time_s <= 20.0, time_s * 100.0, 2000.0 + (time_s - 20.0) * 5000.0)
    position = targets.position_ecef_m(np.zeros(6, np.int32), time_s)
    np.testing.assert_allclose(position[:, 0] - 6.4e6, expected, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("burning", "settings", "burn"),
    [
        (None, {}, (0.0, 100.0)),
        ([0, 1, 1, 0, 0], {}, (25.0, 75.0)),
        ([0, 1, 1, 0, 0], {"burnout_s": 60.5}, (25.0, 60.5)),
        ([0, 1, 1, 0, 0], {"burnout_s": 80.0}, (25.0, 80.0)),
        ([0, 0, 0, 1, 0], {}, (75.0, 100.0)),
        ([1, 0, 1, 0, 0], {}, (0.0, 75.0)),
        ([1, 0, 1, 0, 0], {"burnout_s": 40.0}, (0.0, 40.0)),
        (None, {"ignition_s": 3.25, "burnout_s": 60.5}, (3.25, 60.5)),
        (None, {"start_s": 7.0}, (7.0, 107.0)),
    ],
)
def test_the_burn_is_the_files_or_the_blocks(tmp_path, burning, settings, burn):
    targets, _ = flown(tmp_path, csv_text(np.linspace(0.0, 100.0, 5), burning=burning), **settings)
    assert (targets.ignition_s[0], targets.burnout_s[0]) == burn
    time_s = np.array([burn[0] - 1e-6, burn[0], 0.5 * sum(burn), burn[1], burn[1] + 1e-6])
    position = targets.position_ecef_m(np.zeros(5, np.int32), time_s)
    assert np.isfinite(position).all(axis=1).tolist() == [False, True, True, True, False]


@pytest.mark.parametrize(("free_flight", "end_s"), [(False, 60.0), (True, 100.0)])
def test_who_follows_bodies_follows_them_to_the_last_state(tmp_path, free_flight, end_s):
    path = tmp_path / "table.csv"
    path.write_text(csv_text(np.linspace(0.0, 100.0, 11)), encoding="utf-8")
    context = TargetContext(ids=("T",), paths=("targets[0]",), free_flight=free_flight)
    model = Host.discover().component(TargetModel, "table")
    config = model.config(type="SRBM", file=str(path), burnout_s=60.0)
    targets = model.build([config], context)
    assert (targets.burnout_s[0], targets.end_s[0]) == (60.0, end_s)
    time_s = np.array([60.0, np.nextafter(60.0, 99.0), 100.0])
    position = targets.position_ecef_m(np.zeros(3, np.int32), time_s)
    is_followed = time_s <= end_s
    assert np.isfinite(position).all(axis=1).tolist() == is_followed.tolist()
    assert np.linalg.norm(position - arc(time_s)[0], axis=1)[is_followed].max() <= 0.02


@pytest.mark.parametrize(
    ("heights_m", "burning", "points"),
    [
        ((0.0, 9e3, 8e3, 200.0), (1, 1, 0, 0), {"launch", "impact"}),
        ((0.0, 9e3, 8e3, 200.0), (0, 1, 0, 0), {"impact"}),
        ((0.0, 9e3, 8e3, 200.0), (1, 1, 1, 1), {"launch"}),
        ((2e3, 9e3, 8e3, 2e3), (1, 1, 0, 0), set()),
    ],
)
def test_ends_near_the_ground_are_launch_and_impact(tmp_path, heights_m, burning, points):
    # On the equator, one degree of longitude a state.
    rows = [
        f"{10 * k},0,{k},{height},{burns}"
        for k, (height, burns) in enumerate(zip(heights_m, burning, strict=True))
    ]
    _, truth = flown(tmp_path, "\n".join(["time_s,lat,lon,height,is_burning", *rows]))
    assert points == {"launch", "impact"} & set(truth)
    for name, place in (("launch", (0.0, 0.0, 0.0)), ("impact", (0.0, 3.0, 200.0))):
        if name in points:
            values = [truth[name][key] for key in ("lat_deg", "lon_deg", "height_m")]
            assert values == pytest.approx(place, abs=1e-6)
    if "impact" in points:
        assert truth["impact"]["time_s"] == 30.0


HEAD = "time_s,x_ecef_m,y_ecef_m,z_ecef_m\n"
GOOD_CSV = HEAD + "0,7e6,0,0\n1,7e6,0,0\n"
GOOD_OEM = oem_text(np.array([0.0, 10.0]))
BURNING = HEAD.replace("m\n", "m,is_burning\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "settings", "reported"),
    [
        (
            "",
            {},
            "is empty; its first line names the columns: time_s, x_ecef_m, y_ecef_m, z_ecef_m",
        ),
        (
            "time_s,x_m\n",
            {},
            (
                "line 1: lacks the columns x_ecef_m, y_ecef_m, z_ecef_m and has unknown columns"
                " ('x_m')"
            ),
        ),
        (HEAD.replace("x_", "time_s,x_"), {}, "line 1: names a column twice"),
        (HEAD + "0,7e6,0,0\n", {}, "has 1 state; at least 2 are needed"),
        (HEAD + "0,7e6,0,0\n1,7e6,zero,0\n", {}, "line 3: y_ecef_m is 'zero', not a finite number"),
        (HEAD + "0,7e6,0,0\n1,nan,0,0\n", {}, "line 3: x_ecef_m is 'nan', not a finite number"),
        (HEAD + "0,7e6,0\n", {}, "line 2: has 3 values; line 1 names 4 columns"),
        (
            HEAD + "1,7e6,0,0\n0,7e6,0,0\n",
            {},
            "line 3: its time does not follow that of line 2; sort the states",
        ),
        (
            HEAD + "0,7e3,0,0\n1,7e3,0,0\n",
            {},
            "line 2: the position is 7000 m from the Earth's centre",
        ),
        (
            BURNING + "0,7e6,0,0,0\n1,7e6,0,0,1\n",
            {},
            "is_burning is 0 throughout; 1 says that the plume radiates up to",
        ),
        (
            BURNING + "".join(f"{t},7e6,0,0,{1 - t % 2}\n" for t in range(19)),
            {},
            "is_burning begins 9 burns; at most 8",
        ),
        (
            BURNING + "".join(f"{t},7e6,0,0,{1 - t % 2}\n" for t in range(7)),
            {"ignition_s": 1.2, "burnout_s": 1.8},
            "a burn from 1.2 to 1.8 s is within a dark gap of the file",
        ),
        (GOOD_CSV, {"object": "ONE"}, "is read as csv, which has no object; omit object"),
        (
            GOOD_CSV,
            {"burnout_s": 2.0},
            "a burn from 0 to 2 s does not fit: states go from 0 to 1 s",
        ),
        (
            GOOD_OEM,
            {"start_s": 1.0},
            "is read as oem, which has no start_s; omit start_s (its settings: object)",
        ),
        (GOOD_OEM, {"object": "TWO"}, "has no object 'TWO'; it has ONE"),
        (
            GOOD_OEM.replace("ITRF2014", "RSW"),
            {},
            "line 13: REF_FRAME is 'RSW'; convert the states to one of ITRF, TDR",
        ),
        (
            GOOD_OEM.replace("UTC", "TCG"),
            {},
            "line 13: TIME_SYSTEM is 'TCG'; convert the times to one of UTC, UT1,",
        ),
        (
            GOOD_OEM.replace("EARTH", "MARS"),
            {},
            "line 13: CENTER_NAME is 'MARS'; only EARTH is taken",
        ),
        (
            GOOD_OEM.replace("OBJECT_ID = 2026-001A\n", ""),
            {},
            "line 12: the metadata lack OBJECT_ID",
        ),
        (GOOD_OEM.replace("META_STOP", ""), {}, "is not of the form KEYWORD = value"),
        (GOOD_OEM.replace("12:00:10.", "12:00:60."), {}, "is no time like 2026-04-01T12:00:00.000"),
        (
            GOOD_OEM.rstrip() + " 1\n",
            {},
            "line 15: has 8 values; a state has a time and 6 (or 9) numbers",
        ),
        (
            GOOD_OEM.replace("META_START", "META_START\nMETA_START"),
            {},
            "line 6: begins a block within one that began",
        ),
        (
            HEAD + "0,7e6,0,0\n1e-320,7e6,0,0\n",
            {},
            "line 3: is 9.99989e-321 s after line 2; leave one out",
        ),
        (
            HEAD.replace("m\n", "m,vx_ecef_m_s,vy_ecef_m_s,vz_ecef_m_s\n")
            + "0,7e6,0,0,1,1,1\n1,7e6,0,0,1,1e200,1\n",
            {},
            "line 3: a velocity of 1e+200 m/s is above that of light",
        ),
        ("CCSDS_OEM_VERS = 2.0\n", {}, "has no META_START, so no states"),
        ("CCSDS_OEM_VERS = 2.0\nMETA_STOP\n", {}, "line 2: ends a block that never began"),
    ],
)
def test_bad_files_give_a_message_with_line_and_way_out(tmp_path, text, settings, reported):
    with pytest.raises(SceneError) as caught:
        flown(tmp_path, text, **settings)
    message = str(caught.value)
    assert reported in message
    assert f"targets[0].file: {tmp_path / 'table.txt'}: " in message
    assert caught.value.exit_code == 2


def test_missing_files_and_files_of_bytes_are_reported(tmp_path):
    with pytest.raises(SceneError, match="cannot be read: no such file"):
        flown(tmp_path, "", file=str(tmp_path / "none.csv"))
    (tmp_path / "bytes.csv").write_bytes(b"time_s\n\x81\x8d")
    with pytest.raises(SceneError, match="line 2: is not UTF-8 text"):
        flown(tmp_path, "", file=str(tmp_path / "bytes.csv"))


def test_segments_of_an_oem_must_meet(tmp_path):
    head = oem_text(np.array([0.0, 10.0, 20.0]))
    second = oem_text(np.array([20.0, 30.0]))
    text = head + second[second.index("META_START") :]
    targets, _ = flown(tmp_path, text.replace("2026-04-01T", "2026-091T"))
    assert largest_error_m(targets, 0.0, 30.0) <= 0.02
    later = oem_text(np.array([25.0, 30.0]))
    with pytest.raises(SceneError, match="this segment does not start when the one before it ends"):
        flown(tmp_path, head + later[later.index("META_START") :])


def test_useable_times_and_objects_of_an_oem_are_heeded(tmp_path):
    text = oem_text(np.array([0.0, 10.0, 20.0]))
    useable = text.replace("META_STOP", "USEABLE_START_TIME = 2026-04-01T12:00:05\nMETA_STOP")
    assert flown(tmp_path, useable)[1]["ignition_s"] == 5.0
    second = oem_text(np.array([0.0, 10.0])).replace("ONE", "TWO").replace("001A", "001B")
    message = text + second[second.index("META_START") :]
    assert flown(tmp_path, message, object="2026-001A")[1]["burnout_s"] == 20.0
    assert flown(tmp_path, message, object="TWO")[1]["burnout_s"] == 10.0
    with pytest.raises(SceneError, match="has several objects; say which with object: ONE, TWO"):
        flown(tmp_path, message)


def test_a_sampled_boost_gives_the_events_of_the_boost(tmp_path):
    """The whole way: a class profile's positions, twice a second, in a file, detected as the
    profile itself is.
    """
    overrides = ["outputs=[]", "seed=5", "tracker=none"]
    scene = load_scene(EXAMPLE, overrides=overrides)
    targets = compile_plan(scene).targets
    blocks = []
    for row, target in enumerate(scene.targets):
        ignition = float(targets.ignition_s[row])
        burnout = float(targets.burnout_s[row])
        time_s = np.unique([*np.arange(ignition, burnout, 0.5), burnout])
        position = targets.position_ecef_m(np.full(len(time_s), row, np.int32), time_s)
        lines = [
            ",".join(map(repr, values)) for values in np.column_stack([time_s, position]).tolist()
        ]
        path = tmp_path / f"{target.id}.csv"
        path.write_text(HEAD + "\n".join(lines), encoding="utf-8")
        blocks.append(
            f"{{id: {target.id}, model: table, type: {target.model.config.type}, file: '{path}'}}"
        )
    profile = simulate(scene)
    table = simulate(load_scene(EXAMPLE, overrides=[*overrides, f"targets=[{', '.join(blocks)}]"]))
    assert profile.manifest["files"] == []
    assert [Path(file["path"]).name for file in table.manifest["files"]] == [
        "T1.csv",
        "T2.csv",
        "T3.csv",
    ]
    assert len(profile.detections) > 1000
    assert table.detections.time_ns.tobytes() == profile.detections.time_ns.tobytes()
    assert table.detections.detection_id.tobytes() == profile.detections.detection_id.tobytes()
    assert table.truth.target.tobytes() == profile.truth.target.tobytes()
    sight = table.detections.line_of_sight_ecef - profile.detections.line_of_sight_ecef
    assert np.abs(sight).max() <= 1e-7


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(
        SceneError,
        match=r"pipe: cannot be read: it is a pipe \(FIFO\); write its content to a file",
    ):
        flown(tmp_path, "", file=str(tmp_path / "pipe"))


class TestReadingAtOnce:
    """A table of plain numbers is read at once; whatever else stands in it, line by line, to the
    same numbers.
    """

    TIMES = np.arange(0.0, 50.0, 0.25)

    def lines_read(self, text, monkeypatch):
        lines = []
        row = csv_table._row

        def counted(table, cells, line):
            lines.append(line)
            return row(table, cells, line)

        monkeypatch.setattr(csv_table, "_row", counted)
        return read("csv", text), lines

    def test_plain_numbers_need_no_line_of_python(self, monkeypatch):
        text = csv_text(self.TIMES, burning=np.ones(len(self.TIMES))).replace(
            "\n0.5,", "\n\n# a comment\n0.5,"
        )
        table, lines = self.lines_read(text, monkeypatch)
        assert not lines
        position, velocity = arc(self.TIMES)
        assert np.array_equal(table.position_m, position)
        assert np.array_equal(table.velocity_m_s, velocity)

    def test_both_ways_give_the_same_numbers(self, monkeypatch):
        at_once, _ = self.lines_read(csv_text(self.TIMES), monkeypatch)
        monkeypatch.setattr(csv_table, "_plain_numbers", lambda *_: None)
        by_line, lines = self.lines_read(csv_text(self.TIMES), monkeypatch)
        assert len(lines) == len(self.TIMES)
        assert np.array_equal(at_once.time_s, by_line.time_s)
        assert np.array_equal(at_once.position_m, by_line.position_m)

    def test_lines_are_numbered_as_in_the_file(self):
        text = csv_text(self.TIMES).replace("\n0.5,", "\n\n# a comment\n0.1,")
        assert "line 7: its time does not follow that of line 4" in refusal("csv", text)

    def test_points_that_are_not_smooth_are_limited(self, monkeypatch):
        monkeypatch.setattr(csv_table, "MOST_BREAKS", 3)
        text = csv_text(np.sort([0.0, 5.0, *[1.0, 2.0, 3.0, 4.0] * 2]))
        assert "has 4 times that occur twice; at most 3" in refusal("csv", text)
