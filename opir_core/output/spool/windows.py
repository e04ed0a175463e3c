"""Spools of sinks that take windows: batches are columns, as numpy archives, and hold no messages.

Truth is no part of an event and is not kept: windows from a spool have none.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from io import BytesIO
from typing import Any, TypeVar

import numpy as np
from attrs import evolve, fields

from opir_core.errors import SinkError
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Sink
from opir_core.interfaces.records import Batch, Detections, DetectionTruth, Tracks, Window
from opir_core.output.events.encoder_input import window_blocks

_CONTENT_TYPE = "application/vnd.opir.window+npz"
_VERSION = "1"
_DETECTION_COLUMNS = tuple(attribute.name for attribute in fields(Detections))
_TRACK_COLUMNS = tuple(attribute.name for attribute in fields(Tracks))
_COLUMNS = {"detections": _DETECTION_COLUMNS, "tracks": _TRACK_COLUMNS, "estimates": _TRACK_COLUMNS}

_Record = TypeVar("_Record", bound=Columns)


class WindowBatcher:
    """Cuts windows into batches of columns, each with the estimates that its detections refer to."""

    def batches(self, window: Window) -> Iterator[Batch]:
        """Yield a window as batches of columns."""
        for block in window_blocks(window):
            yield Batch(
                body=_packed(_with_own_estimates(block)),
                keys=("",),
                key_of=np.zeros(len(block.detections), dtype=np.uint16),
                content_type=_CONTENT_TYPE,
                schema_version=_VERSION,
            )


class WindowTransport:
    """A transport that writes batches of columns into a sink; what is written is acknowledged."""

    trouble: str | None = None

    def __init__(self, sink: Sink) -> None:
        self._sink = sink

    def send(self, batch: Batch) -> "Future[None]":
        """Write the batch's window and return a future that is done."""
        future: Future[None] = Future()
        try:
            self._sink.write(_unpacked(batch))
        except SinkError as error:
            future.set_exception(error)
        else:
            future.set_result(None)
        return future

    def close(self, wait_s: float) -> None:
        """Close the sink."""
        self._sink.close()


def _with_own_estimates(block: Window) -> Window:
    rows, index = np.unique(block.detections.estimate, return_inverse=True)
    is_row = rows >= 0
    estimate = index.astype(np.int64) - np.count_nonzero(~is_row)
    detections = evolve(block.detections, estimate=estimate)
    return evolve(block, detections=detections, estimates=block.estimates.take(rows[is_row]))


def _packed(window: Window) -> bytes:
    columns: dict[str, Any] = {
        f"{record}.{name}": getattr(getattr(window, record), name)
        for record, names in _COLUMNS.items()
        for name in names
    }
    archive = BytesIO()
    np.savez(archive, times=np.array([window.start_s, window.end_s]), looks=np.array(window.looks), **columns)
    return archive.getvalue()


def _unpacked(batch: Batch) -> Window:
    if (batch.content_type, batch.schema_version) != (_CONTENT_TYPE, _VERSION):
        raise SinkError(
            f"its spool holds {batch.content_type} of an output of another kind; give each output a spool of its own"
        )
    with np.load(BytesIO(batch.body), allow_pickle=False) as archive:
        start_s, end_s = archive["times"].tolist()
        return Window(
            start_s=start_s,
            end_s=end_s,
            looks=int(archive["looks"]),
            detections=_record(Detections, "detections", archive),
            truth=DetectionTruth.empty(),
            tracks=_record(Tracks, "tracks", archive),
            estimates=_record(Tracks, "estimates", archive),
        )


def _record(record: Callable[..., _Record], name: str, archive: Any) -> _Record:
    return record(*(archive[f"{name}.{column}"] for column in _COLUMNS[name])).freeze()
