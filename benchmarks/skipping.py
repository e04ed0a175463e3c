"""What each optional part costs a scene that names it, and a scene that does not: modules, calls,
memory and time.

The scene is `examples/first_light.yaml`, with what each part needs beside it; the parts are those
of `skipping.yaml`. Calls and allocations are those of the part's own modules in a whole process;
what the interpreter does while it imports a module is no call. Times are processor time of whole
processes, medians of interleaved runs.
"""

import inspect
import json
import statistics
import subprocess
import sys
import tempfile
import tracemalloc
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

import yaml
from attrs import field, frozen
from pages import markdown_table, options_of, publish
from startup import process_s

SCENE = Path(__file__).resolve().parents[1] / "examples" / "first_light.yaml"

#: What happens to the events when a part is named.
SAME = "the same"
FILLED = "fields of tracks are filled"
ADDED = "others are added"
CHANGED = "changed"

#: What all scenes have: a sensor that the Sun never blinds, so that the part can be added.
ALL = ("sensors[0].solar_exclusion_deg=0",)
#: So many parts are in the table of the page; the CSV file has all.
SHOWN = 5

PAGE = """# What a scene does not name costs nothing

What does each optional part cost a scene that names it, and what one that does not?
{answer}

{table}

The dearest {count} of {parts} parts: calls of functions of the part's own modules, bytes that
they hold at the end, and the additional processor time of a process once
`examples/first_light.yaml` names the part; all others are within {rest_ms} ms. *Events*: those of
the sensors and targets that were there before. All settings beside a part are default, but for
the focal plane: it is measured beside `focal_plane: null` with `nei_w_m2: 5e-13`. All counts,
also of scenes that do not name a part: [skipping.csv](skipping.csv).{shared}
"""
HEAD = ("part", "beside", "calls", "kB held", "time, ms", "events")


@frozen
class Part:
    """An optional part, as `skipping.yaml` describes it."""

    name: str
    words: tuple[str, ...] = field(converter=tuple)
    modules: tuple[str, ...] = field(converter=tuple)
    events: str = CHANGED
    beside: tuple[str, ...] = field(default=(), converter=tuple)
    shared: bool = False


PARTS = tuple(
    Part(**entry)
    for entry in yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
)


@frozen
class Use:
    """A run's use of a part's modules: imported ones, calls of functions, bytes allocated."""

    imported: int
    calls: int
    bytes: int

    @classmethod
    def of(cls, modules, run):
        """Return the use of modules, and those inside them, in a run."""

        def total(counts):
            return sum(count for name, count in counts.items() if is_in(name, modules))

        return cls(total(Counter(run["modules"])), total(run["calls"]), total(run["bytes"]))


def is_in(name, modules):
    """Whether a module is one of some, or inside one."""
    return any(name == module or name.startswith(f"{module}.") for module in modules)


def command(words):
    """Return the words of `opir run` for overrides and options."""
    settings = ["run", str(SCENE), "--quiet"]
    for word in (*ALL, *words):
        settings += [word] if word.startswith("--") else ["--set", word]
    return settings


def used(words, folder):
    """Return the modules, calls and bytes of a run in a folder, by module."""
    path = folder / "use.json"
    child = [sys.executable, str(Path(__file__).resolve()), "--child", str(path), *words]
    subprocess.run(child, cwd=folder, check=True)
    return json.loads(path.read_text(encoding="utf-8"))


def child(path, words):
    """Run the scene in this process, counted; write the counts."""
    from opir_core.cli.main import main as opir

    calls = Counter()

    def count(frame, event, _argument):
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
    files = {getattr(module, "__file__", None): name for name, module in [*sys.modules.items()]}
    result = {
        "modules": sorted(sys.modules),
        "calls": {files.get(file, file): number for file, number in calls.items()},
        "bytes": {files.get(row.traceback[0].filename, ""): row.size for row in held},
    }
    path.write_text(json.dumps(result), encoding="utf-8")
    sys.exit(code)


def rows_of(parts, repeat):
    """Yield the row of each part."""
    runs = sorted({part.beside for part in parts} | {(*part.beside, *part.words) for part in parts})
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        turns = [
            [process_s([sys.executable, "-m", "opir_core", *command(run)], folder) for run in runs]
            for _ in range(repeat)
        ]
        times = dict(zip(runs, map(statistics.median, zip(*turns, strict=True)), strict=True))
        counts = {run: used(run, folder) for run in runs}
    for part in parts:
        named = (*part.beside, *part.words)
        idle = Use.of(part.modules, counts[part.beside])
        use = Use.of(part.modules, counts[named])
        yield {
            "part": part.name,
            "beside": ", ".join(part.beside),
            "modules_without": idle.imported,
            "calls_without": idle.calls,
            "bytes_without": idle.bytes,
            "modules": use.imported,
            "calls": use.calls,
            "kilobytes": round(use.bytes / 1024),
            "processor_ms": round(1e3 * (times[named] - times[part.beside])),
            "events": part.events,
        }


def page(table):
    """Return the page."""
    called = [row["part"] for row in table if row["calls_without"]]
    shared = [row["part"] for row in table if row["modules_without"]]
    dearest = sorted(table, key=lambda row: -row["processor_ms"])
    columns = ("part", "beside", "calls", "kilobytes", "processor_ms", "events")
    answer = f"Without being named, none of {len(table)} parts is called."
    if called:
        answer = f"Called without being named: {', '.join(called)}."
    words = f" The modules of {', '.join(shared)} are imported by what is beside them, too."
    return PAGE.format(
        answer=answer,
        table=markdown_table(HEAD, [[row[name] for name in columns] for row in dearest[:SHOWN]]),
        shared=words if shared else "",
        count=min(SHOWN, len(table)),
        parts=len(table),
        rest_ms=max((abs(row["processor_ms"]) for row in dearest[SHOWN:]), default=0),
    )


def main():
    """Measure and write."""
    if sys.argv[1:2] == ["--child"]:
        child(Path(sys.argv[2]), sys.argv[3:])
    options = options_of(__doc__, repeat=5, only=tuple(entry.name for entry in PARTS))
    selected = [entry for entry in PARTS if entry.name in options.only]
    publish(options, page, skipping=rows_of(selected, options.repeat))


if __name__ == "__main__":
    main()
