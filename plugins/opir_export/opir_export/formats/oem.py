"""The exporter `oem`: CCSDS Orbit Ephemeris Messages 2.0 (KVN) of true flights and sensors.

States are Earth-fixed, in the frame of the run: WGS 84, which is ITRF to some centimetres. Source:
CCSDS 502.0-B-3.
"""

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.output import OutputFiles
from opir_export.ccsds.ephemerides import SampledStates, sensor_ephemerides, target_ephemerides
from opir_export.ccsds.keyword_values import block, header, time_texts
from opir_export.settings import OemConfig

#: Degree of the interpolation between states.
_DEGREE = 7


@frozen
class OemFolder:
    """Writes a folder with a message per object; each burn or free flight is a segment."""

    config: OemConfig

    #: A folder has no ending.
    suffix = ""

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the messages of a run into a folder, and return the files."""
        scene = run.plan.scene
        files = []
        with OutputFiles(folder=path) as output:
            for name, ephemerides in groupby(
                self._ephemerides(run), lambda states: states.file_name
            ):
                lines = header(
                    "OEM",
                    "2.0",
                    scene.epoch_us,
                    [f"truth of the scene {scene.name}, simulated by opir"],
                )
                for ephemeris in ephemerides:
                    lines += _segment(ephemeris, scene.epoch_us, self.config.frame)
                files.append(path / f"{name}.oem")
                text = "\n".join([*lines, ""]).encode("ascii", "replace")
                output.write(files[-1], text, "ephemeris", is_made_up=True)
        return files

    def _ephemerides(self, run: Any) -> Iterator[SampledStates]:
        if self.config.objects != "targets":
            yield from sensor_ephemerides(run.plan, self.config.step_s)
        if self.config.objects != "sensors":
            yield from target_ephemerides(run.plan, self.config.step_s, self.config.burn_step_s)


def _segment(ephemeris: SampledStates, epoch_us: int, frame: str) -> list[str]:
    times = time_texts(ephemeris.since_us, epoch_us)
    meta = {
        "OBJECT_NAME": ephemeris.name,
        "OBJECT_ID": ephemeris.name,
        "CENTER_NAME": "EARTH",
        "REF_FRAME": frame,
        "TIME_SYSTEM": "UTC",
        "START_TIME": times[0],
        "STOP_TIME": times[-1],
        "INTERPOLATION": "LAGRANGE",
        "INTERPOLATION_DEGREE": min(_DEGREE, len(times) - 1),
    }
    states = np.concatenate([ephemeris.position_m, ephemeris.velocity_m_s], axis=1) * 1e-3
    rows = (" ".join(f"{value:.9f}" for value in state) for state in states.tolist())
    return [
        *block("META", meta),
        *(f"{time} {row}" for time, row in zip(times, rows, strict=True)),
        "",
    ]
