"""Tracks of GPS receivers and maps: GPX (trkpt and rtept with times) and KML (gx:Track).

Heights of GPX are above mean sea level or the ellipsoid, as the receiver writes them: they are
taken as above the WGS 84 ellipsoid, with a note. A line of KML has no times, so no speed: it is
refused.
"""

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.detections.times import unix_ns
from opir_readers.states import number_or_nan, require_angles, require_order, single_run
from opir_readers.xml_nodes import XmlNode, xml_root

_SEA_LEVEL = (
    "heights are taken as above the WGS 84 ellipsoid; above mean sea level they are up to 105 m off"
)


class Point(NamedTuple):
    """A point of a track: its line, nanoseconds of UTC since 1970, and its place."""

    line: int
    unix_ns: int
    lat_deg: float
    lon_deg: float
    height_m: float


#: The name and the points of a track.
Track = tuple[str, Sequence[Point]]


def gpx_table(text: str, epoch_us: int, name: str | None) -> StateTable:
    """Return the track of a GPX file, that of a name where there are several. Raises
    `BadFileError`.
    """
    root = xml_root(text)
    nodes = [track for kind in ("trk", "rte") for track in root.all(kind)]
    tracks = [(track.text_of("name"), _gpx_points(track)) for track in nodes]
    tracks = tracks or [("", _gpx_points(root))]
    return _table(_track(tracks, name, "trk"), epoch_us, "GPX: latitude, longitude, height")


def kml_table(text: str, epoch_us: int, name: str | None) -> StateTable:
    """Return the track of a KML file, that of the place mark of a name where there are several.
    Raises `BadFileError`.
    """
    root = xml_root(text)
    marks = root.all("Placemark")
    tracks = [(mark.text_of("name"), points) for mark in marks for points in _tracks_of_mark(mark)]
    tracks = tracks or [("", _kml_points(track)) for track in root.all("Track")]
    if not tracks:
        lines = sum(1 for _ in root.all("LineString"))
        has = f" (it has {lines} lines of places without times)" if lines else ""
        raise BadFileError(
            f"has no gx:Track, whose places have times{has}; export the track with times, or as GPX"
            " or CSV"
        )
    return _table(_track(tracks, name, "Placemark"), epoch_us, "KML: longitude, latitude, height")


def _tracks_of_mark(mark: XmlNode) -> list[Sequence[Point]]:
    """Return the tracks of a place mark; those of a gx:MultiTrack are one, in parts."""
    whole = list(mark.all("MultiTrack"))
    if not whole:
        return [_kml_points(track) for track in mark.all("Track")]
    return [
        [point for track in multiple.all("Track") for point in _kml_points(track)]
        for multiple in whole
    ]


def _gpx_points(track: XmlNode) -> Sequence[Point]:
    nodes = (node for kind in ("trkpt", "rtept", "wpt") for node in track.all(kind))
    return [_gpx_point(node) for node in nodes]


def _gpx_point(node: XmlNode) -> Point:
    time = node.text_of("time")
    if not time:
        raise BadFileError(
            f"line {node.line}: this {node.name} has no time; export the track with times"
        )
    lat, lon = (_number(node.attributes.get(name, ""), node.line, name) for name in ("lat", "lon"))
    if not node.text_of("ele"):
        raise BadFileError(
            f"line {node.line}: this {node.name} has no ele, its height; export the track with"
            " heights"
        )
    height = _number(node.text_of("ele"), node.line, "ele")
    return Point(node.line, unix_ns(time, f"line {node.line}: time"), lat, lon, height)


def _kml_points(track: XmlNode) -> Sequence[Point]:
    mode = track.text_of("altitudeMode")
    if mode and mode != "absolute":
        raise BadFileError(f"line {track.line}: altitudeMode is {mode}; export absolute heights")
    times = [node for node in track.children if node.name == "when"]
    places = [node for node in track.children if node.name == "coord"]
    if len(times) != len(places):
        raise BadFileError(f"line {track.line}: has {len(times)} times and {len(places)} places")
    return [_kml_point(time, place) for time, place in zip(times, places, strict=True)]


def _kml_point(time: XmlNode, place: XmlNode) -> Point:
    words = place.text.split()
    if len(words) != 3:
        raise BadFileError(
            f"line {place.line}: {place.text[:40]!r} is not longitude, latitude and height"
        )
    lon, lat, height = (_number(word, place.line, "coord") for word in words)
    return Point(place.line, unix_ns(time.text, f"line {time.line}: when"), lat, lon, height)


def _number(text: str, line: int, name: str) -> float:
    value = number_or_nan(text)
    if math.isnan(value):
        raise BadFileError(f"line {line}: {name} is {text[:40]!r}, not a finite number")
    return value


def _track(tracks: Sequence[Track], name: str | None, kind: str) -> Iterable[Point]:
    """Return the points of the track of a name, or of the only one."""
    matches = [points for title, points in tracks if points and name in (None, title)]
    if len(matches) == 1:
        return matches[0]
    names = ", ".join(title or "one without a name" for title, _ in tracks) or "none"
    if not matches:
        which = "with points" if name is None else repr(name)
        raise BadFileError(f"has no {kind} {which}; its tracks: {names}")
    raise BadFileError(f"has several tracks; say which with object: {names}")


def _table(track: Iterable[Point], epoch_us: int, frame: str) -> StateTable:
    """Return the states of a track; of points in a row with the same time the first counts."""
    points = []
    last_ns = None
    for point in track:
        if point.unix_ns != last_ns:
            points.append(point)
        last_ns = point.unix_ns
    if len(points) < 2:
        raise BadFileError(f"has {len(points)} states at different times; at least 2 are needed")
    lines, times_ns, lat_deg, lon_deg, height_m = zip(*points, strict=True)
    line_of = lines.__getitem__
    time_s = np.array([(time_ns - epoch_us * 1000) * 1e-9 for time_ns in times_ns])
    latitude, longitude = np.radians([lat_deg, lon_deg])
    require_angles(latitude, longitude, line_of)
    require_order(time_s, line_of, may_repeat=False)
    with np.errstate(over="ignore", invalid="ignore"):
        position = geodetic_to_ecef(latitude, longitude, np.array(height_m))
    return single_run(
        time_s, position, None, line_of, notes=(_SEA_LEVEL,), has_dates=True, frame=frame
    )
