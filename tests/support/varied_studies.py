"""Studies as `opir sweep` writes them: each way to vary settings, figures that span decades, a
constant.
"""

import json
from itertools import product

import numpy as np
import pyarrow as pa
from pyarrow import parquet

PERIOD = "sensors[*].scan_period_ms"
CHANCE = "sensors[*].detection_probability.ICBM"
TRACKER = "tracker"
#: Levels of what varies, and the design, by the name of the study.
STUDIES = {
    "one-knob": ({PERIOD: [50.0, 100.0, 10_000.0]}, "factorial"),
    "two-knobs": ({PERIOD: [50.0, 100.0, 200.0], CHANCE: [0.3, 0.9]}, "factorial"),
    "small-multiples": (
        {PERIOD: [50.0, 100.0, 200.0, 300.0, 400.0, 500.0], CHANCE: [0.3, 0.5, 0.6, 0.7, 0.9]},
        "factorial",
    ),
    "names": (
        {TRACKER: ["imm with a long name of its own", "kepler-arc", "stonesoup"]},
        "factorial",
    ),
    "three-knobs": (
        {PERIOD: [50.0, 100.0, 5000.0], CHANCE: [0.3, 0.9], TRACKER: ["imm", "kepler-arc"]},
        "factorial",
    ),
    "one-at-a-time": (
        {PERIOD: [100.0, 50.0, 5000.0], CHANCE: [0.9, 0.3], TRACKER: ["imm", "kepler-arc"]},
        "one-at-a-time",
    ),
    "alone": ({}, "factorial"),
}
FIGURES = {
    "latency_s": "s",
    "position_rmse_m": "m",
    "impact_area_km2": "km2",
    "warned": "",
    "tracked": "",
}
RUNS = 6


def levels_of(vary, design):
    """Return the rows of levels of a design."""
    rows = list(product(*vary.values()))
    if design == "factorial":
        return rows
    middle = [levels[0] for levels in vary.values()]
    return [row for row in rows if sum(a != b for a, b in zip(row, middle, strict=True)) <= 1]


def scale_of(knobs):
    """Return the size of each figure at some settings."""
    size = knobs.get(PERIOD, 100.0) * 2e-3 / knobs.get(CHANCE, 0.5)
    size *= 2.0 if knobs.get(TRACKER) == "kepler-arc" else 1.0
    return {
        "latency_s": size,
        "position_rmse_m": 3e4 * size**0.3,
        "impact_area_km2": 1e6 * size**2,
        "warned": min(1.0, 0.3 / size),
        "tracked": 1.0,
    }


def drawn(scale, rng):
    """Return the figures (RUNS,) of runs around their sizes."""
    figures = {
        figure: value * rng.lognormal(0.0, 1.0 if figure != "tracked" else 0.0, RUNS)
        for figure, value in scale.items()
    }
    figures["warned"] = np.minimum(figures["warned"], 1.0)
    return figures


def summary(figures, size):
    """Return the columns of a figure's results; its difference is that to its size."""
    half = 2.571 * figures.std(ddof=1) / RUNS**0.5
    mean = figures.mean()
    return {
        "runs": RUNS,
        "first_seed": 0,
        "last_seed": RUNS - 1,
        "share": 1.0,
        "runs_with_value": RUNS,
        "mean": mean,
        "low_95": mean - half,
        "high_95": mean + half,
        "sd": figures.std(ddof=1),
        "q10": figures.min(),
        "median": np.median(figures),
        "q90": figures.max(),
        "difference": mean - size,
        "difference_low_95": mean - size - half,
        "difference_high_95": mean - size + half,
    }


def written(folder, name):
    """Write a study whose figures span decades, with intervals that reach below 0, and a
    constant.
    """
    vary, design = STUDIES[name]
    rng = np.random.default_rng(4)
    rows = []
    runs = []
    settings = levels_of(vary, design)
    for number, levels in enumerate(settings):
        knobs = {"design": number, **dict(zip(vary, levels, strict=True))}
        scale = scale_of(knobs)
        figures = drawn(scale, rng)
        for run in range(RUNS):
            values = {figure: float(column[run]) for figure, column in figures.items()}
            runs.append({**knobs, "replicate": run, "seed": run, **values})
        for figure, unit in FIGURES.items():
            head = {**knobs, "figure": figure, "unit": unit}
            rows.append({**head, **summary(figures[figure], scale[figure])})
    folder.mkdir(parents=True)
    parquet.write_table(pa.Table.from_pylist(rows), folder / "results.parquet")
    parquet.write_table(pa.Table.from_pylist(runs), folder / "runs.parquet")
    definition = {
        "study_version": 2, "study": name, "scene": "s", "design": design, "vary": list(vary), "runs": RUNS,
        "until": "", "figures": FIGURES,
        "bounds": {figure: [0.0, 1.0 if figure in ("warned", "tracked") else None] for figure in FIGURES},
        "metrics": {"latency": ["latency_s"], "other": list(FIGURES)[1:]},
        "designs": [{"design": number} for number in range(len(settings))],
        "shown": ["latency_s", "position_rmse_m"], "notes": [],
        "requirements": [{"figure": "latency_s", "limit": 0.5, "is_least": False}],
    }  # fmt: skip
    (folder / "study.json").write_text(json.dumps(definition), encoding="utf-8")
    return folder
