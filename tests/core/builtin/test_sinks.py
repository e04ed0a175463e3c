"""The built-in sinks: whole lines, exact counts, complaints that say where and what to do."""

import json
import signal
from pathlib import Path
from typing import Any

import pytest
from core_components import HOST
from file_sinks import encoder, python, sink
from json_lines import json_lines
from opir_testing import stub_window

from opir_core.builtin.sinks import LineFile
from opir_core.output.events import encoder_input
from opir_core.plugin import Delivery, Encoder, EventEncoder, SinkModel


def never() -> Encoder:
    raise AssertionError("this sink has nothing to encode")


def test_sinks_and_encoders_are_those_of_the_documentation() -> None:
    assert HOST.names(SinkModel) == ["jsonl", "memory", "null"]
    assert HOST.names(EventEncoder) == ["forge", "forge-bands", "forge-tracks", "tracks"]


def test_jsonl_writes_what_the_encoder_makes(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    out = sink("jsonl", path=str(path))
    windows = [stub_window(3), stub_window(0), stub_window(2, first_scan=3)]
    for window in windows:
        out.write(window)
    assert out.close() == Delivery(delivered=5)
    assert path.read_bytes() == b"".join(map(encoder().encode, windows))


def test_jsonl_overwrites(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text("an older and longer file" * 1000)
    out = sink("jsonl", path=str(path))
    out.write(stub_window(1))
    out.close()
    assert json.loads(path.read_text())["sensor_id"] == "S-1"


def test_jsonl_makes_an_empty_file_of_no_events(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    assert sink("jsonl", path=str(path)).close() == Delivery(delivered=0)
    assert path.read_bytes() == b""


def test_jsonl_holds_nothing_back(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    out = sink("jsonl", path=str(path))
    for count in range(1, 4):
        out.write(stub_window(1))
        assert path.read_bytes().count(b"\n") == count
    out.close()


def test_a_large_window_is_written_block_by_block(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    maximum = 0
    inner = encoder()

    class Watched(Encoder):
        content_type = inner.content_type
        schema_version = inner.schema_version

        def encode(self, window: Any) -> bytes:
            nonlocal maximum
            maximum = max(maximum, len(window.detections))
            return inner.encode(window)

    out = sink("jsonl", make_encoder=Watched, path=str(path))
    out.write(stub_window(2 * encoder_input.BLOCK_ROWS + 1))
    assert out.close() == Delivery(delivered=2 * encoder_input.BLOCK_ROWS + 1)
    assert maximum == encoder_input.BLOCK_ROWS
    assert path.read_bytes().count(b"\n") == 2 * encoder_input.BLOCK_ROWS + 1


def test_a_killed_run_leaves_whole_lines(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    done = python(
        "sink = LineFile(sys.argv[1], encoder)\n"
        "for scan in range(50): sink.write(stub_window(3, first_scan=3 * scan))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n",
        str(path),
    )
    assert done.returncode == -signal.SIGKILL
    assert len(json_lines(path)) == 150


@pytest.mark.parametrize("torn", ["", '{"detection_id":"04', "words of someone else"])
def test_an_unfinished_line_of_a_killed_run_is_removed(tmp_path: Path, torn: str) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text(f'{{"a":1}}\n{torn}', encoding="utf-8")
    LineFile(str(path), encoder(), appends=True).close()
    assert path.read_text(encoding="utf-8") == '{"a":1}\n' + ("" if torn.startswith("{") else torn)


def test_jsonl_writes_to_standard_output() -> None:
    done = python(
        "print('before'); sink = LineFile('-', encoder); sink.write(stub_window(2)); sink.close()"
    )
    assert done.returncode == 0, done.stderr
    assert [line[:16] for line in done.stdout.splitlines()] == [
        b"before",
        *2 * [b'{"detection_id":'],
    ]


def test_standard_output_stays_open_after_the_sink_is_closed() -> None:
    done = python(
        "sink = LineFile('-', encoder); sink.write(stub_window(1)); sink.close(); print('after')"
    )
    assert done.stdout.splitlines()[-1] == b"after"
    assert done.returncode == 0


def test_memory_keeps_windows_and_shows_events() -> None:
    memory = sink("memory")
    windows = [stub_window(2), stub_window(0), stub_window(1, first_scan=2)]
    for window in windows:
        memory.write(window)
    assert memory.close() == Delivery(delivered=3)
    assert memory.windows == windows
    assert len(memory) == 3
    assert memory.lines() == b"".join(map(encoder().encode, windows))
    assert [event["timestamp"][17:19] for event in memory.events()] == ["00", "01", "02"]


def test_memory_without_events_has_none() -> None:
    assert sink("memory").events() == []


def test_memory_and_null_make_no_encoder() -> None:
    for name in ("memory", "null"):
        out = sink(name, make_encoder=never)
        out.write(stub_window(4))
        assert out.close() == Delivery(delivered=4)
