"""A disk that fails at any one call, or from one on: nothing is lost uncounted, and the run before
is intact.

By default the calls that fail are the first and the last of each kind on each file;
OPIR_EVERY_FAULT=1 takes every one.
"""

import errno
import json
import os
import re
import shutil
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from failing_disk import ERRORS, READ, SHORT, WRITING, FailingDisk, can_fail
from spool_transports import ENCODER, MIB, SENSORS, Holding, ids_of, window

from opir_core import Plan, compile_plan, load_run
from opir_core.builtin.sinks import LineFile
from opir_core.errors import OpirError, SinkError
from opir_core.output import deliver, spool_state
from opir_core.output.run_files import read_manifest
from opir_core.output.spool import EncodedBatcher, Journal, Policy, TransportSink, salvaged_at_start
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not can_fail(), reason="needs /proc and SQLite's calls"),
]

IS_EVERY = bool(os.environ.get("OPIR_EVERY_FAULT"))
#: An error that occurs once, one that stays, as on a full disk, and a short write.
FAULTS = [(errno.EIO, False), (errno.ENOSPC, True), (SHORT, False), (SHORT, True)]
if IS_EVERY:
    FAULTS = [(error, lasts) for error in (*ERRORS, SHORT) for lasts in (False, True)]
FAULT = pytest.mark.parametrize(
    ("error", "lasts"),
    FAULTS,
    ids=[
        f"{errno.errorcode.get(error, 'SHORT')}{'-lasts' if lasts else ''}"
        for error, lasts in FAULTS
    ],
)

SCENE = {
    "scene": "small",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 20.0,
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
#: What a message says of files that are the new run's, in part or in whole, although the run
#: failed.
IS_THERE = re.compile("whole under temporary names|files are in place")
NAMES = ["e.jsonl", "e.manifest.json", "e.tracks.jsonl", "e.truth.jsonl"]


def chosen(calls: Sequence[tuple[str, str]], kinds: Sequence[str] = WRITING) -> list[int]:
    """Return the numbers of the calls that fail, of a run without faults."""
    matching = [call for call in calls if call[0] in kinds]
    if IS_EVERY:
        return list(range(1, len(matching) + 2))
    first_number = {call: number for number, call in reversed(list(enumerate(matching, 1)))}
    last_number = {call: number for number, call in enumerate(matching, 1)}
    return sorted({*first_number.values(), *last_number.values(), len(matching) + 1})


def plan_of(seed: int, *outputs: Any) -> Plan:
    return compile_plan(scene_from_mapping({**SCENE, "seed": seed, "outputs": list(outputs)}))


def run_into(folder: Path, plan: Plan) -> Any:
    beside = {f"{kind}_path": folder / f"e.{kind}.jsonl" for kind in ("truth", "tracks")}
    outcome = deliver(plan, **beside, manifest_path=folder / "e.manifest.json")
    for sink in outcome.report.sinks:
        event_count = outcome.report.events
        assert (
            sink.delivered + sink.spooled + sink.dropped + sink.withheld
            == event_count + sink.recovered
            or sink.error
        )
    outcome.raise_for_failures()
    return outcome


@pytest.fixture
def good(tmp_path: Path) -> Path:
    (tmp_path / "good").mkdir()
    run_into(tmp_path / "good", plan_of(1, {"jsonl": {"path": str(tmp_path / "good" / "e.jsonl")}}))
    return tmp_path / "good"


@FAULT
def test_files_are_of_one_run_for_any_failing_call(good: Path, error: int, lasts: bool) -> None:
    place = good.with_name("place")
    host = Host.discover()
    plans = {seed: plan_of(seed, {"jsonl": {"path": str(place / "e.jsonl")}}) for seed in (2, 3)}

    def fresh() -> None:
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(good, place)

    fresh()
    with FailingDisk(place) as disk:
        run_into(place, plans[2])
        calls = list(disk.calls)
        for number in chosen(calls):
            fresh()
            disk.fail_at(number, error, lasts=lasts)
            reported = message_of(lambda: run_into(place, plans[2]))
            failed = disk.failed
            disk.heal()
            seed = read_manifest(place / "e.manifest.json")["seed"]
            assert (reported is None) == (seed == 2) or IS_THERE.search(reported or ""), (
                number,
                reported,
            )
            assert (
                reported is None or (place / "e.jsonl").name in reported or str(place) in reported
            ), reported
            seed = load_run(place, host).manifest["seed"]  # finishes the run that is whole
            assert seed == 2 if reported is None else seed in (1, 2)
            run_into(place, plans[3])
            assert load_run(place, host).manifest["seed"] == 3
            assert sorted(path.name for path in place.iterdir()) == NAMES
    assert failed == 0, "the last number is beyond the last call"


def path_is(path: Path) -> Callable[[str], bool]:
    return lambda name: name.startswith(path.name)


def message_of(work: Callable[[], Any]) -> str | None:
    try:
        work()
    except OpirError as error:
        return str(error)
    return None


ROWS = 60
WINDOWS = 5


def sink_into(
    path: Path,
    carrier: Holding,
    when_full: str,
    policy: Policy | None = None,
    *,
    survives_power_cut: bool = False,
) -> TransportSink:
    damage = salvaged_at_start(path)
    journal = Journal(str(path), 64 * MIB, survives_power_cut=survives_power_cut)
    brief = Policy(when_full=when_full, wait_s=0.0 if when_full != "wait" else 0.05, stall_s=0.2)
    policy = policy or brief
    return TransportSink("stub", carrier, journal, EncodedBatcher(ENCODER, SENSORS), policy, damage)


def life(
    path: Path, when_full: str, carrier: Holding, first_value: int, **more: bool
) -> tuple[Any, int, str | None]:
    """Return the counts of a sink that is given windows until it fails, how many events these had,
    and its error.
    """
    sink = sink_into(path, carrier, when_full, **more)
    event_count = 0
    reported = None
    for number in range(WINDOWS):
        event_count += ROWS
        reported = message_of(lambda: sink.write(window(ROWS, first_value + number * ROWS)))  # noqa: B023
        if reported is not None:
            break
    return sink.close(), event_count, reported


@FAULT
@pytest.mark.parametrize("mood", ["take", "hold"])
@pytest.mark.parametrize("when_full", ["refuse", "drop-oldest"])
def test_a_spool_loses_nothing_uncounted_whatever_call_fails(
    tmp_path: Path, when_full: str, mood: str, error: int, lasts: bool
) -> None:
    with FailingDisk(tmp_path) as disk:
        life(tmp_path / "spool", when_full, Holding(mood), 0)
        life(tmp_path / "spool", when_full, Holding(), 0)
        for number in chosen(list(disk.calls)):
            path = tmp_path / f"spool-{number}"
            disk.fail_at(number, error, lasts=lasts, of=path_is(path))
            carriers = [Holding(mood), Holding(), Holding()]
            lives = []
            for place, carrier in enumerate(carriers[:2]):
                try:
                    reported, inputs, failure = life(
                        path, when_full, carrier, place * ROWS * WINDOWS
                    )
                except SinkError as refused:  # the spool cannot be opened: the run does not start
                    assert str(path) in str(refused)  # noqa: PT017
                    continue
                total = reported.delivered + reported.spooled + reported.dropped + reported.withheld
                assert total == inputs + reported.recovered, (number, reported, inputs)
                assert (failure is None) or reported.dropped > 0, (number, failure)
                lives.append((reported, place, inputs))
            disk.heal()
            remaining, _, _ = life(path, when_full, carriers[2], 2 * ROWS * WINDOWS)
            assert (remaining.spooled, remaining.dropped) == (0, 0), (number, remaining)
            examine(lives, remaining, carriers)


def examine(
    lives: Sequence[tuple[Any, int, int]], remaining: Any, carriers: Sequence[Holding]
) -> None:
    """Hold what arrived against what was given: what is missing is counted, each sensor's events
    are in order.
    """
    arrived = dict.fromkeys(name for carrier in carriers for name in carrier.ids)
    all_ids = ids_of(window(3 * ROWS * WINDOWS))
    given_ids = [
        name for _, place, count in lives for name in all_ids[place * ROWS * WINDOWS :][:count]
    ]
    given_ids += all_ids[2 * ROWS * WINDOWS :]
    missing = set(given_ids) - set(arrived)
    assert set(arrived) <= set(given_ids)
    assert len(missing) <= sum(reported.dropped for reported, _, _ in lives)
    in_order = [name for name in given_ids if name in arrived]
    for sensor in range(len(SENSORS)):
        place = {
            name: number for number, name in enumerate(all_ids) if number % len(SENSORS) == sensor
        }
        assert [name for name in arrived if name in place] == [
            name for name in in_order if name in place
        ]


@pytest.mark.parametrize("lasts", [False, True])
@pytest.mark.parametrize("survives_power_cut", [False, True])
def test_a_spool_that_waits_for_its_disk_drops_nothing(
    tmp_path: Path, survives_power_cut: bool, lasts: bool
) -> None:
    more = {"survives_power_cut": survives_power_cut}
    with FailingDisk(tmp_path) as disk:
        life(tmp_path / "spool", "wait", Holding(), 0, **more)
        opened = next(at for at, call in enumerate(disk.calls) if call == ("write", "spool-wal"))
        for number in (n for n in chosen(list(disk.calls), [*WRITING, READ]) if n > opened + 4):
            path = tmp_path / f"spool-{number}"
            carrier = Holding()
            patient = Policy(when_full="wait", wait_s=20.0, stall_s=5.0)
            sink = sink_into(path, carrier, "wait", patient, **more)
            disk.fail_at(
                number - opened - 4,
                errno.EIO,
                lasts=lasts,
                kinds=[*WRITING, READ],
                of=path_is(path),
            )
            reported = []
            writing = threading.Thread(
                target=lambda: reported.extend(  # noqa: B023
                    message_of(lambda: sink.write(window(ROWS, place * ROWS)))  # noqa: B023
                    for place in range(WINDOWS)
                )
            )
            writing.start()
            writing.join(0.1)
            disk.heal()
            writing.join(20.0)
            assert reported == [None] * WINDOWS
            counts = sink.close()
            assert (counts.delivered, counts.dropped, counts.complaint) == (
                ROWS * WINDOWS,
                0,
                None,
            ), number
            assert list(dict.fromkeys(carrier.ids)) == ids_of(window(ROWS * WINDOWS))
            assert spool_state(path).events == 0


@FAULT
def test_a_spooled_file_is_whole_after_it_is_run_again(
    tmp_path: Path, error: int, lasts: bool
) -> None:
    def plan_in(folder: Path) -> Plan:
        spool = {"path": str(folder / "spool")}
        return plan_of(2, {"jsonl": {"path": str(folder / "e.jsonl"), "spool": spool}})

    with FailingDisk(tmp_path) as disk:
        (tmp_path / "sound").mkdir()
        run_into(tmp_path / "sound", plan_in(tmp_path / "sound"))
        expected_lines = (tmp_path / "sound" / "e.jsonl").read_bytes().splitlines()
        for number in chosen(list(disk.calls)):
            folder = tmp_path / f"run-{number}"
            folder.mkdir()
            plan = plan_in(folder)
            disk.fail_at(number, error, lasts=lasts)
            reported = message_of(lambda: run_into(folder, plan))  # noqa: B023
            disk.heal()
            lines = (
                (folder / "e.jsonl").read_bytes().splitlines()
                if (folder / "e.jsonl").exists()
                else []
            )
            assert reported is not None or list(dict.fromkeys(lines)) == expected_lines, number
            run_into(folder, plan)
            lines = (folder / "e.jsonl").read_bytes().splitlines()
            assert list(dict.fromkeys(lines)) == expected_lines, number
            assert all(json.loads(line) for line in lines)


def test_an_incomplete_line_is_removed_before_the_next(
    tmp_path: Path,
) -> None:
    """A retried output would otherwise append to half a line, and lose the event of that line."""
    path = tmp_path / "lines"
    lines = ENCODER.encode(window(21)).splitlines()
    with FailingDisk(tmp_path) as disk:
        file = LineFile(str(path), ENCODER)
        file.write(window(10))
        disk.fail_at(1, SHORT, lasts=True)
        assert "input/output error" in str(message_of(lambda: file.write(window(11, 10))))
        assert path.read_bytes().splitlines()[-1] not in lines
        assert "input/output error" in str(message_of(lambda: file.write(window(11, 10))))
        disk.heal()
        file.write(window(11, 10))
        file.close()
    values = path.read_bytes().splitlines()
    assert list(dict.fromkeys(values)) == lines
