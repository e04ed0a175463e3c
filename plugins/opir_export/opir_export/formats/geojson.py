"""The exporter `geojson`: a FeatureCollection (RFC 7946) of flights, sensors and predictions."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.output import DECIMALS, OutputFiles, geometry_of, region_figures
from opir_core.plugin import ImpactRegion
from opir_export.scenery.map_features import (
    Flight,
    Prediction,
    SensorPath,
    flights,
    predictions,
    sensor_paths,
    timestamps,
)
from opir_export.settings import MapConfig

_TURN_DEG = 360.0
#: Decimals of heights, m.
_HEIGHT_DECIMALS = 1

Feature = Mapping[str, Any]


@frozen
class GeoJsonFile:
    """Writes a run as one file of GeoJSON."""

    config: MapConfig

    suffix = ".geojson"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the features of a run to a file."""
        document = {
            "type": "FeatureCollection",
            "name": run.plan.scene.name,
            "features": list(features(run, self.config)),
        }
        with OutputFiles() as output:
            output.write(
                path,
                msgspec.json.format(msgspec.json.encode(document), indent=1) + b"\n",
                "GeoJSON",
            )
        return [path]


def features(run: Any, config: MapConfig) -> Iterator[Feature]:
    """Yield the features of a run: `kind` in their properties says what each is."""
    for path in sensor_paths(run, config.step_s):
        yield from _sensor_features(path, config)
    for flight in flights(run, config.step_s):
        yield from _flight_features(run, flight)
    for prediction in predictions(run, config.regions):
        yield from _prediction_features(run, prediction)


def _sensor_features(path: SensorPath, config: MapConfig) -> Iterator[Feature]:
    named = {"sensor_id": path.sensor.id, "sensor_type": path.sensor.type}
    places = path.geodetic_deg()
    yield _feature(_point(places[0]), kind="sensor", **named)
    if not path.is_stationary:
        yield _feature(line(places), kind="satellite track", **named)
    if config.footprints:
        yield _feature(area(path.footprint), kind="footprint", **named)


def _flight_features(run: Any, flight: Flight) -> Iterator[Feature]:
    named = {"target_id": flight.target_id, "target_type": flight.target_type}
    places = flight.geodetic_deg()
    ignition, burnout, end = timestamps(
        run, [flight.time_s[0], flight.burnout_s, flight.time_s[-1]]
    )
    yield _feature(
        line(places), kind="ground track", **named, ignition=ignition, burnout=burnout, end=end
    )
    yield _feature(_point(places[0]), kind="launch", **named, time=ignition)
    if flight.has_impact:
        yield _feature(_point(places[-1]), kind="impact", **named, time=end)


def _prediction_features(run: Any, prediction: Prediction) -> Iterator[Feature]:
    start = timestamps(run, [prediction.start_s])[0]
    end = None if prediction.end_s is None else timestamps(run, [prediction.end_s])[0]
    named = {"track_id": prediction.track, "start": start, "end": end}
    for kind, place in (
        ("estimated launch", prediction.launch),
        ("predicted impact", prediction.impact),
    ):
        if np.isfinite(place[:2]).all():
            time = timestamps(run, [place[2]])[0] if np.isfinite(place[2]) else None
            yield _feature(_point(np.degrees(place[1::-1])), kind=kind, **named, time=time)
    for region in prediction.regions:
        yield _feature(geometry_of(region), kind="impact region", **named, **region_figures(region))


def area(ring: FloatArray) -> dict[str, Any]:
    """Return the area in a ring of latitude_rad and longitude_rad as Polygon or MultiPolygon.

    It is cut at the 180th meridian and closed around a pole.
    """
    return geometry_of(ImpactRegion(containment=1.0, area_km2=0.0, polygons=((ring,),)))


def line(places: FloatArray) -> dict[str, Any]:
    """Return a line through longitudes, latitudes (degrees) and heights (n, 3).

    It is cut at the 180th meridian. Equal places, to the decimals written, are a point.
    """
    lines = cut_line(places)
    if len(lines) == 1 and not _has_length(lines[0]):
        return _point(lines[0][0])
    if len(lines) == 1:
        return {"type": "LineString", "coordinates": _positions(lines[0])}
    return {"type": "MultiLineString", "coordinates": [_positions(line) for line in lines]}


def cut_line(places: FloatArray) -> list[FloatArray]:
    """Return a line (n, k) as lines between -180 and 180 degrees of longitude.

    Columns are longitude and latitude, degrees, and others. A line that only touches the meridian
    is left out: it would have one place.
    """
    unwrapped = places.copy()
    unwrapped[:, 0] = np.unwrap(places[:, 0], period=_TURN_DEG)
    turn = np.floor((unwrapped[:, 0] + 0.5 * _TURN_DEG) / _TURN_DEG).astype(np.int64)
    lines = []
    start = unwrapped[:0]
    ends = np.flatnonzero(np.diff(turn)) + 1
    stretches = np.split(unwrapped, ends)
    for end, stretch in zip(ends.tolist(), stretches, strict=False):
        crossing = _crossing(*unwrapped[end - 1 : end + 1], *turn[end - 1 : end + 1])
        lines.append(_within_turn(np.concatenate([start, stretch, crossing]), turn[end - 1]))
        start = crossing
    lines.append(_within_turn(np.concatenate([start, stretches[-1]]), turn[-1]))
    return [line for line in lines if _has_length(line)] or lines[-1:]


def _crossing(place: FloatArray, next_place: FloatArray, turn: int, next_turn: int) -> FloatArray:
    """Return the place (1, k) between two others at which a line crosses the 180th meridian."""
    meridian_deg = _TURN_DEG * (max(turn, next_turn) - 0.5)
    share = (meridian_deg - place[0]) / (next_place[0] - place[0])
    return (place + share * (next_place - place))[np.newaxis]


def _has_length(line: FloatArray) -> bool:
    """Whether a line has two different places, to the decimals written."""
    rounded = np.round(line[:, :2], DECIMALS)
    return bool((rounded != rounded[0]).any())


def _within_turn(line: FloatArray, turns: int) -> FloatArray:
    """Return a line (n, k) with longitudes less `turns` whole turns, in [-180, 180] degrees."""
    shifted = line.copy()
    shifted[:, 0] = np.clip(line[:, 0] - _TURN_DEG * turns, -0.5 * _TURN_DEG, 0.5 * _TURN_DEG)
    return shifted


def _point(place: FloatArray) -> dict[str, Any]:
    return {"type": "Point", "coordinates": _positions(place[np.newaxis])[0]}


def _positions(places: FloatArray) -> list[list[float]]:
    """Return rounded positions."""
    rounded = np.round(places, DECIMALS) + 0.0
    if places.shape[1] > 2:
        rounded[:, 2] = np.round(places[:, 2], _HEIGHT_DECIMALS) + 0.0
    positions: list[list[float]] = rounded.tolist()
    return positions


def _feature(geometry: Mapping[str, Any], **properties: Any) -> Feature:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
