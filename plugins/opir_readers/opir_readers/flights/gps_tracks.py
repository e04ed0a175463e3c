"""Tracks of GPS receivers and maps: GPX (trkpt and rtept with times) and KML (gx:Track).

Heights of GPX are above mean sea level or the ellipsoid, as the receiver writes them: they are
taken as above the WGS 84 ellipsoid, with a note. A line of KML has no times, so no speed: it is
refused.
"""

import math
from collections.abc import Sequence

import numpy as np

from opir_core.geometry import geodetic_to_ecef
from opir_core.plugin import BadFileError, StateTable
from opir_readers.detections.times import unix_ns
from opir_readers.states import require_angles, require_order, require_places
from opir_readers.xml_nodes import XmlNode, xml_root

_POINTS = ("trkpt", "rtept", "wpt")

_SEA_LEVEL = (
    "heights are taken as above the WGS 84 ellipsoid; above mean sea level they are up to 105 m off"
)

#: A point of a track: line, nanoseconds of UTC since 1970, latitude and longitude, deg, height, m.
Point = tuple[int, int, float, float, float]


def gpx_table(text: str, epoch_us: int, wanted: str | None) -> StateTable:
    """Return the track of a GPX file; `wanted` is its name where there are several. Raises
    `BadFileError`.
    """
    root = xml_root(text)
    tracks = [
        (track.text_of("name"), list(_gpx_points(track)))
        for kind in ("trk", "rte")
        for track in root.all(kind)
    ]
    if not tracks:
        tracks = [("", list(_gpx_points(root)))]
    return _table(
        _chosen(tracks, wanted, "trk"), epoch_us, "GPX: latitude, longitude, height", (_SEA_LEVEL,)
    )


def kml_table(text: str, epoch_us: int, wanted: str | None) -> StateTable:
    """Return the track of a KML file; `wanted` is the name of its place mark. Raises
    `BadFileError`.
    """
    root = xml_root(text)
    marks = (
        (mark.text_of("name"), track)
        for mark in root.all("Placemark")
        for track in mark.all("Track")
    )
    tracks = [(name, _kml_points(track)) for name, track in marks]
    if not tracks:
        tracks = [("", _kml_points(track)) for track in root.all("Track")]
    if not tracks:
        lines = sum(1 for _ in root.all("LineString"))
        has = f" (it has {lines} lines of places without times)" if lines else ""
        raise BadFileError(
            f"has no gx:Track, whose places have times{has}; export the track with times, or as GPX"
            f" or CSV"
        )
    return _table(
        _chosen(tracks, wanted, "Placemark"),
        epoch_us,
        "KML: longitude, latitude, height",
        (_SEA_LEVEL,),
    )


def _gpx_points(track: XmlNode) -> Sequence[Point]:
    points = []
    for kind in _POINTS:
        for node in track.all(kind):
            time = node.text_of("time")
            if not time:
                raise BadFileError(
                    f"line {node.line}: this {kind} has no time; export the track with times"
                )
            angles = [
                _number(node.attributes.get(name, ""), node.line, name) for name in ("lat", "lon")
            ]
            if not node.text_of("ele"):
                raise BadFileError(
                    f"line {node.line}: this {kind} has no ele, its height; export the track with"
                    f" heights"
                )
            height = _number(node.text_of("ele"), node.line, "ele")
            points.append(
                (node.line, unix_ns(time, f"line {node.line}: time"), angles[0], angles[1], height)
            )
    return points


def _kml_points(track: XmlNode) -> Sequence[Point]:
    mode = track.text_of("altitudeMode")
    if mode and mode != "absolute":
        raise BadFileError(f"line {track.line}: altitudeMode is {mode}; export absolute heights")
    times = [node for node in track.children if node.name == "when"]
    places = [node for node in track.children if node.name == "coord"]
    if len(times) != len(places):
        raise BadFileError(f"line {track.line}: has {len(times)} times and {len(places)} places")
    points = []
    for time, place in zip(times, places, strict=True):
        words = place.text.split()
        if len(words) != 3:
            raise BadFileError(
                f"line {place.line}: {place.text[:40]!r} is not longitude, latitude and height"
            )
        lon, lat, height = (_number(word, place.line, "coord") for word in words)
        points.append((place.line, unix_ns(time.text, f"line {time.line}: when"), lat, lon, height))
    return points


def _number(text: str, line: int, name: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise BadFileError(f"line {line}: {name} is {text[:40]!r}, not a finite number")
    return value


def _chosen(
    tracks: Sequence[tuple[str, Sequence[Point]]], wanted: str | None, kind: str
) -> Sequence[Point]:
    """Return the points of the track of a name, or of the only one."""
    found = [(name, points) for name, points in tracks if points and wanted in (None, name)]
    if len(found) == 1:
        return found[0][1]
    names = ", ".join(name or "one without a name" for name, _ in tracks) or "none"
    if not found:
        which = "with points" if wanted is None else repr(wanted)
        raise BadFileError(f"has no {kind} {which}; its tracks: {names}")
    raise BadFileError(f"has several tracks; say which with object: {names}")


def _table(
    points: Sequence[Point], epoch_us: int, frame: str, notes: tuple[str, ...]
) -> StateTable:
    kept = [
        point
        for number, point in enumerate(points)
        if number == 0 or point[1] != points[number - 1][1]
    ]
    if len(kept) < 2:
        raise BadFileError(f"has {len(kept)} states at different times; at least 2 are needed")
    lines = [point[0] for point in kept]
    time_s = np.array([(point[1] - epoch_us * 1000) * 1e-9 for point in kept])
    angles = np.radians([[point[2], point[3]] for point in kept])
    require_angles(angles[:, 0], angles[:, 1], lines.__getitem__)
    require_order(time_s, lines.__getitem__, may_repeat=False)
    with np.errstate(over="ignore", invalid="ignore"):
        position = geodetic_to_ecef(
            angles[:, 0], angles[:, 1], np.array([point[4] for point in kept])
        )
    require_places(position, lines.__getitem__)
    burns = np.array([[time_s[0], time_s[-1]]])
    run = np.zeros(len(kept), dtype=np.int64)
    return StateTable(
        time_s, position, None, run, burns, lines.__getitem__, notes, has_dates=True, frame=frame
    )
