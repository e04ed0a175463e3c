"""A study folder as `opir sweep` writes it, with figures that follow a formula."""

import json

import pyarrow as pa
from pyarrow import parquet

PERIODS_MS = (50.0, 100.0, 200.0)
TRACKERS = ("none", "imm")
PERIOD = "sensors[*].scan_period_ms"
TRACKER = "tracker"


def written_study(folder):
    """Write a study of two settings: the latency is twice the scan period, the area has no value
    without a tracker.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for number, (period_ms, tracker) in enumerate(
        (periods_m, name) for periods_m in PERIODS_MS for name in TRACKERS
    ):
        for figure, unit in (("latency_s", "s"), ("area_km2", "km2")):
            mean = 2e-3 * period_ms if unit == "s" else (1e4 if tracker == "imm" else float("nan"))
            mean_value = 2e-3 * PERIODS_MS[0] if unit == "s" else mean
            rows.append(
                {
                    "design": number,
                    PERIOD: period_ms,
                    TRACKER: tracker,
                    "figure": figure,
                    "unit": unit,
                    "runs": 10,
                    "first_seed": 3,
                    "last_seed": 12,
                    "share": float(mean == mean),
                    "runs_with_value": 10 if mean == mean else 0,
                    "mean": mean,
                    "low_95": 0.9 * mean,
                    "high_95": 1.1 * mean,
                    "sd": 0.1,
                    "q10": mean,
                    "median": mean,
                    "q90": mean,
                    "difference": mean - mean_value,
                    "difference_low_95": mean - mean_value - 0.01,
                    "difference_high_95": mean - mean_value + 0.01,
                }
            )
    parquet.write_table(pa.Table.from_pylist(rows), folder / "results.parquet")
    definition = {
        "study_version": 3,
        "study": "revisit",
        "scene": "first-light",
        "design": "factorial",
        "vary": [PERIOD, TRACKER],
        "runs": 10,
        "until": "",
        "figures": {"latency_s": "s", "area_km2": "km2"},
        "metrics": {"latency": ["latency_s"], "impact": ["area_km2"]},
        "designs": [{"design": number} for number in range(len(rows) // 2)],
    }
    (folder / "study.json").write_text(json.dumps(definition), encoding="utf-8")
    return folder
