"""Small inputs with large contents, in a process of its own each: it ends soon, in at most a
gigabyte, with an answer that is promised.
"""

import gzip
import io
import json
import re
import subprocess
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pyarrow = pytest.importorskip("pyarrow")
from pyarrow import parquet  # noqa: E402
from read_files import READER  # noqa: E402
from spoilt_commands import BAD, CODES, MOST_BYTES, TINY, set_of_tracks  # noqa: E402

pytestmark = pytest.mark.slow

LONGEST_S = 120.0
#: Runs a command and prints the most memory of its own: that of a child counts what it was forked from.
RUN = """
import sys
from pathlib import Path
from opir_core.cli.main import main
code = main(sys.argv[1:])
status = Path("/proc/self/status")
sys.stderr.write(status.read_text() if status.exists() else "VmHWM: 0 kB")
sys.exit(code)
"""
HEAD = "time_s,x_ecef_m,y_ecef_m,z_ecef_m\n"
TARGET = TINY["targets"][0]
SENSOR = TINY["sensors"][0]


def scene(**changes: Any) -> dict[str, bytes]:
    return {"scene.yaml": json.dumps({**TINY, **changes}).encode()}


def zipped(content: bytes) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a.csv", content)
    return archive.getvalue()


def columns(count: int, rows: int, groups: int) -> bytes:
    table = pyarrow.table({f"c{number}": [0.0] * rows for number in range(count)})
    written = io.BytesIO()
    with parquet.ParquetWriter(written, table.schema) as file:
        for _ in range(groups):
            file.write_table(table)
    return written.getvalue()


def aliases() -> bytes:
    lines = ["a0: &a0 [x, x]", *(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60))]
    return "\n".join(lines).encode()


def entities() -> bytes:
    names = "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 20))
    return f'<!DOCTYPE a [<!ENTITY a0 "lol">{names}]><gpx><trk>&a19;</trk></gpx>'.encode()


def large_set() -> dict[str, bytes]:
    about = json.loads(set_of_tracks()["set.json"])
    about["scenes"][0] |= {"end_s": 1e12, "launches": 10**6}
    return {name: text.encode() for name, text in set_of_tracks().items()} | {
        "set.json": json.dumps(about).encode()
    }


def satellites() -> bytes:
    (elements,) = json.loads(READER["omm"].example)
    return json.dumps([{**elements, "NORAD_CAT_ID": number} for number in range(30_000)]).encode()


def many_targets() -> dict[str, bytes]:
    return scene(targets=[{**TARGET, "id": f"T{number}"} for number in range(1_000_000)])


IN_FILE = {"sensors": [{"model": "LEO-WIDE", "id": "L", "orbit": {"omm_file": {"path": "a.json"}}}]}

#: Files by name and the command that reads them.
BOMBS: dict[str, tuple[Callable[[], dict[str, bytes]], str]] = {
    "zip": (lambda: {"a.csv": zipped(b"0" * 500_000_000)}, "import a.csv"),
    "gzip": (lambda: {"a.csv": gzip.compress(b"0" * 1_000_000_000, 1)}, "import a.csv"),
    "gzip of numbers": (
        lambda: {"a.csv": gzip.compress(b"1,2,3\n" * 10_600_000, 1)}, "import a.csv"
    ),
    "gzip in gzip": (
        lambda: {"a.gz": gzip.compress(gzip.compress(b"0" * 1_000_000_000, 1))}, "import a.gz"
    ),
    "aliases of YAML": (lambda: {"scene.yaml": aliases()}, "validate scene.yaml"),
    "deep YAML": (lambda: {"scene.yaml": b"a: " + b"[" * 1_000_000}, "validate scene.yaml"),
    "deep JSON": (lambda: {"a.json": b'{"a":' * 5_000_000}, "import a.json"),
    "deep JSON of elements": (
        lambda: {**scene(**IN_FILE), "a.json": b"[" * 1_000_000}, "validate scene.yaml"
    ),
    "deep manifest": (lambda: {"e.jsonl": b"", "e.manifest.json": b"[" * 5_000_000}, "score e.jsonl"),
    "a whole number of a million digits": (
        lambda: {"scene.yaml": b"seed: " + b"9" * 1_000_000}, "validate scene.yaml"
    ),
    "numbers of JSON of a million digits": (
        lambda: {"a.json": b'[{"time_s":' + b"9" * 1_000_000 + b"}]"}, "import a.json"
    ),
    "a large exponent": (lambda: {"scene.yaml": b"duration_s: 1e999999999"}, "validate scene.yaml"),
    "a long scene": (lambda: scene(duration_s=1e15), "run scene.yaml -o e.jsonl"),
    "a short period": (
        lambda: scene(sensors=[{**SENSOR, "scan_period_ms": 1e-6}]), "run scene.yaml -o e.jsonl"
    ),
    "a short cadence": (
        lambda: scene(tracker={"model": "kepler-arc", "cadence_s": 1e-9}), "run scene.yaml -o e.jsonl"
    ),
    "a million targets": (many_targets, "validate scene.yaml"),
    "designs without end": (
        scene, "sweep scene.yaml --vary seed=1:1e9:1 --runs 1000000 --executor serial -o s"
    ),
    "rows of Parquet without end": (
        lambda: {"a.parquet": columns(2, 1_000_000, 300)}, "import a.parquet"
    ),
    "columns of Parquet": (lambda: {"a.parquet": columns(10_000, 2, 1)}, "import a.parquet"),
    "one line": (lambda: {"a.csv": b"time_s," * 8_000_000}, "import a.csv"),
    "lines": (
        lambda: {"a.csv": (HEAD + "".join(f"{n},65,{n},0\n" for n in range(2_500_000))).encode()},
        "import a.csv",
    ),
    "blank lines": (lambda: {"a.csv": b"\n" * 2_000_000 + b"x"}, "import a.csv"),
    "objects of JSON": (lambda: {"a.json": b"[" + b"{}," * 20_000_000 + b"{}]"}, "import a.json"),
    "elements of XML": (lambda: {"a.gpx": b"<gpx>" + b"<a/>" * 15_000_000}, "import a.gpx"),
    "entities of XML": (lambda: {"a.gpx": entities()}, "import a.gpx"),
    "satellites of one name": (
        lambda: {"a.json": satellites()}, "import a.json --sensors LEO-WIDE --out s.yaml"
    ),
    "a fine grid": (scene, "coverage scene.yaml --geometry --grid 0.001 -o c"),
    "a set of long scenes": (large_set, "score . --tracks tracks.csv"),
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_soon_in_little_memory(name: str, tmp_path: Path) -> None:
    files, command = BOMBS[name]
    for file, content in files().items():
        (tmp_path / file).write_bytes(content)
    answer = subprocess.run(
        [sys.executable, "-c", RUN, *command.split()],
        cwd=tmp_path,
        capture_output=True,
        check=False,
        text=True,
        timeout=LONGEST_S,
    )
    printed, _, status = answer.stderr.rpartition("Name:")
    assert answer.returncode in CODES, answer.stderr
    assert not BAD.search(printed), printed
    peak = re.search(r"VmHWM:\s*(\d+)", status or answer.stderr)
    assert peak is not None
    assert 1024 * int(peak[1]) < MOST_BYTES
