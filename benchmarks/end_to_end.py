"""End to end: error of what a user reads against whole-process time, over every accuracy setting.

    python benchmarks/end_to_end.py [--scenes one salvo raid] [--raid 1000] [--knobs NAME ...]
        [--duration 300] [--write docs/benchmarks] [--from-csv docs/benchmarks]

Each setting is varied alone, the others at their defaults, and held against its most exact level
with the same seed: so noise is the same, and differences are those of the setting. Two rows more
for each scene: all defaults, and all at their most exact, against each other. Every run is a
process of its own; times are its processor time, start-up included. Scenes name all physics there
is: air, background, forces, focal planes, spectral classification and a tracker; `leave out` levels
say what each costs and what it changes. `--from-csv` draws page and plot again.
"""

import argparse
import json
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from end_to_end_page import ALL, write_page
from opir_studies.differences import RunAnswers, answers_of, differences
from opir_studies.knobs import Knob, knobs_of
from opir_studies.tuning import overrides_at
from result_files import write_csv

import opir_core as opir
from opir_core.builtin.class_flights import EPHEMERIS_TOLERANCE_M
from opir_core.reading import scene_mapping

#: Modules that build trajectories to `EPHEMERIS_TOLERANCE_M`.
TRAJECTORIES = ("class_flights", "targets", "gravity_turn_targets")
TOLERANCES_M = ("1e-6", "1e-4", "0.01", "1", "10")
#: Settings of the raid, whose runs take minutes.
RAID = (ALL, "trajectory tolerance", "probability tolerance", "tracker cadence and slice")
SCENES = {"one": 1, "salvo": 10, "raid": 1000}


def scene(launches: int, duration_s: float) -> dict[str, Any]:
    """Return a scene as plain values: launches from a field of points 100 km apart, in the first
    ten seconds.
    """
    side = int(np.ceil(np.sqrt(launches)))
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
            {
                "model": "SBIRS-GEO",
                "id": "WEST",
                "orbital_slot_deg": -150.0,
                "focal_plane": "notional",
            },
            {
                "model": "SBIRS-GEO",
                "id": "EAST",
                "orbital_slot_deg": -100.0,
                "focal_plane": "notional",
            },
        ],
        "targets": [
            {
                "id": f"T{n:04d}",
                "type": "ICBM",
                "launch": {
                    "lat_deg": 34.7 - 0.9 * (n // side),
                    "lon_deg": -125.0 - 0.9 * (n % side),
                    "time_s": 2.0 + 10.0 * n / launches,
                },
                "aim": {"lat_deg": 9.0 - 0.9 * (n // side), "lon_deg": 167.7 - 0.9 * (n % side)},
            }
            for n in range(launches)
        ],
        "outputs": [],
    }


def knobs(plain: Mapping[str, Any]) -> list[Knob]:
    """Return all settings: those that `opir tune` turns, and those that leave a part out or are not
    in a scene file.
    """
    return [
        Knob("trajectory tolerance", tuple((f"{each} m",) for each in TOLERANCES_M)),
        *knobs_of(opir.scene_from_mapping(plain)),
        Knob("leave out the air", ((), ("atmosphere=clear",))),
        Knob("leave out the background", ((), ("background=none",))),
        Knob(
            "leave out the focal plane",
            ((), ("sensors[*].focal_plane=null", "sensors[*].nei_w_m2=1e-12")),
        ),
        Knob("tracker", ((), ("tracker=kepler-arc",), ("tracker=none",))),
    ]


def child(request: Mapping[str, Any], out: str) -> None:
    """Run a scene with overrides and keep its answers."""
    for module in TRAJECTORIES if request["tolerance_m"] else ():
        import_module(f"opir_core.builtin.{module}").EPHEMERIS_TOLERANCE_M = request["tolerance_m"]  # type: ignore[attr-defined]
    run = opir.simulate(opir.scene_from_mapping(request["scene"], overrides=request["overrides"]))
    Path(out).write_bytes(pickle.dumps(answers_of(run)))


def answered(plain: Mapping[str, Any], overrides: Sequence[str]) -> tuple[RunAnswers, float]:
    """Return the answers of a process that runs a scene, and its processor time, s."""
    tolerance = [float(each.removesuffix(" m")) for each in overrides if each.endswith(" m")]
    request = {
        "scene": plain,
        "overrides": [each for each in overrides if not each.endswith(" m")],
        "tolerance_m": tolerance[0] if tolerance else None,
    }
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder, "answers")
        asked = Path(folder, "request.json")
        asked.write_text(json.dumps(request), encoding="utf-8")
        process = subprocess.Popen([sys.executable, __file__, "--child", str(asked), str(out)])
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise SystemExit(
                f"{plain['scene']} with {', '.join(overrides)} ended with exit code"
                f" {process.returncode}"
            )
        return pickle.loads(out.read_bytes()), used.ru_utime + used.ru_stime


def is_default(plain: Mapping[str, Any], overrides: Sequence[str]) -> bool:
    """Return whether overrides say what the scene has without them."""
    if any(each.endswith(" m") for each in overrides):
        return float(overrides[0].removesuffix(" m")) == EPHEMERIS_TOLERANCE_M
    own = opir.scene_from_mapping(plain)
    return scene_mapping(
        opir.scene_from_mapping(plain, overrides=list(overrides))
    ) == scene_mapping(own)


def row_of(
    knob: str, level: str, default: bool, took: float, found: RunAnswers, reference: RunAnswers
) -> dict[str, str]:
    """Return a row of the CSV file, without its scene."""
    errors = {**differences(found, reference), "from_truth_km": found.from_truth["impact_km"]}
    row = {"knob": knob, "level": level, "default": str(int(default)), "processor_s": f"{took:.3f}"}
    return row | {each: f"{value:.4g}" for each, value in errors.items()}


def shown(override: str) -> str:
    """Return an override without the path of its component."""
    path, equals, value = override.partition("=")
    return f"{path.rpartition('.')[2]}={value}" if equals else path


def rows(plain: Mapping[str, Any], only: Sequence[str]) -> Iterator[dict[str, str]]:
    """Yield the rows of one scene."""
    every = knobs(plain)
    own, own_s = answered(plain, ())
    for knob in every:
        reference: RunAnswers | None = None
        for level in knob.levels if not only or knob.name in only else ():
            default = is_default(plain, level)
            found, took = (own, own_s) if default else answered(plain, level)
            reference = reference or found
            text = ", ".join(shown(each) for each in level)
            yield row_of(knob.name, text or "as named", default, took, found, reference)
    if not only or ALL in only:
        tuned = [every[0], *knobs_of(opir.scene_from_mapping(plain))]
        exact, exact_s = answered(plain, overrides_at(tuned, [0] * len(tuned)))
        yield row_of(ALL, "exact", False, exact_s, exact, exact)
        yield row_of(ALL, "defaults", True, own_s, own, exact)


def main() -> None:
    """Measure and write the results, or draw page and plot again."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", choices=tuple(SCENES), default=tuple(SCENES))
    parser.add_argument("--raid", type=int, default=SCENES["raid"], help="launches of the raid")
    parser.add_argument("--knobs", nargs="+", default=(), help="these settings, or `all settings`")
    parser.add_argument(
        "--duration", type=float, default=300.0, help="scene time, s; a burn takes about 240"
    )
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    parser.add_argument("--from-csv", type=Path, metavar="FOLDER")
    parser.add_argument("--child", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(json.loads(Path(given.child[0]).read_text(encoding="utf-8")), given.child[1])
        return
    if given.from_csv:
        write_page(given.from_csv)
        return
    table = []
    for name in given.scenes:
        launches = given.raid if name == "raid" else SCENES[name]
        for row in rows(
            scene(launches, given.duration), given.knobs or (RAID if name == "raid" else ())
        ):
            table.append(
                {
                    "scene": name,
                    "launches": str(launches),
                    "duration_s": f"{given.duration:g}",
                    **row,
                }
            )
            print(",".join(table[-1].values()), flush=True)
    if given.write:
        write_csv(given.write / "end_to_end.csv", table)
        write_page(given.write)


if __name__ == "__main__":
    main()
