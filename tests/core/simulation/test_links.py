"""Reports on their way to the ground, against what a scene's links say."""

from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet as pq
import pytest
from attrs import evolve
from json_lines import json_lines
from opir_testing.doubles import CountingTracker
from two_sensor_scene import two_sensor_scene
from waiting import until

import opir_core as opir
from opir_core import compile_plan, plan_windows
from opir_core.errors import ModelError
from opir_core.geometry import geodetic_to_ecef
from opir_core.live import LiveRun, LiveSettings, LiveWindow
from opir_core.output import ForgeEncoder, detection_schema
from opir_core.planning.link_compiler import network_of
from opir_core.plugin import Detections, EncoderContext, Host
from opir_core.reading import scene_hash, scene_mapping
from opir_core.simulation.engine import Engine
from opir_core.simulation.explanation import explained
from opir_core.simulation.report_order import ReportOrder
from opir_core.simulation.run import run_of_plan
from opir_core.simulation.undetected import undetected_text

WEST, EAST = 0, 1
LIGHT_M_S = 299_792_458.0
HAWAII = {"id": "HI", "lat_deg": 21.3, "lon_deg": -158.0, "mask_deg": 5.0}
COLORADO = {"id": "CO", "lat_deg": 39.7, "lon_deg": -104.8, "height_m": 1700.0, "delay_s": 0.25}
FAST = {"rate_bytes_s": 1e6}


def links(*downlinks: dict[str, Any], **more: Any) -> dict[str, Any]:
    listed = {"downlinks": list(downlinks)} if downlinks else {}
    return {"stations": [HAWAII, COLORADO], **listed, **more}


def scene(block: dict[str, Any] | None, **changes: Any) -> opir.Scene:
    written = {} if block is None else {"links": block}
    return opir.scene_from_mapping(two_sensor_scene(duration_s=90.0, **written, **changes))


def columns(run: opir.Run) -> list[bytes]:
    detections = run.detections
    names = ("time_ns", "reported_ns", "sensor", "detection_id", "path", "track")
    return [getattr(detections, name).tobytes() for name in names] + [
        run.tracks.available_s.tobytes(),
        run.tracks.state.tobytes(),
    ]


def delays_s(run: opir.Run, sensor: int) -> tuple[Any, Any]:
    """Return times of looks and delays of a sensor, s, in the order of looks."""
    rows = np.flatnonzero(run.detections.sensor == sensor)
    rows = rows[np.argsort(run.detections.time_ns[rows], kind="stable")]
    look_ns = run.detections.time_ns[rows]
    return look_ns * 1e-9, (run.detections.reported_ns[rows] - look_ns) * 1e-9


def slant_s(run: opir.Run, sensor: int, station: dict[str, Any]) -> float:
    """Return the light time, s, from a geostationary sensor to a station."""
    place = np.radians([station["lat_deg"], station["lon_deg"]])
    station_m = geodetic_to_ecef(place[0], place[1], station.get("height_m", 0.0))
    sensor_m = run.sensors[sensor].orbit.position_ecef_m(np.zeros(1))[0]
    return float(np.sqrt(np.square(sensor_m - station_m).sum()) / LIGHT_M_S)


def test_scenes_without_links_have_neither_paths_nor_delays() -> None:
    run = opir.simulate(scene(None))
    assert run.detections.path.shape == (len(run.detections), 0)
    assert not run.detections.is_delayed
    assert run.lost is None
    assert "lost_reports" not in run.summary["counts"]
    assert "links" not in scene_mapping(run.plan.scene)


def test_a_report_takes_its_service_its_light_and_the_station() -> None:
    run = opir.simulate(scene(links({"rate_bytes_s": 5000.0, "message_bytes": 200})))
    _, west_s = delays_s(run, WEST)
    _, east_s = delays_s(run, EAST)
    # Hawaii is the first station, which both see.
    np.testing.assert_allclose(west_s, 0.04 + slant_s(run, WEST, HAWAII), atol=2e-9)
    np.testing.assert_allclose(east_s, 0.04 + slant_s(run, EAST, HAWAII), atol=2e-9)
    by_colorado = opir.simulate(scene(links({**FAST, "paths": [["CO"]]})))
    _, late_s = delays_s(by_colorado, WEST)
    np.testing.assert_allclose(late_s, 0.0005 + 0.25 + slant_s(run, WEST, COLORADO), atol=2e-9)


def test_latencies_of_reporting_follow_the_arrival() -> None:
    settings = two_sensor_scene(duration_s=30.0, links=links(FAST))
    for sensor in settings["sensors"]:
        sensor["reporting"] = {"processing": {"mean_s": 3.0}}
    run = opir.simulate(opir.scene_from_mapping(settings))
    np.testing.assert_allclose(delays_s(run, WEST)[1], 3.0005 + slant_s(run, WEST, HAWAII))
    settings["sensors"][0]["reporting"] = {"downlink": {"mean_s": 3.0}}
    with pytest.raises(opir.SceneError, match=r"WEST has reporting\.downlink too"):
        compile_plan(opir.scene_from_mapping(settings))


def test_a_queue_serves_one_report_after_another() -> None:
    run = opir.simulate(scene(links({"rate_bytes_s": 800.0, "message_bytes": 1000})))
    look_s, delay_s = delays_s(run, WEST)
    free_s = 0.0
    for look, delay in zip(look_s, delay_s - slant_s(run, WEST, HAWAII), strict=True):
        free_s = max(free_s, look) + 1.25
        assert look + delay == pytest.approx(free_s, abs=1e-8)
    assert delay_s[-1] > 50.0


def test_in_an_outage_nothing_is_sent_and_the_next_path_is_taken() -> None:
    outage = {"node": "HI", "at_s": 20.0, "until_s": 40.0}
    direct = opir.simulate(scene(links({**FAST, "paths": [["HI"]]}, outages=[outage])))
    look_s, delay_s = delays_s(direct, WEST)
    sent_s = look_s + delay_s - slant_s(direct, WEST, HAWAII)
    assert not ((sent_s > 20.0 + 1e-6) & (sent_s < 40.0)).any()
    waited = (look_s > 20.0) & (look_s < 40.0)
    queue = np.arange(1, np.count_nonzero(waited) + 1)
    np.testing.assert_allclose(sent_s[waited], 40.0 + 0.0005 * queue, atol=1e-6)
    switched = opir.simulate(scene(links(FAST, outages=[outage])))
    names = switched.plan.link_paths
    for look, path in zip(
        *(switched.detections.time_s, switched.detections.path[:, 0]), strict=True
    ):
        assert names[path] == (("CO",) if 20.0 <= look < 39.9995 else ("HI",)) or (
            abs(look - 20.0) < 1e-3
        )


def test_relays_crosslinks_and_any_pass_reports_on() -> None:
    relays = [{"id": "R1", "lon_deg": -41.0, "delay_s": 0.5}]
    guam = {"id": "GUAM", "lat_deg": 13.5, "lon_deg": 144.8}
    by = links({**FAST, "paths": [["GUAM"], ["any", "CO"]]}, relays=relays)
    by["stations"].append(guam)
    run = opir.simulate(scene(by))
    ways = [run.plan.link_paths[path] for path in run.detections.path[:, 0]]
    of_sensor = {sensor: set() for sensor in (WEST, EAST)}
    for way, sensor in zip(ways, run.detections.sensor.tolist(), strict=True):
        of_sensor[sensor].add(way)
    # Guam is below the horizon of the eastern slot; the other sensor comes before the relay.
    assert of_sensor == {WEST: {("GUAM",)}, EAST: {("WEST", "CO")}}
    down = opir.simulate(scene({**by, "outages": [{"node": "WEST"}]}))
    assert {down.plan.link_paths[path] for path in down.detections.path[:, 0]} == {("R1", "CO")}
    assert not (down.detections.sensor == WEST).any()
    places_m = [
        down.sensors[EAST].orbit.position_ecef_m(np.zeros(1))[0],
        4.21641696e7 * np.array([np.cos(np.radians(41.0)), -np.sin(np.radians(41.0)), 0.0]),
        geodetic_to_ecef(np.radians(39.7), np.radians(-104.8), 1700.0),
    ]
    light_s = np.sqrt(np.square(np.diff(places_m, axis=0)).sum(axis=1)).sum() / LIGHT_M_S
    np.testing.assert_allclose(delays_s(down, EAST)[1], 0.0005 + 0.75 + light_s, atol=1e-6)


def test_lost_reports_are_missing_and_counted() -> None:
    lossless = opir.simulate(scene(links(FAST)))
    run = opir.simulate(scene(links({**FAST, "loss": 0.25})))
    assert run.lost is not None
    sent = len(lossless.detections)
    assert len(run.detections) + run.lost.sum() == sent
    assert run.lost.sum() == pytest.approx(0.25 * sent, abs=3.0 * np.sqrt(0.1875 * sent))
    ids = set(map(tuple, lossless.detections.detection_id.tolist()))
    assert ids.issuperset(map(tuple, run.detections.detection_id.tolist()))
    assert run.summary["counts"]["lost_reports"] == run.lost.sum()
    # The same reports are lost with a larger share.
    more = opir.simulate(scene(links({**FAST, "loss": 0.5})))
    arrived = set(map(tuple, run.detections.detection_id.tolist()))
    assert arrived.issuperset(map(tuple, more.detections.detection_id.tolist()))


def test_reports_that_are_too_old_are_lost() -> None:
    outage = {"node": "HI", "at_s": 20.0, "until_s": 40.0}
    downlink = {**FAST, "paths": [["HI"]], "keep_s": 5.0}
    look_s, delay_s = delays_s(opir.simulate(scene(links(downlink, outages=[outage]))), WEST)
    assert delay_s.max() <= 5.0
    assert not ((look_s > 20.0) & (look_s < 35.0)).any()
    assert ((look_s > 35.2) & (look_s < 40.0)).any()
    never = links(downlink, outages=[{"node": "HI", "at_s": 20.0}])
    assert opir.simulate(scene(never)).detections.time_s.max() < 20.0


QUEUED = links(
    {"rate_bytes_s": 600.0, "loss": 0.1, "paths": [["HI"]]},
    outages=[{"node": "HI", "mtbf_s": 20.0, "mttr_s": 4.0}],
)


@pytest.mark.parametrize("lag", [{}, {"tracking_lag_s": 60.0}, {"tracking_lag_s": 5.0}])
def test_windows_and_workers_change_no_byte(lag: dict[str, float]) -> None:
    order = "report" if lag else "observation"
    queued = scene(QUEUED, tracker="kepler-arc", tracking_order=order, **lag)
    reference = opir.simulate(queued)
    assert len(reference.tracks)
    assert reference.detections.reported_ns.max() > 100e9
    for settings in ({"window_s": 0.7}, {"window_s": 11.0}, {"workers": 2, "window_s": 9.0}):
        run = opir.simulate(queued, **settings)
        assert columns(run) == columns(reference), settings
        assert run.lost.tolist() == reference.lost.tolist()


class EndingOrbit:
    """A satellite whose ephemeris ends with the scene."""

    is_stationary = False

    def __init__(self, orbit: Any) -> None:
        self.orbit = orbit

    def position_ecef_m(self, time_s: Any) -> Any:
        if len(time_s) and max(time_s) > 90.0:
            raise ModelError("the ephemeris ends at 90 s")
        return self.orbit.position_ecef_m(time_s)


def test_an_ephemeris_may_end_with_the_scene() -> None:
    read = scene(links(FAST))
    plan = compile_plan(read)
    sensors = [evolve(sensor, orbit=EndingOrbit(sensor.orbit)) for sensor in plan.sensors]
    ending = network_of(read, read.links, sensors).transmitters[WEST]
    assert ending.edge_ns.tolist() == [0, 90 * 10**9, 3690 * 10**9]
    assert ending.path.tolist() == [0, -1]
    assert plan.links.transmitters[WEST].edge_ns.tolist() == [0, 3690 * 10**9]


def test_tracks_are_there_when_the_reports_are() -> None:
    run = opir.simulate(scene(QUEUED, tracker="kepler-arc"))
    detections = run.detections
    for tick_s, available_s in zip(run.tracks.tick_s, run.tracks.available_s, strict=True):
        earlier = detections.reported_ns[detections.time_ns < tick_s * 1e9]
        assert available_s == pytest.approx(max(tick_s, earlier.max() * 1e-9), abs=1e-6)


def test_a_live_run_has_the_events_of_the_batch_also_after_a_launch_is_added() -> None:
    queued = scene(QUEUED, outputs=["memory"])
    live_windows: list[LiveWindow] = []
    run = LiveRun(queued, Host.discover(), LiveSettings(speed=None), live_windows.append)
    run.start()
    until(lambda: run.status().state in ("ended", "failed"))
    run.stop()
    live = Detections.concatenate(live.window.detections for live in live_windows)
    batch = opir.simulate(queued).detections
    assert live.reported_ns.tolist() == batch.reported_ns.tolist()
    assert live.path.tolist() == batch.path.tolist()
    with pytest.raises(opir.OpirError, match="links: needs a restart"):
        LiveRun(queued, Host.discover(), LiveSettings()).configure(
            {**scene_mapping(queued), "links": links()}
        )


def test_a_changed_plan_goes_on_with_the_queues() -> None:
    plan = compile_plan(scene(QUEUED))
    windows = [window.detections for window in plan_windows(plan, 30.0)]
    engine = Engine(plan)
    start = engine.advance(30_000_000_000)
    changed = Engine(compile_plan(scene(QUEUED)))
    changed.take_over(engine)
    end = changed.advance(90_000_000_000)
    changes = Detections.concatenate([start.detections, end.detections])
    order = np.argsort(changes.reported_ns, kind="stable")
    batch = Detections.concatenate(windows)
    assert changes.reported_ns[order].tolist() == batch.reported_ns.tolist()


def test_events_and_files_have_the_path(tmp_path: Path) -> None:
    run = opir.simulate(scene(links({"sensors": ["EAST"], "paths": [["CO"]]})))
    loaded = opir.load_run(run.save(tmp_path / "events.jsonl"))
    events = json_lines(tmp_path / "events.jsonl")
    jsonschema.Draft202012Validator(detection_schema()).validate(events[0])
    assert {(event["sensor_id"], tuple(event["path"] or ())) for event in events} == {
        ("EAST", ("CO",)),
        ("WEST", ()),
    }
    assert loaded.detections.path.tolist() == run.detections.path.tolist()
    keys = list(events[0])
    assert keys.index("path") == keys.index("reported_at") + 1
    context = EncoderContext(
        sensors=tuple(run.sensors), epoch_us=run.plan.scene.epoch_us, paths=run.plan.link_paths
    )
    windows = plan_windows(run.plan)
    text = b"".join(ForgeEncoder(context).encode(window) for window in windows)
    assert text == (tmp_path / "events.jsonl").read_bytes()


def test_columns_and_tables_have_the_path(tmp_path: Path) -> None:
    block = links({"sensors": ["EAST"], "paths": [["CO"]]})
    run = opir.simulate(scene(block))
    events = run.save(tmp_path / "events.parquet")
    table = pq.read_table(events).select(["sensor_id", "path"])
    assert {tuple(row.values()) for row in table.to_pylist()} == {("EAST", "CO"), ("WEST", None)}
    loaded = opir.load_run(events)
    assert loaded.detections.path.tolist() == run.detections.path.tolist()
    without = opir.simulate(scene(None)).save(tmp_path / "without.parquet")
    assert "path" not in pq.read_schema(without).names


def test_a_director_gets_reports_when_they_arrive() -> None:
    directed = {
        "sensors": [
            *two_sensor_scene()["sensors"],
            {"model": "generic-pointed", "id": "SPOT", "orbital_slot_deg": -120.0},
        ],
        "tracker": "kepler-arc",
        "director": {"model": "cue", "least_probability_launch": 0.0},
    }
    late = {**COLORADO, "delay_s": 12.0}
    block = {"stations": [late], "downlinks": [FAST]}

    def first_command_s(run: opir.Run) -> float:
        return min(record.time_s for record in run.commands if record.track >= 0)

    at_once = opir.simulate(opir.scene_from_mapping(two_sensor_scene(**directed)))
    run = opir.simulate(opir.scene_from_mapping(two_sensor_scene(**directed, links=block)))
    assert 12.0 <= first_command_s(run) - first_command_s(at_once) <= 14.0
    sliced = opir.simulate(run.plan.scene, window_s=3.3)
    assert sliced.commands == run.commands
    assert columns(sliced) == columns(run)


def test_explain_tells_paths_and_delays() -> None:
    plan = compile_plan(scene(links(outages=[{"node": "HI", "at_s": 30.0, "until_s": 60.0}])))
    rows = [row for row in explained(plan)["links"] if row["sensor_id"] == "WEST"]
    shares = {tuple(row["path"] or ()): row["share"] for row in rows}
    assert shares == {("HI",): pytest.approx(2 / 3), ("CO",): pytest.approx(1 / 3)}
    assert [row["longest_s"] for row in rows] == [pytest.approx(30.0), pytest.approx(30.0)]
    assert rows[0]["delay_s"] == pytest.approx(0.05 + 0.12, abs=0.02)
    assert explained(compile_plan(scene(None)))["links"] == []


def test_an_overloaded_link_is_warned_of() -> None:
    slow = explained(compile_plan(scene(links({"rate_bytes_s": 800.0, "message_bytes": 1000}))))
    words = [line for line in slow["warnings"] if line.startswith("links: WEST: ")]
    assert len(words) == 1
    assert "its link is open for 90 s; reports queue" in words[0]
    fast = explained(compile_plan(scene(links(FAST))))
    assert not any(line.startswith("links") for line in fast["warnings"])


def test_a_scene_is_written_and_read_read() -> None:
    written = scene(QUEUED)
    read = opir.scene_from_mapping(scene_mapping(written))
    assert read == written
    assert scene_hash(read) != scene_hash(scene(links()))


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (links({"sensors": ["WETS"]}), r"links\.downlinks\[0\]\.sensors\[0\].*did you mean WEST"),
        (links({"paths": [["EAST"]]}), "the path ['EAST'] does not end at a station"),
        (links({"paths": [["R9", "CO"]]}), r"links\.downlinks\[0\]\.paths\[0\]\[0\].*no 'R9'"),
        (links(outages=[{"node": "EASTERN"}]), r"links\.outages\[0\]\.node.*did you mean EAST"),
        (links(outages=[{"node": "CO", "at_s": 9, "until_s": 3}]), "is not after 9 s"),
        (links(outages=[{"node": "CO", "mtbf_s": 9}]), "mtbf_s and mttr_s belong together"),
        (links({}, {}), "two downlinks name no sensors"),
        (links(relays=[{"id": "CO", "lon_deg": 0}]), "'CO' names two nodes"),
        (links(relays=[{"id": "WEST", "lon_deg": 0}]), "'WEST' names two nodes"),
        ({"stations": []}, "links need a station"),
        (links({"rate_bytes_s": 0}), "rate_bytes_s"),
    ],
)
def test_bad_links_are_refused_with_their_place(block: dict[str, Any], words: str) -> None:
    pattern = words.replace("['EAST']", r"\['EAST'\]")
    with pytest.raises(opir.SceneError, match=pattern):
        scene(block)


def test_outages_at_random_follow_the_seed() -> None:
    def closed(seed: int) -> list[int]:
        plan = compile_plan(scene(QUEUED, seed=seed))
        return plan.links.transmitters[WEST].edge_ns.tolist()

    assert closed(1) == closed(1) != closed(2)
    plan = compile_plan(scene(QUEUED, seed=1))
    reseeded = opir.reseeded(plan, 2)
    assert reseeded.links.transmitters[WEST].edge_ns.tolist() == closed(2)


def test_a_plan_for_another_seed_has_other_silences() -> None:
    downlink = {**FAST, "paths": [["HI"]], "keep_s": 1.0}
    plan = compile_plan(scene(links(downlink, outages=QUEUED["outages"]), seed=1))
    reseeded = opir.reseeded(plan, 2)
    anew = compile_plan(reseeded.scene)
    assert plan.sensors[WEST].partial_s != reseeded.sensors[WEST].partial_s
    assert reseeded.sensors[WEST].partial_s == anew.sensors[WEST].partial_s != ()


@pytest.mark.parametrize(
    ("downlink", "outage", "spans"),
    [
        ({}, {"at_s": 20.0}, [[0.0, 20.0]]),
        ({}, {"at_s": 20.0, "until_s": 60.0}, [[0.0, 90.0]]),
        ({"keep_s": 15.0}, {"at_s": 20.0, "until_s": 60.0}, [[0.0, 20.0], [45.0, 90.0]]),
        ({"loss": 1.0}, {"at_s": 80.0}, []),
    ],
)
def test_silence_of_a_dead_link_says_nothing(
    downlink: dict[str, Any], outage: dict[str, Any], spans: list[list[float]]
) -> None:
    block = links({**FAST, **downlink}, outages=[{"node": "WEST", **outage}])
    run = opir.simulate(scene(block))
    stated = run.manifest["watched_s"]["WEST"]
    # To the time that the transmitter takes for a report, 0.5 ms.
    np.testing.assert_allclose(np.ravel(stated), np.ravel(spans), atol=1e-3)
    (west, _) = run.plan.tracker_sensors()
    assert [list(span) for span in west.spans_until_s(90.0)] == stated
    # The looks whose reports arrive are in these spans, to a light time, and fill them.
    look_s, _ = delays_s(run, WEST)
    is_inside = [any(from_s <= time_s < to_s for from_s, to_s in spans) for time_s in look_s]
    assert np.mean(is_inside or [True]) > 0.98
    for from_s, to_s in spans:
        burning_s = np.clip([from_s, to_s], run.plan.targets.ignition_s[0], None)
        inside_s = look_s[(look_s >= from_s) & (look_s < to_s)]
        np.testing.assert_allclose([inside_s.min(), inside_s.max()], burning_s, atol=3.0)


BOTH_DOWN = [{"node": node, "at_s": 30.0, "until_s": 50.0} for node in ("WEST", "EAST")]


@pytest.mark.parametrize("rate_bytes_s", [1e6, 1500.0])
def test_late_reports_are_no_silence_in_the_order_of_report(rate_bytes_s: float) -> None:
    """The burn lasts longer than the scene; at 1 500 bytes a second the queue lasts 20 s."""
    block = links({"rate_bytes_s": rate_bytes_s}, outages=BOTH_DOWN)
    run = opir.simulate(scene(block, tracker="imm", tracking_order="report"))
    rows = run.detections.time_ns < 50e9
    assert run.detections.reported_ns[rows].max() > 50e9
    tracks = run.tracks
    assert set(tracks.track.tolist()) == {0}
    silent = (tracks.tick_s >= 31.0) & (tracks.tick_s <= 50.0)
    assert silent.sum() == 20
    assert tracks.probability_burning[silent].min() > 0.75
    assert tracks.probability_burning.min() > 0.5
    assert (tracks.probability_burning[tracks.tick_s >= 85.0] > 0.99).all()


def test_a_queue_tells_nothing_before_its_reports_come() -> None:
    """Two runs whose reports are the same up to a time have the same tracks up to then, to the last
    second, in which the queue of one of them is empty.
    """
    block = links({"rate_bytes_s": 1500.0}, outages=BOTH_DOWN)
    plan = compile_plan(scene(block, tracker="imm", tracking_order="report"))
    looks = Engine(plan).advance(plan.end_ns)
    is_early = looks.detections.time_ns < 52e9
    differs_s = looks.detections.reported_ns[~is_early].min() * 1e-9
    assert differs_s > 58.0

    def burning(rows: Any) -> list[tuple[float, float]]:
        reports = ReportOrder(plan)
        some = looks.detections.take(rows), looks.truth.take(rows)
        window = evolve(looks, detections=some[0], truth=some[1])
        tracks = reports.take(window, plan.end_ns).tracks
        known = tracks.available_s < differs_s - 1.0
        return list(zip(tracks.tick_s[known], tracks.probability_burning[known], strict=True))

    everything = burning(np.arange(len(is_early)))
    assert everything == burning(np.flatnonzero(is_early))
    assert everything[-1][1] > 0.5


@pytest.mark.parametrize(("lag_s", "until_s"), [(None, 50.0), (12.0, 38.0), (25.0, None)])
def test_a_tracker_in_the_order_of_report_knows_when_no_contact_is_in_time(
    lag_s: float | None, until_s: float | None
) -> None:
    """Nothing shines, so that no report is on its way."""
    lag = {} if lag_s is None else {"tracking_lag_s": lag_s}
    block = links(FAST, outages=BOTH_DOWN)
    plan = compile_plan(scene(block, targets=[], tracker="imm", tracking_order="report", **lag))
    told = []

    class Listening(CountingTracker):
        def set_sensors(self, sensors: Any) -> None:
            told.append(sensors)

    run_of_plan(evolve(plan, make_tracker=Listening))
    ((west, east),) = told
    for sensor in (west, east):
        wanted = [0.0, 90.0] if until_s is None else [0.0, 30.0, until_s, 90.0]
        np.testing.assert_allclose(np.ravel(sensor.spans_until_s(90.0)), wanted, atol=0.6)


def test_what_no_report_tells_of_is_said_to_be_lost() -> None:
    dead = links(FAST, outages=[{"node": name} for name in ("WEST", "EAST")])
    assert (
        undetected_text(compile_plan(scene(dead)), 0) == "the reports of EAST, WEST do not arrive"
    )
    one = links(FAST, outages=[{"node": "WEST"}])
    assert "P_d at most" in undetected_text(compile_plan(scene(one)), 0)
