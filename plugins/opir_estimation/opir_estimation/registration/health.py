"""The health of the sensors as reported: estimates with standard deviations, and a sentence each."""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.plugin import SensorHealth
from opir_estimation.registration.agreement import Agreement
from opir_estimation.registration.error_filter import LAW, Moments
from opir_estimation.registration.innovations import TrackInnovations
from opir_estimation.registration.registration import Registration
from opir_estimation.registration.shared_errors import ERRORS

_NAMES = ("east", "north", "clock")


@lru_cache(maxsize=1)
def sensor_health(registration: Registration, names: tuple[str, ...]) -> SensorHealth:
    """Return the health of sensors with names (s,).

    The last result is kept: a live run asks every cycle, and the registration changes with a tick
    only.
    """
    figures = _figures(registration)
    hidden = unobservable(registration.reported, registration.errors.mean_prior())
    rows = [
        _SensorRow(
            {name: column[row] for name, column in figures.items()},
            float(registration.innovations.looks[row]),
            _contradiction(registration.agreement, row),
            bool(registration.noise[row] == 1.0),
            registration.errors.comparisons > 0,
            hidden,
            row,
            names,
        )
        for row in range(len(names))
    ]
    return SensorHealth.of(figures, tuple("; ".join(_sentence(row)) for row in rows))


def _figures(registration: Registration) -> dict[str, FloatArray]:
    """Return the figures of the sensors (s,), by the names of `SensorHealth`."""
    sums = registration.innovations
    scales = registration.scales
    is_shown = scales.degrees >= LAW.shown_degrees
    noise_scale = np.where(is_shown, np.exp(scales.log_mean), np.nan)
    errors = registration.reported
    mean = errors.mean.reshape(-1, ERRORS)
    variance = np.maximum(np.diagonal(errors.covariance), 0.0)
    sigma = np.sqrt(variance).reshape(-1, ERRORS)
    return {
        "bias_rad": mean[:, :2],
        "bias_sigma_rad": sigma[:, :2],
        "clock_s": mean[:, 2],
        "clock_sigma_s": sigma[:, 2],
        "noise_scale": noise_scale,
        "noise_scale_sigma": noise_scale * scales.log_sigma,
        "innovations": sums.mean_square,
        "outlier_share": _outlier_share(registration.tracks),
    }


def _outlier_share(tracks: TrackInnovations) -> FloatArray:
    """Return the shares (s,) of looks that tracks explain as outliers; nan for few looks."""
    explained = tracks.explained.sum(axis=0)
    looks = tracks.looks.sum(axis=0) + explained
    unknown = np.full(len(looks), np.nan)
    return np.divide(explained, looks, out=unknown, where=looks > LAW.enough_looks)


def unobservable(errors: Moments, prior: FloatArray) -> FloatArray:
    """Return the combinations (k, q) of errors, in units of their prior deviations, that the looks
    have not shown.

    They span the eigenvectors of the covariance in units of the prior variances (q,) of which more
    than half is left, each with as few errors as the elimination of others leaves.
    """
    scale = np.sqrt(prior)
    unknown = np.flatnonzero(scale)
    if not len(unknown):
        return np.zeros((0, len(prior)))
    scale = scale[unknown]
    spread = errors.covariance[np.ix_(unknown, unknown)] / (scale[:, None] * scale)
    variance, vector = np.linalg.eigh(spread)
    rows = _eliminated(vector.T[variance > LAW.unobserved])
    combinations = np.zeros((len(rows), len(prior)))
    combinations[:, unknown] = rows
    return combinations


def _eliminated(rows: FloatArray) -> FloatArray:
    """Return another basis of rows (k, q): each has 1 where the others have 0."""
    basis = rows.copy()
    for row in range(len(basis)):
        pivot = int(np.argmax(np.abs(basis[row])))
        basis[row] /= basis[row, pivot]
        others = np.arange(len(basis)) != row
        basis[others] -= basis[others, pivot][:, None] * basis[row]
    return basis


class _SensorRow(NamedTuple):
    """Figures of the sensor with a number, its looks, how it contradicts others, whether its noise
    is assumed to be as stated, and the unobservable combinations of all.
    """

    figures: dict[str, Any]
    looks: float
    contradiction: str
    is_noise_stated: bool
    is_compared: bool
    hidden: FloatArray
    row: int
    names: Sequence[str]


def _sentence(sensor: _SensorRow) -> Iterator[str]:
    """Yield the figures of a sensor in words, part by part."""
    figures = sensor.figures
    if sensor.contradiction:
        yield sensor.contradiction
    if not figures["bias_sigma_rad"].max() < LAW.small_rad:
        yield _bias(sensor) + _unseen(sensor, _NAMES[:2])
    elif not sensor.is_compared:
        yield "bias assumed to be 0: no target was compared between two sensors"
    elif sensor.looks == 0.0:
        yield "not judged: no look of it was compared with a track"
    else:
        yield "no sign of a bias"
    if figures["clock_sigma_s"] < LAW.small_s:
        yield "clock assumed to be right"
    else:
        clock = f"clock {figures['clock_s']:+z.2f} ± {figures['clock_sigma_s']:.2f} s"
        yield clock + _unseen(sensor, _NAMES[2:])
    yield from _noise(sensor)


def _contradiction(agreement: Agreement, row: int) -> str:
    """Return in words how a sensor contradicts the others; nothing of one that does not."""
    if not agreement.contradicts[row]:
        return ""
    expected, shared, alone = (
        round(float(sums[row])) for sums in (agreement.expected, agreement.shared, agreement.alone)
    )
    elsewhere = f", and {alone} elsewhere" if alone else ""
    return (
        f"contradicts the others: {shared} of {expected} expected looks on targets that two of them"
        f" see{elsewhere}"
    )


def _noise(sensor: _SensorRow) -> Iterator[str]:
    """Yield noise, outliers and innovations in words, as far as they are known."""
    figures = sensor.figures
    scale = figures["noise_scale"]
    if np.isfinite(scale):
        sigma = max(figures["noise_scale_sigma"], 0.01 * scale)
        used = "" if sensor.is_noise_stated else ", which is used"
        yield f"noise {_digits(scale)} ± {_digits(sigma)} × stated{used}"
    share = figures["outlier_share"]
    if share > LAW.outlier_share:
        sigma = np.sqrt(share * (1.0 - share) / max(sensor.looks, 1.0))
        yield f"outliers {share:.0%} ± {max(sigma, 0.01):.0%} of the looks"
    square = figures["innovations"]
    if np.isfinite(square):
        is_small = square * LAW.wrong_square < 1.0 and not sensor.is_noise_stated
        is_wrong = sensor.looks > LAW.enough_looks and (square > LAW.wrong_square or is_small)
        verdict = ": not as stated" if is_wrong else ""
        yield f"innovations {_digits(square)} × their stated variance{verdict}"


def _digits(value: float) -> str:
    """Return a figure with two decimals, a small one with two digits."""
    return f"{value:.2f}" if value >= 0.01 or value == 0.0 else f"{value:.2g}"


def _bias(sensor: _SensorRow) -> str:
    angles = []
    columns = sensor.figures["bias_rad"], sensor.figures["bias_sigma_rad"], _NAMES[:2]
    for bias_rad, sigma_rad, name in zip(*columns, strict=True):
        sigma = 1e6 * sigma_rad
        digits = 0 if sigma >= 1.0 else 1
        # 0 as a sum, as "-0" says nothing.
        bias = round(1e6 * bias_rad, digits) + 0.0
        angles.append(f"{bias:.{digits}f} ± {sigma:.{digits}f} µrad {name}")
    return ", ".join(angles)


def _unseen(sensor: _SensorRow, errors: tuple[str, ...]) -> str:
    """Return the combinations of a sensor's errors that cannot be observed, in brackets."""
    columns = [ERRORS * sensor.row + _NAMES.index(error) for error in errors]
    is_named = np.abs(sensor.hidden[:, columns]) > LAW.named_weight
    combinations = sensor.hidden[np.any(is_named, axis=1)]
    if not len(combinations):
        return ""
    if not sensor.is_compared:
        return " (as stated: no target was compared between two sensors)"
    words = "; ".join(_combination(weights, sensor) for weights in combinations)
    return f" (not observable: {words})"


def _combination(weights: FloatArray, sensor: _SensorRow) -> str:
    """Return a combination of errors (q,) in words: those of the sensor first, without its name."""
    errors = [int(error) for error in np.flatnonzero(np.abs(weights) > LAW.named_weight)]
    errors.sort(key=lambda error: (error // ERRORS != sensor.row, error))
    words = ""
    for error in errors:
        owner, kind = divmod(error, ERRORS)
        if words:
            words += " + " if weights[error] * weights[errors[0]] > 0.0 else " - "
        words += _NAMES[kind] + ("" if owner == sensor.row else f" of {sensor.names[owner]}")
    return words
