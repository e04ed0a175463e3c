"""Track estimates as JSON: launch and impact points with error ellipses, states with covariances,
type probabilities.

Unknown values are null.
"""

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.estimation.ellipses import CONTAINMENT, containment_ellipse
from opir_core.interfaces.records import IMPACT_METHODS, TRACK_CONTAINMENTS, Tracks, Window
from opir_core.interfaces.weighed_tracks import hypothesis_columns
from opir_core.output.events.rendering import Looked
from opir_core.output.events.text import (
    DEGREE_DECIMALS,
    METRE_DECIMALS,
    POINT_DECIMALS,
    RATIO_DECIMALS,
    are_finite,
    known_rows,
    rounded,
    rounded_bearing_deg,
    rounded_degrees,
    rounded_longitude_deg,
    rounded_number,
    timestamp_text,
    where_known,
    writable_unix_microseconds,
)
from opir_core.scene.scene import REPORTED_TYPES

#: Containment probabilities of the other two ellipses of an event; that of the first is
#: `CONTAINMENT`.
OTHER_CONTAINMENTS = (0.5, 0.9)
#: The code of the impact method without a stated containment.
PAPER = IMPACT_METHODS.index("paper")


class UncertaintyEllipse(msgspec.Struct):
    """Ellipse that contains the point with probability `containment`; `bearing_deg` of the major
    axis, from north.
    """

    semi_major_m: float
    semi_minor_m: float
    bearing_deg: float
    containment: float


class Place(msgspec.Struct):
    """A launch or impact point: its geodetic WGS 84 position."""

    lat_deg: float
    lon_deg: float


class EstimatedPoint(Place):
    """A launch or impact point with its time, UTC, and uncertainties; unknown values are None."""

    time: str | None
    ellipse: UncertaintyEllipse | None
    ellipse_50: UncertaintyEllipse | None
    ellipse_90: UncertaintyEllipse | None
    time_sigma_s: float | None


class ImpactPoint(EstimatedPoint):
    """An impact point, and how it was predicted.

    `containment` is the probability of `ellipse`. The method `paper` states none: it has `sigma_m`,
    the σ per axis of the paper's law, in place of ellipses.
    """

    method: str
    containment: float | None
    sigma_m: float | None


class TrackState(msgspec.Struct):
    """ECEF position, m, and velocity relative to the Earth, m/s, at a time, with covariance;
    unknown values are None.

    The covariance is of x, y, z and their rates, at burnout also of its time, s: the lower
    triangle, row by row. `ellipsoid_sigmas` are the radii, in standard deviations, of the
    ellipsoids that contain the state with the probabilities `TRACK_CONTAINMENTS`; None for a normal
    distribution.
    """

    timestamp: str | None
    position_ecef_m: list[float]
    velocity_ecef_m_s: list[float]
    covariance_ecef: list[float] | None
    ellipsoid_sigmas: list[float] | None


_TRACK_FIELDS = (
    b',"track_state":%b,"burnout":%b,"track_type_probability":%b,"track_hypotheses":%b,"track_probability_launch":%b,'
    b'"track_probability_missile":%b,"track_probability_orbit":%b,"track_probability_comes_down":%b,"track_end":%b,"track_available_at":%b'
)
_encode = msgspec.json.Encoder().encode


def place_texts(place: FloatArray) -> list[bytes]:
    """Return points (n, 3), latitude_rad, longitude_rad and scene time_s, as JSON without their
    times and uncertainties, `null` if the position is unknown or not on the Earth.
    """
    return _point_texts(Place, _place_columns(place, POINT_DECIMALS), place)


def launch_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the launch points of estimates as JSON, `null` if the position is unknown or not on
    the Earth.
    """
    return _point_texts(
        EstimatedPoint,
        _point_columns(tracks.launch, tracks.launch_covariance, epoch_us),
        tracks.launch,
    )


def impact_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the predicted impact points of estimates as JSON, `null` if the position is unknown or
    not on the Earth.

    Impacts by the paper's law have no ellipses.
    """
    is_paper = tracks.impact_method == PAPER
    covariance = np.where(is_paper[:, np.newaxis, np.newaxis], np.nan, tracks.impact_covariance)
    covariance[:, 2, 2] = tracks.impact_covariance[:, 2, 2]
    point = _point_columns(tracks.impact, covariance, epoch_us, tracks.impact_sigmas)
    ellipses = point[_ELLIPSE]
    columns = (
        *point,
        [IMPACT_METHODS[code] for code in tracks.impact_method.tolist()],
        [None if ellipse is None else CONTAINMENT for ellipse in ellipses],
        [sigma_m and rounded_number(sigma_m, METRE_DECIMALS) for sigma_m in paper_sigma_m(tracks)],
    )
    return _point_texts(ImpactPoint, columns, tracks.impact)


@np.errstate(over="ignore", invalid="ignore")
def paper_sigma_m(tracks: Tracks) -> list[float | None]:
    """Return the standard deviations per axis (n,), m, of impacts by the paper's law; None for
    others.
    """
    variance = 0.5 * (tracks.impact_covariance[:, 0, 0] + tracks.impact_covariance[:, 1, 1])
    return _sigmas(np.where(tracks.impact_method == PAPER, variance, np.nan))


#: The place of `ellipse` among the values of `EstimatedPoint`.
_ELLIPSE = EstimatedPoint.__struct_fields__.index("ellipse")


def _point_columns(
    place: FloatArray,
    covariance: FloatArray,
    epoch_us: int,
    reported_sigmas: FloatArray | None = None,
) -> Sequence[Sequence[Any]]:
    """Return the values of `EstimatedPoint` for points (n, 3), latitude_rad, longitude_rad and
    scene time_s.

    `covariance` (n, 3, 3) is of east and north, m, and time, s; `reported_sigmas` (n, 3) as in
    `containment_ellipse`.
    """
    return (
        *_place_columns(place, DEGREE_DECIMALS),
        time_texts(np.where(are_on_earth(place), place[:, 2], 0.0), epoch_us),
        *(
            _ellipses(covariance[:, :2, :2], share, reported_sigmas)
            for share in (CONTAINMENT, *OTHER_CONTAINMENTS)
        ),
        [
            sigma_s and rounded_number(sigma_s, RATIO_DECIMALS)
            for sigma_s in _sigmas(covariance[:, 2, 2])
        ],
    )


def _place_columns(place: FloatArray, decimals: int) -> Sequence[Sequence[Any]]:
    """Return the values of `Place` for points (n, 3)."""
    filled = np.where(are_on_earth(place)[:, np.newaxis], place, 0.0)
    return (
        rounded_degrees(filled[:, 0], decimals).tolist(),
        rounded_longitude_deg(np.mod(filled[:, 1], 2.0 * np.pi), decimals).tolist(),
    )


def _point_texts(
    kind: type[Place], columns: Sequence[Sequence[Any]], place: FloatArray
) -> list[bytes]:
    points = (kind(*values) for values in zip(*columns, strict=True))
    return list(map(_encode, where_known(points, are_on_earth(place))))


def are_on_earth(place: FloatArray) -> BoolArray:
    """Return which points (n, 3), latitude_rad, longitude_rad and time, have a known position on
    the Earth.
    """
    return np.isfinite(place[:, 1]) & (np.abs(place[:, 0]) <= 0.5 * np.pi)


def time_texts(time_s: FloatArray, epoch_us: int) -> list[str | None]:
    """Return scene times (n,), s, as timestamps, None if unknown."""
    unix_us, writable = writable_unix_microseconds(time_s, epoch_us)
    texts = timestamp_text(np.where(writable, unix_us, 0))
    return where_known(texts, writable)


def _sigmas(variance: FloatArray) -> list[float | None]:
    """Return standard deviations (n,), None where the variance is unknown or negative."""
    valid = (variance >= 0.0) & (variance < np.inf)
    return where_known(np.sqrt(np.where(valid, variance, 0.0)).tolist(), valid)


def _ellipses(
    covariance_m2: FloatArray, containment: float, reported_sigmas: FloatArray | None
) -> list[UncertaintyEllipse | None]:
    ellipse = containment_ellipse(covariance_m2, containment, reported_sigmas)
    axes = zip(
        rounded(ellipse.semi_major_m, METRE_DECIMALS).tolist(),
        rounded(ellipse.semi_minor_m, METRE_DECIMALS).tolist(),
        rounded_bearing_deg(ellipse.bearing_rad, 180.0).tolist(),
        strict=True,
    )
    ellipses = (UncertaintyEllipse(*values, containment) for values in axes)
    return where_known(ellipses, np.isfinite(ellipse.semi_major_m))


def track_fields(window: Window, epoch_us: int, hypotheses: Sequence[str]) -> Looked:
    """Return the fields of each detection's track at its estimate's tick, without launch and
    impact.

    `hypotheses` are the names of the columns of `hypothesis_probability`.
    """
    rows, of_detection = np.unique(window.detections.estimate, return_inverse=True)
    estimates = window.estimates.take(rows[rows >= 0])
    unknown = [_TRACK_FIELDS % ((b"null",) * _TRACK_FIELDS.count(b"%b"))] * (
        len(rows) - len(estimates)
    )
    columns = (
        state_texts(estimates, epoch_us),
        burnout_texts(estimates, epoch_us),
        type_texts(estimates),
        *(
            map(_encode, column)
            for column in hypothesis_columns(estimates, hypotheses, RATIO_DECIMALS).values()
        ),
        map(_encode, time_texts(estimates.available_s, epoch_us)),
    )
    fields = [_TRACK_FIELDS % values for values in zip(*columns, strict=True)]
    return Looked([*unknown, *fields], of_detection)


def state_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the states of estimates at their ticks as JSON, `null` if unknown."""
    return _state_texts(
        tracks.state, tracks.tick_s, tracks.state_covariance, tracks.state_sigmas, epoch_us
    )


def burnout_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the states at burnout as JSON, `null` if unknown."""
    radii = np.full((len(tracks), len(TRACK_CONTAINMENTS)), np.nan)
    return _state_texts(
        tracks.burnout[:, :6], tracks.burnout[:, 6], tracks.burnout_covariance, radii, epoch_us
    )


def type_texts(tracks: Tracks) -> list[bytes]:
    """Return the type probabilities of estimates as JSON, `null` if unknown."""
    shares = rounded(tracks.type_probability, RATIO_DECIMALS).tolist()
    types = (dict(zip(REPORTED_TYPES, share, strict=True)) for share in shares)
    return list(map(_encode, where_known(types, are_finite(tracks.type_probability))))


def _state_texts(
    state: FloatArray, time_s: FloatArray, covariance: FloatArray, radii: FloatArray, epoch_us: int
) -> list[bytes]:
    """Return states (n, 6) at scene times (n,) with covariances (n, d, d) and radii of ellipsoids
    (n, 3).

    Covariances keep all digits: a nearly singular one, rounded, may not be positive semidefinite.
    """
    finite = are_finite(state)
    places = rounded(np.where(finite[:, np.newaxis], state, 0.0), METRE_DECIMALS).tolist()
    rows, columns = np.tril_indices(covariance.shape[1])
    values = zip(
        time_texts(time_s, epoch_us),
        places,
        known_rows(covariance[:, rows, columns]),
        known_rows(radii),
        strict=True,
    )
    states = (TrackState(time, place[:3], place[3:], *spread) for time, place, *spread in values)
    return list(map(_encode, where_known(states, finite)))
