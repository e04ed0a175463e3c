"""What a tracker found of its sensors beside what is true of them."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from opir_scoring.evidence import RunEvidence


def sensor_scores(evidence: RunEvidence) -> list[dict[str, Any]]:
    """Return one mapping for each sensor that the tracker says something of: that, and the true
    bias, rad.
    """
    bias = evidence.plan.bias
    rows = []
    for number, (sensor, health) in enumerate(
        zip(evidence.plan.sensors, evidence.health, strict=True)
    ):
        if health is not None:
            true = (
                [0.0, 0.0]
                if bias is None
                else [float(bias.east_rad[number]), float(bias.north_rad[number])]
            )
            rows.append({"sensor_id": sensor.id, "true_bias_rad": true, **health})
    return rows


def sensor_text(rows: list[dict[str, Any]]) -> str:
    """Return the scores of sensors as lines."""
    return "\n".join(_lines(rows))


def _lines(rows: list[dict[str, Any]]) -> Iterator[str]:
    for row in rows:
        off = np.subtract(np.array(row["bias_rad"], dtype=np.float64), row["true_bias_rad"])
        sigma = np.array(row["bias_sigma_rad"], dtype=np.float64)
        far = np.divide(np.abs(off), sigma, out=np.zeros(2), where=sigma > 0.0)
        east, north = 1e6 * np.array(row["true_bias_rad"])
        yield f"{row['sensor_id']}: {row['text']}"
        yield f"  true bias {east:.0f} µrad east, {north:.0f} µrad north: off by {far[0]:.1f} and {far[1]:.1f} σ"
