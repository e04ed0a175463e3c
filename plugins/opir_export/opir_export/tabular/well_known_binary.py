"""Polygons of GeoJSON as well-known binary, and as text (OGC Simple Feature Access, 06-103r4)."""

from collections.abc import Mapping, Sequence
from struct import pack, unpack_from
from typing import Any

import numpy as np

_LITTLE_ENDIAN = 1
_POLYGON = 3
_MULTI_POLYGON = 6
#: Sizes in bytes: byte order, kind and count; a count; a point.
_HEAD = 9
_COUNT = 4
_POINT = 16


def well_known_binary(geometry: Mapping[str, Any]) -> bytes:
    """Return a Polygon or a MultiPolygon of GeoJSON as WKB, little endian."""
    if geometry["type"] == "Polygon":
        return _polygon(geometry["coordinates"])
    polygons = geometry["coordinates"]
    return pack("<BII", _LITTLE_ENDIAN, _MULTI_POLYGON, len(polygons)) + b"".join(
        map(_polygon, polygons)
    )


def _polygon(rings: Sequence[Any]) -> bytes:
    head = pack("<BII", _LITTLE_ENDIAN, _POLYGON, len(rings))
    return head + b"".join(
        pack("<I", len(ring)) + np.array(ring, dtype="<f8").tobytes() for ring in rings
    )


def text_of_binary(shape: bytes) -> str:
    """Return a Polygon or MultiPolygon of WKB as well-known text."""
    _, kind, count = unpack_from("<BII", shape)
    if kind == _POLYGON:
        return f"POLYGON {_rings_text(shape, 0)[0]}"
    at = _HEAD
    polygons = []
    for _ in range(count):
        words, at = _rings_text(shape, at)
        polygons.append(words)
    return f"MULTIPOLYGON ({', '.join(polygons)})" if polygons else "MULTIPOLYGON EMPTY"


def _rings_text(shape: bytes, at: int) -> tuple[str, int]:
    """Return the rings of the polygon at an offset as text, and the offset of its end."""
    _, _, count = unpack_from("<BII", shape, at)
    at += _HEAD
    rings = []
    for _ in range(count):
        (length,) = unpack_from("<I", shape, at)
        points = np.frombuffer(shape, dtype="<f8", count=2 * length, offset=at + _COUNT).reshape(
            -1, 2
        )
        rings.append("(" + ", ".join(f"{x} {y}" for x, y in points.tolist()) + ")")
        at += _COUNT + _POINT * length
    return f"({', '.join(rings)})", at
