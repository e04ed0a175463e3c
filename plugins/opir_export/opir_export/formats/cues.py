"""The exporter `cues`: the volumes that another sensor must search, a JSON object for each track."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
from attrs import frozen

from opir_core.output import OutputFiles
from opir_export.search_volumes import cues_of
from opir_export.settings import CuesConfig


@frozen
class CuesFile:
    """Writes a line for each track, with a volume or the reason why there is none."""

    config: CuesConfig

    suffix = ".cues.jsonl"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the cues of a run to a file, and return it; `SceneError` without a tracker."""
        lines = msgspec.json.Encoder().encode_lines(cues_of(run, self.config))
        with OutputFiles() as output:
            output.write(path, lines, "cues")
        return [path]
