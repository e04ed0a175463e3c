"""A published benchmark set of boost-phase tracking by line of sight: make it, and score trackers
on it.

    python benchmarks/tracking_set/tracking_set.py --generate FOLDER     # the set anew, the same
    bytes python benchmarks/tracking_set/tracking_set.py --write docs/benchmarks

`--generate` writes the scenes, flights, lines of sight and bounds (CSV, JSON and Parquet, CC0) and
compares them with the committed digests (`--keep-digests` commits those of what is written);
`--seeds 1 3 5` makes others to tune on. Without it the set is made in a temporary folder (or that
of `--set`, where tracks stay), the trackers of opir, Stone Soup's and a labelled multi-Bernoulli
filter run on it, and `opir score` judges all alike.
"""

import json
import os
import sys
import tempfile
import time
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.append(str(Path(__file__).resolve().parents[1]))

from opir_scoring.benchmark_figures import figures_by_case, scored_set
from pages import (
    Table,
    draw_lines,
    interval_text,
    markdown_table,
    options_of,
    publish,
    read_csv,
    svg_plot,
)
from set_cases import CASES, SEEDS
from set_files import CUTOFF_OF_BOUND, VERSION, table_text, write_set
from set_trackers import HEADER, TRACKERS, detections_of, rows_of, tracks_of

DIGESTS = Path(__file__).with_name("digests.json")
#: The file in the folder of a set that keeps processor times, s.
TIMES = "processor_s.json"
#: The share of states in their 95 % ellipsoids above which a tracker counts as consistent.
HELD = 0.9
ALL = "all"

PAGE = """# Tracking set

How well does a tracker follow boosts by lines of sight alone, on flights that follow no tracker's
prior? {verdict}

![GOSPA over the cut-off, and energy score over the bound's, by case and tracker](tracking_set.svg)

{cases} cases of {seeds} scenes each, version {version}, free for any use (CC0): flights, sensors,
lines of sight, bounds and scores. [Enter your own
tracker](../how-to/enter-the-tracking-benchmark.md).

```
python benchmarks/tracking_set/tracking_set.py --generate tracking-set
opir score tracking-set --tracks my_tracks.csv
```

{table}

`kepler-arc` fits free flights: while a target burns it is mostly off by more than c, and its
tracks are false.

False: tracks of no launch; missed: launches without a track, of {launches}. GOSPA/c: of positions,
per launch, mean over ticks, over the cut-off c, {cutoff:g} times the median bound of position in
each scene; a launch missed at a tick costs 0.71. /bound: RMS of the error over the bound that
knows the law of flights, and mean energy score over an efficient tracker's. Log: log score of the
state, nats above it. NEES/6: median; 0.89 is consistent. [All
definitions](../how-to/enter-the-tracking-benchmark.md#score).

## How it is made

* **Cases**: {questions}.
* **Flights** are point masses with thrust, drag and gravity, integrated by the set itself: no code
  and no curve of opir's target models or trackers. One to three stages, dark times of 4 to 15 s in
  `gaps`, thrust off the velocity by a constant angle in upper stages; laws of all parameters in
  `benchmarks/tracking_set/set_flights.py`.
* **Lines of sight** have normal errors of the stated standard deviation, isotropic across the
  line; a burning target above the horizon is detected with P_d 0.95, a dark one never; light takes
  no time. In `wrong-noise` 30 % of the errors are three times as large as stated, in
  `bias-unstated` a bias of 60 µrad is not stated.
* **Bounds**: the posterior Cramér–Rao bound of the flight's parameters under their laws, with
  biases as unknowns and known association (van Trees); and one with unknown thrust. A tracker that
  does not know the law stays above the first.
* **Scored** is a launch from its third detection to 20 s after its last burnout, every 5 s.
* **Trackers** know what `set.json` says: noise, P_d, density of clutter, bias; nothing was tuned
  to the set. opir's have a scene with `detection: constant` and `classification: none`. The Stone
  Soup trackers are those of [opir's adapter](../how-to/stone-soup.md) at its defaults. The LMB
  filter is a labelled multi-Bernoulli filter with one normal distribution a label and belief
  propagation (`benchmarks/tracking_set/set_lmb.py`); Stone Soup has none. Rows of `imm` with
  P(launch) of at most 0.5 are left out; its states are scored as normal distributions, without the
  radii that it reports. Versions: {versions}.

A full run takes {spent:.0f} s of processor time: {times}. All figures by case:
[tracking_set.csv](tracking_set.csv).
"""
#: Columns of the table, and their heads.
COLUMNS = {
    "covered": "covered",
    "false_tracks": "false",
    "missed_launches": "missed",
    "gospa_over_cutoff": "GOSPA/c",
    "error_over_bound": "error /bound",
    "energy_over_bound": "energy /bound",
    "log_score_above_bound": "log",
    "nees_over_6_median": "NEES/6",
}


def changed(digests):
    """Return the scenes and tables whose digests are not the committed ones, of those that have
    any.
    """
    committed = json.loads(DIGESTS.read_text(encoding="utf-8"))
    is_complete = len(digests["scenes"]) == len(committed["scenes"])
    return [
        name
        for part in (("scenes", "tables") if is_complete else ("scenes",))
        for name, digest in digests[part].items()
        if committed[part].get(name, digest) != digest
    ]


def generated(folder, options):
    """Write the set into a folder; print and return whether it is the published one."""
    with timed(folder, "set"):
        digests = write_set(folder, options.cases, options.seeds)
    if options.keep_digests:
        text = json.dumps({"version": VERSION, **digests}, indent=1)
        DIGESTS.write_text(text + "\n", encoding="utf-8")
    names = changed(digests)
    words = (
        f"differs from version {VERSION}: {', '.join(names)}" if names else f"as version {VERSION}"
    )
    print(f"{len(digests['scenes'])} scenes, {words}")
    return not names


def run(folder, names):
    """Write the tracks of trackers on a set beside it."""
    description = json.loads((folder / "set.json").read_text(encoding="utf-8"))
    sights = read_csv(folder / "lines_of_sight.csv")
    for name in names:
        with timed(folder, name):
            rows = []
            for scene in description["scenes"]:
                detections = detections_of(sights.where(scene=scene["scene"]), scene)
                tracks = tracks_of(scene, description["epoch"], detections, name)
                rows += rows_of(scene["scene"], tracks, description["tick_s"])
        tracks_file(folder, name).write_bytes(table_text(HEADER, rows))


@contextmanager
def timed(folder, name):
    """Keep the processor time of the block in the folder of the set."""
    folder.mkdir(parents=True, exist_ok=True)
    start_s = time.process_time()
    yield
    spent_s = time.process_time() - start_s
    text = json.dumps({**times_of(folder), name: spent_s}, indent=1)
    (folder / TIMES).write_text(text + "\n", encoding="utf-8")
    print(f"{name}: {spent_s:.0f} s of processor time")


def times_of(folder):
    """Return the stored processor times, s."""
    path = folder / TIMES
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def tracks_file(folder, name):
    """Return the file of a tracker's tracks."""
    return folder / f"tracks of {name.replace(',', '')}.csv"


def tracker_rows(folder, name):
    """Yield the figures of a tracker in each case, and in all."""
    _, scores = scored_set(folder, tracks_file(folder, name))
    source = "stonesoup" if name.startswith("Stone Soup") else "opir-core"
    title = "Stone Soup" if name.startswith("Stone Soup") else "opir"
    for case, figures in figures_by_case([score for _, score in scores]).items():
        low, high = figures.pop("cutoff_m")
        held = figures.pop("held_95")
        held_low, held_high = held["interval_95"]
        yield {
            "tracker": name,
            "case": case,
            **figures,
            "cutoff_least_m": low,
            "cutoff_most_m": high,
            "held_95": held["value"],
            "held_95_low95": held_low,
            "held_95_high95": held_high,
            "processor_s": times_of(folder)[name] if case == ALL else "",
            "version": f"{title} {version(source)}",
        }


def set_rows(options):
    """Make the set where there is none, run the trackers and yield the rows of figures, and of
    times beside.
    """
    names = options.trackers
    if not find_spec("stonesoup"):
        names = [name for name in names if "Stone" not in name]
    with tempfile.TemporaryDirectory() as place:
        folder = options.set or Path(place)
        if not (folder / "set.json").exists():
            generated(folder, options)
        run(folder, names)
        with timed(folder, "scores"):
            present = [name for name in TRACKERS if tracks_file(folder, name).exists()]
            rows = [row for name in present for row in tracker_rows(folder, name)]
        yield from rows
        for name in ("set", "scores"):
            if name in times_of(folder):
                blank = dict.fromkeys(rows[0], "")
                spent = {"tracker": name, "case": ALL, "processor_s": times_of(folder)[name]}
                yield blank | spent


def total_rows(table):
    """Return the row of each tracker over all cases, or over the only one."""
    scored = Table(row for row in table if row["covered"] != "")
    names = scored.names("case")
    return scored.where(case=ALL if ALL in names else names[0])


def page(table):
    """Return the page."""
    total = total_rows(table)
    lines = [
        [
            row["tracker"],
            *(f"{row[name]:.3g}" for name in COLUMNS),
            interval_text(row, "held_95", ".0%"),
        ]
        for row in total
    ]
    times = [(row["tracker"], row["processor_s"]) for row in table if row["processor_s"] != ""]
    return PAGE.format(
        verdict=verdict(total),
        cases=len(CASES),
        seeds=len(SEEDS),
        version=VERSION,
        table=markdown_table(("tracker", *COLUMNS.values(), "held"), lines),
        launches=total[0]["launches"],
        cutoff=CUTOFF_OF_BOUND,
        questions="; ".join(f"*{name}*, {case.question}" for name, case in CASES.items()),
        versions=", ".join(total.names("version")),
        spent=sum(spent_s for _, spent_s in times),
        times=", ".join(f"{name} {spent_s:.0f} s" for name, spent_s in times),
    )


def verdict(total):
    """Return which trackers have the least GOSPA and energy score, and which are consistent."""
    gospa, energy = (
        min(total, key=lambda row: row[name])["tracker"]
        for name in ("gospa_over_cutoff", "energy_over_bound")
    )
    held = [row["tracker"] for row in total if row["held_95"] >= HELD]
    words = f"{', '.join(held)} hold{'s' if len(held) == 1 else ''}" if held else "no tracker holds"
    scores = "and" if gospa == energy else f"and {energy}"
    return (
        f"{gospa} has the least GOSPA/c, {scores} the least energy score; {words} at least"
        f" {100 * HELD:.0f} % of the states in 95 % ellipsoids."
    )


def draw(path, table):
    """Draw scores by case and tracker."""
    panels = {
        "gospa_over_cutoff": "GOSPA over the cut-off",
        "energy_over_bound": "energy score over the bound's",
    }
    rows = Table(row for row in table if row["covered"] != "")
    cases = rows.names("case")
    with svg_plot(path, 2, 1, figsize=(10.0, 7.0), sharex=True) as (_, axes):
        for panel, (name, label) in zip(axes, panels.items(), strict=True):
            places = Table({**row, "place": cases.index(row["case"])} for row in rows)
            draw_lines(panel, places, "tracker", "place", name, "o:")
            panel.set(yscale="log", ylabel=label)
            panel.set_xticks(range(len(cases)), cases, rotation=30, fontsize=7)


def main():
    """Make the set, or measure and write; return 1 if the set is not the published one."""
    options = options_of(
        __doc__,
        generate=Path,
        keep_digests=False,
        set=Path,
        cases=tuple(CASES),
        seeds=SEEDS,
        trackers=tuple(TRACKERS),
    )
    if options.generate:
        return 0 if generated(options.generate, options) else 1
    publish(options, page, draw, tracking_set=set_rows(options))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
