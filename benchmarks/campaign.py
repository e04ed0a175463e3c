"""Campaign of faults: random trials of everything that writes events, and the events lost.

A trial has a seed of its own, `SEED/NUMBER`, which `--first NUMBER` repeats. Batch runs are killed,
interrupted and put on disks that fail at a random call; spools are filled, damaged and put on such
disks; the Kafka sink has a broker that comes, goes, refuses and freezes; services are killed and
restarted through all of it. A trial survives if the guarantees of the reference page held. `--only`
is a word in the trials' function names; `--page` gets the figures.
"""

import json
import os
import random
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from attrs import define, frozen

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

import kafka_broker
from failing_disk import ERRORS, READ, SHORT, SYNC, WRITE, WRITING, FailingDisk
from figures import keep
from forked_processes import is_alive
from pages import markdown_table, options_of
from serve_process import Nursery, nursery
from spool_transports import ENCODER, MIB, SENSORS, Holding, ids_of, window
from waiting import until
from watched_service import WatchedService

import opir_core as opir
from opir_core.output.delivery import deliver
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.salvage import salvaged_at_start
from opir_core.output.spool.transport_sink import Policy, TransportSink

BEGIN = "<!-- campaign: begin -->"
END = "<!-- campaign: end -->"
HEAD = ("trial", "tried", "survived", "events", "reported as lost", "lost unreported")

SCENE = {
    "scene": "campaign",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 30.0,
    "sensors": [{"constellation": "DSP"}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 1.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}


@frozen
class Result:
    """Events of a trial, those reported as lost, and those missing without a report."""

    events: int
    reported: int = 0
    missing: int = 0


@define
class Row:
    """The trials of a kind."""

    tried: int = 0
    survived: int = 0
    events: int = 0
    reported: int = 0
    missing: int = 0


@frozen(eq=False)
class Stand:
    """What trials share: where processes come from, and a broker."""

    plain: Nursery
    faulty: Nursery
    broker: Any


def scene(folder, seed):
    """Return a scene with an output in a folder."""
    return {**SCENE, "seed": seed, "outputs": [{"jsonl": {"path": str(folder / "e.jsonl")}}]}


def run_into(folder, seed):
    """Run the scene into a folder."""
    plan = opir.compile_plan(opir.scene_from_mapping(scene(folder, seed)))
    truth = folder / "e.truth.jsonl"
    outcome = deliver(plan, truth_path=truth, manifest_path=folder / "e.manifest.json")
    outcome.raise_for_failures()


def complete_run(folder, *seeds):
    """Return the events of a run that must be complete and of one of the seeds; the next run must
    replace it.
    """
    run = opir.load_run(folder)
    assert run.manifest["seed"] in seeds, run.manifest["seed"]
    events = len(run.detections)
    run_into(folder, 9)
    assert opir.load_run(folder).manifest["seed"] == 9
    return events


def batch_killed(rng, folder, stand):
    """A batch run over another one, ended by a signal at a random moment."""
    run_into(folder, 1)
    path = folder.with_name("scene.yaml")
    path.write_text(json.dumps({**scene(folder, 2), "outputs": []}), encoding="utf-8")
    words = ("--out", str(folder / "e.jsonl"), "--truth", str(folder / "e.truth.jsonl"))
    process = stand.plain.born(folder.with_name("log"), "run", str(path), *words)
    time.sleep(rng.uniform(0.0, 1.0))
    if is_alive(process):
        os.kill(process, rng.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
    until(lambda: not is_alive(process))
    return Result(complete_run(folder, 1, 2))


def batch_failing_disk(rng, folder, _stand):
    """A batch run over another one, on a disk that fails."""
    run_into(folder, 1)
    with FailingDisk(folder) as disk:
        disk.fail_at(rng.randint(1, 30), fault(rng), lasts=rng.random() < 0.5)
        message = message_of(lambda: run_into(folder, 2))
        disk.heal()
    return Result(complete_run(folder, *((2,) if message is None else (1, 2))))


def fault(rng):
    """Return a random fault of a disk."""
    return rng.choice([*ERRORS, SHORT])


def message_of(work):
    """Return the message of an error, None without one."""
    try:
        work()
    except opir.OpirError as error:
        return str(error)
    return None


def spool_sink(path, carrier, rng):
    """Return an output with a spool and a random policy."""
    damage = salvaged_at_start(path)
    journal = Journal(str(path), 64 * MIB, survives_power_cut=rng.random() < 0.5)
    when_full = rng.choice(["refuse", "drop-oldest", "drop-newest", "wait"])
    policy = Policy(when_full=when_full, wait_s=0.05, stall_s=0.2)
    return TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), policy, damage)


def spool_failing_disk(rng, folder, _stand):
    """Six lives of an output with a spool on a disk that fails at random calls but in the last."""
    arrived = {}
    written = []
    reported = 0
    with FailingDisk(folder) as disk:
        for life in range(6):
            kinds = rng.choice([WRITING, (WRITE,), (SYNC,), (READ,), (*WRITING, READ)])
            disk.fail_at(rng.randint(1, 120), fault(rng), lasts=rng.random() < 0.3, kinds=kinds)
            if life == 5:
                disk.heal()
            carrier = Holding(rng.choice(["take", "take", "hold"]) if life < 5 else "take")
            try:
                sink = spool_sink(folder / "spool", carrier, rng)
            except opir.SinkError:
                continue
            count = len(written)
            written += spooled(rng, sink, count)
            counts = sink.close()
            total = counts.delivered + counts.spooled + counts.dropped + counts.withheld
            assert total == len(written) - count + counts.recovered, counts
            reported += counts.dropped
            arrived |= dict.fromkeys(carrier.ids)
    return compared(written, arrived, reported)


def spooled(rng, sink, first):
    """Write windows of random sizes until one fails; return the ids of all events."""
    ids = []
    for _ in range(rng.randint(1, 6)):
        batch = window(rng.randint(1, 200), first + len(ids))
        ids += ids_of(batch)
        if message_of(lambda: sink.write(batch)) is not None:  # noqa: B023
            break
    return ids


def compared(written, arrived, reported):
    """Hold arrivals against the events written: order by sensor, nothing unknown, missing ones
    reported.
    """
    assert arrived.keys() <= set(written)
    missing = len(set(written) - arrived.keys())
    place = {name: number for number, name in enumerate(written)}
    for sensor in range(len(SENSORS)):
        numbers = [place[name] for name in arrived if place[name] % len(SENSORS) == sensor]
        assert numbers == sorted(numbers), "out of order"
    return Result(len(written), reported, max(0, missing - reported))


def spool_damaged(rng, folder, _stand):
    """A spool with bits flipped between two runs."""
    path = folder / "spool"
    written = ids_of(window(2000))
    journal = Journal(str(path), 64 * MIB)
    for number in range(20):
        journal.put(next(EncodedBatcher(ENCODER, SENSORS).batches(window(100, 100 * number))))
    journal.close()
    content = bytearray(path.read_bytes())
    for _ in range(rng.choice([1, 8, 64])):
        content[rng.randrange(4096, len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)
    carrier = Holding()
    delivery = spool_sink(path, carrier, rng).close()
    assert delivery.delivered == len(carrier.ids) == delivery.recovered - delivery.dropped
    result = compared(written, dict.fromkeys(carrier.ids), delivery.dropped)
    # How many events a damaged batch had may be damaged too: that it is damaged is reported, and
    # its file kept.
    is_reported = delivery.complaint is not None and path.with_name("spool.damaged-1").exists()
    assert not result.missing or is_reported
    return Result(result.events, result.reported + result.missing)


def kafka_faults(rng, folder, stand):
    """Four lives of the Kafka sink with a spool; the broker comes, goes, is slow, refuses or
    freezes but in the last.
    """
    broker = stand.broker
    first = 0
    topic = broker.topic()
    for life in range(4):
        is_final = life == 3
        policy = Policy(wait_s=1.0, stall_s=15.0 if is_final else 0.5, retry_s=0.3)
        if is_final:
            broker.heal()
        sink = kafka_broker.kafka_sink(broker.address, topic, folder / "spool", policy)
        for _ in range(rng.randint(1, 5)):
            if not is_final:
                broker_fault(rng, broker)
            for _ in range(rng.randint(1, 5)):
                sink.write(window(20, first))
                first += 20
                time.sleep(rng.uniform(0.0, 0.1))
        delivery = sink.close()
        assert delivery.dropped == 0, delivery
    broker.heal()
    assert delivery.spooled == 0, delivery
    kafka_broker.examine(broker, topic, first)
    return Result(first)


def broker_fault(rng, broker):
    """Let a broker fail at random, or recover."""
    kind = rng.choice(["down", "up", "slow", "error", "fatal", "none"])
    if kind in ("down", "up"):
        broker.tell(kind)
    elif kind == "slow":
        broker.tell("slow", rng.choice([0, 100, 2500]))
    elif kind in ("error", "fatal"):
        codes = [29] if kind == "fatal" else [2, 5, 6, 7, 19, -1]
        broker.tell("error", kafka_broker.PRODUCE, *[rng.choice(codes)] * rng.choice([1, 5, 30]))


def service_faults(rng, _folder, stand):
    """A service with two outputs through launches, settings, restarts, kills, and faults of broker
    and disk.
    """
    service = WatchedService(stand.faulty, stand.broker)
    try:
        for _ in range(10):
            service_step(rng, service, stand.broker)
            service.observe()
        service.close()
    finally:
        service.end()
    return Result(2 * sum(service.given.values()), sum(service.lost.values()))


def service_step(rng, service, broker):
    """Do one thing to a service at random."""

    def restart(end):
        end()
        service.start()

    def fail_disk():
        kinds = rng.choice([WRITING, (READ,)])
        service.fail_disk(rng.randint(1, 40), fault(rng), rng.random() < 0.5, kinds)

    steps = [
        lambda: broker_fault(rng, broker),
        fail_disk,
        service.heal_disk,
        lambda: restart(service.kill),
        lambda: restart(service.stop),
        lambda: time.sleep(0.5),
    ]
    if not service.is_faulty:
        period_ms = rng.choice([1000.0, 5000.0])
        steps += [service.launch, lambda: service.configure(period_ms, rng.choice(["a", "b"]))]
    rng.choice(steps)()


KINDS: dict[str, Callable[[random.Random, Path, Stand], Result]] = {
    "batch run, ended by SIGKILL, SIGTERM or SIGINT": batch_killed,
    "batch run, disk that fails": batch_failing_disk,
    "spool, disk that fails": spool_failing_disk,
    "spool, bits flipped": spool_damaged,
    "Kafka sink, broker that fails": kafka_faults,
    "service, all of these": service_faults,
}


def campaign(minutes, seed, only, first):
    """Make trials until the time is over; return their rows and the failures."""
    rows = {name: Row() for name, trial in KINDS.items() if only in trial.__name__}
    failures = list[str]()
    end_s = time.monotonic() + 60.0 * minutes
    number = first
    with nursery() as plain, nursery("faulty_process") as faulty:
        broker = kafka_broker.MockBroker()
        try:
            while time.monotonic() < end_s:
                name = list(rows)[number % len(rows)]
                if number % 60 == 59:  # the mock broker keeps every topic in memory
                    broker.close()
                    broker = kafka_broker.MockBroker()
                rng = random.Random(f"{seed}/{number}")
                if failure := tried(name, rng, rows[name], Stand(plain, faulty, broker)):
                    failures.append(f"trial {number} ({name}): {failure}")
                number += 1
        finally:
            broker.close()
    return rows, failures


def tried(name, rng, row, stand):
    """Make one trial; return its failure, empty if it survived."""
    row.tried += 1
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "folder"
        folder.mkdir()
        try:
            result = KINDS[name](rng, folder, stand)
        except Exception as error:
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(frame.filename).name}, line {frame.lineno}"
            return f"{type(error).__name__} in {where}: {str(error)[:2000]}"
    row.events += result.events
    row.reported += result.reported
    row.missing += result.missing
    row.survived += not result.missing
    return f"{result.missing} events are missing" if result.missing else ""


def table(rows):
    """Return the table of the trials."""
    columns = ("tried", "survived", "events", "reported", "missing")
    lines = [[name, *(getattr(row, column) for column in columns)] for name, row in rows.items()]
    return markdown_table(HEAD, lines)


def write(path, rows, minutes, seed):
    """Put the figures into a page, between its marks."""
    head, remainder = path.read_text(encoding="utf-8").split(BEGIN)
    day = datetime.now(UTC).date().isoformat()
    words = (
        f"{minutes:g} minutes, seed {seed}, {day}: `python benchmarks/campaign.py --minutes"
        f" {minutes:g} --seed {seed}`."
    )
    text = f"{head}{BEGIN}\n{words}\n\n{table(rows)}\n{END}{remainder.split(END)[1]}"
    path.write_text(text, encoding="utf-8")


def main():
    """Make a campaign; return 1 if a trial failed."""
    options = options_of(__doc__, minutes=60.0, seed=1, only="", first=0, page=Path)
    rows, failures = campaign(options.minutes, options.seed, options.only, options.first)
    print(table(rows), *failures, sep="\n")
    for name, row in rows.items():
        keep(f"{name}: survived", row.survived / max(row.tried, 1))
        keep(f"{name}: missing", row.missing, "events")
    if options.page:
        write(options.page, rows, options.minutes, options.seed)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
