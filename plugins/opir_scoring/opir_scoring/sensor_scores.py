"""A tracker's estimates of its sensors' biases beside the true ones."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from opir_scoring.evidence import RunEvidence


def sensor_scores(evidence: RunEvidence) -> list[dict[str, Any]]:
    """Return one mapping for each sensor of whose health the tracker has an estimate: that, and
    the true bias, rad.
    """
    bias = evidence.plan.bias
    rows = []
    for number, health in enumerate(evidence.health):
        if health is not None:
            sensor = evidence.plan.sensors[number]
            true = [0.0, 0.0]
            if bias is not None:
                true = [float(bias.east_rad[number]), float(bias.north_rad[number])]
            rows.append({"sensor_id": sensor.id, "true_bias_rad": true, **health})
    return rows


def sensor_text(rows: list[dict[str, Any]]) -> str:
    """Return the scores of sensors as lines."""
    return "\n".join(_lines(rows))


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    for row in rows:
        off = np.subtract(np.array(row["bias_rad"], dtype=np.float64), row["true_bias_rad"])
        sigma = np.array(row["bias_sigma_rad"], dtype=np.float64)
        error = np.divide(np.abs(off), sigma, out=np.zeros(2), where=sigma > 0.0)
        east, north = 1e6 * np.array(row["true_bias_rad"])
        yield f"{row['sensor_id']}: {row['text']}"
        bias = f"true bias {east:.0f} µrad east, {north:.0f} µrad north"
        yield f"  {bias}: off by {error[0]:.1f} and {error[1]:.1f} σ"
