"""Windows as batches of columns, numpy archives, for sinks that take windows.

Truth is not part of an event and is not kept. Columns mean something only beside their run: its
epoch, the ids of its sensors and the names of its types are kept with them, and a run that finds
them in its spool reads them by its own.
"""

from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any, TypeVar

import numpy as np
from attrs import evolve, fields, frozen
from numpy.typing import NDArray

from opir_core.errors import SinkError
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.records import Batch, Detections, DetectionTruth, Tracks, Window
from opir_core.interfaces.sensors import Sensor
from opir_core.output.spool.regions import REGION_PARTS, packed_regions, unpacked_regions
from opir_core.scene.scene import REPORTED_TYPES
from opir_core.simulation.report_order import with_own_estimates
from opir_core.simulation.shifting import shifted

CONTENT_TYPE = "application/vnd.opir.window+npz"
VERSION = "7"
_DETECTION_COLUMNS = tuple(attribute.name for attribute in fields(Detections))
_TRACK_COLUMNS = tuple(attribute.name for attribute in fields(Tracks))
_COLUMNS = {"detections": _DETECTION_COLUMNS, "tracks": _TRACK_COLUMNS, "estimates": _TRACK_COLUMNS}
_REGION_COLUMNS = ("tracks.impact_regions", "estimates.impact_regions")

_Record = TypeVar("_Record", bound=Columns)


@frozen(eq=False, repr=False)
class Origin:
    """The run of columns: its epoch, µs since 1970-01-01, its sensors, the names of its types and
    hypotheses.
    """

    epoch_us: int
    sensors: Sequence[Sensor]
    reported_types: tuple[str, ...] = REPORTED_TYPES
    hypotheses: tuple[str, ...] = ()

    def packed(self, window: Window) -> bytes:
        """Return a window as an archive."""
        window = with_own_estimates(window)
        columns: dict[str, Any] = {
            f"{record}.{name}": getattr(getattr(window, record), name)
            for record, names in _COLUMNS.items()
            for name in names
        }
        for name in _REGION_COLUMNS:
            columns |= {
                f"{name}.{key}": array for key, array in packed_regions(columns.pop(name)).items()
            }
        sensors_used = np.unique(window.detections.sensor)
        columns |= {
            "epoch_us": np.array(self.epoch_us),
            "sensors": sensors_used,
            "sensor_ids": np.array(
                [self.sensors[row].id for row in sensors_used.tolist()], dtype=str
            ),
            "reported_types": np.array(self.reported_types),
            "hypotheses": np.array(self.hypotheses, dtype=str),
        }
        archive = BytesIO()
        np.savez(
            archive,
            times=np.array([window.start_s, window.end_s]),
            looks=np.array(window.looks),
            **columns,
        )
        return archive.getvalue()

    def unpacked(self, batch: Batch) -> Window:
        """Return the window of an archive, perhaps of another run, with this run's epoch and rows
        of sensors.

        Raises `SinkError` for another kind or version of batch, and for sensors, types or
        hypotheses that this run lacks.
        """
        if batch.content_type != CONTENT_TYPE:
            raise SinkError(
                f"its spool holds {batch.content_type} of another kind of output; give each output"
                f" a spool of its own"
            )
        if batch.schema_version != VERSION:
            raise SinkError(
                f"its spool holds windows of version {batch.schema_version}, and this opir reads"
                f" {VERSION}; run the opir that made them until the spool is empty, or give this"
                f" output a spool of its own"
            )
        with np.load(BytesIO(batch.body), allow_pickle=False) as archive:
            start_s, end_s = archive["times"].tolist()
            detections = _record(Detections, "detections", archive)
            window = Window(
                start_s=start_s,
                end_s=end_s,
                looks=int(archive["looks"]),
                detections=evolve(
                    detections, sensor=self._rows(detections.sensor, archive)
                ).freeze(),
                truth=DetectionTruth.empty(),
                tracks=_record(Tracks, "tracks", archive),
                estimates=_record(Tracks, "estimates", archive),
            )
            self._require_hypotheses(archive)
            later_us = int(archive["epoch_us"]) - self.epoch_us
        return shifted(window, 1000 * later_us) if later_us else window

    def _require_hypotheses(self, archive: Any) -> None:
        weighed = any(
            archive[f"{record}.hypothesis_probability"].size for record in ("tracks", "estimates")
        )
        if weighed and tuple(archive["hypotheses"].tolist()) != self.hypotheses:
            raise SinkError(f"its spool holds tracks with other hypotheses; {_REMEDY}")

    def _rows(self, sensor: NDArray[Any], archive: Any) -> NDArray[Any]:
        """Return the rows of this run's sensors that have the ids of those of an archive."""
        if tuple(archive["reported_types"].tolist()) != self.reported_types:
            raise SinkError(f"its spool holds events with other types; {_REMEDY}")
        names_used = archive["sensors"]
        ids = archive["sensor_ids"].tolist()
        if all(
            row < len(self.sensors) and self.sensors[row].id == name
            for row, name in zip(names_used, ids, strict=True)
        ):
            return sensor
        row_of = {sensor.id: row for row, sensor in enumerate(self.sensors)}
        if unknown := [name for name in ids if name not in row_of]:
            raise SinkError(
                f"its spool holds events of {unknown[0]}, which the scene does not have; {_REMEDY}"
            )
        rows = np.array([row_of[name] for name in ids], dtype=sensor.dtype)
        return rows[np.searchsorted(names_used, sensor)]


_REMEDY = (
    "run the scene that made them until the spool is empty, or give this output a spool of its own"
)


def _record(record: Callable[..., _Record], name: str, archive: Any) -> _Record:
    return record(*(_column(f"{name}.{column}", archive) for column in _COLUMNS[name])).freeze()


def _column(name: str, archive: Any) -> Any:
    if name not in _REGION_COLUMNS:
        return archive[name]
    return unpacked_regions({key: archive[f"{name}.{key}"] for key in REGION_PARTS})
