"""Coastlines for the service's page: Natural Earth's land at 1:110m and 1:50m, as compact JSON.

    npm pack world-atlas@2.0.2 && tar xzf world-atlas-2.0.2.tgz python
    docs/design/page_coastlines.py package/land-110m.json 10 >
    plugins/opir_http/opir_http/page/coast-110m.json python docs/design/page_coastlines.py
    package/land-50m.json 50 > plugins/opir_http/opir_http/page/coast-50m.json

Natural Earth is in the public domain (naturalearthdata.com, terms of use); the npm package
`world-atlas` holds its land as TopoJSON, whose arcs are quantised differences. The result is a list
of polygons, each a list of rings, each the longitude and latitude of its first point and then the
differences to the next, in units of 1/`scale` degree.
"""

import json
import sys
from itertools import accumulate, pairwise
from pathlib import Path

Place = tuple[int, int]


def polygons(topology: dict, scale: int) -> list[list[list[int]]]:
    """Return the polygons of all land, as rings of differences in units of 1/`scale` degree."""
    arcs = _arcs(topology, scale)
    found = []
    for shape in topology["objects"]["land"]["geometries"]:
        for polygon in shape["arcs"] if shape["type"] == "MultiPolygon" else [shape["arcs"]]:
            rings = [ring for numbers in polygon if len(ring := _ring(numbers, arcs)) >= 8]
            found += [rings] if rings else []
    return found


def _arcs(topology: dict, scale: int) -> list[list[Place]]:
    (scale_x, scale_y), (origin_x, origin_y) = (
        topology["transform"]["scale"],
        topology["transform"]["translate"],
    )
    arcs = []
    for arc in topology["arcs"]:
        places = zip(*(accumulate(column) for column in zip(*arc, strict=True)), strict=True)
        arcs.append(
            [
                (round(scale * (x * scale_x + origin_x)), round(scale * (y * scale_y + origin_y)))
                for x, y in places
            ]
        )
    return arcs


def _ring(numbers: list[int], arcs: list[list[Place]]) -> list[int]:
    whole = [
        place
        for number in numbers
        for place in (arcs[number] if number >= 0 else arcs[~number][::-1])
    ]
    kept = [place for place, before in zip(whole, [None, *whole], strict=False) if place != before]
    steps = [(x - before_x, y - before_y) for (before_x, before_y), (x, y) in pairwise(kept)]
    return [coordinate for pair in [kept[0], *steps] for coordinate in pair]


if __name__ == "__main__":
    path = Path(sys.argv[1])
    scale = int(sys.argv[2])
    source = f"Natural Earth 1:{path.stem.removeprefix('land-')} land, public domain"
    land = {
        "source": source,
        "scale": scale,
        "polygons": polygons(json.loads(path.read_text()), scale),
    }
    print(json.dumps(land, separators=(",", ":")))
