"""The latest estimate of each track, as JSON documents."""

import math
from array import array
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces import hypothesis_columns
from opir_core.output import (
    burnout_texts,
    impact_texts,
    launch_texts,
    region_texts,
    state_texts,
    timestamp_text,
    writable_unix_microseconds,
)
from opir_core.plugin import REPORTED_TYPES, Tracks

#: Maximum number of earlier positions kept of a track; of the older half then every second is
#: removed.
TRAIL = 96

Document = dict[str, Any]
#: Time, latitude and longitude in degrees, height in metres.
Position = tuple[str, float, float, float]


class TrackDocuments:
    """The latest estimate of each track, at most `maximum`: those not updated for longest are removed.

    `hypotheses` are the names of the run's hypotheses.
    """

    def __init__(self, epoch_us: int, maximum: int = 1_000, hypotheses: Sequence[str] = ()) -> None:
        self._epoch_us = epoch_us
        self.maximum = maximum
        self._hypotheses = hypotheses
        self._documents_by_track: OrderedDict[int, Document] = OrderedDict()
        #: Earlier positions of each track, one after the other: Unix time, µs, latitude and
        #: longitude, deg, height, m.
        self._trails: dict[int, array[float]] = {}

    def __len__(self) -> int:
        return len(self._documents_by_track)

    def take(self, tracks: Tracks) -> Document:
        """Add estimates, sorted by tick; return the document with the last one of each track."""
        row_of = {number: row for row, number in enumerate(tracks.track.tolist())}
        tracks = tracks.take(list(row_of.values()))
        documents = self.documents(tracks)
        unix_us, _ = writable_unix_microseconds(tracks.tick_s, self._epoch_us)
        for document, time_us in zip(documents, unix_us.tolist(), strict=True):
            self._documents_by_track[document["track_id"]] = document
            self._documents_by_track.move_to_end(document["track_id"])
            self._extend_trail(document, time_us)
        while len(self._documents_by_track) > self.maximum:
            removed, _ = self._documents_by_track.popitem(last=False)
            self._trails.pop(removed, None)
        return {"tracks": documents}

    def latest(self, limit: int, *, trail: bool = False) -> list[Document]:
        """Return the documents of the tracks updated last, newest first; with their earlier
        positions if `trail`.
        """
        newest = list(reversed(tuple(self._documents_by_track.values())))[:limit]
        if not trail:
            return newest
        return [document | {"trail": self._trail(document["track_id"])} for document in newest]

    def _trail(self, number: int) -> list[Position]:
        """Return the earlier positions of a track."""
        rows = np.array(self._trails.get(number, ()), dtype=np.float64).reshape(-1, 4)
        times = timestamp_text(rows[:, 0].astype(np.int64))
        return [(time, *place) for time, place in zip(times, rows[:, 1:].tolist(), strict=True)]

    def _extend_trail(self, document: Document, time_us: int) -> None:
        if document["latitude_deg"] is None or document["altitude_m"] is None:
            return
        trail = self._trails.setdefault(document["track_id"], array("d"))
        trail.extend(
            (time_us, document["latitude_deg"], document["longitude_deg"], document["altitude_m"])
        )
        if len(trail) > 4 * TRAIL:
            rows = np.array(trail).reshape(-1, 4)
            keep = np.ones(len(rows), dtype=bool)
            keep[0 : len(rows) // 2 : 2] = False
            self._trails[document["track_id"]] = array("d", rows[keep].ravel())

    def documents(self, tracks: Tracks) -> list[Document]:
        """Return a document for each row."""
        place = ecef_to_geodetic(tracks.state[:, :3])
        unix_us, _ = writable_unix_microseconds(tracks.tick_s, self._epoch_us)
        available_us, _ = writable_unix_microseconds(tracks.available_s, self._epoch_us)
        columns = (
            tracks.track.tolist(),
            timestamp_text(unix_us),
            timestamp_text(available_us),
            _rounded(np.degrees(place.latitude_rad), 6),
            _rounded(np.degrees(place.longitude_rad), 6),
            _rounded(place.height_m, 1),
            map(msgspec.Raw, launch_texts(tracks, self._epoch_us)),
            map(msgspec.Raw, impact_texts(tracks, self._epoch_us)),
            map(msgspec.Raw, region_texts(tracks.impact_regions)),
            _rounded(tracks.probability_burning, 4),
            _rounded(tracks.probability_relights, 4),
            [
                dict(zip(REPORTED_TYPES, _rounded(row, 4), strict=True))
                for row in tracks.type_probability
            ],
            map(msgspec.Raw, state_texts(tracks, self._epoch_us)),
            map(msgspec.Raw, burnout_texts(tracks, self._epoch_us)),
        )
        weighed = hypothesis_columns(tracks, self._hypotheses, 4)
        names = (*_NAMES, *weighed)
        return [
            dict(zip(names, values, strict=True))
            for values in zip(*columns, *weighed.values(), strict=True)
        ]


_NAMES = (
    "track_id",
    "timestamp",
    "available_at",
    "latitude_deg",
    "longitude_deg",
    "altitude_m",
    "launch_point",
    "impact_point",
    "impact_regions",
    "probability_burning",
    "probability_relights",
    "type_probability",
    "state",
    "burnout",
)


def _rounded(column: FloatArray, decimals: int) -> list[float | None]:
    return [
        value if math.isfinite(value) else None for value in np.round(column, decimals).tolist()
    ]
