"""The exporter `czml`: flights, sensors and predicted impacts over time, for Cesium.

https://github.com/AnalyticalGraphicsInc/czml-writer/wiki/CZML-Guide
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.host import warn
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
from opir_export.search_volumes import ELLIPSOID_SIGMAS, FlownVolume, flown_volumes
from opir_export.settings import CzmlConfig

Packet = Mapping[str, Any]

#: Colours, red, green, blue and opacity: those of Okabe and Ito.
_FLIGHT = (213, 94, 0, 255)
_SENSOR = (0, 114, 178, 255)
_PREDICTION = (204, 121, 167, 255)
_SEARCH = (0, 158, 115, 255)
#: Opacity of regions, of 255.
_FAINT = 60
#: Degree of the interpolation between positions: flights bend.
_DEGREE = 3
#: Speed of the clock, seconds of the scene per second.
_MULTIPLIER = 10


@frozen
class CzmlFile:
    """Writes a run as one CZML document."""

    config: CzmlConfig

    suffix = ".czml"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the packets of a run to a file."""
        content = msgspec.json.format(
            msgspec.json.encode(list(packets(run, self.config))), indent=1
        )
        with OutputFiles() as output:
            output.write(path, content + b"\n", "CZML")
        return [path]


def packets(run: Any, config: CzmlConfig) -> Iterator[Packet]:
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
    if config.search_volumes:
        volumes = list(flown_volumes(run, config.step_s))
        if not volumes:
            warn("search volumes: none, as no track has an estimate without a burn")
        yield from (_volume_packet(run, volume) for volume in volumes)


def _volume_packet(run: Any, volume: FlownVolume) -> Packet:
    """Return the ellipsoid of a search volume over time."""
    start, end = timestamps(run, volume.time_s[[0, -1]])
    radii_m, axes = _ellipsoids(volume.covariance_m2)
    return {
        "id": f"search/{volume.track}",
        "name": f"Track {volume.track}: search volume, 95 %",
        "availability": f"{start}/{end}",
        "position": _sampled(run, volume.time_s, volume.position_m),
        "orientation": _samples(run, volume.time_s, "unitQuaternion", _quaternions(axes), 9),
        "ellipsoid": {
            "radii": _samples(run, volume.time_s, "cartesian", radii_m, 3),
            "material": _solid((*_SEARCH[:3], _FAINT)),
            "outline": True,
            "outlineColor": _colour(_SEARCH),
        },
    }


def _ellipsoids(covariance_m2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the radii (n, 3), m, of 95 % and the axes (n, 3, 3) as columns, right-handed.

    Each axis goes on from that of the time before: a viewer interpolates between them.
    """
    variance_m2, axes = _continued(*np.linalg.eigh(covariance_m2))
    axes[:, :, 2] *= np.linalg.det(axes)[:, None]
    return ELLIPSOID_SIGMAS * np.sqrt(np.maximum(variance_m2, 0.0)), axes


def _continued(variance_m2: FloatArray, axes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return variances (n, 3) and axes (n, 3, 3) in the order and sense of the time before."""
    orders = np.array(list(permutations(range(3))))
    for step in range(1, len(axes)):
        overlap = np.abs(axes[step - 1].T @ axes[step])
        order = orders[np.argmax(overlap[np.arange(3), orders].sum(axis=1))]
        axes[step] = axes[step][:, order]
        variance_m2[step] = variance_m2[step][order]
        axes[step] *= np.sign(np.sum(axes[step - 1] * axes[step], axis=0))
    return variance_m2, axes


def _quaternions(axes: FloatArray) -> FloatArray:
    """Return unit quaternions (n, 4), x, y, z, w, of rotations (n, 3, 3), without changes of sign
    from one to the next; Bar-Itzhack, Journal of Guidance, Control and Dynamics 23 (2000), 1085.
    """
    trace = np.trace(axes, axis1=1, axis2=2)[:, None, None]
    difference = axes - axes.mT
    vector = difference[:, [2, 0, 1], [1, 2, 0]][:, :, None]
    turns = np.block([[axes + axes.mT - trace * np.eye(3), vector], [vector.mT, trace]])
    turns = np.linalg.eigh(turns)[1][:, :, 3]
    same = np.sign(np.sum(turns[1:] * turns[:-1], axis=1))
    turns[1:] *= np.cumprod(np.where(same < 0.0, -1.0, 1.0))[:, None]
    return turns


def _sensor_packets(run: Any, path: SensorPath, config: CzmlConfig) -> Iterator[Packet]:
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
    epoch, samples = _samples(run, time_s, "cartesian", position_ecef_m, 3).items()
    degree = min(_DEGREE, len(time_s) - 1) or 1
    interpolation = {"interpolationAlgorithm": "LAGRANGE", "interpolationDegree": degree}
    return dict([epoch, ("referenceFrame", "FIXED"), *interpolation.items(), samples])


def _samples(
    run: Any, time_s: FloatArray, name: str, values: FloatArray, digits: int
) -> dict[str, Any]:
    """Return values (n, m) at times, seconds after the first, rounded to digits."""
    samples = np.column_stack([np.round(time_s - time_s[0], 3), np.round(values, digits)])
    return {"epoch": timestamps(run, time_s[:1])[0], name: samples.ravel().tolist()}


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
