"""A stand for spools: carriers that do as they are reported, and a process that can be killed while
it fills one.
"""

import json
import os
import time
from concurrent.futures import Future
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from opir_testing import stub_sensor
from opir_testing.doubles import stub_window

from opir_core.errors import SinkError
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.outputs import Sink, Transport
from opir_core.interfaces.records import Batch, Window
from opir_core.output.events.forge import ForgeEncoder
from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.columns import Origin
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.transport_sink import Policy, TransportSink

SENSORS = tuple(stub_sensor(f"S-{number}") for number in range(5))
ENCODER = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=0))
ORIGIN = Origin(0, SENSORS)
MIB = 1 << 20
QUICK = Policy(when_full="refuse", wait_s=0.3, stall_s=0.2)


def filled_spool(path: Path, batches: int, rows: int) -> Path:
    """Write a spool of batches of a number of events each, and return its path."""
    journal = Journal(str(path), 64 * MIB)
    for number in range(batches):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(rows, rows * number))))
    journal.close()
    return path


class Holding(Transport):
    """A carrier that acknowledges when reported to, or at once; `mood` is "take", "hold" or
    "fail".
    """

    def __init__(self, mood: str = "take") -> None:
        self.mood = mood
        self.trouble: str | None = None
        self.parcels: list[Batch] = []
        self.held: list[Future[None]] = []
        self.closed = 0

    def send(self, batch: Batch) -> "Future[None]":
        future: Future[None] = Future()
        self.parcels.append(batch)
        if self.mood == "take":
            future.set_result(None)
        elif self.mood == "fail":
            future.set_exception(SinkError("the broker refuses it"))
        else:
            self.held.append(future)
        return future

    def release(self) -> None:
        self.mood = "take"
        for future in self.held:
            future.set_result(None)
        self.held.clear()

    def close(self, wait_s: float) -> None:
        self.closed += 1
        for future in self.held:
            future.cancel()

    @property
    def ids(self) -> list[str]:
        return [event["detection_id"] for event in self.events]

    @property
    def events(self) -> list[dict[str, Any]]:
        return [json.loads(line) for parcel in self.parcels for line in parcel.messages()]


class Appending(Holding):
    """A carrier that appends lines to a file, a little at a time, as a slow consumer takes them.

    A kill can leave a line torn. The next carrier goes on below it, so that what is sent again is
    whole.
    """

    def __init__(self, path: Path, nap_s: float) -> None:
        super().__init__()
        is_torn = path.exists() and path.read_bytes()[-1:] not in (b"", b"\n")
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        if is_torn:
            os.write(self._file, b"\n")
        self._nap_s = nap_s

    def send(self, batch: Batch) -> "Future[None]":
        time.sleep(self._nap_s)
        os.write(self._file, batch.body)
        return super().send(batch)

    def close(self, wait_s: float) -> None:
        os.close(self._file)


def window(count: int, first: int = 0) -> Window:
    """Return a window whose detections take turns between the sensors."""
    return stub_window(
        count, first_scan=first, sensor=np.arange(first, first + count) % len(SENSORS)
    )


def ids_of(*windows: Window) -> list[str]:
    return [
        json.loads(line)["detection_id"]
        for each in windows
        for line in ENCODER.encode(each).splitlines()
    ]


def spooled(
    path: Path, carrier: Any, policy: Policy = QUICK, max_bytes: int = 64 * MIB
) -> TransportSink:
    return TransportSink(
        "stub", carrier, Journal(str(path), max_bytes), EncodedBatcher(ENCODER, SENSORS), policy
    )


def unspooled(carrier: Any, policy: Policy = QUICK, max_bytes: int = 64 * MIB) -> TransportSink:
    return TransportSink(
        "stub", carrier, MemoryBacklog(max_bytes), EncodedBatcher(ENCODER, SENSORS), policy
    )


def fill(sink: Sink, windows: int, rows: int, first: int, nap_s: float) -> None:
    """Write windows one after the other."""
    for number in range(windows):
        sink.write(window(rows, first + number * rows))
        time.sleep(nap_s)


def spool_for_ever(folder: str, first: int) -> None:
    """Be a process that fills a spool for ever, to be killed."""
    take_for_ever(
        spooled(Path(folder) / "spool", Appending(Path(folder) / "arrived", 0.001)), folder, first
    )


def take_for_ever(sink: Sink, folder: str, first: int) -> None:
    """Write windows of 7 events from number `first` on, and note the first of each that is
    written.
    """
    taken = os.open(Path(folder) / "taken", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in range(first, first + 1_000_000, 7):
        sink.write(window(7, number))
        os.write(taken, b"%d\n" % number)
        time.sleep(0.001)


def small(
    tmp_path: Path, carrier: Any, when_full: str, *, is_spooled: bool, wait_s: float = 0.2
) -> TransportSink:
    policy = Policy(when_full=when_full, wait_s=wait_s, stall_s=0.3)
    if is_spooled:
        return spooled(tmp_path / "spool", carrier, policy, 10 * MIB)
    return unspooled(carrier, policy, 10 * MIB)


def overfill(sink: TransportSink) -> int:
    """Write twice what the small backlogs hold, and return how many events that is."""
    for each in many_windows():
        sink.write(each)
    return 40_000


@cache
def many_windows() -> list[Window]:
    return [window(1000, 1000 * number) for number in range(40)]
