"""Estimated points on the ground as events carry them: place, time, and their uncertainty."""

import msgspec
import numpy as np

from opir_core.arrays import FloatArray
from opir_core.estimation.containment_ellipse import CONTAINMENT, containment_ellipse
from opir_core.output.events.text import (
    METRE_DECIMALS,
    RATIO_DECIMALS,
    rounded,
    rounded_bearing_deg,
    rounded_degrees,
    rounded_longitude_deg,
    timestamp_text,
    writable_unix_microseconds,
)

#: The probabilities of the other two ellipses of an event; the first is that of `containment_ellipse`.
OTHER_CONTAINMENTS = (0.5, 0.9)


class UncertaintyEllipse(msgspec.Struct):
    """Where the point lies with the probability `containment`; `bearing_deg` is the longer axis', from north."""

    semi_major_m: float
    semi_minor_m: float
    bearing_deg: float
    containment: float


class EstimatedPoint(msgspec.Struct):
    """A launch or an impact: geodetic place on WGS 84, UTC, and how surely; what is not known is None."""

    lat_deg: float
    lon_deg: float
    time: str | None
    ellipse: UncertaintyEllipse | None
    ellipse_50: UncertaintyEllipse | None
    ellipse_90: UncertaintyEllipse | None
    time_sigma_s: float | None


_encode = msgspec.json.Encoder().encode


def point_texts(
    place: FloatArray, covariance: FloatArray, epoch_us: int, told_sigmas: FloatArray | None = None
) -> list[bytes]:
    """Return points as JSON, or `null` where the place is not known or none on Earth.

    `place` (n, 3) is latitude_rad, longitude_rad and scene time_s; `covariance` (n, 3, 3) is over east and
    north, m, and time, s; `told_sigmas` (n, 3) are as in `containment_ellipse`.
    """
    on_earth = np.isfinite(place[:, 1]) & (np.abs(place[:, 0]) <= 0.5 * np.pi)
    known = np.where(on_earth[:, np.newaxis], place, 0.0)
    columns = (
        rounded_degrees(known[:, 0]).tolist(),
        rounded_longitude_deg(np.mod(known[:, 1], 2.0 * np.pi)).tolist(),
        _times(known[:, 2], epoch_us),
        *(_ellipses(covariance[:, :2, :2], share, told_sigmas) for share in (CONTAINMENT, *OTHER_CONTAINMENTS)),
        _sigmas(covariance[:, 2, 2]),
    )
    points = (EstimatedPoint(*values) for values in zip(*columns, strict=True))
    return [_encode(point if here else None) for here, point in zip(on_earth.tolist(), points, strict=True)]


def _times(time_s: FloatArray, epoch_us: int) -> list[str | None]:
    unix_us, writable = writable_unix_microseconds(time_s, epoch_us)
    texts = timestamp_text(np.where(writable, unix_us, 0))
    return [text if known else None for text, known in zip(texts, writable.tolist(), strict=True)]


def _sigmas(variance: FloatArray) -> list[float | None]:
    known = (variance >= 0.0) & (variance < np.inf)
    sigma = rounded(np.sqrt(np.where(known, variance, 0.0)), RATIO_DECIMALS).tolist()
    return [value if lawful else None for value, lawful in zip(sigma, known.tolist(), strict=True)]


def _ellipses(
    covariance_m2: FloatArray, containment: float, told_sigmas: FloatArray | None
) -> list[UncertaintyEllipse | None]:
    ellipse = containment_ellipse(covariance_m2, containment, told_sigmas)
    known = np.isfinite(ellipse.semi_major_m).tolist()
    major_m = rounded(ellipse.semi_major_m, METRE_DECIMALS).tolist()
    minor_m = rounded(ellipse.semi_minor_m, METRE_DECIMALS).tolist()
    bearing_deg = rounded_bearing_deg(ellipse.bearing_rad, 180.0).tolist()
    return [
        UncertaintyEllipse(major, minor, bearing, containment) if lawful else None
        for lawful, major, minor, bearing in zip(known, major_m, minor_m, bearing_deg, strict=True)
    ]
