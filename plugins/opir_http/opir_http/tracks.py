"""The latest estimate of each track, as JSON documents."""

import math
from collections import OrderedDict
from typing import Any

import msgspec
import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces.records import Tracks
from opir_core.output.events.estimates import burnout_texts, impact_texts, launch_texts, state_texts
from opir_core.output.events.text import timestamp_text, writable_unix_microseconds
from opir_core.output.geojson import region_texts
from opir_core.scene.scene import REPORTED_TYPES

#: Maximum number of tracks; those not updated for longest are removed.
KEPT = 1000
#: Maximum number of earlier positions kept of a track; of the older half then every second is removed.
TRAIL = 96

Document = dict[str, Any]
#: Time, latitude and longitude in degrees, height in metres.
Position = tuple[Any, ...]


class TrackDocuments:
    """The latest estimate of each track, for a bounded number of tracks."""

    def __init__(self, epoch_us: int) -> None:
        self._epoch_us = epoch_us
        self._documents_by_track: OrderedDict[int, Document] = OrderedDict()
        self._trails: dict[int, list[Position]] = {}

    def __len__(self) -> int:
        return len(self._documents_by_track)

    def take(self, tracks: Tracks) -> Document:
        """Add estimates, sorted by tick; return the document with the last one of each track."""
        last = {number: row for row, number in enumerate(tracks.track.tolist())}
        documents = self.documents(tracks.take(list(last.values())))
        for document in documents:
            self._documents_by_track[document["track_id"]] = document
            self._documents_by_track.move_to_end(document["track_id"])
            self._extend_trail(document)
        while len(self._documents_by_track) > KEPT:
            removed, _ = self._documents_by_track.popitem(last=False)
            self._trails.pop(removed, None)
        return {"tracks": documents}

    def latest(self, limit: int, *, trail: bool = False) -> list[Document]:
        """Return the documents of the tracks updated last, newest first; with their earlier positions if `trail`."""
        newest = list(reversed(tuple(self._documents_by_track.values())))[:limit]
        if not trail:
            return newest
        return [document | {"trail": list(self._trails.get(document["track_id"], ()))} for document in newest]

    def _extend_trail(self, document: Document) -> None:
        if document["latitude_deg"] is None:
            return
        trail = self._trails.setdefault(document["track_id"], [])
        trail.append(tuple(document[name] for name in ("timestamp", "latitude_deg", "longitude_deg", "altitude_m")))
        if len(trail) > TRAIL:
            del trail[0 : len(trail) // 2 : 2]

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
            [dict(zip(REPORTED_TYPES, _rounded(row, 4), strict=True)) for row in tracks.type_probability],
            map(msgspec.Raw, state_texts(tracks, self._epoch_us)),
            map(msgspec.Raw, burnout_texts(tracks, self._epoch_us)),
        )
        return [dict(zip(_NAMES, values, strict=True)) for values in zip(*columns, strict=True)]


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
    return [value if math.isfinite(value) else None for value in np.round(column, decimals).tolist()]
