"""Tracks as records of plain values with units in their keys: the lines of the tracks file and of
the encoder `tracks`.

Unknown values are null. Positions are ECEF, m, velocities relative to the rotating Earth, m/s;
points are geodetic, on WGS 84. Numbers are written in full, but for the outlines of regions.
"""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from opir_core.arrays import FloatArray
from opir_core.interfaces.records import IMPACT_METHODS, TRACK_CONTAINMENTS, Tracks
from opir_core.interfaces.weighed_tracks import hypothesis_columns
from opir_core.output.events.estimates import PAPER, are_on_earth, paper_sigma_m, time_texts
from opir_core.output.events.text import are_finite, known_rows, where_known
from opir_core.output.geojson import region_text, region_texts
from opir_core.reading.format_versions import TRACK_FORMAT
from opir_core.scene.scene import REPORTED_TYPES

#: Finite, and with squares that are finite too.
FiniteNumber = Annotated[float, Meta(ge=-1e100, le=1e100)]
#: A probability; sums of some pass 1 by rounding errors.
Share = Annotated[float, Meta(ge=-1e-6, le=1.000001)]
_Vector = tuple[FiniteNumber, FiniteNumber, FiniteNumber]
_Pair = tuple[FiniteNumber, FiniteNumber]
_Six = tuple[FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber]
_Seven = tuple[
    FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber, FiniteNumber
]
_Limit = 2**63 - 1
_Track = Annotated[int, Meta(ge=0, le=_Limit)]
_Time = Annotated[float, Meta(ge=-float(_Limit), le=float(_Limit))]


class LaunchRecord(msgspec.Struct, kw_only=True, gc=False):
    """A launch point and its time; covariances of east and north, m², and of time with east and
    north.
    """

    lat_deg: Annotated[float, Meta(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Meta(ge=-360.0, le=360.0)]
    time_s: FiniteNumber | None = None
    time: str | UnsetType | None = UNSET
    covariance_m2: tuple[_Pair, _Pair] | None = None
    time_variance_s2: FiniteNumber | None = None
    time_covariance_m_s: _Pair | None = None


class ImpactRecord(LaunchRecord, kw_only=True, gc=False):
    """A predicted impact: how it was predicted, and the radii of the ellipses with the
    probabilities `containment`.

    `ellipse_sigmas` are in standard deviations; null for those of a normal distribution. The method
    `paper` states no probability: it has `sigma_m` in place of covariance and containment.
    """

    method: Literal["posterior", "paper"] = "posterior"
    containment: Sequence[Share] | None = None
    ellipse_sigmas: _Vector | None = None
    sigma_m: FiniteNumber | None = None


class BurnoutRecord(msgspec.Struct, kw_only=True, gc=False):
    """The state at burnout and its time; the covariance (7, 7) is of position, velocity and
    time.
    """

    time_s: FiniteNumber
    time: str | UnsetType | None = UNSET
    position_ecef_m: _Vector
    velocity_ecef_m_s: _Vector
    covariance: tuple[_Seven, _Seven, _Seven, _Seven, _Seven, _Seven, _Seven] | None = None


class TrackRecord(msgspec.Struct, kw_only=True, gc=False):
    """A track at a tick; the covariance (6, 6) is of position and velocity.

    In a file the first record of a track is complete. Later ones have `since_s`, the time of the
    track's record before, and leave out what is as in that one. Files of earlier versions have
    complete records, in which `impact_regions_id` may stand for the regions of an earlier line.
    """

    schema_version: str | UnsetType = UNSET
    time_s: _Time
    timestamp: str | UnsetType = UNSET
    track_id: _Track
    since_s: float | UnsetType = UNSET
    available_s: _Time | None = None
    available_at: str | UnsetType | None = UNSET
    target_type: str | None = None
    type_probability: dict[str, Share] | None = None
    hypotheses: dict[str, Share] | None = None
    probability_launch: Share | None = None
    probability_missile: Share | None = None
    probability_orbit: Share | None = None
    probability_comes_down: FiniteNumber | None = None
    position_ecef_m: _Vector | None = None
    velocity_ecef_m_s: _Vector | None = None
    covariance: tuple[_Six, _Six, _Six, _Six, _Six, _Six] | None = None
    ellipsoid_sigmas: _Vector | None = None
    launch: LaunchRecord | None = None
    burnout: BurnoutRecord | None = None
    impact: ImpactRecord | None = None
    impact_regions: Any = UNSET
    impact_regions_id: int | UnsetType = UNSET
    probability_burning: Share | None = None
    probability_relights: Share | None = None
    end: Literal["impact", "orbit", "lost", "flash", "unresolved"] | None = None
    seen_s: FiniteNumber | None = None
    is_brief: bool = False


def track_records(
    tracks: Tracks,
    hypotheses: Sequence[str],
    epoch_us: int | None = None,
    schema_version: str | UnsetType = UNSET,
    regions: Mapping[str, Sequence[Any]] | None = None,
) -> list[Any]:
    """Return the records of tracks (n,); with an epoch, µs since 1970-01-01, they have timestamps
    too.

    `hypotheses` are the names of the columns of `hypothesis_probability`; `regions` are the columns
    of impact regions, by default the regions themselves.
    """
    types = _types(tracks)
    if regions is None:
        regions = {"impact_regions": list(map(msgspec.Raw, region_texts(tracks.impact_regions)))}
    columns = {
        "time_s": tracks.tick_s.tolist(),
        "timestamp": _timestamps(tracks.tick_s, epoch_us),
        "track_id": tracks.track.tolist(),
        "available_s": tracks.available_s.tolist(),
        "available_at": _timestamps(tracks.available_s, epoch_us),
        "target_type": [
            None if share is None else max(share, key=share.__getitem__) for share in types
        ],
        "type_probability": types,
        **hypothesis_columns(tracks, hypotheses),
        "position_ecef_m": known_rows(tracks.state[:, :3]),
        "velocity_ecef_m_s": known_rows(tracks.state[:, 3:]),
        "covariance": known_rows(tracks.state_covariance),
        "ellipsoid_sigmas": known_rows(tracks.state_sigmas),
        "launch": _points(LaunchRecord, tracks.launch, tracks.launch_covariance, epoch_us),
        "burnout": _burnouts(tracks, epoch_us),
        "impact": _impacts(tracks, epoch_us),
        **regions,
        "probability_burning": known_rows(tracks.probability_burning),
        "probability_relights": known_rows(tracks.probability_relights),
        "seen_s": known_rows(tracks.seen_s),
        "is_brief": tracks.is_brief.tolist(),
    }
    return [
        TrackRecord(schema_version=schema_version, **dict(zip(columns, row, strict=True)))
        for row in zip(*columns.values(), strict=True)
    ]


#: Fields that every record has.
_VERSION = f"{TRACK_FORMAT.name}-{TRACK_FORMAT.version}"
_ALWAYS = {"schema_version", "time_s", "timestamp", "track_id", "since_s"}
_KEPT = tuple(name for name in TrackRecord.__struct_fields__ if name not in _ALWAYS)


class Changes:
    """Leaves out of records what is as in the record of the same track before."""

    def __init__(self) -> None:
        self._latest: dict[int, TrackRecord] = {}

    def records(self, tracks: Tracks, hypotheses: Sequence[str]) -> list[TrackRecord]:
        """Return the records of the next tracks (n,), as in `track_records`."""
        regions = {"impact_regions": tracks.impact_regions.tolist()}
        records = [self._changed(row) for row in track_records(tracks, hypotheses, regions=regions)]
        for track in tracks.track[tracks.end > 0].tolist():
            self._latest.pop(track, None)
        return records

    def _changed(self, record: TrackRecord) -> TrackRecord:
        before = self._latest.get(record.track_id)
        self._latest[record.track_id] = record
        changes: dict[str, Any] = {"schema_version": _VERSION}
        if before is not None:
            same = [name for name in _KEPT if getattr(record, name) == getattr(before, name)]
            changes = {"since_s": before.time_s, **dict.fromkeys(same, UNSET)}
        if "impact_regions" not in changes:
            changes["impact_regions"] = msgspec.Raw(region_text(record.impact_regions))
        return msgspec.structs.replace(record, **changes)


def _impacts(tracks: Tracks, epoch_us: int | None) -> list[ImpactRecord | None]:
    points = _points(ImpactRecord, tracks.impact, tracks.impact_covariance, epoch_us)
    rows = zip(
        points,
        tracks.impact_method.tolist(),
        known_rows(tracks.impact_sigmas),
        paper_sigma_m(tracks),
        strict=True,
    )
    for point, method, sigmas, sigma_m in rows:
        if point is None:
            continue
        point.method = IMPACT_METHODS[method]
        if method == PAPER:
            point.sigma_m = sigma_m
            point.covariance_m2 = None
        else:
            point.containment = TRACK_CONTAINMENTS
            point.ellipse_sigmas = sigmas
    return points


def _points(
    kind: Any, place: FloatArray, covariance: FloatArray, epoch_us: int | None
) -> list[Any]:
    """Return points (n, 3) with covariances (n, 3, 3) as records, None where the position is
    unknown.
    """
    longitude = place[:, 1]
    east = np.where(
        np.abs(longitude) <= np.pi, longitude, np.mod(longitude + np.pi, 2.0 * np.pi) - np.pi
    )
    columns = {
        "lat_deg": np.degrees(place[:, 0]).tolist(),
        "lon_deg": np.degrees(east).tolist(),
        "time_s": known_rows(place[:, 2]),
        "time": _timestamps(place[:, 2], epoch_us),
        "covariance_m2": known_rows(covariance[:, :2, :2]),
        "time_variance_s2": known_rows(covariance[:, 2, 2]),
        "time_covariance_m_s": known_rows(covariance[:, :2, 2]),
    }
    rows = zip(*columns.values(), strict=True)
    points = (kind(**dict(zip(columns, row, strict=True))) for row in rows)
    return where_known(points, are_on_earth(place))


def _burnouts(tracks: Tracks, epoch_us: int | None) -> list[BurnoutRecord | None]:
    rows = zip(
        tracks.burnout.tolist(),
        _timestamps(tracks.burnout[:, 6], epoch_us),
        known_rows(tracks.burnout_covariance),
        strict=True,
    )
    burnouts = (
        BurnoutRecord(
            time_s=state[6],
            time=time,
            position_ecef_m=state[:3],
            velocity_ecef_m_s=state[3:6],
            covariance=covariance,
        )
        for state, time, covariance in rows
    )
    return where_known(burnouts, are_finite(tracks.burnout))


def _types(tracks: Tracks) -> list[dict[str, float] | None]:
    return [
        None if share is None else dict(zip(REPORTED_TYPES, share, strict=True))
        for share in known_rows(tracks.type_probability)
    ]


def _timestamps(time_s: FloatArray, epoch_us: int | None) -> Sequence[Any]:
    return [UNSET] * len(time_s) if epoch_us is None else time_texts(time_s, epoch_us)
