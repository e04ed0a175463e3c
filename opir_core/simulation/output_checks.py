"""Checks of what models return, on whole columns, always on: types, shapes, ranges, no nan.

Each raises `InvalidOutput`, to which the engine adds the component and its owner.
"""

from typing import Any

import numpy as np

from opir_core.arrays import ByteArray, FloatArray, IntArray
from opir_core.errors import kind_of
from opir_core.host.boundary import InvalidOutput
from opir_core.interfaces.detection_models import Measured

#: Largest distance of the sum of type probabilities from 1.
_SUM_ROUNDING = 1e-6

_DETECTION = "detection"
_CLASSIFICATION = "classification"
_CONFIDENCE = "confidence"


def outline(output: Any) -> str:
    """Return a short description of an output: `float64 (3,)`, `None`, `a list`."""
    return f"{output.dtype} {output.shape}" if isinstance(output, np.ndarray) else kind_of(output)


def checked_probability(probability: Any, rows: int, method: str = "probability") -> FloatArray:
    """Return the probabilities (rows,) of a detection model, in [0, 1]."""
    _require_array(probability, "f", (rows,), _DETECTION, method)
    return _in_unit_interval(probability, _DETECTION, method)


def checked_measured(measured: Any, rows: int, bands: int, method: str = "measure") -> Measured:
    """Return the measurements of `rows` looks, with columns of `bands` bands."""
    if not isinstance(measured, Measured):
        raise InvalidOutput(
            _DETECTION, method, f"returned {outline(measured)}, no opir_core.plugin.Measured"
        )
    _require_array(measured.bands, "u", (rows,), _DETECTION, f"{method}().bands")
    _require_array(measured.snr, "f", (rows,), _DETECTION, f"{method}().snr")
    sigma_rad = measured.line_of_sight_sigma_rad
    if sigma_rad is not None:
        _require_array(sigma_rad, "f", (rows,), _DETECTION, f"{method}().line_of_sight_sigma_rad")
        # Half a radian is far more than any line of sight: other units are wrong.
        _require_range(
            sigma_rad, 0.0, 0.5, _DETECTION, f"{method}().line_of_sight_sigma_rad", "rad"
        )
    for name in ("band_irradiance_w_m2", "band_noise_w_m2"):
        column = getattr(measured, name)
        if column is not None:
            _require_array(column, "f", (rows, bands), _DETECTION, f"{method}().{name}")
    return measured


def checked_types(codes: Any, rows: int, types: int, method: str) -> ByteArray:
    """Return the codes (rows,) of reported types, below `types`."""
    _require_array(codes, "iu", (rows,), _CLASSIFICATION, method)
    if rows and (codes.min() < 0 or codes.max() >= types):
        row = int(np.argmax((codes < 0) | (codes >= types)))
        words = f"returned the code {codes[row]} in row {row}; codes are 0 to {types - 1}"
        raise InvalidOutput(_CLASSIFICATION, method, words)
    return codes


def checked_log_probability(log_probability: Any, rows: int, types: int, method: str) -> FloatArray:
    """Return ln of the type probabilities (rows, types), each row of which sums to 1."""
    _require_array(log_probability, "f", (rows, types), _CLASSIFICATION, method)
    total = np.exp(log_probability).sum(axis=1) if rows else np.ones(0)
    sound = np.abs(total - 1.0) <= _SUM_ROUNDING
    if not sound.all():
        row = int(np.argmin(sound))
        words = f"returned probabilities that sum to {total[row]:.9g} in row {row}, not to 1"
        raise InvalidOutput(_CLASSIFICATION, method, words)
    return log_probability


def checked_confidence(confidence: Any, rows: int, method: str) -> FloatArray:
    """Return the confidences (rows,), in [0, 1]."""
    _require_array(confidence, "f", (rows,), _CONFIDENCE, method)
    return _in_unit_interval(confidence, _CONFIDENCE, method)


def checked_rates(rate_per_scan: Any, sensors: int) -> FloatArray:
    """Return the rates (sensors,) of false alarms, finite and not negative."""
    _require_array(rate_per_scan, "f", (sensors,), _DETECTION, "rate_per_scan")
    _require_range(rate_per_scan, 0.0, 1e15, _DETECTION, "rate_per_scan", "per scan")
    return rate_per_scan


def checked_confirmation(confirmation: Any, sensors: int) -> IntArray:
    """Return the M of N (sensors, 2) scans that confirm detections, 1 <= M <= N."""
    _require_array(confirmation, "iu", (sensors, 2), _DETECTION, "confirmation")
    needed = confirmation[:, 0]
    scans = confirmation[:, 1]
    if np.any((needed < 1) | (scans < needed)):
        row = int(np.argmax((needed < 1) | (scans < needed)))
        words = f"is {needed[row]} of {scans[row]} scans for sensor {row}; 1 <= M <= N is required"
        raise InvalidOutput(_DETECTION, "confirmation", words)
    return confirmation


def _in_unit_interval(values: FloatArray, key: str, method: str) -> FloatArray:
    _require_range(values, 0.0, 1.0, key, method, "")
    return values


def _require_array(output: Any, kinds: str, shape: tuple[int, ...], key: str, method: str) -> None:
    if isinstance(output, np.ndarray) and output.dtype.kind in kinds and output.shape == shape:
        return
    numbers = {"f": "floats", "iu": "whole numbers", "u": "unsigned whole numbers"}[kinds]
    raise InvalidOutput(
        key, method, f"returned {outline(output)}; {numbers} of shape {shape} are required"
    )


def _require_range(
    values: FloatArray, low: float, high: float, key: str, method: str, unit: str
) -> None:
    """Require values in [low, high]; nan is not."""
    # The extremes of a column with a nan are nan, and no comparison with nan is true.
    if not values.size or (values.min() >= low and values.max() <= high):
        return
    row = int(np.argmin((values >= low) & (values <= high)))
    words = (
        f"returned {values[row]:g} in row {row}; [{low:g}, {high:g}]{f' {unit}' if unit else ''} is"
        f" required"
    )
    raise InvalidOutput(key, method, words)
