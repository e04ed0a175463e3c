"""A published benchmark set of boost-phase tracking by line of sight: make it, and score trackers
on it.

    python benchmarks/tracking_set/tracking_set.py --generate FOLDER     # the set anew, the same bytes
    python benchmarks/tracking_set/tracking_set.py --write docs/benchmarks

`--generate` writes the scenes, flights, lines of sight and bounds (CSV, JSON and Parquet, CC0) and
compares them with the committed digests; `--seeds 1 3 5` makes others to tune on. Without it the
set is made in a temporary folder, the trackers of opir, Stone Soup's and a labelled multi-Bernoulli
filter run on it, and `opir score` judges all alike.
"""

import argparse
import csv
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[1]))

from opir_scoring.benchmark_figures import figures_by_case, scored_set
from result_files import read_csv, write_csv
from set_cases import CASES, SEEDS
from set_files import VERSION, table_text, write_set
from set_trackers import HEADER, TRACKERS, detections_of, rows_of, tracks_of
from tracking_set_page import page

DIGESTS = Path(__file__).with_name("digests.json")
#: The file in the folder of a set that keeps processor times, s.
TIMES = "processor_s.json"


def differences(digests: Mapping[str, Mapping[str, str]]) -> list[str]:
    """Return the scenes and tables whose digests are not the committed ones, of those that have
    any.
    """
    kept = json.loads(DIGESTS.read_text(encoding="utf-8"))
    whole = len(digests["scenes"]) == len(kept["scenes"])
    names = ("scenes", "tables") if whole else ("scenes",)
    return [
        name
        for part in names
        for name, digest in digests[part].items()
        if kept[part].get(name, digest) != digest
    ]


def run(folder: Path, names: Sequence[str]) -> None:
    """Write the tracks of trackers on a set beside it."""
    description = json.loads((folder / "set.json").read_text(encoding="utf-8"))
    seen: dict[str, list[dict[str, str]]] = {}
    for row in read_csv(folder / "lines_of_sight.csv"):
        seen.setdefault(row["scene"], []).append(row)
    for name in names:
        with timed(folder, name):
            rows = []
            for scene in description["scenes"]:
                tracks = tracks_of(
                    scene, description["epoch"], detections_of(seen[scene["scene"]], scene), name
                )
                rows += rows_of(scene["scene"], tracks, description["tick_s"])
        (folder / tracks_file(name)).write_bytes(table_text(HEADER, rows))


@contextmanager
def timed(folder: Path, name: str) -> Iterator[None]:
    """Keep the processor time of what is done, in the folder of the set."""
    folder.mkdir(parents=True, exist_ok=True)
    began = time.process_time()
    yield
    spent = time.process_time() - began
    (folder / TIMES).write_text(
        json.dumps({**times_of(folder), name: spent}, indent=1) + "\n", encoding="utf-8"
    )
    sys.stdout.write(f"{name}: {spent:.0f} s of processor time\n")


def times_of(folder: Path) -> dict[str, float]:
    """Return the processor times that were kept, s."""
    place = folder / TIMES
    return dict(json.loads(place.read_text(encoding="utf-8"))) if place.exists() else {}


def tracks_file(name: str) -> str:
    """Return the name of the file of a tracker's tracks."""
    return "tracks of " + name.replace(",", "") + ".csv"


def results(folder: Path) -> Iterator[dict[str, str]]:
    """Yield a row of figures for each tracker with tracks and each case, and for all cases."""
    spent = times_of(folder)
    for name in [each for each in TRACKERS if (folder / tracks_file(each)).exists()]:
        _, scores = scored_set(folder, folder / tracks_file(name))
        for case, figures in figures_by_case([each for _, each in scores]).items():
            low, high = figures.pop("cutoff_m")
            held = figures.pop("held_95")
            yield {
                "tracker": name,
                "case": case,
                **{key: f"{value:.4g}" for key, value in figures.items()},
                "cutoff_least_m": f"{low:g}",
                "cutoff_most_m": f"{high:g}",
                "held_95": f"{held['value']:.4f}",
                **{
                    f"held_95_{end}95": f"{x:.4f}"
                    for end, x in zip(("low", "high"), held["interval_95"], strict=True)
                },
                "processor_s": f"{spent[name]:.0f}" if case == "all" else "",
                "version": version_of(name),
            }


def version_of(name: str) -> str:
    """Return the version of what a tracker comes from."""
    return (
        f"Stone Soup {version('stonesoup')}"
        if name.startswith("Stone Soup")
        else f"opir {version('opir-core')}"
    )


def scored(arguments: argparse.Namespace) -> list[dict[str, str]]:
    """Make the set where there is none, run the trackers and return the rows of figures."""
    names = arguments.trackers
    if names is None:
        names = [name for name in TRACKERS if "Stone" not in name or find_spec("stonesoup")]
    with tempfile.TemporaryDirectory() as folder:
        place = arguments.set or Path(folder)
        if not (place / "set.json").exists():
            generated(place, arguments)
        run(place, names)
        with timed(place, "scores"):
            rows = list(results(place))
        rest = {name: value for name, value in times_of(place).items() if name in ("set", "scores")}
    return [
        *rows,
        *(
            {"tracker": name, "case": "all", "processor_s": f"{value:.0f}"}
            for name, value in rest.items()
        ),
    ]


def generated(folder: Path, arguments: argparse.Namespace) -> bool:
    """Write the set into a folder; return whether it is the published one."""
    with timed(folder, "set"):
        digests: Any = write_set(folder, arguments.cases, arguments.seeds)
    if arguments.keep_digests:
        DIGESTS.write_text(
            json.dumps({"version": VERSION, **digests}, indent=1) + "\n", encoding="utf-8"
        )
    return report(digests)


def report(digests: Mapping[str, Mapping[str, str]]) -> bool:
    """Say whether the set is the published one; return it."""
    wrong = differences(digests)
    words = (
        f"differs from version {VERSION}: {', '.join(wrong)}" if wrong else f"as version {VERSION}"
    )
    sys.stdout.write(f"{len(digests['scenes'])} scenes, {words}\n")
    return not wrong


def filled(rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """Return rows with the same columns."""
    return [{name: row.get(name, "") for name in rows[0]} for row in rows]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--generate",
        type=Path,
        metavar="FOLDER",
        help="write the set into this folder, and no more",
    )
    parser.add_argument(
        "--keep-digests", action="store_true", help="commit the digests of what is written"
    )
    parser.add_argument(
        "--set",
        type=Path,
        metavar="FOLDER",
        help="a set that was written before; tracks go there too",
    )
    parser.add_argument(
        "--cases", nargs="+", default=list(CASES), choices=list(CASES), metavar="CASE"
    )
    parser.add_argument(
        "--seeds", nargs="+", type=int, default=list(SEEDS), help="odd ones are free to tune on"
    )
    parser.add_argument(
        "--trackers",
        nargs="*",
        metavar="TRACKER",
        help="run these alone (of "
        + "; ".join(TRACKERS)
        + "); all with tracks in the folder of the set are scored",
    )
    parser.add_argument("--write", type=Path, help="folder for the page and the data")
    parser.add_argument("--from-csv", type=Path, help="folder with the data of an earlier run")
    arguments = parser.parse_args()
    if arguments.generate:
        return 0 if generated(arguments.generate, arguments) else 1
    folder = arguments.from_csv or arguments.write
    rows = (
        read_csv(folder / "tracking_set.csv") if arguments.from_csv else filled(scored(arguments))
    )
    if folder is None:
        csv.writer(sys.stdout, lineterminator="\n").writerows(
            [list(rows[0]), *(row.values() for row in rows)]
        )
    else:
        write_csv(folder / "tracking_set.csv", rows)
        (folder / "tracking_set.md").write_text(page(rows), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
