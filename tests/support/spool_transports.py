"""A stand for spools: carriers that do as they are reported, and a process that can be killed while
it fills one.
"""

import json
import os
import time
from concurrent.futures import Future
from functools import cache
from pathlib import Path

import numpy as np
from opir_testing import stub_sensor
from opir_testing.doubles import stub_window

from opir_core.errors import SinkError
from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.outputs import Transport
from opir_core.output.events.forge import ForgeEncoder
from opir_core.output.spool.batches import EncodedBatcher, MemoryBacklog
from opir_core.output.spool.columns import Origin
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.transport_sink import Policy, TransportSink

SENSORS = tuple(stub_sensor(f"S-{number}") for number in range(5))
ENCODER = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=0))
ORIGIN = Origin(0, SENSORS)
MIB = 1 << 20
#: For carriers that do not acknowledge, and for those that do, however slow the machine is.
QUICK = Policy(when_full="refuse", wait_s=0.3, stall_s=0.2)
PATIENT = Policy(when_full="refuse", wait_s=30.0, stall_s=30.0)


def filled_spool(path, batches, rows):
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

    def __init__(self, mood="take"):
        self.mood = mood
        self.trouble = None
        self.parcels = []
        self.held = []
        self.closed = 0

    def send(self, batch):
        future = Future()
        self.parcels.append(batch)
        if self.mood == "take":
            future.set_result(None)
        elif self.mood == "fail":
            future.set_exception(SinkError("the broker refuses it"))
        else:
            self.held.append(future)
        return future

    def release(self):
        self.mood = "take"
        for future in self.held:
            future.set_result(None)
        self.held.clear()

    def close(self, wait_s):
        self.closed += 1
        for future in self.held:
            future.cancel()

    @property
    def ids(self):
        return [event["detection_id"] for event in self.events]

    @property
    def events(self):
        return [json.loads(line) for parcel in self.parcels for line in parcel.messages()]


class Appending(Holding):
    """A carrier that appends lines to a file, a little at a time, as a slow consumer takes them.

    A kill can leave a line torn. The next carrier goes on below it, so that what is sent again is
    whole.
    """

    def __init__(self, path, nap_s):
        super().__init__()
        is_torn = path.exists() and path.read_bytes()[-1:] not in (b"", b"\n")
        self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        if is_torn:
            os.write(self._file, b"\n")
        self._nap_s = nap_s

    def send(self, batch):
        time.sleep(self._nap_s)
        os.write(self._file, batch.body)
        return super().send(batch)

    def close(self, wait_s):
        os.close(self._file)


def window(count, first=0):
    """Return a window whose detections take turns between the sensors."""
    return stub_window(
        count, first_scan=first, sensor=np.arange(first, first + count) % len(SENSORS)
    )


def ids_of(*windows):
    return [
        json.loads(line)["detection_id"]
        for window in windows
        for line in ENCODER.encode(window).splitlines()
    ]


def spooled(path, carrier, policy=None, max_bytes=64 * MIB):
    return _sink(carrier, Journal(str(path), max_bytes), policy)


def unspooled(carrier, policy=None, max_bytes=64 * MIB):
    return _sink(carrier, MemoryBacklog(max_bytes), policy)


def _sink(carrier, backlog, policy):
    batcher = EncodedBatcher(ENCODER, SENSORS)
    return TransportSink("stub", carrier, backlog, batcher, policy or policy_for(carrier))


def policy_for(carrier):
    """Return how long closing waits for a carrier, by its mood."""
    return PATIENT if carrier.mood == "take" else QUICK


def fill(sink, windows, rows, first, nap_s):
    """Write windows one after the other."""
    for number in range(windows):
        sink.write(window(rows, first + number * rows))
        time.sleep(nap_s)


def spool_for_ever(folder, first):
    """Be a process that fills a spool for ever, to be killed."""
    take_for_ever(
        spooled(Path(folder) / "spool", Appending(Path(folder) / "arrived", 0.001)), folder, first
    )


def take_for_ever(sink, folder, first):
    """Write windows of 7 events from number `first` on, and note the first of each that is
    written.
    """
    taken = os.open(Path(folder) / "taken", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for number in range(first, first + 1_000_000, 7):
        sink.write(window(7, number))
        os.write(taken, b"%d\n" % number)
        time.sleep(0.001)


def small(tmp_path, carrier, when_full, *, is_spooled, wait_s=0.2):
    policy = Policy(when_full=when_full, wait_s=wait_s, stall_s=0.3)
    if is_spooled:
        return spooled(tmp_path / "spool", carrier, policy, 10 * MIB)
    return unspooled(carrier, policy, 10 * MIB)


def overfill(sink):
    """Write twice what the small backlogs hold, and return how many events that is."""
    for many_window in many_windows():
        sink.write(many_window)
    return 40_000


@cache
def many_windows():
    return [window(1000, 1000 * number) for number in range(40)]


def flip_body(path: Path, *events: int) -> None:
    """Change one byte in the messages of some of the first 2000 events."""
    content = bytearray(path.read_bytes())
    for event in events:
        content[content.index(ids_of(window(2000))[event].encode())] ^= 1
    path.write_bytes(content)
