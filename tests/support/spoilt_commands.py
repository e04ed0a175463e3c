"""Commands of `opir` on spoilt files: what each reads, and whether its answer is one of those that
are promised.
"""

import contextlib
import io
import json
import re
import resource
import shlex
import shutil
import signal
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from random import Random
from types import FrameType
from typing import Any, NamedTuple

import yaml
from command_line import main
from live_scene import DIRECTED, mapping
from read_files import READERS
from repository import DATA, EXAMPLES, ROOT
from spoilt_content import WORDS, form_of, spoilt
from spool_transports import filled_spool

#: Exit codes of commands on spoilt files: not that of an internal error, 1.
CODES = (0, 2, 3, 4, 5, 6)
LONGEST_S = 20.0
MOST_BYTES = 1_000_000_000

#: What no answer holds: the names of Python's errors, but for a lack of memory, which is reported, and
#: for what pyarrow says of a damaged file.
BAD = re.compile(
    r"internal error|Traceback|\b(?!TProtocol|MemoryError)[A-Z][A-Za-z]*(Error|Warning|Exception)\b"
)

TINY: dict[str, Any] = {
    "scene": "spoilt",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 40.0,
    "seed": 7,
    "sensors": [
        {"model": "DSP", "id": "A", "orbital_slot_deg": -150.0},
        {"model": "DSP", "id": "B", "orbital_slot_deg": -90.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 2.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
    "tracker": "kepler-arc",
}
TABLE = {"id": "T1", "model": "table", "type": "ICBM", "file": "table.csv", "start_s": 1.0}
ELEMENTS = {"model": "LEO-WIDE", "id": "L", "orbit": {"omm_file": {"path": "elements.json"}}}
PRIOR_LAW = ROOT / "plugins" / "opir_forecast" / "opir_forecast" / "vehicles.json"
PRIOR = {"model": "imm", "boost_prior": "prior.json"}
SLOWER = {**TINY["sensors"][0], "scan_period_ms": 5000.0}
CHANGES = (
    {"lap": 0, "time_ns": 5_000_000_000, "launch": mapping()["targets"][1]},
    {
        "lap": 0,
        "time_ns": 8_000_000_000,
        "settings": {**TINY, "sensors": [SLOWER, *TINY["sensors"][1:]]},
    },
    {"end_ns": 20_000_000_000},
)
STUDY = {
    "study": "s",
    "scene": {**TINY, "duration_s": 10.0, "tracker": "none"},
    "vary": {"sensors[*].scan_period_ms": [5000.0, 10000.0]},
    "runs": 2,
    "executor": "serial",
    "metrics": ["latency", {"detection_by_time": {"times_s": [5.0]}}],
}
RUN = ("events.jsonl", "events.truth.jsonl", "events.tracks.jsonl", "events.manifest.json")
#: Paths and words that settings are spoilt with, beside those of files.
SETTINGS = (
    "duration_s", "seed", "epoch", "sensors", "sensors[*]", "sensors[-1].id", "sensors[0].scan_period_ms",
    "targets[99999999999]", "targets[0].launch.lat_deg", "a.b", "[", "]", "[0]", ".", "=", "", "{}", "[[[[", "1e3",
    "34.7,-120.6,100,270", "34.7,,", "time_s=T", "time_s=T,time_s=U", 'lat="a b', "*",
)  # fmt: skip
COMMANDS = "events.commands.jsonl"
COLUMNS = ("events.parquet", "events.truth.parquet", "events.tracks.jsonl", "events.manifest.json")
SHORT = ("--set", "duration_s=5")


class Kind(NamedTuple):
    """A command in a folder of originals, whose word `{}` is the file that is spoilt, the patterns
    of such files, and how often it comes, by how long it takes.
    """

    folder: str
    files: tuple[str, ...]
    command: str
    share: int = 10


def ending_of(example: str) -> str:
    try:
        json.loads(example)
    except ValueError:
        return "text"
    return "json"


def scene_kinds() -> Iterator[Kind]:
    scenes = (
        "tiny.yaml",
        "live.yaml",
        "directed.yaml",
        *(path.name for path in EXAMPLES.glob("*.yaml")),
    )
    yield Kind("scenes", scenes, "validate {}")
    yield Kind("scenes", scenes, "explain {}")
    tiny = ("tiny.yaml", "live.yaml", "directed.yaml")
    yield Kind("scenes", tiny, "run {} -o out.jsonl --set duration_s=5")
    yield Kind("scenes", ("tiny.yaml",), "coverage {} --geometry --grid 30 --steps 2 -o out", 2)
    yield Kind("scenes", ("first_light.yaml",), "physics budget {} --set detection=snr", 2)
    yield Kind("scenes", ("study.yaml",), "sweep {} -o out -q", 5)
    optimise = "optimise {} --objective 'min latency_s' --evaluations 3 -o out"
    yield Kind("scenes", ("study.yaml",), optimise, 2)
    yield Kind("scenes", ("tiny.yaml",), "tune {} --runs 1 --error p_d=0.1 --set duration_s=5", 2)
    yield Kind("inputs", ("table.csv",), "run in_table.yaml -o out.jsonl -q")
    yield Kind("inputs", ("elements.json",), "run in_elements.yaml -o out.jsonl -q")
    yield Kind("inputs", ("prior.json",), "validate in_prior.yaml")
    yield Kind("inputs", ("prior.json",), "run in_prior.yaml -o out.jsonl -q --set duration_s=5")


def file_kinds() -> Iterator[Kind]:
    files = tuple(
        name for reader in READERS for name in [f"{reader.name}.{ending_of(reader.example)}"]
    )
    yield Kind("files", (*files, "table.parquet", "table.json"), "import {}")
    yield Kind(
        "files",
        (*files, "table.parquet", "table.json"),
        "import {} --out out.csv --site=34.7,-120.6,100,270",
    )
    yield Kind("files", ("omm.json", "tle.text"), "import {} --sensors LEO-WIDE")
    sights = ("events.jsonl", "sights.text", "tdm.text", "events.parquet")
    yield Kind("lines", sights, "track {} --sensors sensors.yaml -o out.jsonl")
    yield Kind("lines", ("sensors.yaml",), "track events.jsonl --sensors {} -o out.jsonl -q")
    yield Kind(
        "lines",
        ("watched.text",),
        "track events.jsonl --sensors sensors.yaml -o out.jsonl --watched {}",
    )
    yield Kind("files", ("flight.text",), "prior fit {} -o out.json", 1)


def run_kinds() -> Iterator[Kind]:
    for folder, files in (("run", RUN), ("run2", (*RUN, COMMANDS)), ("columns", COLUMNS)):
        for command in ("export {} --to geojson -o out", "score {}", "export {} --to csv -o out"):
            yield Kind(folder, files, command.replace("{}", files[0]))
    yield Kind("run", RUN, "report events.jsonl -o out.html --no-data", 2)
    yield Kind("run2", RUN[2:3], "score events.jsonl --tracks {}", 15)
    yield Kind("run", RUN[3:], "rerun {} -o out")
    yield Kind("changes", ("e.changes.jsonl",), "run {} -o out.jsonl")
    yield Kind("changes", ("e.changes.jsonl",), "export {} --to scene -o out.yaml")
    study = ("study.json", "results.parquet", "runs.parquet", "launches.parquet", "shares.parquet")
    yield Kind("study", study, "report . -o out.html --no-data", 5)
    yield Kind("shards", ("one/shard.json", "one/parts/*"), "merge one two -o out -q", 3)
    tables = ("set.json", "truth.csv", "bounds.csv", "tracks.csv", "tracks.json")
    yield Kind("set", tables, "score . --tracks tracks.csv")
    yield Kind("set", tables[-1:], "score . --tracks tracks.json")
    yield Kind("spool", ("spool.bytes",), "spool check {}")
    yield Kind("spool", ("spool.bytes",), "spool salvage {}")


def word_kinds() -> Iterator[Kind]:
    yield Kind("scenes", (), "validate tiny.yaml --set {}={}")
    yield Kind(
        "scenes", (), "physics min-intensity --nei={} --range-km={} --snr={} --transmittance={}"
    )
    yield Kind("files", (), "import csv.text --columns={} --start-s={} --site={} --noise-m={}")


KINDS = (*scene_kinds(), *file_kinds(), *run_kinds(), *word_kinds())


def write_originals(root: Path) -> None:
    """Write the files that are spoilt, each kind of a command in its folder."""
    for name, contents in originals().items():
        folder = root / name
        folder.mkdir()
        for file, content in contents.items():
            (folder / file).write_text(content, encoding="utf-8")
    for path in EXAMPLES.glob("*.yaml"):
        shutil.copy(path, root / "scenes")
    for name, source in (("run2", "run-2"), ("study", "study-3")):
        shutil.copytree(DATA / "formats" / source, root / name)
    made_by_opir(root)
    filled_spool(root / "spool" / "spool.bytes", 4, 20)


def originals() -> Mapping[str, Mapping[str, str]]:
    flight = (EXAMPLES / "ascents" / "crs8.csv").read_text(encoding="utf-8")
    reading = {reader.name: reader.example for reader in READERS}
    times = [0.0, 10.0, 20.0, 30.0]
    records = [
        {
            "time_s": time_s,
            "x_ecef_m": 6.5e6 + 900.0 * time_s,
            "y_ecef_m": 2e3 * time_s,
            "z_ecef_m": 1e5,
        }
        for time_s in times
    ]
    return {
        "scenes": {
            "tiny.yaml": yaml.safe_dump(TINY),
            "live.yaml": yaml.safe_dump(mapping()),
            "directed.yaml": yaml.safe_dump(mapping(**DIRECTED)),
            "study.yaml": yaml.safe_dump(STUDY),
        },
        "inputs": {
            "table.csv": flight,
            "elements.json": reading["omm"],
            "prior.json": PRIOR_LAW.read_text(encoding="utf-8"),
            "in_table.yaml": yaml.safe_dump({**TINY, "targets": [TABLE]}),
            "in_elements.yaml": yaml.safe_dump({**TINY, "sensors": [ELEMENTS], "tracker": "none"}),
            "in_prior.yaml": yaml.safe_dump({**TINY, "tracker": PRIOR}),
        },
        "files": {
            **{f"{reader.name}.{ending_of(reader.example)}": reader.example for reader in READERS},
            "table.json": json.dumps(records),
            "flight.text": flight,
            "table.csv": table_of(records),
        },
        "lines": {
            "sights.text": reading["sights"],
            "tdm.text": reading["tdm"],
            "sensors.yaml": yaml.safe_dump(TINY),
            "watched.text": "sensor_id,start_s,end_s\nA,0,10\nA,12,30\nB,0,40\n",
        },
        "changes": {
            "e.changes.jsonl": "\n".join(
                map(json.dumps, ({"changes_version": "1.1", "loop": False, "scene": TINY}, *CHANGES))
            )
        },
        "set": set_of_tracks(),
        "run": {}, "columns": {}, "shards": {}, "spool": {},
    }  # fmt: skip


def set_of_tracks() -> Mapping[str, str]:
    """Return a benchmark set of one launch, and tracks that are its truth."""
    state = ("x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s")
    bounds = ("position_m", "log_det", "energy_m", "free_position_m")
    truth = [
        {
            "scene": "a-1",
            "launch": "L1",
            "time_s": time_s,
            **dict.fromkeys(state, 1e6 + 100.0 * time_s),
        }
        for time_s in (5.0, 10.0, 15.0, 20.0)
    ]
    limits = [{**row, **dict.fromkeys(bounds, 300.0)} for row in truth]
    tracks = [{"track": "X", **row, "probability": 0.9} for row in truth]
    scene = {"scene": "a-1", "case": "a", "launches": 1, "end_s": 20.0, "cutoff_m": 7500.0}
    about = {"set": "s", "version": "1.0", "tick_s": 5.0, "cases": {"a": "one"}, "scenes": [scene]}
    return {
        "set.json": json.dumps(about),
        "truth.csv": table_of(truth),
        "bounds.csv": table_of(limits, ("scene", "launch", "time_s", *bounds)),
        "tracks.csv": table_of(tracks),
        "tracks.json": json.dumps(tracks),
    }


def table_of(rows: Sequence[Mapping[str, Any]], names: Sequence[str] = ()) -> str:
    """Return rows as a table of CSV."""
    names = names or list(rows[0])
    lines = [",".join(str(row[name]) for name in names) for row in rows]
    return "\n".join([",".join(names), *lines, ""])


def made_by_opir(root: Path) -> None:
    """Write runs and shards by opir itself."""
    tiny = root / "scenes" / "tiny.yaml"
    for folder, ending in (("run", "jsonl"), ("columns", "parquet")):
        answer = answer_to(f"run {tiny} -q -o {root / folder / f'events.{ending}'}", root)
        assert answer.code == 0, answer.text
    for name in ("events.jsonl", "events.parquet"):
        folder = "run" if name.endswith("l") else "columns"
        shutil.copy(root / folder / name, root / "lines" / name)
    for number, name in enumerate(("one", "two"), start=1):
        command = f"sweep {root}/scenes/study.yaml --shard {number}/2 -q -o {root}/shards/{name}"
        answer = answer_to(command, root)
        assert answer.code == 0, answer.text
    shutil.copy(root / "columns" / "events.parquet", root / "files" / "table.parquet")


class Answer(NamedTuple):
    """The exit code of a command, all that it printed, its time and the most bytes resident."""

    code: int | None
    text: str
    elapsed_s: float
    peak_bytes: int

    @property
    def fault(self) -> str | None:
        """Which promise the answer breaks, or None."""
        if self.code not in CODES:
            return f"exit code {self.code}"
        if match := BAD.search(self.text):
            return match.group()
        if self.code and not self.text.strip():
            return "no words"
        if self.elapsed_s > LONGEST_S:
            return f"{self.elapsed_s:.0f} s"
        return f"{self.peak_bytes / 1e6:.0f} MB" if self.peak_bytes > MOST_BYTES else None


class OverdueError(BaseException):
    """A command takes longer than it may."""


@contextlib.contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Raise `OverdueError` in the main thread after a time."""

    def end(_signal: int, _frame: FrameType | None) -> None:
        raise OverdueError(f"longer than {seconds:g} s")

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def answer_to(command: str, folder: Path, *values: str) -> Answer:
    """Return the answer to a command, whose words `{}` are values, in a folder; Python's warnings
    count as errors.
    """
    remaining = iter(values)
    words = [re.sub(r"\{\}", lambda _: next(remaining), word) for word in shlex.split(command)]
    printed = io.StringIO()
    start = forget_peak()
    present_bytes = peak_bytes()  # of what this process has read and kept before
    try:
        with (
            contextlib.chdir(folder), contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed), warnings.catch_warnings(), limited(2 * LONGEST_S),
        ):  # fmt: skip
            warnings.simplefilter("error")
            code: Any = main(words)
    except SystemExit as error:
        code = error.code
    except BaseException as error:
        code = None
        printed.write(f"uncaught {type(error).__name__}: {error}")
    return Answer(code, printed.getvalue(), time.monotonic() - start, peak_bytes() - present_bytes)


def forget_peak() -> float:
    """Begin to measure the most memory anew, where the system can; return the time."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return time.monotonic()


def peak_bytes() -> int:
    """Return the most resident bytes since they were forgotten, or of the process."""
    with contextlib.suppress(OSError):
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return 1024 * int(status.partition("VmHWM:")[2].split()[0])
    scale = 1 if sys.platform == "darwin" else 1024
    return scale * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


class Case(NamedTuple):
    """A command on a spoilt file: what is written where, and the words."""

    kind: Kind
    file: str
    content: bytes
    values: tuple[str, ...]


def case_of(seed: int, root: Path, kinds: Sequence[Kind] = KINDS) -> Case:
    """Return the case of a seed, of originals in a folder."""
    rng = Random(seed)
    (kind,) = rng.choices(kinds, [kind.share for kind in kinds])
    if not kind.files:
        values = tuple(rng.choice((*WORDS, *SETTINGS)) for _ in range(kind.command.count("{}")))
        return Case(kind, "", b"", values)
    folder = root / kind.folder
    path = rng.choice(sorted(folder.glob(rng.choice(kind.files))))
    file = str(path.relative_to(folder))
    content = spoilt(path.read_bytes(), form_of(file), rng)
    return Case(kind, file, content, (file,) * kind.command.count("{}"))


def answer_of(case: Case, root: Path, place: Path) -> Answer:
    """Return the answer to a case, given in a copy of its folder."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(root / case.kind.folder, place)
    if case.file:
        (place / case.file).write_bytes(case.content)
    return answer_to(case.kind.command, place, *case.values)
