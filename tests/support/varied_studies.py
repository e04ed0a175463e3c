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


def written(folder, name):
    """Write a study whose figures span decades, with intervals that reach below 0, and a
    constant.
    """
    vary, design = STUDIES[name]
    settings = list(product(*vary.values()))
    if design == "one-at-a-time":
        middle = [levels[0] for levels in vary.values()]
        settings = [
            row for row in settings if sum(a != b for a, b in zip(row, middle, strict=True)) <= 1
        ]
    rng = np.random.default_rng(4)
    rows = []
    runs = []
    for number, levels in enumerate(settings):
        knobs = dict(zip(vary, levels, strict=True))
        size = (
            knobs.get(PERIOD, 100.0)
            * 2e-3
            / knobs.get(CHANCE, 0.5)
            * (2.0 if knobs.get(TRACKER) == "kepler-arc" else 1.0)
        )
        scale = {
            "latency_s": size,
            "position_rmse_m": 3e4 * size**0.3,
            "impact_area_km2": 1e6 * size**2,
            "warned": min(1.0, 0.3 / size),
            "tracked": 1.0,
        }
        values = {
            figure: value * rng.lognormal(0.0, 1.0 if figure != "tracked" else 0.0, RUNS)
            for figure, value in scale.items()
        }
        values["warned"] = np.minimum(values["warned"], 1.0)
        runs += [
            {
                "design": number,
                **knobs,
                "replicate": run,
                "seed": run,
                **{figure: float(value[run]) for figure, value in values.items()},
            }
            for run in range(RUNS)
        ]
        for figure, unit in FIGURES.items():
            figures = values[figure]
            half = 2.571 * figures.std(ddof=1) / RUNS**0.5
            rows.append(
                {
                    "design": number,
                    **knobs,
                    "figure": figure,
                    "unit": unit,
                    "runs": RUNS,
                    "first_seed": 0,
                    "last_seed": RUNS - 1,
                    "share": 1.0,
                    "runs_with_value": RUNS,
                    "mean": figures.mean(),
                    "low_95": figures.mean() - half,
                    "high_95": figures.mean() + half,
                    "sd": figures.std(ddof=1),
                    "q10": figures.min(),
                    "median": np.median(figures),
                    "q90": figures.max(),
                    "difference": figures.mean() - scale[figure],
                    "difference_low_95": figures.mean() - scale[figure] - half,
                    "difference_high_95": figures.mean() - scale[figure] + half,
                }
            )
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
