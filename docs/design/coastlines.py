"""Coastlines for the maps of reports: Natural Earth's 1:110m land, cut down to tenths of a degree.

    npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz python docs/design/coastlines.py
    package/land-110m.json > plugins/opir_report/opir_report/maps/coast.json

Natural Earth is in the public domain (naturalearthdata.com, terms of use); the npm package
`world-atlas` holds its land as TopoJSON, whose arcs are quantised differences. The result is a list
of rings, longitude and latitude in turn, in tenths of a degree.
"""

import json
import sys
from itertools import accumulate
from pathlib import Path


def rings(topology: dict) -> list[list[int]]:
    """Return the rings of all land, each as [longitude, latitude, ...] in tenths of a degree."""
    (scale_x, scale_y), (origin_x, origin_y) = (
        topology["transform"]["scale"],
        topology["transform"]["translate"],
    )
    arcs = []
    for arc in topology["arcs"]:
        places = zip(*(accumulate(column) for column in zip(*arc, strict=True)), strict=True)
        arcs.append(
            [
                (round(10 * (x * scale_x + origin_x)), round(10 * (y * scale_y + origin_y)))
                for x, y in places
            ]
        )
    found = []
    for shape in topology["objects"]["land"]["geometries"]:
        for polygon in shape["arcs"] if shape["type"] == "MultiPolygon" else [shape["arcs"]]:
            for ring in polygon:
                whole = [
                    place
                    for number in ring
                    for place in (arcs[number] if number >= 0 else arcs[~number][::-1])
                ]
                kept = [
                    place
                    for place, before in zip(whole, [None, *whole], strict=False)
                    if place != before
                ]
                found.append([coordinate for place in kept for coordinate in place])
    return found


if __name__ == "__main__":
    print(
        json.dumps(
            {
                "source": "Natural Earth 1:110m land, public domain",
                "rings": rings(json.loads(Path(sys.argv[1]).read_text())),
            },
            separators=(",", ":"),
        )
    )
