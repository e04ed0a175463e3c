"""What an event costs: detections to lines of JSON, and on into a file.

The events are those of a raid (`raid.py`) or of its tracked form. `forge` is opir's encoder, from
columns in memory, with the compiled and the reference renderer; `msgspec` encodes objects that are
in memory already, one struct or one dictionary an event, which is left out of its time. All make
the same lines, which is checked first. Times are those of encoding alone; ratios are to msgspec's
structs.
"""

import tempfile
from collections.abc import Callable

import msgspec
from attrs import evolve
from figures import keep
from pages import options_of, turns_s
from raid import raid_scene

import opir_core as opir
from opir_core.builtin.sinks import LineFile
from opir_core.interfaces.contexts import EncoderContext
from opir_core.output.events.encoder_input import window_blocks
from opir_core.output.events.forge import ForgeEncoder
from opir_core.output.events.rendering import chosen_renderer
from opir_core.plugin import Host
from opir_core.reading import scene_mapping
from opir_core.simulation.run import plan_windows

Way = Callable[[], object]


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


def encoded(encoder, windows):
    """Return the lines of windows, block by block."""
    return [encoder.encode(block) for window in windows for block in window_blocks(window)]


def filed(encoder, windows):
    """Write the lines of windows into a file."""
    with tempfile.TemporaryDirectory() as folder:
        sink = LineFile(f"{folder}/events.jsonl", encoder)
        for window in windows:
            sink.write(window)
        sink.close()


def msgspec_ways(lines):
    """Return the ways of msgspec to make lines; raise `SystemExit` if they make other lines."""
    encode = msgspec.json.Encoder().encode_lines
    structs = [msgspec.json.decode(line, type=RaidEvent) for line in lines.splitlines()]
    mappings = [msgspec.json.decode(line) for line in lines.splitlines()]
    if encode(structs) != lines or encode(mappings) != lines:
        raise SystemExit("msgspec makes other lines than the encoder")
    return {
        "msgspec, structs in memory": lambda: encode(structs),
        "msgspec, dictionaries in memory": lambda: encode(mappings),
    }


def ways_of(launches, tracker):
    """Return the ways to encode the events of a raid, and the number of events."""
    scene = raid_scene(launches, 12, 300.0, [])
    plan = opir.compile_plan(scene)
    windows = list(plan_windows(plan))
    tracked = list(plan_windows(opir.compile_plan(with_tracker(scene, tracker))))
    context = EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us)
    reference = ForgeEncoder(context)
    compiled = ForgeEncoder(evolve(context, render=chosen_renderer(Host.discover())[1]))
    lines = b"".join(encoded(compiled, windows))
    ways = msgspec_ways(lines) | {
        "compiled renderer": lambda: encoded(compiled, windows),
        "reference renderer": lambda: encoded(reference, windows),
        "compiled renderer, tracked": lambda: encoded(compiled, tracked),
        "compiled renderer, to file": lambda: filed(compiled, windows),
    }
    return ways, lines.count(b"\n")


def with_tracker(scene, tracker):
    """Return a scene with a tracker."""
    return opir.scene_from_mapping({**scene_mapping(scene), "tracker": tracker})


def main():
    """Measure and print."""
    options = options_of(__doc__, raid=10, repeats=7, tracker="kepler-arc")
    ways, events = ways_of(options.raid, options.tracker)
    times = turns_s(ways, options.repeats)
    for name, taken_s in times.items():
        ratio = taken_s / times["msgspec, structs in memory"]
        print(f"{name:32} {1e9 * taken_s / events:8.0f} ns/event {ratio:8.2f}")
        keep(f"raid: {name}", 1e9 * taken_s / events, "ns/event")


if __name__ == "__main__":
    main()
