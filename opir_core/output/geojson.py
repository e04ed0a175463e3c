"""Impact regions as GeoJSON (RFC 7946), and back.

Positions are longitude and latitude in degrees, outer rings counter-clockwise, holes clockwise. A
region across the 180th meridian is cut there (section 3.1.9); one around a pole is closed along the
meridian and the pole.
"""

from collections.abc import Mapping, Sequence
from math import isnan, nan, radians
from typing import Any

import msgspec
import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, ObjectArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry.sphere import AzimuthalEquidistant
from opir_core.interfaces.impact_regions import IMPACT_CONDITIONS, ImpactRegion
from opir_core.output.region_edges import STEP_DEG, refined
from opir_core.output.region_outlines import outlined, ring_radii_m, sides_cross

#: Decimals of positions, degrees: 0.1 m on the ground.
DECIMALS = 6
_POLE_DEG = 90.0
#: Rings with fewer distinct points enclose no area.
_FEWEST = 3

_encode = msgspec.json.Encoder().encode
Rings = list[FloatArray]


@frozen
class Resolution:
    """Decimals of positions, and the longest step in longitude along an edge, degrees."""

    decimals: int = DECIMALS
    step_deg: float = STEP_DEG

    @classmethod
    def of(cls, region: ImpactRegion) -> "Resolution":
        """Return the resolution that the size of a region deserves: positions within 0.1 % of its
        radius and 1 % of that of its smallest part, edges within 0.2 % of its radius.

        An edge that is straight in longitude and latitude leaves a great circle by up to 1/16 of
        the square of its length in longitude, rad.
        """
        radii = ring_radii_m(region) / EARTH_EQUATORIAL_RADIUS_M
        largest = float(radii.max(initial=0.0))
        error = min(_RESOLVED * largest, 10.0 * _RESOLVED * float(radii.min(initial=np.inf)))
        if error <= 0.0:
            return cls()
        step_deg = float(np.degrees(np.sqrt(16.0 * 2.0 * _RESOLVED * largest)))
        # Around the antipode of its centre a small distance on Earth is a large one on its map.
        if region.area_km2 >= _WIDE_KM2:
            return cls(3, step_deg)
        decimals = int(np.ceil(-np.log10(np.sqrt(2.0) * np.degrees(error))))
        return cls(min(max(decimals, 0), DECIMALS), max(step_deg, STEP_DEG))

    def finer(self, times: int) -> "Resolution":
        """Return a resolution with more digits, and with steps half as long for each."""
        return Resolution(self.decimals + times, self.step_deg * 0.5**times)


#: Finer resolutions that are tried where sides cross at the first.
_REFINEMENTS = 4

#: Error of positions and edges, as a share of a region's radius.
_RESOLVED = 0.001

#: Positions to 0.1 m, edges of a degree.
FINE = Resolution()


def region_texts(column: ObjectArray) -> list[bytes]:
    """Return tuples of regions (n,) as JSON arrays of figures and GeoJSON geometry, with few points
    and digits; equal ones once.
    """
    texts: dict[int, bytes] = {}
    rows = column.tolist()
    for row in rows:
        if id(row) not in texts:
            texts[id(row)] = region_text(row)
    return [texts[id(row)] for row in rows]


def region_text(regions: Sequence[ImpactRegion]) -> bytes:
    """Return regions as a JSON array of figures and GeoJSON geometry, with few points and digits:
    boundaries and areas within 1 %.
    """
    return _encode([_short_document(region) for region in regions])


def _short_document(region: ImpactRegion) -> dict[str, Any]:
    """Return the document of a region with the fewest points and digits that keep its sides from
    crossing each other.
    """
    outline = outlined(region)
    coarse = Resolution.of(region)
    for resolution in (*map(coarse.finer, range(_REFINEMENTS)), FINE):
        document = region_document(outline, resolution)
        if not _crosses(document["geometry"]):
            return document
    # A region whose own parts cross each other stays so.
    return region_document(outline, coarse)


def _crosses(geometry: Mapping[str, Any]) -> bool:
    """Return whether sides of a geometry cross or touch each other."""
    coordinates = geometry["coordinates"]
    polygons = [coordinates] if geometry["type"] == "Polygon" else coordinates
    return sides_cross([np.array(ring[:-1]) for polygon in polygons for ring in polygon])


def region_document(region: ImpactRegion, resolution: Resolution = FINE) -> dict[str, Any]:
    """Return the figures of a region, the centre of its map, longitude and latitude in degrees, and
    its geometry.
    """
    centre = np.degrees(region.chart().centre[::-1]).tolist() if region.polygons else None
    geometry = geometry_of(region, resolution)
    return {**region_figures(region), "centre": centre, "geometry": geometry}


def region_figures(region: ImpactRegion) -> dict[str, Any]:
    """Return containment and area_km2 of a region, its condition with its probability, and
    effective_samples.
    """
    samples = region.effective_samples
    return {
        "containment": region.containment,
        "area_km2": region.area_km2,
        "condition": region.condition,
        "probability": region.probability,
        "effective_samples": None if isnan(samples) else samples,
    }


def region_from_document(document: Mapping[str, Any]) -> ImpactRegion:
    """Return the region of a document; raises KeyError, TypeError or ValueError if it is none.

    It may lack condition, probability, effective samples and centre.
    """
    centre = document.get("centre")
    condition = document.get("condition", IMPACT_CONDITIONS[0])
    samples = document.get("effective_samples")
    if condition not in IMPACT_CONDITIONS:
        raise ValueError(
            f"{condition!r} is no condition of a region; give one of {', '.join(IMPACT_CONDITIONS)}"
        )
    geometry = document["geometry"]
    if geometry["type"] not in ("Polygon", "MultiPolygon"):
        raise ValueError(f"a {geometry['type']} is no region; give a Polygon or a MultiPolygon")
    polygons = (
        [geometry["coordinates"]] if geometry["type"] == "Polygon" else geometry["coordinates"]
    )
    return ImpactRegion(
        containment=float(document["containment"]),
        area_km2=float(document["area_km2"]),
        polygons=tuple(tuple(_ring_from(ring) for ring in polygon) for polygon in polygons),
        centre=None if centre is None else _centre_from(*centre),
        condition=condition,
        probability=float(document.get("probability", 1.0)),
        effective_samples=nan if samples is None else float(samples),
    )


def _centre_from(longitude_deg: float, latitude_deg: float) -> tuple[float, float]:
    if not abs(latitude_deg) <= _POLE_DEG or not np.isfinite(longitude_deg):
        raise ValueError("a centre is longitude and latitude, degrees")
    return radians(latitude_deg), radians(longitude_deg)


def _ring_from(positions: Any) -> FloatArray:
    degrees = np.array(positions, dtype=np.float64)
    closed = (
        degrees.ndim == 2
        and degrees.shape[1] == 2
        and len(degrees) > _FEWEST
        and (degrees[0] == degrees[-1]).all()
    )
    if not (closed and np.abs(degrees[:, 1]).max() <= _POLE_DEG):
        raise ValueError(
            "a ring is a list of at least four [longitude, latitude], the last equal to the first"
        )
    return np.radians(degrees[:, ::-1])


def geometry_of(region: ImpactRegion, resolution: Resolution = FINE) -> dict[str, Any]:
    """Return a region as a Polygon or a MultiPolygon."""
    polygons = [
        piece for polygon in region.polygons for piece in _parts(polygon, region, resolution)
    ]
    kind, coordinates = (
        ("Polygon", polygons[0]) if len(polygons) == 1 else ("MultiPolygon", polygons)
    )
    return {"type": kind, "coordinates": coordinates}


#: From this area on a ring alone does not tell which pole it holds, or whether it holds both, km²:
#: a cap of 40 degrees.
_WIDE_KM2 = 6e7


def _poles_in(plane: FloatArray, chart: AzimuthalEquidistant) -> tuple[float, ...]:
    """Return the latitudes of the poles inside a ring of the map, degrees."""
    places = chart.points(np.radians([[-_POLE_DEG, 0.0], [_POLE_DEG, 0.0]]))
    return tuple(
        pole
        for pole, at in zip((-_POLE_DEG, _POLE_DEG), places, strict=True)
        if _is_inside(at, plane[:-1])
    )


def _parts(
    polygon: Sequence[FloatArray], region: ImpactRegion, resolution: Resolution
) -> list[Any]:
    """Return a polygon of a region as polygons of coordinates: one, unless the 180th meridian cuts
    it.
    """
    is_wide = region.area_km2 >= _WIDE_KM2
    decimals = resolution.decimals
    if _is_flat(polygon, resolution.step_deg, is_wide=is_wide):
        rings = [
            points
            for ring in polygon
            if len(points := _distinct(np.degrees(ring[:-1, ::-1]), decimals)) >= _FEWEST
        ]
        return (
            [[_closed(points, is_outer=not place) for place, points in enumerate(rings)]]
            if rings
            else []
        )
    planar = _planar(polygon, region.chart(), resolution.step_deg, is_wide=is_wide)
    return _cut(planar, decimals)


def _is_flat(polygon: Sequence[FloatArray], step_deg: float, *, is_wide: bool) -> bool:
    """Return whether a polygon may be written as it is: edges short in longitude, or cut already
    and read back.

    Edges along the 180th meridian or along a pole are cuts.
    """
    widest_deg = 0.0
    is_cut = False
    for ring in polygon:
        latitude, longitude = np.degrees(ring).T
        on_cut = (np.abs(longitude) == 180.0) | (np.abs(latitude) == _POLE_DEG)
        along = on_cut[1:] & on_cut[:-1]
        step = np.abs(np.diff(longitude)).max(initial=0.0, where=~along)
        if np.abs(longitude).max() > 180.0:
            return False
        widest_deg = max(widest_deg, float(step))
        is_cut = is_cut or bool(along.any())
    return widest_deg <= (180.0 if is_cut else step_deg) and (
        is_cut or not (is_wide or polygon[1:])
    )


def _planar(
    polygon: Sequence[FloatArray], chart: AzimuthalEquidistant, step_deg: float, *, is_wide: bool
) -> Rings:
    """Return the rings of a polygon, open, as longitude and latitude, degrees; longitudes are
    continuous along them.

    A ring around a pole is closed along two meridians and the pole. Where a polygon holds both
    poles, its outer ring is a hole of the whole Earth. Holes are moved by whole turns into the
    outer ring.
    """
    planes = [chart.points(ring) for ring in polygon]
    poles = [_poles_in(plane, chart) if is_wide else () for plane in planes]
    outer, *holes = [
        _unrolled(*polygon_ring, chart, step_deg)
        for polygon_ring in zip(polygon, planes, poles, strict=True)
    ]
    if len(poles[0]) == 2:
        holes = [outer, *holes]
        outer = _WORLD
    rings = [outer]
    for hole in holes:
        shifts = [_moved(hole, turn) for turn in (0, 1, -1, 2, -2)]
        rings.append(
            next((shifted for shifted in shifts if _is_inside(_middle(shifted), outer)), hole)
        )
    return _closed_around(rings)


def _closed_around(rings: Rings) -> Rings:
    """Return rings in which the outer one, closed along a meridian and a pole, is closed around
    holes that cross it.
    """
    outer, *holes = rings
    west = float(outer[:, 0].min())
    east = float(outer[:, 0].max())
    across = [hole for hole in holes if hole[:, 0].min() < west or hole[:, 0].max() > east]
    if not across:
        return rings
    chains = [outer[:-2], outer[-2:]]
    for hole in across:
        edge, turns = (west, 1) if hole[:, 0].min() < west else (east, -1)
        is_east = hole[:, 0] >= edge
        chains += [
            _moved(chain, turns if edge == west else 0) for chain in _chains(hole, ~is_east, edge)
        ]
        chains += [
            _moved(chain, turns if edge == east else 0) for chain in _chains(hole, is_east, edge)
        ]
    return _joined(chains) + [
        hole for hole in holes if not any(hole is crossing_hole for crossing_hole in across)
    ]


def _moved(ring: FloatArray, turns: int) -> FloatArray:
    """Return a ring moved east by whole turns."""
    return ring + np.array([360.0 * turns, 0.0])


#: The whole Earth as a ring.
_WORLD = np.array([[-180.0, -90.0], [180.0, -90.0], [180.0, 90.0], [-180.0, 90.0]])


def _unrolled(
    ring: FloatArray,
    plane: FloatArray,
    poles: Sequence[float],
    chart: AzimuthalEquidistant,
    step_deg: float,
) -> FloatArray:
    points = refined(ring, plane, chart, step_deg)
    points[1:, 0] -= 360.0 * np.cumsum(np.rint(np.diff(points[:, 0]) / 360.0))
    turns = round((points[-1, 0] - points[0, 0]) / 360.0)
    if not turns:
        return points[:-1]
    pole_deg = poles[0] if poles else float(np.copysign(_POLE_DEG, points[:, 1].mean()))
    return _around_pole(points, 360.0 * turns, pole_deg)


def _around_pole(closed: FloatArray, turn_deg: float, pole_deg: float) -> FloatArray:
    """Return a ring around a pole, open, closed along the 180th meridian and the pole.

    Of the ring's crossings of the meridian, the one nearest to the pole is taken, so that no other
    is cut off.
    """
    longitude, latitude = closed.T
    edges_deg = 360.0 * np.floor((longitude + 180.0) / 360.0) - 180.0
    crossings = np.flatnonzero(np.diff(edges_deg))
    at_deg = np.maximum(edges_deg[crossings], edges_deg[crossings + 1])
    share = (at_deg - longitude[crossings]) / (longitude[crossings + 1] - longitude[crossings])
    crossed_deg = latitude[crossings] + share * (latitude[crossings + 1] - latitude[crossings])
    nearest = int(np.argmax(crossed_deg * np.sign(pole_deg)))
    place = int(crossings[nearest])
    edge_deg = float(at_deg[nearest])
    height_deg = float(crossed_deg[nearest])
    later = closed[: place + 1] + np.array([turn_deg, 0.0])
    closing = [
        [edge_deg + turn_deg, height_deg],
        [edge_deg + turn_deg, pole_deg],
        [edge_deg, pole_deg],
    ]
    return np.concatenate([[[edge_deg, height_deg]], closed[place + 1 : -1], later, closing])


def _cut(rings: Rings, decimals: int) -> list[list[list[list[float]]]]:
    """Return the parts of a polygon between odd multiples of 180 degrees, moved to [-180, 180], as
    coordinates.
    """
    west = float(rings[0][:, 0].min())
    east = float(rings[0][:, 0].max())
    first_turn = int((west + 180.0) // 360.0)
    last_turn = int(np.ceil((east - 180.0) / 360.0))
    sides = list[tuple[int, Rings]]()
    remaining = rings
    for turn in range(first_turn, last_turn):
        edge_deg = 360.0 * turn + 180.0
        sides.append((turn, _side(remaining, edge_deg, is_west=True)))
        remaining = _side(remaining, edge_deg, is_west=False)
    sides.append((last_turn, remaining))
    moved = [[_moved(ring, -turn) for ring in side] for turn, side in sides]
    return [polygon for side in moved for polygon in _assembled(side, decimals)]


def _side(rings: Rings, edge_deg: float, *, is_west: bool) -> Rings:
    """Return the rings of what lies west or east of a meridian.

    Chains of points on this side begin and end on the meridian. There the polygon covers every
    second interval between their ends, in the order of latitude: each chain continues with the one
    at the other end of its interval.
    """
    uncut = []
    chains = []
    for ring in rings:
        is_on_side = ring[:, 0] < edge_deg if is_west else ring[:, 0] >= edge_deg
        if is_on_side.all():
            uncut.append(ring)
        elif is_on_side.any():
            chains += _chains(ring, is_on_side, edge_deg)
    return uncut + _joined(chains)


def _chains(ring: FloatArray, is_on_side: BoolArray, edge_deg: float) -> Rings:
    """Return the parts of a ring on one side, each with its two points on the meridian."""
    count = len(ring)
    twice = np.append(is_on_side, is_on_side)
    starts = np.flatnonzero(twice[count:] & ~twice[count - 1 : -1]).tolist()
    chains = []
    for start in starts:
        length = int(np.argmin(twice[start:]))
        chain = ring[np.arange(start, start + length) % count]
        next_point = ring[(start + length) % count]
        ends = (
            _crossing(ring[start - 1], chain[0], edge_deg),
            _crossing(chain[-1], next_point, edge_deg),
        )
        chains.append(np.concatenate([ends[:1], chain, ends[1:]]))
    return chains


def _crossing(start: FloatArray, end: FloatArray, edge_deg: float) -> FloatArray:
    share = (edge_deg - start[0]) / (end[0] - start[0])
    return np.array([edge_deg, start[1] + share * (end[1] - start[1])])


def _joined(chains: Rings) -> Rings:
    ends = [
        (*chain[place].tolist(), number, place)
        for number, chain in enumerate(chains)
        for place in (0, -1)
    ]
    ends.sort(key=lambda end: end[:2])
    across: dict[tuple[int, int], tuple[int, int]] = {}
    for (_, _, *start), (_, _, *stop) in zip(ends[::2], ends[1::2], strict=True):
        across[start[0], start[1]] = (stop[0], stop[1])
        across[stop[0], stop[1]] = (start[0], start[1])
    rings = []
    open_chains = set(range(len(chains)))
    while open_chains:
        first_chain = min(open_chains)
        number = first_chain
        place = 0
        pieces = Rings()
        while not pieces or (number, place) != (first_chain, 0):
            open_chains.discard(number)
            pieces.append(chains[number] if place == 0 else chains[number][::-1])
            number, place = across[number, -1 if place == 0 else 0]
        rings.append(np.concatenate(pieces))
    return rings


def _assembled(rings: Rings, decimals: int) -> list[list[list[list[float]]]]:
    """Return rings as polygons: those inside another are its holes."""
    rings = [points for ring in rings if len(points := _distinct(ring, decimals)) >= _FEWEST]
    is_hole = [_is_hole(ring, rings) for ring in rings]
    polygons = []
    for outer in (ring for ring, hole in zip(rings, is_hole, strict=True) if not hole):
        holes = [
            ring
            for ring, hole in zip(rings, is_hole, strict=True)
            if hole and _is_inside(_middle(ring), outer)
        ]
        polygons.append(
            [_closed(outer, is_outer=True), *(_closed(hole, is_outer=False) for hole in holes)]
        )
    return polygons


def _is_hole(ring: FloatArray, rings: Rings) -> bool:
    return any(outline is not ring and _is_inside(_middle(ring), outline) for outline in rings)


def _middle(ring: FloatArray) -> FloatArray:
    return ring[len(ring) // 2]


def _distinct(ring: FloatArray, decimals: int) -> FloatArray:
    points = np.round(ring, decimals) + 0.0
    x, y = points.T
    differs = np.empty(len(points), dtype=np.bool_)
    differs[1:] = (x[1:] != x[:-1]) | (y[1:] != y[:-1])
    differs[0] = x[0] != x[-1] or y[0] != y[-1]
    return points[differs]


def _closed(points: FloatArray, *, is_outer: bool) -> list[list[float]]:
    x, y = points.T
    is_counter_clockwise = (
        float(x[:-1] @ y[1:] - x[1:] @ y[:-1] + x[-1] * y[0] - x[0] * y[-1]) > 0.0
    )
    ordered = points if is_counter_clockwise == is_outer else points[::-1]
    return np.concatenate([ordered, ordered[:1]]).tolist()


def _is_inside(point: FloatArray, ring: FloatArray) -> bool:
    """Return whether a point lies inside a ring in the plane: a ray from it crosses the ring an odd
    number of times.
    """
    (x0, y0), (x1, y1) = ring.T, np.concatenate([ring[1:], ring[:1]]).T
    crosses = (y0 > point[1]) != (y1 > point[1])
    at = x0[crosses] + (point[1] - y0[crosses]) / (y1 - y0)[crosses] * (x1 - x0)[crosses]
    return bool(np.count_nonzero(at > point[0]) % 2)
