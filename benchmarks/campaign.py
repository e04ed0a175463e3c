"""Campaign of faults: random trials of everything that writes events, and what of it was lost.

    nice python benchmarks/campaign.py --minutes 120 --seed 1 [--only KIND] [--write
    docs/reference/guarantees.md]

A trial has a seed of its own, `SEED/NUMBER`, which `--first NUMBER` repeats. Batch runs are killed,
interrupted and put on disks that fail at a random call; spools are filled, damaged and put on such
disks; the Kafka sink has a broker that comes, goes, refuses and freezes; services are killed and
restarted through all of it. A trial survives if what the page of guarantees says held. `--write`
puts the figures into that page.
"""

import argparse
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
from serve_process import Nursery, nursery
from spool_transports import ENCODER, MIB, SENSORS, Holding, ids_of, window
from waiting import until
from watched_service import WatchedService

from opir_core.errors import OpirError, SinkError
from opir_core.output.delivery import deliver
from opir_core.output.saved_runs import load_run
from opir_core.output.spool.batches import EncodedBatcher
from opir_core.output.spool.journal import Journal
from opir_core.output.spool.salvage import salvaged_at_start
from opir_core.output.spool.transport_sink import Policy, TransportSink
from opir_core.planning.plan import compile_plan
from opir_core.reading import scene_from_mapping

BEGIN = "<!-- campaign: begin -->"
END = "<!-- campaign: end -->"
HEAD = (
    "| trial | tried | survived | events | reported as lost | lost unreported"
    " |\n|---|--:|--:|--:|--:|--:|"
)

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
class Found:
    """Events of a trial, those reported as lost, and those that are missing although they are
    not.
    """

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


def scene(folder: Path, seed: int) -> dict[str, Any]:
    return {**SCENE, "seed": seed, "outputs": [{"jsonl": {"path": str(folder / "e.jsonl")}}]}


def run_into(folder: Path, seed: int) -> None:
    plan = compile_plan(scene_from_mapping(scene(folder, seed)))
    beside = {"truth_path": folder / "e.truth.jsonl", "manifest_path": folder / "e.manifest.json"}
    deliver(plan, **beside).raise_for_failures()


def whole_run(folder: Path, *seeds: int) -> int:
    """Return the events of a run that must be whole and of one of the seeds; the next run must
    replace it.
    """
    run = load_run(folder)
    assert run.manifest["seed"] in seeds, run.manifest["seed"]
    events = len(run.detections)
    run_into(folder, 9)
    assert load_run(folder).manifest["seed"] == 9
    return events


def batch_killed(rng: random.Random, folder: Path, stand: Stand) -> Found:
    """A batch run over another one, ended by a signal at a random moment."""
    import json

    run_into(folder, 1)
    place = folder.with_name("scene.yaml")
    place.write_text(json.dumps({**scene(folder, 2), "outputs": []}), encoding="utf-8")
    words = (
        "run",
        str(place),
        "--out",
        str(folder / "e.jsonl"),
        "--truth",
        str(folder / "e.truth.jsonl"),
    )
    number = stand.plain.born(folder.with_name("log"), *words)
    time.sleep(rng.uniform(0.0, 1.0))
    if is_alive(number):
        os.kill(number, rng.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
    until(lambda: not is_alive(number))
    return Found(whole_run(folder, 1, 2))


def batch_failing_disk(rng: random.Random, folder: Path, _stand: Stand) -> Found:
    """A batch run over another one, on a disk that fails."""
    run_into(folder, 1)
    with FailingDisk(folder) as disk:
        disk.fail_at(rng.randint(1, 30), fault(rng), lasts=rng.random() < 0.5)
        message = message_of(lambda: run_into(folder, 2))
        disk.heal()
    return Found(whole_run(folder, *((2,) if message is None else (1, 2))))


def fault(rng: random.Random) -> int:
    return rng.choice([*ERRORS, SHORT])


def message_of(work: Callable[[], Any]) -> str | None:
    try:
        work()
    except OpirError as error:
        return str(error)
    return None


def spool_sink(path: Path, carrier: Any, rng: random.Random) -> TransportSink:
    damage = salvaged_at_start(path)
    journal = Journal(str(path), 64 * MIB, survives_power_cut=rng.random() < 0.5)
    policy = Policy(
        when_full=rng.choice(["refuse", "drop-oldest", "drop-newest", "wait"]),
        wait_s=0.05,
        stall_s=0.2,
    )
    return TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), policy, damage)


def spool_failing_disk(rng: random.Random, folder: Path, _stand: Stand) -> Found:
    """Five lives of an output with a spool on a disk that fails at random calls."""
    arrived: dict[str, None] = {}
    given: list[str] = []
    reported = 0
    first = 0
    with FailingDisk(folder) as disk:
        for life in range(6):
            kinds = rng.choice([WRITING, (WRITE,), (SYNC,), (READ,), (*WRITING, READ)])
            disk.fail_at(rng.randint(1, 120), fault(rng), lasts=rng.random() < 0.3, kinds=kinds)
            disk.heal() if life == 5 else None
            carrier = Holding(rng.choice(["take", "take", "hold"]) if life < 5 else "take")
            try:
                sink = spool_sink(folder / "spool", carrier, rng)
            except SinkError:
                continue
            before = len(given)
            for _ in range(rng.randint(1, 6)):
                rows = rng.randint(1, 200)
                given += ids_of(window(rows, first))
                message = message_of(lambda: sink.write(window(rows, first)))  # noqa: B023
                first += rows
                if message is not None:
                    break
            counts = sink.close()
            total = counts.delivered + counts.spooled + counts.dropped + counts.withheld
            assert total == len(given) - before + counts.recovered, counts
            reported += counts.dropped
            arrived |= dict.fromkeys(carrier.ids)
    return compared(given, arrived, reported)


def compared(given: list[str], arrived: dict[str, None], reported: int) -> Found:
    """Hold arrivals against what was given: order by sensor, nothing unknown, what is missing
    reported.
    """
    assert arrived.keys() <= set(given)
    missing = len(set(given) - arrived.keys())
    place = {name: number for number, name in enumerate(given)}
    for sensor in range(len(SENSORS)):
        numbers = [place[name] for name in arrived if place[name] % len(SENSORS) == sensor]
        assert numbers == sorted(numbers), "out of order"
    return Found(len(given), reported, max(0, missing - reported))


def spool_damaged(rng: random.Random, folder: Path, _stand: Stand) -> Found:
    """A spool with bits flipped between two runs."""
    path = folder / "spool"
    given = ids_of(window(2000))
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
    found = compared(given, dict.fromkeys(carrier.ids), delivery.dropped)
    # How many events a damaged batch had may be damaged too: that it is damaged is reported, and
    # its file kept.
    assert not found.missing or (
        delivery.complaint is not None and path.with_name("spool.damaged-1").exists()
    )
    return Found(found.events, found.reported + found.missing)


def kafka_faults(rng: random.Random, folder: Path, stand: Stand) -> Found:
    """Four lives of the Kafka sink with a spool; the broker comes, goes, is slow, refuses or
    freezes.
    """
    broker = stand.broker
    first = 0
    topic = broker.topic()
    for life in range(4):
        policy = Policy(wait_s=1.0, stall_s=0.5 if life < 3 else 15.0, retry_s=0.3)
        broker.heal() if life == 3 else None
        sink = kafka_broker.kafka_sink(broker.address, topic, folder / "spool", policy)
        for _ in range(rng.randint(1, 5)):
            broker_fault(rng, broker) if life < 3 else None
            for _ in range(rng.randint(1, 5)):
                sink.write(window(20, first))
                first += 20
                time.sleep(rng.uniform(0.0, 0.1))
        delivery = sink.close()
        assert delivery.dropped == 0, delivery
    broker.heal()
    assert delivery.spooled == 0, delivery
    kafka_broker.examine(broker, topic, first)
    return Found(first)


def broker_fault(rng: random.Random, broker: Any) -> None:
    kind = rng.choice(["down", "up", "slow", "error", "fatal", "none"])
    if kind in ("down", "up"):
        broker.tell(kind)
    elif kind == "slow":
        broker.tell("slow", rng.choice([0, 100, 2500]))
    elif kind in ("error", "fatal"):
        codes = [29] if kind == "fatal" else [2, 5, 6, 7, 19, -1]
        broker.tell("error", kafka_broker.PRODUCE, *[rng.choice(codes)] * rng.choice([1, 5, 30]))


def service_faults(rng: random.Random, _folder: Path, stand: Stand) -> Found:
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
    return Found(2 * sum(service.given.values()), sum(service.lost.values()))


def service_step(rng: random.Random, service: WatchedService, broker: Any) -> None:
    def restart(end: Callable[[], None]) -> None:
        end()
        service.start()

    steps: list[Callable[[], Any]] = [
        lambda: broker_fault(rng, broker),
        lambda: service.fail_disk(
            rng.randint(1, 40), fault(rng), rng.random() < 0.5, rng.choice([WRITING, (READ,)])
        ),
        service.heal_disk,
        lambda: restart(service.kill),
        lambda: restart(service.stop),
        lambda: time.sleep(0.5),
    ]
    if not service.is_faulty:
        steps += [
            service.launch,
            lambda: service.configure(rng.choice([1000.0, 5000.0]), rng.choice(["a", "b"])),
        ]
    rng.choice(steps)()


KINDS: dict[str, Callable[[random.Random, Path, Stand], Found]] = {
    "batch run, ended by SIGKILL, SIGTERM or SIGINT": batch_killed,
    "batch run, disk that fails": batch_failing_disk,
    "spool, disk that fails": spool_failing_disk,
    "spool, bits flipped": spool_damaged,
    "Kafka sink, broker that fails": kafka_faults,
    "service, all of these": service_faults,
}


def campaign(minutes: float, seed: int, only: str, first: int) -> tuple[dict[str, Row], list[str]]:
    """Make trials until the time is over; return their rows and the failures."""
    kinds = {name: trial for name, trial in KINDS.items() if only in trial.__name__}
    rows = {name: Row() for name in kinds}
    failures = list[str]()
    give_up_s = time.monotonic() + 60.0 * minutes
    number = first
    with nursery() as plain, nursery("faulty_process") as faulty:
        broker = kafka_broker.MockBroker()
        try:
            while time.monotonic() < give_up_s:
                name = list(kinds)[number % len(kinds)]
                if number % 60 == 59:  # the mock broker keeps every topic in memory
                    broker.close()
                    broker = kafka_broker.MockBroker()
                failures += tried(
                    name,
                    random.Random(f"{seed}/{number}"),
                    rows[name],
                    Stand(plain, faulty, broker),
                    number,
                )
                number += 1
        finally:
            broker.close()
    return rows, failures


def tried(name: str, rng: random.Random, row: Row, stand: Stand, number: int) -> list[str]:
    """Make one trial; return its failure, if it failed."""
    row.tried += 1
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "folder"
        folder.mkdir()
        try:
            found = KINDS[name](rng, folder, stand)
        except Exception as error:
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}, line {place.lineno}"
            return [
                f"trial {number} ({name}): {type(error).__name__} in {where}: {str(error)[:2000]}"
            ]
    row.events = row.events + found.events
    row.reported = row.reported + found.reported
    row.missing = row.missing + found.missing
    row.survived += not found.missing
    return [f"trial {number} ({name}): {found.missing} events are missing"] if found.missing else []


def table(rows: dict[str, Row]) -> str:
    """Return the table of the trials."""
    lines = [
        f"| {name} | {row.tried} | {row.survived} | {row.events} | {row.reported} | {row.missing} |"
        for name, row in rows.items()
    ]
    return "\n".join([HEAD, *lines])


def write(path: Path, rows: dict[str, Row], minutes: float, seed: int) -> None:
    """Put the figures into a page, between its marks."""
    text = path.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    day = datetime.now(UTC).date().isoformat()
    words = (
        f"{minutes:g} minutes, seed {seed}, {day}: `python benchmarks/campaign.py --minutes"
        f" {minutes:g} --seed {seed}`."
    )
    path.write_text(
        f"{before}{BEGIN}\n{words}\n\n{table(rows)}\n{END}{rest.split(END)[1]}", encoding="utf-8"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--only",
        default="",
        metavar="WORD",
        help="only trials with this word in their function's name",
    )
    parser.add_argument(
        "--first", type=int, default=0, metavar="NUMBER", help="begin with this trial"
    )
    parser.add_argument("--write", type=Path, metavar="PAGE", help="put the figures into this page")
    arguments = parser.parse_args()
    rows, failures = campaign(arguments.minutes, arguments.seed, arguments.only, arguments.first)
    print(table(rows), *failures, sep="\n")
    for name, row in rows.items():
        keep(f"{name}: survived", row.survived / max(row.tried, 1))
        keep(f"{name}: missing", row.missing, "events")
    if arguments.write:
        write(arguments.write, rows, arguments.minutes, arguments.seed)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
