"""What an event costs: detections to lines of JSON, and on into a file, by the ways that were
tried.

    python benchmarks/encoding.py [--events 200000] [--repeats 7]
    python benchmarks/encoding.py --raid 100 [--repeats 7]

Prints the median processor time, in ns an event, and its ratio to the first, of

- `forge`: the encoder, block by block, for events without tracks, with tracks, and from moving
  sensors with tracks;
- `forge, three bands` and `forge-bands`: events of sensors with three bands without and with what
  these measured;
- `forge-tracks, tracked`: events with the states and covariances of their tracks, a hundred events
  a track and tick;
- `forge to file`: the same through the `jsonl` sink, the writing included;
- `msgspec structs`: one struct an event, constant parts as ready-made JSON (`msgspec.Raw`),
  `encode_lines`;
- `dictionaries`: one dictionary an event, the standard library's `json`, `isoformat` and `uuid`.

All ways make the same lines of the same detections, which is checked first.

With `--raid` the events are those of `benchmarks/raid.py` with so many launches, and the ways are
opir's renderers, from columns in memory, and msgspec from what is in memory already: one struct, or
one dictionary, an event. Times are those of encoding alone; the ratio is to msgspec's structs.
"""

import argparse
import json
import statistics
import tempfile
import time
import uuid
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

import msgspec
import numpy as np
from attrs import evolve
from figures import keep
from opir_testing import stub_sensor
from raid import raid

import opir_core
from opir_core.builtin.sinks import LineFile
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
from opir_core.interfaces.viewpoints import AzimuthElevation
from opir_core.output.events.encoder_input import window_blocks
from opir_core.output.events.forge import ForgeEncoder
from opir_core.output.events.rendering import chosen_renderer
from opir_core.output.events.text import (
    rounded,
    rounded_bearing_deg,
    rounded_degrees,
    timestamp_text,
    unix_microseconds,
)
from opir_core.plugin import Band, Host, Sensor
from opir_core.random_streams.detection_ids import id_key, uuid8_words, uuid_text
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.simulation.run import plan_windows

EPOCH_US = 1_775_044_800_000_000
SENSORS = 10
TARGETS = 100


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--events", type=int, default=200_000)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--raid", type=int, metavar="LAUNCHES", help="encode the events of a raid")
    options = parser.parse_args()
    if options.raid:
        raid_lines(options.raid, options.repeats)
        return
    sensors = tuple(
        stub_sensor(f"SBIRS-GEO-{n}", -170.5 + 35 * n, type="SBIRS-GEO") for n in range(SENSORS)
    )
    context = EncoderContext(
        sensors=sensors, epoch_us=EPOCH_US, render=chosen_renderer(Host.discover())[1]
    )
    encoder = ForgeEncoder(context)
    with_tracks = ForgeEncoder(context, has_tracks=True)
    plain = sample_window(options.events, is_tracked=False, is_moving=False)
    tracked = sample_window(options.events, is_tracked=True, is_moving=False)
    moving = sample_window(options.events, is_tracked=True, is_moving=True)
    check_ways_agree(encoder, plain, sensors)
    lit, without, with_bands = three_bands(plain)
    ways: dict[str, Callable[[], object]] = {
        "forge": lambda: encoded(encoder, plain),
        "forge, tracked": lambda: encoded(encoder, tracked),
        "forge, tracked, moving sensors": lambda: encoded(encoder, moving),
        "forge, three bands": lambda: encoded(without, lit),
        "forge-bands, three bands": lambda: encoded(with_bands, lit),
        "forge-tracks, tracked": lambda: encoded(with_tracks, tracked),
        "forge to file": lambda: filed(encoder, plain),
        "forge to file, tracked": lambda: filed(encoder, tracked),
        "msgspec structs": lambda: [struct_lines(block, sensors) for block in window_blocks(plain)],
        "dictionaries": lambda: [
            dictionary_lines(block, sensors) for block in window_blocks(plain)
        ],
    }
    took = median_ns(ways, options.repeats)
    for name, median in took.items():
        print(f"{name:32} {median / options.events:8.0f} ns/event {median / took['forge']:8.2f}")
        keep(name, median / options.events, "ns/event")


def raid_lines(launches: int, repeats: int) -> None:
    """Print what the events of a raid cost as lines, by both renderers and by msgspec from objects
    in memory.
    """
    plan = opir_core.compile_plan(raid(launches, 12, 300.0, []))
    windows = list(plan_windows(plan))
    context = EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us)
    reference = ForgeEncoder(context)
    compiled = ForgeEncoder(evolve(context, render=chosen_renderer(Host.discover())[1]))
    lines = [compiled.encode(block) for window in windows for block in window_blocks(window)]
    structs = [
        msgspec.json.decode(line, type=RaidEvent) for block in lines for line in block.splitlines()
    ]
    mappings = [msgspec.json.decode(line) for block in lines for line in block.splitlines()]
    whole = b"".join(lines)
    encode = msgspec.json.Encoder().encode_lines
    if encode(structs) != whole or encode(mappings) != whole:
        raise SystemExit("msgspec makes other lines than the encoder")
    ways: dict[str, Callable[[], object]] = {
        "msgspec, structs in memory": lambda: encode(structs),
        "msgspec, dictionaries in memory": lambda: encode(mappings),
        "compiled renderer": lambda: [encoded(compiled, window) for window in windows],
        "reference renderer": lambda: [encoded(reference, window) for window in windows],
    }
    took = median_ns(ways, repeats)
    for name, median in took.items():
        ratio = median / took["msgspec, structs in memory"]
        print(f"{name:32} {median / len(structs):8.0f} ns/event {ratio:8.2f}")
        keep(f"raid: {name}", median / len(structs), "ns/event")


def three_bands(window: Window) -> tuple[Window, ForgeEncoder, ForgeEncoder]:
    """Return a window as sensors with three bands measure it, and the encoders `forge` and
    `forge-bands` for them.
    """
    bands = Band("SWIR", 2.5, 3.0), Band("MWIR", 4.2, 4.45), Band("LWIR", 8.0, 12.0)
    slots = -170.5 + 35.0 * np.arange(SENSORS)
    sensors = tuple(
        stub_sensor(f"NEXTGEN-{n}", slot, bands=bands) for n, slot in enumerate(slots.tolist())
    )
    measured = 10.0 ** np.random.default_rng(2).uniform(-13.0, -10.0, (len(window.detections), 3))
    lit = evolve(window, detections=evolve(window.detections, band_irradiance_w_m2=measured))
    context = EncoderContext(
        sensors=sensors, epoch_us=EPOCH_US, render=chosen_renderer(Host.discover())[1]
    )
    return lit, ForgeEncoder(context), ForgeEncoder(context, has_irradiances=True)


def sample_window(count: int, *, is_tracked: bool, is_moving: bool) -> Window:
    """Return a window as a raid makes it: every sensor sees every target, 20 times a second."""
    random = np.random.default_rng(1)
    look = np.arange(count)
    scan = look // (SENSORS * TARGETS)
    sensor = (look // TARGETS % SENSORS).astype(np.int32)
    stream = look % (SENSORS * TARGETS)
    keys = np.array([id_key("benchmark", n) for n in range(SENSORS * TARGETS)], dtype=np.uint64)
    home = 4.2e7 * random.random((SENSORS, 3))[sensor]
    downward = 4e6 * random.normal(size=(count, 3)) - home
    estimate = scan // 20 * TARGETS + stream % TARGETS if is_tracked else np.full(count, -1)
    detections = Detections(
        time_ns=scan * 50_000_000,
        sensor=sensor,
        scan=scan,
        detection_id=uuid8_words(keys[stream], scan),
        reported_type=(stream % 4).astype(np.uint8),
        bands=np.ones(count, dtype=np.uint8),
        detection_count=(scan + 1).astype(np.int32),
        confidence=random.random(count),
        line_of_sight_ecef=downward / np.linalg.norm(downward, axis=1, keepdims=True),
        sensor_ecef_m=home + (7000.0 * scan * 0.05)[:, np.newaxis] if is_moving else home,
        snr=30.0 * random.random(count),
        track=stream % TARGETS if is_tracked else np.full(count, -1),
        estimate=estimate,
        line_of_sight_sigma_rad=np.full(count, 2e-5),
        band_irradiance_w_m2=np.empty((count, 0)),
    )
    nothing = np.zeros(count)
    truth = DetectionTruth(nothing.astype(np.int32), nothing, nothing, nothing, nothing)
    estimates = sample_estimates(random, int(estimate.max()) + 1)
    return Window(0.0, 300.0, count, detections, truth, Tracks.empty(), estimates)


def sample_estimates(random: np.random.Generator, count: int) -> Tracks:
    place = np.column_stack(
        [random.random(count), random.random(count), 100.0 * random.random(count)]
    )
    spread = np.broadcast_to(
        np.diag([2e6, 1e6, 4.0]) + 5e5 * np.eye(3)[[1, 0, 2]] * [[1.0], [1.0], [0.0]], (count, 3, 3)
    )
    return Tracks(
        tick_s=np.arange(count) // TARGETS * 1.0,
        track=np.arange(count) % TARGETS,
        state=np.column_stack(
            [6.5e6 * np.ones(count), 1e6 * random.random((count, 2)), random.random((count, 3))]
        ),
        state_covariance=np.zeros((count, 6, 6)),
        launch=place,
        launch_covariance=spread,
        impact=place,
        impact_covariance=spread,
        burnout=np.full((count, 7), np.nan),
        burnout_covariance=np.full((count, 7, 7), np.nan),
        type_probability=np.full((count, 4), 0.25),
    )


def encoded(encoder: ForgeEncoder, window: Window) -> list[int]:
    return [len(encoder.encode(block)) for block in window_blocks(window)]


def filed(encoder: ForgeEncoder, window: Window) -> None:
    with tempfile.TemporaryDirectory() as folder:
        sink = LineFile(f"{folder}/events.jsonl", encoder)
        sink.write(window)
        sink.close()


class Event(msgspec.Struct, gc=False):
    detection_id: str
    timestamp: str
    reported_at: str
    sensor_id: str
    sensor_type: str
    orbital_slot: msgspec.Raw
    target_type: str
    launch_point: None
    impact_point: None
    confidence: float
    schema_version: str
    track_id: None
    azimuth_deg: float
    elevation_deg: float
    line_of_sight_sigma_urad: msgspec.Raw
    bands: msgspec.Raw
    snr: float
    sensor_position_ecef_m: msgspec.Raw
    latitude_deg: None
    longitude_deg: None
    altitude_m: None


class RaidEvent(msgspec.Struct, gc=False):
    """An event as a program holds it that encodes with msgspec, all values plain."""

    detection_id: str
    timestamp: str
    sensor_id: str
    sensor_type: str
    orbital_slot: float | None
    target_type: str
    launch_point: None
    impact_point: None
    confidence: float
    schema_version: str
    reported_at: str
    track_id: None
    azimuth_deg: float
    elevation_deg: float
    line_of_sight_sigma_urad: float
    bands: list[str]
    snr: float | None
    sensor_position_ecef_m: list[float]
    latitude_deg: None
    longitude_deg: None
    altitude_m: None


def struct_lines(window: Window, sensors: tuple[Sensor, ...]) -> bytes:
    """Return the lines of events without tracks from sensors that stay where they are."""
    d = window.detections
    encode = msgspec.json.Encoder()
    raw = [msgspec.Raw(encode.encode(value)) for value in ("MWIR", ["MWIR"])]
    slots = [msgspec.Raw(encode.encode(sensor.orbital_slot_deg)) for sensor in sensors]
    sigma = msgspec.Raw(encode.encode(sensors[0].line_of_sight_sigma_rad * 1e6))
    _, first = np.unique(d.sensor, return_index=True)
    homes = [
        msgspec.Raw(encode.encode(home)) for home in rounded(d.sensor_ecef_m[first], 3).tolist()
    ]
    sensor = d.sensor.tolist()
    count = len(d)
    angles = d.angles()
    when = timestamp_text(unix_microseconds(d.time_ns, EPOCH_US))
    columns = (
        uuid_text(d.detection_id),
        when,
        when,
        [sensors[s].id for s in sensor],
        [sensors[s].type for s in sensor],
        [slots[s] for s in sensor],
        [REPORTED_TYPES[code] for code in d.reported_type.tolist()],
        [None] * count,
        [None] * count,
        rounded(d.confidence, 6).tolist(),
        ["1.0"] * count,
        [None] * count,
        rounded_bearing_deg(angles.azimuth_rad).tolist(),
        rounded_degrees(angles.elevation_rad).tolist(),
        [sigma] * count,
        [raw[1]] * count,
        rounded(d.snr, 6).tolist(),
        [homes[s] for s in sensor],
        [None] * count,
        [None] * count,
        [None] * count,
    )
    return encode.encode_lines(list(map(Event, *columns)))


def dictionary_lines(window: Window, sensors: tuple[Sensor, ...]) -> bytes:
    """Return the lines of events without tracks, one dictionary at a time."""
    d = window.detections
    angles = window.detections.angles()
    events = (dictionary(d, angles, row, sensors) for row in range(len(d)))
    return b"".join(json.dumps(event, separators=(",", ":")).encode() + b"\n" for event in events)


def dictionary(
    d: Detections, angles: AzimuthElevation, row: int, sensors: tuple[Sensor, ...]
) -> dict[str, object]:
    sensor = sensors[d.sensor[row]]
    high, low = d.detection_id[row].tolist()
    when = datetime.fromtimestamp(EPOCH_US // 1_000_000, UTC) + timedelta(
        microseconds=int(d.time_ns[row]) // 1000
    )
    text = when.isoformat(timespec="microseconds").replace("+00:00", "Z")
    return {
        "detection_id": str(uuid.UUID(int=high << 64 | low)),
        "timestamp": text,
        "reported_at": text,
        "sensor_id": sensor.id,
        "sensor_type": sensor.type,
        "orbital_slot": sensor.orbital_slot_deg,
        "target_type": REPORTED_TYPES[d.reported_type[row]],
        "launch_point": None,
        "impact_point": None,
        "confidence": round(float(d.confidence[row]), 6),
        "schema_version": "1.0",
        "track_id": None,
        "azimuth_deg": round(float(np.degrees(angles.azimuth_rad[row])), 9),
        "elevation_deg": round(float(np.degrees(angles.elevation_rad[row])), 9),
        "line_of_sight_sigma_urad": sensor.line_of_sight_sigma_rad * 1e6,
        "bands": [band.name for band in sensor.bands],
        "snr": round(float(d.snr[row]), 6),
        "sensor_position_ecef_m": [round(x, 3) for x in d.sensor_ecef_m[row].tolist()],
        "latitude_deg": None,
        "longitude_deg": None,
        "altitude_m": None,
    }


def check_ways_agree(encoder: ForgeEncoder, window: Window, sensors: tuple[Sensor, ...]) -> None:
    block = next(window_blocks(window, 2000))
    lines = [json.loads(line) for line in encoder.encode(block).splitlines()]
    for other in (struct_lines, dictionary_lines):
        if [json.loads(line) for line in other(block, sensors).splitlines()] != lines:
            raise SystemExit(f"{other.__name__} makes other lines than the encoder")


def median_ns(ways: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Return the median time of each way, tried in turns, so that a slow spell of the machine falls
    on all.
    """
    took: dict[str, list[int]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            start = time.process_time_ns()
            way()
            took[name].append(time.process_time_ns() - start)
    return {name: statistics.median(times) for name, times in took.items()}


if __name__ == "__main__":
    main()
