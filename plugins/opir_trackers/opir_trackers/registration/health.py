"""What is reported of the sensors: estimates with standard deviations, a sentence each, and what is
not observable.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.plugin import SensorHealth
from opir_trackers.registration.error_filter import Moments
from opir_trackers.registration.registration import Registration
from opir_trackers.registration.shared_errors import ERRORS

#: An error is not observable if more than this share of its prior variance is left.
_UNOBSERVED = 0.5

#: Least weight of an error in a combination that is named with it.
_PART = 0.3

#: Mean square of normalised innovations, and number of looks, from which a sensor is said not to be
#: as stated. Outliers of fewer looks have no share: the looks of tracks that ended are forgotten.
_WRONG = 2.0
_ENOUGH = 50.0

_NAMES = ("east", "north", "clock")


@lru_cache(maxsize=1)
def sensor_health(now: Registration, names: tuple[str, ...]) -> SensorHealth:
    """Return what is known of sensors with names (s,).

    The last result is kept: a live run asks every cycle, and the registration changes with a tick
    only.
    """
    sums = now.innovations
    known = now.reported
    mean = known.mean.reshape(-1, ERRORS)
    sigma = np.sqrt(np.maximum(np.diagonal(known.covariance), 0.0)).reshape(-1, ERRORS)
    hidden = unobservable(known, now.errors.mean_prior())
    looks = now.tracks.looks.sum(axis=0) + now.tracks.explained.sum(axis=0)
    found = {
        "bias_rad": mean[:, :2],
        "bias_sigma_rad": sigma[:, :2],
        "clock_s": mean[:, 2],
        "clock_sigma_s": sigma[:, 2],
        "noise_scale": sums.noise_scale,
        "noise_scale_sigma": sums.noise_scale_sigma,
        "innovations": sums.mean_square,
        "outlier_share": np.divide(
            now.tracks.explained.sum(axis=0),
            looks,
            out=np.full(len(looks), np.nan),
            where=looks > _ENOUGH,
        ),
    }
    text = tuple("; ".join(_sentence(now, found, hidden, row, names)) for row in range(len(names)))
    return SensorHealth.of(found, text)


def unobservable(known: Moments, prior: FloatArray) -> FloatArray:
    """Return the combinations (k, q) of errors, in units of their prior deviations, that the looks
    have not shown.

    They span the eigenvectors of the covariance in units of the prior variances (q,) of which more
    than half is left, each with as few errors as the elimination of others leaves.
    """
    scale = np.sqrt(prior)
    some = np.flatnonzero(scale)
    out = np.zeros((0, len(prior)))
    if len(some):
        left, vector = np.linalg.eigh(
            known.covariance[np.ix_(some, some)] / (scale[some][:, None] * scale[some])
        )
        rows = _eliminated(vector.T[left > _UNOBSERVED])
        out = np.zeros((len(rows), len(prior)))
        out[:, some] = rows
    return out


def _eliminated(rows: FloatArray) -> FloatArray:
    """Return another basis of rows (k, q): each has 1 where the others have 0."""
    out = rows.copy()
    for row in range(len(out)):
        pivot = int(np.argmax(np.abs(out[row])))
        out[row] /= out[row, pivot]
        others = np.arange(len(out)) != row
        out[others] -= out[others, pivot][:, None] * out[row]
    return out


def _sentence(
    now: Registration,
    found: dict[str, FloatArray],
    hidden: FloatArray,
    row: int,
    names: Sequence[str],
) -> Iterator[str]:
    """Yield what is known of a sensor, part by part."""
    is_compared = now.errors.used > 0
    is_small = found["bias_sigma_rad"][row].max() < _SMALL_RAD
    if is_small and is_compared and now.innovations.looks[row] == 0.0:
        yield "not judged: no look of it was compared with a track"
    elif is_small:
        yield (
            "no sign of a bias"
            if is_compared
            else "bias assumed to be 0: no target is seen by two sensors"
        )
    else:
        yield _bias(found, row) + _unseen(hidden, row, names, is_compared, _NAMES[:2])
    sigma_s = found["clock_sigma_s"][row]
    if sigma_s == 0.0:
        yield "clock assumed to be right"
    else:
        yield f"clock {found['clock_s'][row]:+.2f} ± {sigma_s:.2f} s" + _unseen(
            hidden, row, names, is_compared, _NAMES[2:]
        )
    scale = found["noise_scale"][row]
    scale_sigma = found["noise_scale_sigma"][row]
    if np.isfinite(scale):
        yield f"noise {scale:.2f} ± {max(scale_sigma, 0.01):.2f} × stated"
    if found["outlier_share"][row] > _FEW:
        yield f"outliers {found['outlier_share'][row]:.0%} of the looks"
    square = found["innovations"][row]
    if np.isfinite(square):
        is_wrong = square > _WRONG and now.innovations.looks[row] > _ENOUGH
        yield f"innovations {square:.2f} × their stated variance" + (
            ": not as stated" if is_wrong else ""
        )


#: Biases below this, rad, are 0 in the figures: what of them is not observed is not worth a word.
_SMALL_RAD = 5e-7

#: Least share of outliers that is worth a word.
_FEW = 0.02


def _bias(found: dict[str, FloatArray], row: int) -> str:
    parts = []
    for axis, name in enumerate(_NAMES[:2]):
        value = 1e6 * found["bias_rad"][row, axis]
        sigma = 1e6 * found["bias_sigma_rad"][row, axis]
        digits = 0 if sigma >= 1.0 else 1
        # 0 as a sum, as "-0" says nothing.
        parts.append(f"{round(value, digits) + 0.0:.{digits}f} ± {sigma:.{digits}f} µrad {name}")
    return ", ".join(parts)


def _unseen(
    hidden: FloatArray, row: int, names: Sequence[str], is_compared: bool, errors: tuple[str, ...]
) -> str:
    """Return what of a sensor's errors cannot be observed, in brackets."""
    mine = [ERRORS * row + _NAMES.index(error) for error in errors]
    parts = hidden[np.any(np.abs(hidden[:, mine]) > _PART, axis=1)]
    if not len(parts):
        return ""
    if not is_compared:
        return " (as stated: no target is seen by two sensors)"
    return f" (not observable: {'; '.join(_combination(part, row, names) for part in parts)})"


def _combination(part: FloatArray, row: int, names: Sequence[str]) -> str:
    """Return a combination of errors (q,) in words: those of a sensor first, without its name."""
    large = [int(each) for each in np.flatnonzero(np.abs(part) > _PART)]
    large.sort(key=lambda each: (each // ERRORS != row, each))
    words = ""
    for each in large:
        join = "" if not words else " + " if part[each] * part[large[0]] > 0.0 else " - "
        words += (
            join
            + _NAMES[each % ERRORS]
            + ("" if each // ERRORS == row else f" of {names[each // ERRORS]}")
        )
    return words
