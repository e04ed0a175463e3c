"""The built-in sinks: whole lines, exact counts, complaints that say where and what to do."""

import io
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from opir_core.builtin.encoders import ENCODERS
from opir_core.builtin.line_file import LineFile
from opir_core.builtin.sinks import SINKS
from opir_core.errors import ModelError, SinkError
from opir_core.events import blocks
from opir_core.fields import field_infos
from opir_core.protocols import Delivery, Encoder, EncoderContext, SinkContext
from opir_core.testing import stub_sensor
from opir_core.testing.windows import stub_window

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


def encoder() -> Encoder:
    made: Encoder = ENCODERS[0].build(ENCODERS[0].config(), EncoderContext(sensors=(stub_sensor(),), epoch_us=0))
    return made


def sink(name: str, make_encoder: Callable[[], Encoder] = encoder, **config: Any) -> Any:
    (component,) = (each for each in SINKS if each.name == name)
    return component.build(component.config(**config), SinkContext(make_encoder=make_encoder, scene_name="stub"))


def never() -> Encoder:
    raise AssertionError("this sink has nothing to encode")


def python(program: str, *arguments: str) -> "subprocess.CompletedProcess[bytes]":
    opening = (
        "import sys, os, signal\n"
        "from opir_core.builtin.line_file import LineFile\n"
        "from opir_core.errors import SinkError\n"
        "from opir_core.events.forge import ForgeEncoder\n"
        "from opir_core.protocols import EncoderContext\n"
        "from opir_core.testing import stub_sensor\n"
        "from opir_core.testing.windows import stub_window\n"
        "encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))\n"
    )
    # As for a user: what is printed waits in Python's buffer.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", opening + program, *arguments]
    return subprocess.run(command, capture_output=True, check=False, env=environment)


def test_the_sinks_and_encoders_are_those_the_documentation_names() -> None:
    assert [each.name for each in SINKS] == ["jsonl", "memory", "null"]
    assert [each.name for each in ENCODERS] == ["forge", "forge-bands", "forge-c2", "udl"]


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
    path, most = tmp_path / "events.jsonl", 0
    inner = encoder()

    class Watched:
        content_type, schema_version = inner.content_type, inner.schema_version

        def encode(self, window: Any) -> bytes:
            nonlocal most
            most = max(most, len(window.detections))
            return inner.encode(window)

    out = LineFile(str(path), Watched())
    out.write(stub_window(2 * blocks.BLOCK_ROWS + 1))
    assert out.close() == Delivery(delivered=2 * blocks.BLOCK_ROWS + 1)
    assert most == blocks.BLOCK_ROWS
    assert path.read_bytes().count(b"\n") == 2 * blocks.BLOCK_ROWS + 1


def test_a_killed_run_leaves_whole_lines(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    done = python(
        "sink = LineFile(sys.argv[1], encoder)\n"
        "for scan in range(50): sink.write(stub_window(3, first_scan=3 * scan))\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n",
        str(path),
    )
    assert done.returncode == -signal.SIGKILL
    assert len([json.loads(line) for line in path.read_text().splitlines()]) == 150


@pytest.mark.parametrize("torn", ["", '{"detection_id":"04', "words of someone else"])
def test_a_line_that_a_killed_run_left_unfinished_is_taken_off_by_the_next_that_appends(
    tmp_path: Path, torn: str
) -> None:
    path = tmp_path / "events.jsonl"
    path.write_text(f'{{"a":1}}\n{torn}', encoding="utf-8")
    LineFile(str(path), encoder(), appends=True).close()
    assert path.read_text(encoding="utf-8") == '{"a":1}\n' + ("" if torn.startswith("{") else torn)


def test_jsonl_writes_to_standard_output() -> None:
    done = python("print('before'); sink = LineFile('-', encoder); sink.write(stub_window(2)); sink.close()")
    assert done.returncode == 0, done.stderr
    assert [line[:16] for line in done.stdout.splitlines()] == [b"before", *2 * [b'{"detection_id":']]


def test_standard_output_stays_open_after_the_sink_is_closed() -> None:
    done = python("sink = LineFile('-', encoder); sink.write(stub_window(1)); sink.close(); print('after')")
    assert done.stdout.splitlines()[-1] == b"after"
    assert done.returncode == 0


def test_standard_output_that_is_no_file_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    with pytest.raises(SinkError, match="standard output is not open for bytes"):
        sink("jsonl", path="-")
    monkeypatch.setattr(sys, "stdout", None)
    with pytest.raises(SinkError, match="give the path of a file"):
        sink("jsonl", path="-")


def test_a_reader_that_is_gone_is_an_error_with_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    out = on_pipe(write_end, monkeypatch)
    with pytest.raises(SinkError, match="broken pipe, after 0 events were delivered; its reader stopped reading"):
        out.write(stub_window(3))
    assert out.close() == Delivery(delivered=0, dropped=3)


def test_a_reader_that_goes_away_is_an_error_with_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    heard = bytearray()

    def listen() -> None:
        while len(heard) < 100_000:
            heard.extend(os.read(read_end, 4096))
        os.close(read_end)

    out = on_pipe(write_end, monkeypatch)
    listener = threading.Thread(target=listen)
    listener.start()
    with pytest.raises(SinkError, match="its reader stopped reading") as caught:
        out.write(stub_window(1000))
    listener.join()
    told = out.close()
    assert f"after {told.delivered} events" in str(caught.value)
    assert told.delivered + told.dropped == 1000
    # What was written and not read when the reader left fits into the pipe.
    line_length = len(encoder().encode(stub_window(1)))
    assert 0 <= told.delivered - heard.count(b"\n") <= 65_536 // line_length + 1


def test_a_pipe_that_does_not_block_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    heard = bytearray()

    def listen() -> None:
        while part := os.read(read_end, 1000):
            heard.extend(part)

    out = on_pipe(write_end, monkeypatch)
    listener = threading.Thread(target=listen)
    listener.start()
    out.write(stub_window(1000))
    assert out.close() == Delivery(delivered=1000)
    listener.join()
    os.close(read_end)
    assert bytes(heard) == encoder().encode(stub_window(1000))


def on_pipe(write_end: int, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return a sink whose standard output is a pipe, which it alone holds open."""
    with os.fdopen(write_end, "w") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        return sink("jsonl", path="-")


@needs_full
def test_a_full_disk_is_an_error_with_a_count() -> None:
    out = sink("jsonl", path=str(FULL))
    with pytest.raises(SinkError) as caught:
        out.write(stub_window(3))
    assert str(caught.value) == (
        "jsonl: /dev/full: no space left on device, after 0 events were delivered;"
        " make room, or give a path on another disk"
    )
    assert out.close() == Delivery(delivered=0, dropped=3)


def test_a_disk_that_fills_leaves_whole_lines_and_an_exact_count(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    done = python(
        "import resource\n"
        "sink = LineFile(sys.argv[1], encoder)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))\n"
        "try:\n"
        "    for scan in range(50): sink.write(stub_window(3, first_scan=3 * scan))\n"
        "except SinkError as error: print(error)\n"
        "told = sink.close(); print(scan, told.delivered, told.dropped)\n",
        str(path),
    )
    assert done.returncode == 0, done.stderr
    complaint, counts = done.stdout.decode().splitlines()
    scan, delivered, dropped = map(int, counts.split())
    lines = path.read_text().splitlines(keepends=True)
    assert all(line.endswith("\n") and json.loads(line) for line in lines)
    assert len(lines) == delivered > 0
    assert delivered + dropped == 3 * (scan + 1)
    assert f"file too large, after {delivered} events were delivered" in complaint


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("missing/deeper/events.jsonl", "no such file or directory; make the folder '{folder}/missing/deeper' or give"),
        ("", "is a directory; give the path of a file in it"),
        ("file/events.jsonl", "not a directory; give a path that may be written"),
        ("x" * 300, "file name too long; give a path that may be written"),
        ("nul\0.jsonl", "is no path"),
        ("half\ud800.jsonl", "is no path"),
    ],
)
def test_a_path_that_cannot_be_opened_is_refused_before_the_run(tmp_path: Path, path: str, message: str) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkError) as caught:
        sink("jsonl", path=f"{tmp_path}/{path}")
    assert message.format(folder=tmp_path) in str(caught.value)
    assert str(caught.value).startswith("jsonl: ")


def test_what_takes_no_bytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        with pytest.raises(SinkError, match="no such device or address; give a path that may be written"):
            sink("jsonl", path=str(path))


def test_an_empty_path_is_refused() -> None:
    with pytest.raises(SinkError, match="jsonl: the path is empty"):
        sink("jsonl", path="")


def test_events_that_cannot_be_encoded_are_dropped_and_said_so(tmp_path: Path) -> None:
    out = sink("jsonl", path=str(tmp_path / "events.jsonl"))
    out.write(stub_window(2))
    with pytest.raises(ModelError):
        out.write(stub_window(3, confidence=2.0))
    assert out.close() == Delivery(delivered=2, dropped=3)


def test_a_file_that_fails_to_close_is_an_error(tmp_path: Path) -> None:
    out = sink("jsonl", path=str(tmp_path / "events.jsonl"))
    os.close(out._descriptor)
    with pytest.raises(SinkError, match="bad file descriptor"):
        out.close()


def test_memory_keeps_windows_and_shows_events() -> None:
    kept = sink("memory")
    windows = [stub_window(2), stub_window(0), stub_window(1, first_scan=2)]
    for window in windows:
        kept.write(window)
    assert kept.close() == Delivery(delivered=3)
    assert kept.windows == windows
    assert len(kept) == 3
    assert kept.lines() == b"".join(map(encoder().encode, windows))
    assert [event["timestamp"][17:19] for event in kept.events()] == ["00", "01", "02"]


def test_memory_without_events_has_none() -> None:
    assert sink("memory").events() == []


def test_memory_and_null_make_no_encoder() -> None:
    for name in ("memory", "null"):
        out = sink(name, make_encoder=never)
        out.write(stub_window(4))
        assert out.close() == Delivery(delivered=4)


@pytest.mark.parametrize("component", SINKS, ids=lambda each: each.name)
def test_defaults_of_every_field_are_told(component: Any) -> None:
    assert all(info.help for info in field_infos(component.config).values())
    assert component.summary
