"""Studies as `opir sweep` writes them: each way to vary settings, figures that span decades, a
constant.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet
from scipy.stats import t

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


def written(folder: Path, name: str) -> Path:
    """Write a study whose figures span decades, with intervals that reach below 0, and a
    constant.
    """
    vary, design = STUDIES[name]
    designs = list(product(*vary.values()))
    if design == "one-at-a-time":
        base = [levels[0] for levels in vary.values()]
        designs = [
            row for row in designs if sum(a != b for a, b in zip(row, base, strict=True)) <= 1
        ]
    rng = np.random.default_rng(4)

    def values(settings: Mapping[str, Any]) -> dict[str, np.ndarray]:
        size = settings.get(PERIOD, 100.0) * 2e-3 / settings.get(CHANCE, 0.5)
        size *= 2.0 if settings.get(TRACKER) == "kepler-arc" else 1.0
        means = (size, 3e4 * size**0.3, 1e6 * size**2, min(1.0, 0.3 / size), 1.0)
        figures = {
            figure: mean * rng.lognormal(0.0, 1.0 if figure != "tracked" else 0.0, RUNS)
            for figure, mean in zip(FIGURES, means, strict=True)
        }
        return figures | {"warned": np.minimum(figures["warned"], 1.0)}

    limits = {figure: 1.0 if figure in ("warned", "tracked") else None for figure in FIGURES}
    return write_study(
        folder,
        list(vary),
        designs,
        values,
        study=name,
        design=design,
        figures=FIGURES,
        bounds={figure: [0.0, limit] for figure, limit in limits.items()},
        metrics={"latency": ["latency_s"], "other": list(FIGURES)[1:]},
        shown=["latency_s", "position_rmse_m"],
        notes=[],
        requirements=[{"figure": "latency_s", "limit": 0.5, "is_least": False}],
    )


def write_study(
    folder: Path,
    paths: Sequence[str],
    designs: Sequence[Sequence[Any]],
    values: Callable[[Mapping[str, Any]], Mapping[str, np.ndarray]],
    **definition: Any,
) -> Path:
    """Write a study: `values` are those of all runs by figure, for the settings of a design."""
    rows = list[dict[str, Any]]()
    runs = list[dict[str, Any]]()
    for number, levels in enumerate(designs):
        settings = {"design": number, **dict(zip(paths, levels, strict=True))}
        figures = values(settings)
        count = len(next(iter(figures.values())))
        runs += [
            settings
            | {"replicate": run, "seed": run}
            | {figure: float(column[run]) for figure, column in figures.items()}
            for run in range(count)
        ]
        rows += [
            settings | {"figure": figure, "unit": definition["figures"][figure]} | summary(column)
            for figure, column in figures.items()
        ]
    folder.mkdir(parents=True, exist_ok=True)
    parquet.write_table(pa.Table.from_pylist(rows), folder / "results.parquet")
    parquet.write_table(pa.Table.from_pylist(runs), folder / "runs.parquet")
    numbers = [{"design": number} for number in range(len(designs))]
    head = {"study_version": 3, "scene": "s", "vary": list(paths), "runs": count, "until": ""}
    text = json.dumps(head | {"designs": numbers} | definition)
    (folder / "study.json").write_text(text, encoding="utf-8")
    return folder


def summary(values: np.ndarray) -> dict[str, float]:
    """Return the columns of results of a design's runs, with the mean as the difference."""
    count = len(values)
    half = t.ppf(0.975, count - 1) * values.std(ddof=1) / count**0.5
    mean = values.mean()
    return {
        "runs": count,
        "first_seed": 0,
        "last_seed": count - 1,
        "share": 1.0,
        "runs_with_value": count,
        "mean": mean,
        "low_95": mean - half,
        "high_95": mean + half,
        "sd": values.std(ddof=1),
        "q10": values.min(),
        "median": np.median(values),
        "q90": values.max(),
        "difference": mean - values[0],
        "difference_low_95": mean - values[0] - half,
        "difference_high_95": mean - values[0] + half,
    }
