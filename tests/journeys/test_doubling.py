"""Twice as long a file or scene takes at most 2.2 times the work and the memory: calls are counted,
and allocated bytes, at one size and at twice the size.

A count of calls does not see what one call of NumPy does; its arrays count as memory.
"""

import json
import sys
import tracemalloc
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from opir_testing import stub_estimates, stub_regions, stub_sensor, stub_window

import opir_core as opir
from opir_core.cli.main import main
from opir_core.output import ForgeEncoder, TracksFile, read_tracks
from opir_core.output.geojson import region_text
from opir_core.output.spool import SentBatches
from opir_core.plugin import Batch, EncoderContext

pytestmark = pytest.mark.slow

MOST = 2.2
LAUNCH = {"lat_deg": 10.0, "lon_deg": 20.0, "time_s": 2.0}
AIM = {"lat_deg": -20.0, "lon_deg": 80.0}


def states(count: int) -> Iterator[tuple[float, float, float, float]]:
    """Yield times, s, and ECEF positions, m, of a slow path above the Earth."""
    for number in range(count):
        yield 0.1 * number, 6.4e6 + 10.0 * number, 20.0 * number, 5.0 * number


def table(count: int, extra: int = 0) -> str:
    heads = ["time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m", *(f"c{name}" for name in range(extra))]
    rows = [[*map(repr, state), *["1.5"] * extra] for state in states(count)]
    return "\n".join([",".join(heads), *map(",".join, rows), ""])


def records(count: int, *, distinct: bool = False) -> list[dict[str, Any]]:
    keys = ("time_s", "x_ecef_m", "y_ecef_m", "z_ecef_m")
    return [
        {f"note_{place if distinct else 0}": 1.0, **dict(zip(keys, state, strict=True))}
        for place, state in enumerate(states(count))
    ]


def gpx(count: int) -> str:
    points = "".join(
        f'<trkpt lat="{0.001 * place}" lon="10"><ele>9000</ele>'
        f"<time>2026-04-01T{place // 3600:02d}:{place // 60 % 60:02d}:{place % 60:02d}Z</time></trkpt>"
        for place in range(count)
    )
    head = '<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
    return f"{head}{points}</trkseg></trk></gpx>"


def written(name: str, text: Callable[[int], str]) -> Callable[[Path, int], Callable[[], object]]:
    """Return what prepares the reading of a file of a size by `opir import`."""

    def prepared(folder: Path, count: int) -> Callable[[], object]:
        path = folder / f"{count}-{name}"
        path.write_text(text(count), encoding="utf-8")
        return lambda: main(["import", str(path)])

    return prepared


def scene(**changes: Any) -> dict[str, Any]:
    target = {"id": "T0", "type": "ICBM", "launch": LAUNCH, "aim": AIM}
    return {
        "scene": "doubled",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "seed": 3,
        "sensors": [{"model": "SBIRS-GEO", "id": "S0", "orbital_slot_deg": 30.0}],
        "targets": [target],
        "detection": "constant",
        "classification": "paper",
        "confidence": "weighted",
        "tracker": "none",
        **changes,
    }


def simulated(changes: Callable[[int], Mapping[str, Any]]) -> Callable[[Path, int], Any]:
    """Return what prepares a run of a scene of a size, by its description."""

    def prepared(_folder: Path, count: int) -> Callable[[], object]:
        described = scene(**changes(count))
        return lambda: opir.simulate(opir.scene_from_mapping(described))

    return prepared


def targets(count: int) -> list[dict[str, Any]]:
    return [
        {
            "id": f"T{number}",
            "type": "SRBM",
            "launch": {**LAUNCH, "lon_deg": 20.0 + 0.01 * number},
            "aim": {"lat_deg": 12.0, "lon_deg": 22.0 + 0.01 * number},
        }
        for number in range(count)
    ]


def sensors(count: int) -> list[dict[str, Any]]:
    return [
        {"model": "DSP", "id": f"S{number}", "orbital_slot_deg": 20.0 + 0.02 * number}
        for number in range(count)
    ]


def encoded(_folder: Path, count: int) -> Callable[[], object]:
    encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))
    window = stub_window(count, snr=np.linspace(1.0, 2.0, count))
    return lambda: encoder.encode(window)


def tracks_file(*, of_one_track: bool) -> Callable[[Path, int], Callable[[], object]]:
    def prepared(folder: Path, count: int) -> Callable[[], object]:
        path = folder / f"{count}-{of_one_track}.tracks.jsonl"
        numbers = np.zeros(count) if of_one_track else np.arange(count) % 50
        tracks = stub_estimates(
            count,
            track=numbers.astype(np.int64),
            tick_s=np.arange(count) * 1.0,
            impact_regions=[stub_regions(9.0, 167.7, 100.0)] * count,
        )
        with TracksFile(path) as file:
            file.write(tracks)
        return lambda: read_tracks(path)

    return prepared


def written_tracks(folder: Path, count: int) -> Callable[[], object]:
    tracks = stub_estimates(count, tick_s=np.arange(count) * 1.0, state=np.ones((count, 6)))

    def write() -> None:
        with TracksFile(folder / f"{count}.jsonl") as file:
            file.write(tracks)

    return write


def outlines(_folder: Path, count: int) -> Callable[[], object]:
    regions = [stub_regions(9.0, float(place % 100), 100.0 + place) for place in range(count)]
    return lambda: [region_text(of_track) for of_track in regions]


def acknowledged_batches(_folder: Path, count: int) -> Callable[[], object]:
    batch = Batch(
        body=b"x", keys=("S",), key_of=np.zeros(1, np.uint16), content_type="", schema_version=""
    )

    def acknowledge() -> None:
        sent = SentBatches()
        futures = [Future[None]() for _ in range(count)]
        for number, future in enumerate(futures):
            sent.add(number, batch, future)
        for future in futures:
            future.set_result(None)
            sent.remove(sent.done())

    return acknowledge


def repeated(folder: Path, count: int) -> Callable[[], object]:
    """Prepare the repetition of a live run of some launches."""
    path = folder / f"{count}.changes.jsonl"
    outputs = folder / f"{count}.jsonl"
    head = {"changes_version": "1.0", "loop": False, "scene": scene(duration_s=30.0)}
    rows = [
        {"lap": 0, "time_ns": 5_000_000_000, "launch": {**launch, "id": f"L{number}"}}
        for number, launch in enumerate(targets(count))
    ]
    path.write_text("\n".join(map(json.dumps, [head, *rows, {"end_ns": 20_000_000_000}])))
    return lambda: main(["run", str(path), "--out", str(outputs), "--quiet"])


def sights(folder: Path, count: int, **changes: Any) -> Path:
    """Write the events of a scene of about a number of looks of one sensor, and its sensors."""
    described = scene(
        duration_s=30.0 + 0.1 * count,
        sensors=[
            {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 30.0, "scan_period_ms": 100.0}
        ],
        detection="always",
        **changes,
    )
    path = folder / f"{count}-sights"
    path.with_suffix(".json").write_text(json.dumps(described), encoding="utf-8")
    events = path.with_suffix(".jsonl")
    assert main(["run", str(path.with_suffix(".json")), "--quiet", "--out", str(events)]) == 0
    return path


def imported_events(folder: Path, count: int) -> Callable[[], object]:
    path = sights(folder, count)
    return lambda: main(["import", str(path.with_suffix(".jsonl"))])


def tracked_events(folder: Path, count: int) -> Callable[[], object]:
    path = sights(folder, count)
    words = ["--sensors", f"{path}.json", "--out", f"{path}.out.jsonl", "--quiet"]
    words += ["--set", "tracker={model: kepler-arc, cadence_s: 1000.0}"]
    return lambda: main(["track", f"{path}.jsonl", *words])


def scored_events(folder: Path, count: int) -> Callable[[], object]:
    path = sights(folder, count, tracker={"model": "kepler-arc", "cadence_s": 10.0})
    return lambda: main(["score", f"{path}.jsonl"])


def saved_run(folder: Path, count: int) -> Callable[[], object]:
    described = scene(
        duration_s=float(count), outputs=[{"jsonl": {"path": f"{folder}/{count}.jsonl"}}]
    )
    path = folder / f"{count}.json"
    path.write_text(json.dumps(described), encoding="utf-8")
    assert main(["run", str(path), "--quiet"]) == 0
    return lambda: opir.load_run(folder / f"{count}.jsonl")


#: What is doubled, its smaller size, and what prepares it.
KINDS: dict[str, tuple[int, Callable[[Path, int], Callable[[], object]]]] = {
    "rows of a table": (400, written("a.csv", table)),
    "columns of a table": (100, written("b.csv", lambda count: table(40, count))),
    "rows of a table with blanks": (
        400, written("c.txt", lambda count: table(count).replace(",", " "))
    ),
    "JSON records": (400, written("a.json", lambda count: json.dumps(records(count)))),
    "JSON records of different keys": (
        400, written("b.json", lambda count: json.dumps(records(count, distinct=True)))
    ),
    "JSON lines": (400, written("c.json", lambda count: "\n".join(map(json.dumps, records(count))))),
    "points of GPX": (400, written("a.gpx", gpx)),
    "numbers of JSON that is no table": (
        2000, written("d.json", lambda count: json.dumps({"list": list(range(count))}))
    ),
    "lines of text that is no table": (2000, written("d.txt", lambda count: "no table here\n" * count)),
    "one long line": (1000, written("e.txt", lambda count: "word " * count)),
    "lines of a tracks file, one track": (400, tracks_file(of_one_track=True)),
    "lines of a tracks file, many tracks": (400, tracks_file(of_one_track=False)),
    "tracks that are written": (400, written_tracks),
    "regions that are written": (16, outlines),
    "events that are encoded": (2000, encoded),
    "events that are read back": (60, saved_run),
    "events that are imported": (200, imported_events),
    "events that are tracked": (200, tracked_events),
    "events that are scored": (200, scored_events),
    "batches that are acknowledged": (200, acknowledged_batches),
    "launches of a changes file": (20, repeated),
    "duration of a scene": (100, simulated(lambda count: {"duration_s": 1.0 * count})),
    "targets of a scene": (40, simulated(lambda count: {"targets": targets(count)})),
    "sensors of a scene": (40, simulated(lambda count: {"sensors": sensors(count)})),
    "looks of a scene": (
        100,
        simulated(
            lambda count: {
                "sensors": [
                    {
                        "model": "DSP",
                        "id": "S",
                        "orbital_slot_deg": 30.0,
                        "scan_period_ms": 1e4 / count,
                    }
                ]
            }
        ),
    ),
    "members of a scene that is read": (
        60, lambda _folder, count: lambda: opir.scene_from_mapping(scene(targets=targets(count)))
    ),
}  # fmt: skip


def cost(call: Callable[[], object]) -> tuple[int, int]:
    """Return the calls that the interpreter makes, and the most bytes that are allocated at once."""
    calls = 0

    def counted(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal calls
        calls += event in ("call", "c_call")

    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    sys.setprofile(counted)
    try:
        call()
    finally:
        sys.setprofile(None)
        most = tracemalloc.get_traced_memory()[1] - before
        tracemalloc.stop()
    return calls, most


@pytest.mark.parametrize("kind", KINDS)
def test_twice_the_size_is_at_most_twice_the_work(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    size, prepared = KINDS[kind]
    small, large = (prepared(tmp_path, count) for count in (size, 2 * size))
    # Imports, and what is computed once, are no part of it.
    small()
    calls, allocated = cost(small)
    calls_of_twice, allocated_of_twice = cost(large)
    capsys.readouterr()
    assert calls_of_twice <= MOST * calls, (calls, calls_of_twice)
    assert allocated_of_twice <= MOST * max(allocated, 100_000), (allocated, allocated_of_twice)


def test_a_loop_within_a_loop_is_found() -> None:
    def pairs(count: int) -> Callable[[], object]:
        return lambda: [abs(row - column) for row in range(count) for column in range(count)]

    (calls, allocated), (calls_of_twice, allocated_of_twice) = map(cost, map(pairs, (200, 400)))
    assert calls_of_twice > MOST * calls
    assert allocated_of_twice > MOST * max(allocated, 100_000)
