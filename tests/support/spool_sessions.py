"""Outputs with a spool that are filled in a recorded process, and what a power cut leaves of them.

    python spool_sessions.py FOLDER OUTPUT SURVIVES SECONDS

fills the spool of an output for so long, twice. OUTPUT is `held`, a destination that acknowledges
some batches late, or `jsonl`, a file. What the output has taken, and what was acknowledged, are
notes of the recording.
"""

import json
import random
import sys
import time
from pathlib import Path

from attrs import frozen
from power_cuts import note
from spool_transports import ENCODER, ORIGIN, QUICK, SENSORS, Holding, ids_of, window

from opir_core.builtin.sinks import LineFile
from opir_core.interfaces.outputs import Transport
from opir_core.output.spool.batches import Batcher, EncodedBatcher, WindowBatcher, WindowTransport
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.salvage import salvaged_at_start
from opir_core.output.spool.transport_sink import Policy, TransportSink

SPOOL = "spool"
LINES = "events.jsonl"
EVENTS = 3
SESSIONS = 2
#: Batches that are under way when the oldest of them are acknowledged, and how many of them then
#: are.
_UNDER_WAY = 6
_ACKNOWLEDGED = 4


class Late(Holding):
    """A destination that acknowledges the oldest batches once many are under way, and notes it."""

    def __init__(self, folder):
        super().__init__("hold")
        self._folder = folder

    def send(self, batch):
        future = super().send(batch)
        if len(self.held) > _UNDER_WAY:
            oldest = self.parcels[-len(self.held) :][:_ACKNOWLEDGED]
            note(
                self._folder,
                "delivered " + " ".join(id_ for parcel in oldest for id_ in ids_in(parcel)),
            )
            for _ in oldest:
                self.held.pop(0).set_result(None)
        return future


def ids_in(batch):
    """Return the ids of a batch of messages."""
    return [json.loads(message)["detection_id"] for message in batch.messages()]


def output(folder, kind, *, survives, policy=QUICK):
    """Return an output with a spool, open."""
    journal = Journal(str(folder / SPOOL), 1 << 20, survives_power_cut=survives)
    transport: Transport
    batcher: Batcher
    if kind == "jsonl":
        transport = WindowTransport(LineFile(str(folder / LINES), ENCODER, appends=True), ORIGIN)
        batcher = WindowBatcher(ENCODER, ORIGIN)
    else:
        transport = Late(folder)
        batcher = EncodedBatcher(ENCODER, SENSORS)
    return TransportSink("stub", transport, journal, batcher, policy)


def fill(folder, kind, seconds, *, survives):
    """Fill the spool of an output, in sessions; note each window once it is taken."""
    rng = random.Random(1)
    start = 0
    for _ in range(SESSIONS):
        sink = output(folder, kind, survives=survives)
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            taken = window(EVENTS, start)
            sink.write(taken)
            note(folder, "taken " + " ".join(ids_of(taken)))
            start += EVENTS
            time.sleep(rng.choice((0.0, 0.01, 0.05, 0.3)))
        sink.close()


@frozen
class Left:
    """What a power cut leaves: the events taken before, with their times; those acknowledged; those
    still there.
    """

    taken: dict[str, float]
    delivered: set[str]
    stored: set[str]
    cut_s: float

    @property
    def lost(self):
        """The events that nobody has any more."""
        return set(self.taken) - self.delivered - self.stored

    @property
    def lost_s(self):
        """How long before the cut the oldest of them was taken, s; 0 if there is none."""
        return max((self.cut_s - self.taken[name] for name in self.lost), default=0.0)


def left(cut, place, kind):
    """Return what is left in a folder after a cut; raises what makes a file unusable."""
    taken = dict[str, float]()
    delivered = set[str]()
    for at_s, text in cut.notes:
        word, *ids = text.decode().split()
        if word == "taken":
            taken.update(dict.fromkeys(ids, at_s))
        else:
            delivered.update(ids)
    assert salvaged_at_start(place / SPOOL) is None, "the spool is damaged"
    stored = lines_after(place) if kind == "jsonl" else spooled_after(place)
    return Left(taken, delivered, stored, cut.time_s)


def spooled_after(place):
    """Return the ids in a spool, which takes another batch too."""
    journal = Journal(str(place / SPOOL), 1 << 20)
    number = 0
    result = set[str]()
    while (numbered := journal.after(number)) is not None:
        number, batch = numbered
        result.update(ids_in(batch))
    journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(1))))
    journal.close()
    return result


def lines_after(place):
    """Return the ids in a file after its output is opened again and has emptied its spool; every
    line is whole.
    """
    delivery = output(place, "jsonl", survives=True, policy=Policy(stall_s=60.0)).close()
    assert (delivery.spooled, delivery.complaint) == (0, None)
    events = [json.loads(line) for line in (place / LINES).read_bytes().splitlines()]
    first = list(
        dict.fromkeys(
            (event["sensor_id"], event["timestamp"], event["detection_id"]) for event in events
        )
    )
    assert first == sorted(first, key=lambda each: each[1]), "out of order"
    return {event["detection_id"] for event in events}


if __name__ == "__main__":
    fill(Path(sys.argv[1]), sys.argv[2], float(sys.argv[4]), survives=sys.argv[3] == "True")
