"""What a tracker has found of its sensors: biases, clocks, noise, innovations."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

import numpy as np
from attrs import fields, frozen

from opir_core.arrays import FloatArray


@frozen(eq=False, kw_only=True)
class SensorHealth:
    """Estimates of each sensor (s,) with their standard deviations; nan where nothing is known.

    `bias_rad` (s, 2) is the line-of-sight bias: how far a line of sight to nadir is moved towards
    east and north. `clock_s` (s,) is the offset of the clock, `noise_scale` (s,) its noise in units
    of the stated one. `innovations` (s,) is the mean square of normalised innovations, per angle, 1
    for sensors that are as stated, and `outlier_share` (s,) the share of looks far off their
    target. `text` has a sentence for each sensor.

    >>> one = np.ones(1)
    >>> SensorHealth.of({"noise_scale": 1.1 * one}, ("noise 1.1 × stated",)).documents()[0]["noise_scale"]
    1.1
    """

    bias_rad: FloatArray
    bias_sigma_rad: FloatArray
    clock_s: FloatArray
    clock_sigma_s: FloatArray
    noise_scale: FloatArray
    noise_scale_sigma: FloatArray
    innovations: FloatArray
    outlier_share: FloatArray
    text: tuple[str, ...]

    @classmethod
    def of(cls, values: dict[str, FloatArray], text: tuple[str, ...]) -> "SensorHealth":
        """Return the health of sensors (s,) from some fields, nan for the others, with a sentence
        for each.
        """
        shapes = {name: (len(text), *((2,) if "bias" in name else ())) for name in _NUMBERS}
        return cls(
            **{name: values.get(name, np.full(shape, np.nan)) for name, shape in shapes.items()},
            text=text,
        )

    @classmethod
    def of_documents(cls, rows: Sequence[Mapping[str, Any]]) -> "SensorHealth":
        """Return the health of sensors from their mappings, as `documents` gives them."""
        values = {
            name: np.array([row[name] for row in rows], dtype=np.float64) for name in _NUMBERS
        }
        return cls.of(values, tuple(row["text"] for row in rows))

    def documents(self) -> list[dict[str, Any]]:
        """Return one mapping for each sensor, of plain values; None where nothing is known."""
        rows = []
        for row, text in enumerate(self.text):
            values = {name: getattr(self, name)[row].tolist() for name in _NUMBERS}
            rows.append({name: _plain(value) for name, value in values.items()} | {"text": text})
        return rows


_NUMBERS = tuple(item.name for item in fields(SensorHealth) if item.name != "text")


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(item) for item in value]
    return value if isfinite(value) else None
