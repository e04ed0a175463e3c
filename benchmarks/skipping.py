"""What each optional part costs a scene that names it, and a scene that does not: modules, calls,
memory and time.

    python benchmarks/skipping.py [--repeat 5] [--only NAME ...] [--write docs/benchmarks]
    [--from-csv docs/benchmarks]

The scene is `examples/first_light.yaml`, with what each part needs beside it. Calls and allocations
are those of the part's own modules in a whole process; what the interpreter does while it imports a
module is no call. Times are processor time of whole processes, medians of interleaved runs.
`--from-csv` writes the page again.
"""

import argparse
import inspect
import json
import os
import statistics
import subprocess
import sys
import tempfile
import tracemalloc
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from attrs import frozen
from result_files import markdown_table, read_csv, write_csv

SCENE = Path(__file__).resolve().parents[1] / "examples" / "first_light.yaml"

#: What happens to the events when a part is named: nothing, fields of tracks are filled, others are
#: added, or they change, as is meant.
SAME = "the same"
FILLED = "fields of tracks are filled"
ADDED = "others are added"
CHANGED = "changed"


@frozen
class Part:
    """An optional part: what is set beside it, what names it, modules of its own, and what it does
    to the events.

    Words are overrides; those with a dash are words of the command line. Modules are named with
    those inside them; if they are `shared`, what is set beside the part imports them, too, but does
    not call them.
    """

    name: str
    words: tuple[str, ...]
    modules: tuple[str, ...]
    events: str = CHANGED
    beside: tuple[str, ...] = ()
    shared: bool = False


SNR = "detection=snr"
#: A stated noise in place of the focal plane, to see what that costs.
STATED = ("sensors[0].focal_plane=null", "sensors[0].nei_w_m2=5e-13")
AIR = "atmosphere=lowtran"
FOCAL_PLANE = "sensors[0].focal_plane=notional"
PLAIN_SENSOR = "model: DSP, id: DSP-1, orbital_slot_deg: -135.0"

PARTS = (
    Part("radiometry", (SNR,), ("opir_photons.radiometry", "opir_photons.detection.snr")),
    Part("noise-only false alarms", (SNR,), ("opir_core.simulation.false_alarms",)),
    Part(
        "interpolated P_d",
        (SNR,),
        ("opir_core.simulation.interpolation", "opir_core.simulation.refinement"),
    ),
    Part(
        "atmosphere",
        (AIR,),
        ("opir_photons.radiometry.lowtran", "opir_photons.radiometry.long_paths"),
        CHANGED,
        (SNR,),
    ),
    Part(
        "cloud",
        ("atmosphere.cloud={top_km: 5}",),
        ("opir_photons.radiometry.clouds",),
        CHANGED,
        (SNR, AIR),
        True,
    ),
    Part(
        "background",
        ("background=earth",),
        ("opir_photons.radiometry.earth",),
        CHANGED,
        (SNR,),
    ),
    Part(
        "false sources",
        ("sources=[{id: fires, model: fires, at: [{lat_deg: 32.0, lon_deg: -102.0}]}]",),
        ("opir_photons.radiometry.sources", "opir_photons.radiometry.emitters"),
        ADDED,
        (SNR,),
    ),
    Part(
        "Sun", ("sensors[0].solar_exclusion_deg=10",), ("opir_core.geometry.sun",), SAME, (), True
    ),
    Part(
        "focal plane",
        (FOCAL_PLANE,),
        ("opir_photons.radiometry.focal_plane",),
        CHANGED,
        (SNR, *STATED),
        True,
    ),
    Part(
        "tracker",
        ("--tracker=imm",),
        ("opir_trackers", "opir_core.estimation.motion", "opir_core.output.tracks_file"),
        FILLED,
    ),
    Part("forces", ("forces=[j2]",), ("opir_core.flight.integration", "opir_core.flight.dop853")),
    Part(
        "encoder forge-c2",
        (
            (
                "outputs=[{jsonl: {path: events.jsonl}}, {jsonl: {path: other.jsonl, encoder:"
                " forge-c2}}]"
            ),
        ),
        ("opir_export.encoders.forge_c2",),
        SAME,
    ),
    Part(
        "encoder udl",
        ("outputs=[{jsonl: {path: events.jsonl}}, {jsonl: {path: other.jsonl, encoder: udl}}]",),
        ("opir_export.encoders.udl",),
        SAME,
    ),
    Part(
        "constellation",
        (f"sensors=[{{{PLAIN_SENSOR}}}, {{constellation: SBIRS-GEO}}]",),
        ("opir_sbirs",),
        ADDED,
    ),
    Part(
        "latency", ("sensors[0].reporting=paper-ground-chain",), ("opir_core.simulation.reporting",)
    ),
    Part("workers", ("--workers=2",), ("opir_core.simulation.workers",), SAME),
)

#: What all scenes have: a sensor that the Sun never blinds, so that the part can be added.
ALL = ("sensors[0].solar_exclusion_deg=0",)


@frozen
class Use:
    """What a run uses of a part's modules: how many are imported, calls of their functions, bytes
    allocated in them.
    """

    imported: int
    calls: int
    bytes: int

    @classmethod
    def of(cls, modules: Sequence[str], run: dict[str, Any]) -> "Use":
        """Return the use of modules, and those inside them, in a run."""

        def total(counts: dict[str, int]) -> int:
            return sum(count for name, count in counts.items() if is_in(name, modules))

        return cls(
            sum(is_in(name, modules) for name in run["modules"]),
            total(run["calls"]),
            total(run["bytes"]),
        )


def is_in(name: str, modules: Sequence[str]) -> bool:
    """Return whether a module is one of some, or inside one."""
    return any(name == module or name.startswith(f"{module}.") for module in modules)


def command(words: Sequence[str]) -> list[str]:
    """Return the words of `opir run` for overrides and options."""
    given = [
        part
        for word in (*ALL, *words)
        for part in ((word,) if word.startswith("--") else ("--set", word))
    ]
    return ["run", str(SCENE), "--quiet", *given]


def used(words: Sequence[str], folder: Path) -> dict[str, Any]:
    """Return the modules, calls and bytes of a run in a folder, by module."""
    path = folder / "use.json"
    subprocess.run(
        [sys.executable, str(Path(__file__).resolve()), "--child", str(path), *words],
        cwd=folder,
        check=True,
    )
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def child(path: Path, words: Sequence[str]) -> None:
    """Run the scene in this process, counted; write the counts."""
    from opir_core.cli.main import main as opir

    calls: Counter[str] = Counter()

    def count(frame: FrameType, event: str, _argument: object) -> None:
        # Bodies of modules and classes run at import and are not optimised code; neither counts
        # what they call.
        caller = frame.f_back
        by_function = caller is None or caller.f_code.co_flags & inspect.CO_OPTIMIZED
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED and by_function:
            calls[frame.f_code.co_filename] += 1

    tracemalloc.start()
    sys.setprofile(count)
    code = opir(command(words))
    sys.setprofile(None)
    held = tracemalloc.take_snapshot().statistics("filename")
    tracemalloc.stop()
    names = {
        file: name
        for name, module in list(sys.modules.items())
        if (file := getattr(module, "__file__", None))
    }
    result = {
        "modules": sorted(sys.modules),
        "calls": {names.get(file, file): number for file, number in calls.items()},
        "bytes": {
            names.get(file, file): row.size for row in held for file in [row.traceback[0].filename]
        },
    }
    path.write_text(json.dumps(result), encoding="utf-8")
    sys.exit(code)


def processor_s(words: Sequence[str], folder: Path) -> float:
    """Return the processor time of a whole process that runs the scene."""
    before = os.times()
    subprocess.run([sys.executable, "-m", "opir_core", *command(words)], cwd=folder, check=True)
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


def measured(parts: Sequence[Part], repeat: int, folder: Path) -> list[dict[str, str]]:
    """Return the row of each part."""
    runs = sorted({part.beside for part in parts} | {(*part.beside, *part.words) for part in parts})
    times: dict[tuple[str, ...], list[float]] = {words: [] for words in runs}
    for _ in range(repeat):
        for words in runs:
            times[words].append(processor_s(words, folder))
    counted = {words: used(words, folder) for words in runs}
    rows = []
    for part in parts:
        without = part.beside
        named = (*part.beside, *part.words)
        off = Use.of(part.modules, counted[without])
        on = Use.of(part.modules, counted[named])
        cost_s = statistics.median(times[named]) - statistics.median(times[without])
        rows.append(
            {
                "part": part.name,
                "beside": ", ".join(part.beside),
                "modules_without": str(off.imported),
                "calls_without": str(off.calls),
                "bytes_without": str(off.bytes),
                "modules": str(on.imported),
                "calls": str(on.calls),
                "kilobytes": f"{on.bytes / 1024:.0f}",
                "processor_ms": f"{1e3 * cost_s:.0f}",
                "events": part.events,
            }
        )
    return rows


PAGE = """# What a scene does not name costs nothing

What does each optional part cost a scene that names it, and what one that does not?
{answer}

{table}

The dearest {count} of {parts} parts: calls of functions of the part's own modules, bytes that they hold at the end, and
the additional processor time of a process once `examples/first_light.yaml` names the part; all others are within
{rest_ms} ms. *Events*: those of the sensors and targets that were there before. All settings beside a part are default,
but for the focal plane: it is measured beside `focal_plane: null` with `nei_w_m2: 5e-13`.
All counts, also of scenes that do not name a part: [skipping.csv](skipping.csv).{shared}
"""

HEAD = ("part", "beside", "calls", "kB held", "time, ms", "events")

#: So many parts are in the table of the page; the CSV file has all.
SHOWN = 5


def write_page(folder: Path) -> None:
    """Write the page from the CSV file of a folder."""
    rows = read_csv(folder / "skipping.csv")
    called = [row["part"] for row in rows if int(row["calls_without"])]
    shared = [row["part"] for row in rows if int(row["modules_without"])]
    dearest = sorted(rows, key=lambda row: -int(row["processor_ms"]))
    lines = [
        tuple(
            row[name] for name in ("part", "beside", "calls", "kilobytes", "processor_ms", "events")
        )
        for row in dearest[:SHOWN]
    ]
    answer = (
        f"Called without being named: {', '.join(called)}."
        if called
        else f"Without being named, none of {len(rows)} parts is called."
    )
    text = (
        f" The modules of {', '.join(shared)} are imported by what is beside them, too."
        if shared
        else ""
    )
    page = PAGE.format(
        answer=answer,
        table=markdown_table(HEAD, lines),
        shared=text,
        count=len(lines),
        parts=len(rows),
        rest_ms=max((abs(int(row["processor_ms"])) for row in dearest[SHOWN:]), default=0),
    )
    (folder / "skipping.md").write_text(page, encoding="utf-8")


def main() -> None:
    """Measure and print; write where asked."""
    if sys.argv[1:2] == ["--child"]:
        child(Path(sys.argv[2]), sys.argv[3:])
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument(
        "--only", nargs="+", choices=[part.name for part in PARTS], help="these parts"
    )
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    parser.add_argument("--from-csv", type=Path, metavar="FOLDER")
    given = parser.parse_args()
    if given.from_csv:
        write_page(given.from_csv)
        return
    with tempfile.TemporaryDirectory() as folder:
        parts = [part for part in PARTS if not given.only or part.name in given.only]
        rows = measured(parts, given.repeat, Path(folder))
    for row in rows:
        print(",".join(row.values()))
    if given.write:
        write_csv(given.write / "skipping.csv", rows)
        write_page(given.write)


if __name__ == "__main__":
    main()
