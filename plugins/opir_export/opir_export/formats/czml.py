"""The exporter `czml`: flights, sensors and predicted impacts over time, for Cesium.

https://github.com/AnalyticalGraphicsInc/czml-writer/wiki/CZML-Guide
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.interfaces import IMPACT_CONDITIONS
from opir_core.output import OutputFiles
from opir_core.plugin import ImpactRegion
from opir_export.scenery.map_features import (
    Flight,
    Prediction,
    SensorPath,
    condition_words,
    flights,
    predictions,
    sensor_paths,
    timestamps,
)
from opir_export.settings import MapConfig

Packet = Mapping[str, Any]

#: Colours, red, green, blue and opacity: those of Okabe and Ito.
_FLIGHT = (213, 94, 0, 255)
_SENSOR = (0, 114, 178, 255)
_PREDICTION = (204, 121, 167, 255)
#: Opacity of regions, of 255.
_FAINT = 60
#: Degree of the interpolation between positions: flights bend.
_DEGREE = 3
#: Speed of the clock, seconds of the scene per second.
_MULTIPLIER = 10


@frozen
class CzmlFile:
    """Writes a run as one CZML document."""

    config: MapConfig

    suffix = ".czml"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the packets of a run to a file."""
        content = msgspec.json.format(
            msgspec.json.encode(list(packets(run, self.config))), indent=1
        )
        with OutputFiles() as output:
            output.write(path, content + b"\n", "CZML")
        return [path]


def packets(run: Any, config: MapConfig) -> Iterator[Packet]:
    """Yield the packets of a run: document and clock, then sensors, targets, predictions."""
    paths = list(flights(run, config.step_s))
    end_s = max([run.plan.scene.duration_s, *(float(flight.time_s[-1]) for flight in paths)])
    start, end = timestamps(run, [0.0, end_s])
    interval = f"{start}/{end}"
    clock = {
        "interval": interval,
        "currentTime": start,
        "multiplier": _MULTIPLIER,
        "range": "LOOP_STOP",
    }
    yield {"id": "document", "name": run.plan.scene.name, "version": "1.0", "clock": clock}
    for sensor in sensor_paths(run, config.step_s):
        yield from _sensor_packets(run, sensor, config)
    for flight in paths:
        yield from _flight_packets(run, flight)
    for prediction in predictions(run, config.regions):
        yield from _prediction_packets(run, prediction, end_s)


def _sensor_packets(run: Any, path: SensorPath, config: MapConfig) -> Iterator[Packet]:
    name = path.sensor.id
    yield {
        "id": f"sensor/{name}",
        "name": name,
        "description": path.sensor.type,
        "position": _fixed(path.position_ecef_m[0])
        if path.is_stationary
        else _sampled(run, path.time_s, path.position_ecef_m),
        "point": {"pixelSize": 8, "color": _colour(_SENSOR)},
        "label": _label(name),
    }
    if config.footprints:
        yield {
            "id": f"footprint/{name}",
            "name": f"{name}: field of view",
            "polyline": {
                "positions": {"cartographicRadians": _radians(path.footprint)},
                "width": 1,
                "arcType": "GEODESIC",
                "material": _solid(_SENSOR),
            },
        }


def _flight_packets(run: Any, flight: Flight) -> Iterator[Packet]:
    start, end = timestamps(run, flight.time_s[[0, -1]])
    yield {
        "id": f"target/{flight.target_id}",
        "name": flight.target_id,
        "description": flight.target_type,
        "availability": f"{start}/{end}",
        "position": _sampled(run, flight.time_s, flight.position_ecef_m),
        "point": {"pixelSize": 6, "color": _colour(_FLIGHT)},
        "label": _label(flight.target_id),
        "path": {"width": 2, "leadTime": 0, "material": _solid(_FLIGHT)},
    }
    for name, row in flight.ends.items():
        yield {
            "id": f"{name}/{flight.target_id}",
            "name": f"{flight.target_id}: {name}",
            "position": _fixed(flight.position_ecef_m[row]),
            "point": {"pixelSize": 5, "color": _colour(_FLIGHT)},
        }


def _prediction_packets(run: Any, prediction: Prediction, end_s: float) -> Iterator[Packet]:
    start, end = timestamps(
        run, [prediction.start_s, end_s if prediction.end_s is None else prediction.end_s]
    )
    availability = f"{start}/{end}"
    named = f"prediction/{prediction.track}/{prediction.start_s:g}"
    if np.isfinite(prediction.impact[:2]).all():
        latitude, longitude = prediction.impact[:2].tolist()
        yield {
            "id": named,
            "name": f"Track {prediction.track}: predicted impact",
            "availability": availability,
            "position": {"cartographicRadians": [longitude, latitude, 0.0]},
            "point": {"pixelSize": 6, "color": _colour(_PREDICTION)},
        }
    for region in prediction.regions:
        title = (
            f"Track {prediction.track}: impact{condition_words(region)},"
            f" {100 * region.containment:g} %"
        )
        presumed = "" if region.condition == IMPACT_CONDITIONS[0] else f"{region.condition}/"
        for number, rings in enumerate(region.polygons):
            id_ = f"{named}/{presumed}{region.containment:g}/{number}"
            yield {
                "id": id_,
                "name": title,
                "description": _words(region),
                "availability": availability,
                "polygon": _polygon(rings),
            }


def _polygon(rings: Sequence[FloatArray]) -> dict[str, Any]:
    """Return a polygon of CZML; it is not cut at the 180th meridian.

    Cesium needs rings whose last point differs from the first.
    """
    outer, *holes = [_radians(ring[:-1]) for ring in rings]
    polygon: dict[str, Any] = {
        "positions": {"cartographicRadians": outer},
        "height": 0,
        "arcType": "GEODESIC",
        "material": _solid((*_PREDICTION[:3], _FAINT)),
        "outline": True,
        "outlineColor": _colour(_PREDICTION),
    }
    return {**polygon, "holes": {"cartographicRadians": holes}} if holes else polygon


def _words(region: ImpactRegion) -> str:
    return f"contains the impact with {100 * region.containment:g} %; {region.area_km2:.0f} km2"


def _sampled(run: Any, time_s: FloatArray, position_ecef_m: FloatArray) -> dict[str, Any]:
    """Return positions at times, seconds after the first."""
    samples = np.column_stack([time_s - time_s[0], position_ecef_m])
    return {
        "epoch": timestamps(run, time_s[:1])[0],
        "referenceFrame": "FIXED",
        "interpolationAlgorithm": "LAGRANGE",
        "interpolationDegree": min(_DEGREE, len(time_s) - 1) or 1,
        "cartesian": np.round(samples, 3).ravel().tolist(),
    }


def _fixed(position_ecef_m: FloatArray) -> dict[str, Any]:
    return {"referenceFrame": "FIXED", "cartesian": np.round(position_ecef_m, 3).tolist()}


def _radians(ring: FloatArray) -> list[float]:
    """Return points of latitude and longitude as one list: longitude, latitude, height, …"""
    places = np.column_stack([ring[:, 1], ring[:, 0], np.zeros(len(ring))])
    flat: list[float] = np.round(places, 9).ravel().tolist()
    return flat


def _label(text: str) -> dict[str, Any]:
    return {"text": text, "font": "12px sans-serif", "pixelOffset": {"cartesian2": [0, -14]}}


def _solid(colour: Sequence[int]) -> dict[str, Any]:
    return {"solidColor": {"color": _colour(colour)}}


def _colour(colour: Sequence[int]) -> dict[str, Any]:
    return {"rgba": list(colour)}
