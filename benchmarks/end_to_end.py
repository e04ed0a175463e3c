"""End to end: error of what a user reads against whole-process time, over every accuracy setting.

Each setting is varied alone, the others at their defaults, and held against its most exact level
with the same seed: so noise is the same, and differences are those of the setting. Two rows more
for each scene: all defaults, and all at their most exact, against each other. Every run is a
process of its own; times are its processor time, start-up included. Scenes name all physics there
is: air, background, forces, focal planes, spectral classification and a tracker; `leave out` levels
say what each costs and what it changes. A burn takes about 240 s of the `--duration`.
"""

import json
import os
import pickle
import tempfile
from importlib import import_module
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import yaml
from complexity import process_of
from opir_studies.differences import answers_of, differences
from opir_studies.knobs import Knob, knobs_of
from opir_studies.tuning import overrides_at
from pages import COLOURS, Table, markdown_table, options_of, publish, shown, svg_plot

import opir_core as opir
from opir_core.builtin.class_flights import EPHEMERIS_TOLERANCE_M
from opir_core.reading import scene_mapping

#: Modules that build trajectories to `EPHEMERIS_TOLERANCE_M`.
TRAJECTORIES = ("class_flights", "targets", "gravity_turn_targets")
#: The name of the rows with all settings at once.
ALL = "all settings"
#: Settings of the raid, whose runs take minutes.
RAID = (ALL, "trajectory tolerance", "probability tolerance", "tracker cadence and slice")
SCENES = {"one": 1, "salvo": 10, "raid": 1000}
SETTINGS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text(encoding="utf-8"))
ERRORS: dict[str, list[str]] = SETTINGS["errors"]
COLUMNS = 4

PAGE = """# End to end: run time against error

What does each accuracy setting cost a whole run, what does it buy, and are the defaults on the
knee?

{answer}

![Error against processor time of a whole process, for each setting; defaults are ringed](end_to_end.svg)

Each setting is varied alone and compared with its most exact level, with the same seed. Scenes:
{scenes}. {duration} s, two SBIRS-GEO with focal planes, in air, with J2 to J4 and drag, spectral
types and `imm`. Times are processor time of whole processes. Beside others, an error of 0 is drawn
at 0.3 times the least of them. `leave out …` changes the physics, to `atmosphere: clear`,
`background: none`, and for the focal plane `focal_plane: null` and `nei_w_m2: 1e-12`; the setting
`tracker` has `tracker: kepler-arc` too: {left_out}.{not_run}

All defaults against the most exact settings:

{table}

Errors are largest values, those of tracks root mean squares over launches
([definitions](../how-to/tune.md#errors)). Those of tracks are differences between two estimates
from the same detections. The last predicted impacts are off the true ones by {truth}: before
burnout an impact is hardly known.

All levels: [end_to_end.csv](end_to_end.csv). `opir tune` [picks levels](../how-to/tune.md) for a
wanted error.
"""


def scene(launches, duration_s):
    """Return a scene: launches from a field of points 100 km apart, in the first ten seconds."""
    side = int(np.ceil(np.sqrt(launches)))
    targets = []
    for n in range(launches):
        south = 0.9 * (n // side)
        west = 0.9 * (n % side)
        launch = {
            "lat_deg": 34.7 - south,
            "lon_deg": -125.0 - west,
            "time_s": 2.0 + 10.0 * n / launches,
        }
        aim = {"lat_deg": 9.0 - south, "lon_deg": 167.7 - west}
        targets.append({"id": f"T{n:04d}", "type": "ICBM", "launch": launch, "aim": aim})
    sensor = {"model": "SBIRS-GEO", "focal_plane": "notional"}
    return {
        "scene": f"end-to-end-{launches}",
        "epoch": "2026-04-01T20:00:00Z",
        "duration_s": duration_s,
        "seed": 1,
        "forces": ["j2", "j3", "j4", "drag"],
        "detection": "snr",
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
        "classification": "spectral",
        "tracker": "imm",
        "sensors": [
            {**sensor, "id": "WEST", "orbital_slot_deg": -150.0},
            {**sensor, "id": "EAST", "orbital_slot_deg": -100.0},
        ],
        "targets": targets,
        "outputs": [],
    }


def knobs(mapping):
    """Return all settings: those that `opir tune` turns, and those that leave a part out or are not
    in a scene file.
    """
    no_focal_plane = ("sensors[*].focal_plane=null", "sensors[*].nei_w_m2=1e-12")
    tolerances = ("1e-6 m", "1e-4 m", "0.01 m", "1 m", "10 m")
    return [
        Knob("trajectory tolerance", tuple((tolerance,) for tolerance in tolerances)),
        *knobs_of(opir.scene_from_mapping(mapping)),
        Knob("leave out the air", ((), ("atmosphere=clear",))),
        Knob("leave out the background", ((), ("background=none",))),
        Knob("leave out the focal plane", ((), no_focal_plane)),
        Knob("tracker", ((), ("tracker=kepler-arc",), ("tracker=none",))),
    ]


def child(request, path):
    """Run a scene with overrides and keep its answers."""
    for module in TRAJECTORIES if request["tolerance_m"] else ():
        import_module(f"opir_core.builtin.{module}").EPHEMERIS_TOLERANCE_M = request["tolerance_m"]
    run = opir.simulate(opir.scene_from_mapping(request["scene"], overrides=request["overrides"]))
    path.write_bytes(pickle.dumps(answers_of(run)))


def trajectory_tolerance(overrides):
    """Return the tolerance among overrides, m, None without one."""
    return next((float(word.removesuffix(" m")) for word in overrides if word.endswith(" m")), None)


def answered(mapping, overrides):
    """Return the answers of a process that runs a scene, and its processor time, s."""
    request = {
        "scene": mapping,
        "overrides": [word for word in overrides if not word.endswith(" m")],
        "tolerance_m": trajectory_tolerance(overrides),
    }
    with tempfile.TemporaryDirectory() as folder:
        answers = Path(folder, "answers")
        path = Path(folder, "request.json")
        path.write_text(json.dumps(request), encoding="utf-8")
        _, processor_s, _ = process_of("--child", str(path), "--answers", str(answers))
        return pickle.loads(answers.read_bytes()), processor_s


def is_default(mapping, overrides):
    """Whether overrides leave the scene as it is."""
    tolerance_m = trajectory_tolerance(overrides)
    if tolerance_m is not None:
        return tolerance_m == EPHEMERIS_TOLERANCE_M
    scene = opir.scene_from_mapping(mapping)
    changed = opir.scene_from_mapping(mapping, overrides=list(overrides))
    return scene_mapping(changed) == scene_mapping(scene)


def shown_override(override):
    """Return an override without the path of its component."""
    path, equals, value = override.partition("=")
    return f"{path.rpartition('.')[2]}={value}" if equals else path


def scene_rows(mapping, only):
    """Yield the rows of one scene."""
    settings = knobs(mapping)
    default, default_s = answered(mapping, ())

    def row(knob, level, run, reference):
        answers, processor_s = run
        figures = {
            "knob": knob,
            "level": level,
            "default": int(answers is default),
            "processor_s": processor_s,
        }
        errors = differences(answers, reference)
        return figures | errors | {"from_truth_km": answers.from_truth["impact_km"]}

    for knob in settings:
        reference = None
        for level in knob.levels if not only or knob.name in only else ():
            run = answered(mapping, level)
            if is_default(mapping, level):
                run = (default, default_s)
            reference = reference or run[0]
            name = ", ".join(map(shown_override, level)) or "as named"
            yield row(knob.name, name, run, reference)
    if not only or ALL in only:
        tuned = [settings[0], *knobs_of(opir.scene_from_mapping(mapping))]
        exact = answered(mapping, overrides_at(tuned, [0] * len(tuned)))
        yield row(ALL, "exact", exact, exact[0])
        yield row(ALL, "defaults", (default, default_s), exact[0])


def rows_of(scenes, raid, only, duration_s):
    """Yield the rows of all scenes."""
    for name in scenes:
        launches = raid if name == "raid" else SCENES[name]
        knob_names = only or (RAID if name == "raid" else ())
        for row in scene_rows(scene(launches, duration_s), knob_names):
            yield {"scene": name, "launches": launches, "duration_s": duration_s, **row}


def page(table):
    """Return the page."""
    defaults = table.where(knob=ALL, level="defaults")
    exact = table.where(knob=ALL, level="exact")
    counts = {row["scene"]: row["launches"] for row in table}
    lines = [
        (words, *(f"{abs(row[key]):.2g}" for row in defaults), f"{bar:g}" if bar else "–")
        for key, words, bar in SETTINGS["bars"]
    ]
    for words, rows in (
        ("processor time, defaults, s", defaults),
        ("the same, most exact, s", exact),
    ):
        lines.append((words, *(f"{row['processor_s']:.1f}" for row in rows), "–"))
    not_run = [name for name in ERRORS if name not in table.names("knob")]
    head = [f"{row['scene']} ({counts[row['scene']]})" for row in defaults]
    truth = [f"{shown(row['from_truth_km'], '.0f')} km ({row['scene']})" for row in defaults]
    return PAGE.format(
        answer=answer(table, defaults),
        left_out=left_out_cost(table),
        not_run=f" Not run for this page: {', '.join(not_run)}." if not_run else "",
        scenes=", ".join(
            f"{name} ({count} launch{'es' if count != 1 else ''})" for name, count in counts.items()
        ),
        duration=table[0]["duration_s"],
        table=markdown_table(("error of defaults", *head, "bar"), lines),
        truth=", ".join(truth) or "–",
    )


def left_out_cost(table):
    """Return words: settings and time of each run without a part, and the time of the default."""
    runs = []
    for row in table.where(default=0):
        if row["knob"].startswith("leave out"):
            default = table.row(scene=row["scene"], knob=row["knob"], default=1)
            runs.append(
                f"with `{row['level']}` a run of `{row['scene']}` takes {row['processor_s']:.1f} s"
                f" (with the defaults {default['processor_s']:.1f} s)"
            )
    return "; ".join(runs) or "no figure here is of that"


def answer(table, defaults):
    """Return which bars are met or missed, and which defaults are off the knee."""
    if not defaults:
        return "The rows of all settings together were not run."
    missed = [
        f"{words} {row[key]:.2g} in `{row['scene']}` (bar {bar:g})"
        for row in defaults
        for key, words, bar in SETTINGS["bars"]
        if bar is not None and abs(row[key]) > bar
    ]
    bars = (
        f"Defaults miss a bar: {'; '.join(missed)}." if missed else "All defaults meet their bars."
    )
    levels = list(dict.fromkeys(off_the_knee(table)))
    if not levels:
        return (
            f"{bars}\nNo other level is both faster by a fifth and as exact as a default: all are"
            " on the curve."
        )
    return (
        f"{bars}\nLevels that are faster by a fifth and no less exact than a default:"
        f" {'; '.join(levels)}."
    )


def off_the_knee(table):
    """Return the levels that beat a default in time by a fifth with no larger error."""
    levels = []
    for default in table:
        if default["default"] != 1 or default["knob"] not in ERRORS:
            continue
        column = ERRORS[default["knob"]][0]
        for row in table:
            is_rival = (row["scene"], row["knob"]) == (default["scene"], default["knob"])
            if not is_rival or row is default:
                continue
            is_exact = abs(row[column]) <= abs(default[column]) + 1e-12
            if is_exact and row["processor_s"] < 0.8 * default["processor_s"]:
                levels.append(f"{default['knob']} {row['level']} in `{default['scene']}`")
    return levels


def draw(path, table):
    """Draw error against time, a panel for each setting, the default ringed."""
    names = [name for name in ERRORS if name in table.names("knob")]
    lines = max(1, -(-len(names) // COLUMNS))
    with svg_plot(path, lines, COLUMNS, figsize=(13.0, 3.0 * lines), squeeze=False) as (_, axes):
        for panel in axes.flat[len(names) :]:
            panel.set_visible(False)
        for panel, name in zip(axes.flat, names, strict=False):
            column, label = ERRORS[name]
            rows = Table(row for row in table.where(knob=name) if row[column] != "")
            positive = [abs(row[column]) for row in rows if 0.0 < abs(row[column]) < np.inf]
            least = 0.3 * min(positive, default=0.0)
            for colour, scene_name in zip(COLOURS, table.names("scene"), strict=False):
                points = [
                    (row["processor_s"], max(abs(row[column]), least), row["default"])
                    for row in rows
                    if row["scene"] == scene_name and abs(row[column]) < np.inf
                ]
                times, errors, defaults = np.array(points).reshape(-1, 3).T
                panel.plot(times, errors, "o-", markersize=4, color=colour, label=scene_name)
                ringed = defaults == 1
                panel.plot(times[ringed], errors[ringed], "ko", markersize=10, fillstyle="none")
            times = rows.column("processor_s")
            if max(times) > 10.0 * min(times):
                panel.set_xscale("log")
            if positive:
                panel.set_yscale("log")
            panel.set_title(name, fontsize=9)
            panel.set_ylabel(label, fontsize=8)
            panel.set_xlabel("processor time, s", fontsize=8)


def main():
    """Measure and write."""
    options = options_of(
        __doc__,
        scenes=tuple(SCENES),
        raid=SCENES["raid"],
        knobs=tuple(dict.fromkeys([*ERRORS, ALL])),
        duration=300.0,
        child=Path,
        answers=Path,
    )
    if options.child:
        child(json.loads(options.child.read_text(encoding="utf-8")), options.answers)
        return
    only = () if len(options.knobs) > len(ERRORS) else options.knobs
    rows = rows_of(options.scenes, options.raid, only, options.duration)
    publish(options, page, draw, end_to_end=rows)


if __name__ == "__main__":
    main()
