"""The encoder `tracks`: the lines of the tracks file with timestamps, one per track and tick.

It encodes no detections: messages go on after burnout, when there are none, up to the end of the
track.
"""

import msgspec
import numpy as np

from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.outputs import Encoder
from opir_core.interfaces.records import Window
from opir_core.output.events import TRACKS_VERSION
from opir_core.output.events.text import timestamp_text
from opir_core.output.track_records import track_records


class TracksEncoder(Encoder):
    """Tracks as lines of JSON; the bytes do not depend on the windows."""

    content_type = "application/json"
    schema_version = TRACKS_VERSION
    encodes_tracks = True

    def __init__(self, context: EncoderContext) -> None:
        self._epoch_us = context.epoch_us
        self._hypotheses = context.hypotheses

    def encode(self, window: Window) -> bytes:
        """Return the window's tracks as lines; a tick outside the years 1 to 9999 raises
        `SinkError`.
        """
        timestamp_text(np.rint(window.tracks.tick_s * 1e6).astype(np.int64) + self._epoch_us)
        records = track_records(
            window.tracks, self._hypotheses, self._epoch_us, self.schema_version
        )
        return msgspec.json.Encoder().encode_lines(records)
