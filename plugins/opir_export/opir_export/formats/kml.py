"""The exporter `kml`: flights, sensors and predictions over time (OGC KML 2.3, gx:Track)."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.output import OutputFiles, geometry_of
from opir_export.formats.geojson import area
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

_KML = "http://www.opengis.net/kml/2.2"
_GX = "http://www.google.com/kml/ext/2.2"
#: Colours of lines and areas, aabbggrr: those of Okabe and Ito.
_STYLES = {
    "flight": ("ff005ed5", "00000000"),
    "sensor": ("ffb27200", "00000000"),
    "footprint": ("80b27200", "10b27200"),
    "prediction": ("ffa779cc", "40a779cc"),
}


@frozen
class KmlFile:
    """Writes a run as one KML file."""

    config: MapConfig

    suffix = ".kml"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the places of a run to a file."""
        root = Xml.Element("kml", {"xmlns": _KML, "xmlns:gx": _GX})
        document = _child(root, "Document")
        _child(document, "name", run.plan.scene.name)
        for name, colours in _STYLES.items():
            _style(document, name, *colours)
        sensors = _folder(document, "Sensors")
        for sensor in sensor_paths(run, self.config.step_s):
            _add_sensor(sensors, run, sensor, self.config)
        targets = _folder(document, "Targets")
        for flight in flights(run, self.config.step_s):
            _add_flight(targets, run, flight)
        tracks = _folder(document, "Predicted impacts")
        for prediction in predictions(run, self.config.regions):
            _add_prediction(tracks, run, prediction)
        Xml.indent(root, " ")
        text = Xml.tostring(root, encoding="utf-8", xml_declaration=True)
        with OutputFiles() as output:
            output.write(path, text + b"\n", "KML")
        return [path]


def _add_sensor(folder: Any, run: Any, path: SensorPath, config: MapConfig) -> None:
    place = _placemark(folder, path.sensor.id, "sensor", path.sensor.type)
    if path.is_stationary:
        _add_point(place, path.geodetic_deg()[0])
    else:
        _add_track(place, timestamps(run, path.time_s), path.geodetic_deg())
    if config.footprints:
        shown = _placemark(folder, f"{path.sensor.id}: field of view", "footprint")
        _add_area(shown, area(path.footprint))


def _add_flight(folder: Any, run: Any, flight: Flight) -> None:
    times = timestamps(run, flight.time_s)
    places = flight.geodetic_deg()
    place = _placemark(folder, flight.target_id, "flight", flight.target_type)
    _add_track(place, times, places)
    for name, row in flight.ends.items():
        point = _placemark(
            folder, f"{flight.target_id}: {name}", "flight", times={"when": times[row]}
        )
        _add_point(point, places[row])


def _add_prediction(folder: Any, run: Any, prediction: Prediction) -> None:
    named = f"Track {prediction.track}"
    times = {"begin": timestamps(run, [prediction.start_s])[0]}
    if prediction.end_s is not None:
        times["end"] = timestamps(run, [prediction.end_s])[0]
    if np.isfinite(prediction.impact[:2]).all():
        point = _placemark(folder, f"{named}: predicted impact", "prediction", times=times)
        _add_point(point, np.array([*np.degrees(prediction.impact[1::-1]), 0.0]))
    for region in prediction.regions:
        title = f"{named}: impact{condition_words(region)}, {100 * region.containment:g} %"
        words = f"{region.area_km2:.0f} km2"
        _add_area(_placemark(folder, title, "prediction", words, times), geometry_of(region))


def _add_track(place: Any, times: Sequence[str], places: FloatArray) -> None:
    track = _child(place, "gx:Track")
    _child(track, "altitudeMode", "absolute")
    for time in times:
        _child(track, "when", time)
    for longitude, latitude, height in places.tolist():
        _child(track, "gx:coord", f"{longitude:.7f} {latitude:.7f} {height:.2f}")


def _add_point(place: Any, at: FloatArray) -> None:
    point = _child(place, "Point")
    _child(point, "altitudeMode", "absolute")
    _child(point, "coordinates", _coordinates([at.tolist()]))


def _add_area(place: Any, geometry: Any) -> None:
    """Add a Polygon or a MultiPolygon of GeoJSON."""
    is_multiple = geometry["type"] == "MultiPolygon"
    parent = _child(place, "MultiGeometry") if is_multiple else place
    for rings in geometry["coordinates"] if is_multiple else [geometry["coordinates"]]:
        polygon = _child(parent, "Polygon")
        _child(polygon, "tessellate", "1")
        for number, ring in enumerate(rings):
            boundary = _child(polygon, "innerBoundaryIs" if number else "outerBoundaryIs")
            _child(_child(boundary, "LinearRing"), "coordinates", _coordinates(ring))


def _coordinates(positions: Iterable[Sequence[float]]) -> str:
    return " ".join(
        ",".join(f"{number + 0.0:.7f}" for number in np.round(position, 7).tolist())
        for position in positions
    )


def _style(document: Any, name: str, line: str, fill: str) -> None:
    style = _child(document, "Style", id=name)
    for tag, colour in (("IconStyle", line), ("LineStyle", line), ("PolyStyle", fill)):
        _child(_child(style, tag), "color", colour)


def _folder(document: Any, name: str) -> Any:
    folder = _child(document, "Folder")
    _child(folder, "name", name)
    return folder


def _placemark(
    folder: Any,
    name: str,
    style: str,
    description: str = "",
    times: Mapping[str, str] | None = None,
) -> Any:
    """Return a new placemark, its elements in the order of the schema.

    `times` are `when`, or `begin` and perhaps `end`.
    """
    place = _child(folder, "Placemark")
    _child(place, "name", name)
    if description:
        _child(place, "description", description)
    if times:
        shown = _child(place, "TimeStamp" if "when" in times else "TimeSpan")
        for tag, time in times.items():
            _child(shown, tag, time)
    _child(place, "styleUrl", f"#{style}")
    return place


def _child(parent: Any, tag: str, text: str | None = None, **attributes: str) -> Any:
    child = Xml.SubElement(parent, tag, attributes)
    child.text = text
    return child
