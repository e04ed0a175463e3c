"""The truth file: what was really launched and really seen, apart from the events.

JSON lines: one `sensor` each where sensors have a line-of-sight bias, one `target` a launch or other hot source, one
`detection` an event, tied to it by `detection_id`; its `target_id` is null where it is noise alone.
"""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

import msgspec

from opir_core.errors import unwritable
from opir_core.interfaces.records import Window
from opir_core.output.events.blocks import window_blocks
from opir_core.planning.plan import Plan
from opir_core.random_streams.detection_ids import uuid_text


class _Detection(msgspec.Struct, tag_field="record", tag="detection", gc=False):
    detection_id: str
    target_id: str | None
    emission_s: float
    range_m: float
    target_elevation_rad: float
    probability: float


class TruthFile:
    """Writes a run's truth to a file, window by window; use it as a context."""

    def __init__(self, path: Path, plan: Plan) -> None:
        self._path = path
        self._ids = plan.targets.ids
        self._encoder = msgspec.json.Encoder()
        self._file = self._opened()
        self._write([{"record": "sensor", **told} for told in self._sensors(plan)])
        self._write([{"record": "target", "target_id": id_, **told} for id_, told in self._launches(plan)])

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable("the truth file", self._path, error) from error

    def write(self, window: Window) -> None:
        """Write the truth of a window's detections."""
        for block in window_blocks(window):
            truth = block.truth
            columns = (
                uuid_text(block.detections.detection_id),
                [None if target < 0 else self._ids[target] for target in truth.target.tolist()],
                truth.emission_time_s.tolist(),
                truth.range_m.tolist(),
                truth.target_elevation_rad.tolist(),
                truth.probability.tolist(),
            )
            self._write(list(map(_Detection, *columns)))

    @staticmethod
    def _sensors(plan: Plan) -> "list[dict[str, object]]":
        return [] if plan.bias is None else [dict(told) for told in plan.bias.told(plan.sensors)]

    @staticmethod
    def _launches(plan: Plan) -> "list[tuple[str, dict[str, object]]]":
        return [(id_, dict(told)) for id_, told in zip(plan.targets.ids, plan.targets.truth(), strict=True)]

    def _opened(self) -> BinaryIO:
        try:
            return self._path.open("wb")
        except OSError as error:
            raise unwritable("the truth file", self._path, error) from error

    def _write(self, lines: Sequence[object]) -> None:
        try:
            self._file.write(self._encoder.encode_lines(list(lines)))
        except OSError as error:
            raise unwritable("the truth file", self._path, error) from error
