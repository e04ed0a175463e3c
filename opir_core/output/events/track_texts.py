"""What a tracker knows of a track, as events carry it: states with covariances, and the probabilities of its types."""

import msgspec
import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.interfaces.records import TOLD_CONTAINMENTS, Tracks, Window
from opir_core.output.events.text import (
    METRE_DECIMALS,
    RATIO_DECIMALS,
    Piece,
    piece_table,
    rounded,
    taken,
    timestamp_text,
    writable_unix_microseconds,
)
from opir_core.scene.scene import REPORTED_TYPES


class TrackState(msgspec.Struct):
    """Earth-fixed position, m, and velocity, m/s, at a time, and their covariance; what is not known is None.

    The covariance is over x, y, z and their rates, and at the end of a burn over its time, s, too: the lower triangle,
    row by row. `ellipsoid_sigmas` are the radii of the ellipsoids that hold the state with the probabilities
    `TOLD_CONTAINMENTS`, in its standard deviations; None are those of a normal distribution.
    """

    timestamp: str | None
    position_ecef_m: list[float]
    velocity_ecef_m_s: list[float]
    covariance_ecef: list[float] | None
    ellipsoid_sigmas: list[float] | None


_KNOWLEDGE = b'"track_state":%b,"burnout":%b,"track_type_probability":%b,'
_encode = msgspec.json.Encoder().encode


def knowledge(window: Window, epoch_us: int) -> Piece:
    """Return what is known of the tracks of detections, at the tick that each detection's estimate is of."""
    rows, of_detection = np.unique(window.detections.estimate, return_inverse=True)
    used = window.estimates.take(rows[rows >= 0])
    unknown = [_KNOWLEDGE % (b"null", b"null", b"null")] * (len(rows) - len(used))
    told = zip(state_texts(used, epoch_us), burnout_texts(used, epoch_us), type_texts(used), strict=True)
    return taken(piece_table([*unknown, *(_KNOWLEDGE % texts for texts in told)]), of_detection)


def state_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the states of estimates at their ticks as JSON, or `null` where they are not known."""
    return _texts(tracks.state, tracks.tick_s, tracks.state_covariance, tracks.state_sigmas, epoch_us)


def burnout_texts(tracks: Tracks, epoch_us: int) -> list[bytes]:
    """Return the states at the ends of burns as JSON, or `null` where they are not known."""
    radii = np.full((len(tracks), len(TOLD_CONTAINMENTS)), np.nan)
    return _texts(tracks.burnout[:, :6], tracks.burnout[:, 6], tracks.burnout_covariance, radii, epoch_us)


def type_texts(tracks: Tracks) -> list[bytes]:
    """Return the probabilities of estimates' types as JSON, or `null` where they are not known."""
    known = _whole(tracks.type_probability)
    shares = rounded(tracks.type_probability, RATIO_DECIMALS).tolist()
    return [
        _encode(dict(zip(REPORTED_TYPES, share, strict=True)) if here else None)
        for here, share in zip(known.tolist(), shares, strict=True)
    ]


def _texts(
    state: FloatArray, time_s: FloatArray, covariance: FloatArray, sigmas: FloatArray, epoch_us: int
) -> list[bytes]:
    """Return states (n, 6) at scene times (n,) with covariances (n, d, d) and radii of ellipsoids (n, 3).

    Covariances are written in full, for one that is nearly singular is none once it is rounded.
    """
    known = _whole(state)
    unix_us, writable = writable_unix_microseconds(time_s, epoch_us)
    times = timestamp_text(np.where(writable, unix_us, 0))
    places = rounded(np.where(known[:, np.newaxis], state, 0.0), METRE_DECIMALS).tolist()
    rows, columns = np.tril_indices(covariance.shape[1])
    lower = covariance[:, rows, columns]
    radii = [each if whole else None for whole, each in zip(_whole(sigmas), sigmas.tolist(), strict=True)]
    terms = [each if whole else None for whole, each in zip(_whole(lower), lower.tolist(), strict=True)]
    when = [time if timed else None for timed, time in zip(writable.tolist(), times, strict=True)]
    told = zip(known.tolist(), when, places, terms, radii, strict=True)
    return [
        _encode(TrackState(time, place[:3], place[3:], *spread) if here else None)
        for here, time, place, *spread in told
    ]


def _whole(rows: FloatArray) -> BoolArray:
    """Return which rows (n, d) are finite numbers throughout."""
    whole: BoolArray = np.logical_and.reduce(np.isfinite(rows), axis=1)
    return whole
