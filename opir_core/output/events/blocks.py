"""Windows cut into blocks, so that what a sink holds at a time does not grow with the window."""

from collections.abc import Iterator

from attrs import evolve

from opir_core.interfaces.optional import PartialEncoder
from opir_core.interfaces.protocols import Encoder
from opir_core.interfaces.records import DetectionTruth, Tracks, Window

#: Detections in a block: enough to spread numpy's cost per call, few enough to stay near the processor.
BLOCK_ROWS = 8_192


def window_blocks(window: Window, rows: int = BLOCK_ROWS) -> Iterator[Window]:
    """Yield windows of at most `rows` detections that together are the window; of one without detections, nothing.

    All have the window's times and estimates; `looks` and `tracks` are in the first.
    """
    for start in range(0, len(window.detections), rows):
        block = slice(start, start + rows)
        part = evolve(window, detections=window.detections.take(block), truth=window.truth.take(block))
        yield part if start == 0 else evolve(part, looks=0, tracks=Tracks.empty())


def only_encodable(window: Window, encoder: Encoder) -> Window:
    """Return the window without the detections that an encoder has no message for."""
    if not isinstance(encoder, PartialEncoder) or not len(window.detections):
        return window
    mask = encoder.encodable(window)
    return (
        window if mask.all() else evolve(window, detections=window.detections.take(mask), truth=DetectionTruth.empty())
    )
