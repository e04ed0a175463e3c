"""Sinks in trouble: readers that leave, full disks, paths that do not open: an error, exact counts,
whole lines.
"""

import io
import json
import math
import os
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from file_sinks import encoder, python, sink
from opir_testing import stub_window

from opir_core import ModelError, SinkError
from opir_core.plugin import Delivery

FULL = Path("/dev/full")
needs_full = pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")


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
    with pytest.raises(
        SinkError, match="broken pipe, after 0 events were delivered; its reader stopped reading"
    ):
        out.write(stub_window(3))
    assert out.close() == Delivery(delivered=0, dropped=3)


@contextmanager
def listening(read_end: int, at_most: float) -> Iterator[bytearray]:
    """Hear what is written to a pipe: all of it, or until the listener leaves."""
    heard = bytearray()

    def listen() -> None:
        while len(heard) < at_most and (block := os.read(read_end, 4096)):
            heard.extend(block)
        os.close(read_end)

    listener = threading.Thread(target=listen)
    listener.start()
    yield heard
    listener.join()


def test_a_reader_that_goes_away_is_an_error_with_a_count(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    out = on_pipe(write_end, monkeypatch)
    with (
        listening(read_end, 100_000) as heard,
        pytest.raises(SinkError, match="its reader stopped reading") as caught,
    ):
        out.write(stub_window(1000))
    reported = out.close()
    assert f"after {reported.delivered} events" in str(caught.value)
    assert reported.delivered + reported.dropped == 1000
    # What was written and not read when the reader left fits into the pipe.
    line_length = len(encoder().encode(stub_window(1)))
    assert 0 <= reported.delivered - heard.count(b"\n") <= 65_536 // line_length + 1


def test_a_pipe_that_does_not_block_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    read_end, write_end = os.pipe()
    os.set_blocking(write_end, False)
    out = on_pipe(write_end, monkeypatch)
    with listening(read_end, math.inf) as heard:
        out.write(stub_window(1000))
        assert out.close() == Delivery(delivered=1000)
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
        "reported = sink.close(); print(scan, reported.delivered, reported.dropped)\n",
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
        (
            "missing/deeper/events.jsonl",
            "no such file or directory; create the folder '{folder}/missing/deeper' or give",
        ),
        ("", "is a directory; give the path of a file in it"),
        ("file/events.jsonl", "not a directory; give a writable path"),
        ("x" * 300, "file name too long; give a writable path"),
        ("nul\0.jsonl", "is no path"),
        ("half\ud800.jsonl", "is no path"),
    ],
)
def test_a_path_that_cannot_be_opened_is_refused_before_the_run(
    tmp_path: Path, path: str, message: str
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SinkError) as caught:
        sink("jsonl", path=f"{tmp_path}/{path}")
    assert message.format(folder=tmp_path) in str(caught.value)
    assert str(caught.value).startswith("jsonl: ")


def test_what_takes_no_bytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        with pytest.raises(SinkError, match="no such device or address; give a writable path"):
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
