"""The exporter `tdm`: a CCSDS Tracking Data Message 2.0 (KVN) with measured angles per sensor.

A segment has the detections of one sensor and one track (or, as truth, of one target). Source:
CCSDS 503.0-B-2.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen
from opir_readers import ecef_state

from opir_core.arrays import FloatArray, IntArray
from opir_core.output import OutputFiles
from opir_core.plugin import Detections
from opir_export.ccsds.keyword_values import block, header, time_texts
from opir_export.settings import TdmConfig

_COMMENTS = (
    "angles of a spaceborne sensor; its positions are those of an OEM of the same run",
    (
        "azimuth clockwise from true north, elevation above the geodetic horizontal, both at the"
        " sensor"
    ),
)
_UNKNOWN = "UNCORRELATED"
_NS_PER_US = 1_000


@frozen
class TdmFile:
    """Writes one message of measured angles."""

    config: TdmConfig

    suffix = ".tdm"

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the message of a run, and return its file."""
        epoch_us = run.plan.scene.epoch_us
        rows = run.detections
        since_us = np.rint(rows.time_ns / _NS_PER_US).astype(np.int64)
        angles_deg = _angles_deg(rows, epoch_us, self.config.angles)
        code, names = self._objects(run)
        comments = _COMMENTS if self.config.angles == "azel" else _COMMENTS[:1]
        lines = header("TDM", "2.0", epoch_us, comments)
        for segment in _segments(rows.sensor, code, since_us):
            name = names[code[segment[0]]]
            data = _data(since_us[segment], angles_deg[segment], epoch_us)
            ends = time_texts(since_us[segment[[0, -1]]], epoch_us)
            meta = self._meta(run.sensors[rows.sensor[segment[0]]].id, name, ends)
            lines += [*block("META", meta), "DATA_START", *data, "DATA_STOP", ""]
        with OutputFiles() as output:
            output.write(path, "\n".join([*lines, ""]).encode("ascii", "replace"), "tracking data")
        return [path]

    def _objects(self, run: Any) -> tuple[IntArray, list[str]]:
        """Return the object of each detection as a code (n,), and the names of the objects."""
        if self.config.objects == "targets":
            return np.where(run.truth.target < 0, len(run.target_ids), run.truth.target), [
                *run.target_ids,
                _UNKNOWN,
            ]
        tracks = np.unique(run.detections.track[run.detections.track >= 0])
        code = np.searchsorted(tracks, run.detections.track)
        names = [*(f"TRACK-{number}" for number in tracks.tolist()), _UNKNOWN]
        return np.where(run.detections.track < 0, len(tracks), code), names

    def _meta(self, sensor: str, name: str, ends: Sequence[str]) -> dict[str, object]:
        frame = {"REFERENCE_FRAME": "EME2000"} if self.config.angles == "radec" else {}
        return {
            "TIME_SYSTEM": "UTC",
            "START_TIME": ends[0],
            "STOP_TIME": ends[1],
            "PARTICIPANT_1": sensor,
            "PARTICIPANT_2": name,
            "MODE": "SEQUENTIAL",
            "PATH": "2,1",
            "TIMETAG_REF": "RECEIVE",
            "ANGLE_TYPE": self.config.angles.upper(),
            **frame,
            "DATA_QUALITY": "RAW",
        }


def _angles_deg(rows: Detections, epoch_us: int, kind: str) -> FloatArray:
    """Return the measured angles (n, 2): azimuth and elevation, or `radec` in EME2000."""
    if kind == "azel":
        angles = rows.angles()
        pair = np.stack([angles.azimuth_rad, angles.elevation_rad], axis=1)
        return np.degrees(pair)
    x, y, z = _equinox_vectors(rows.line_of_sight_ecef, epoch_us, rows.time_s).T
    pair = np.stack([np.mod(np.arctan2(y, x), 2.0 * np.pi), np.arctan2(z, np.hypot(x, y))], axis=1)
    return np.degrees(pair)


def _equinox_vectors(vectors: FloatArray, epoch_us: int, time_s: FloatArray) -> FloatArray:
    """Return vectors (n, 3) of the Earth-fixed frame in EME2000, at scene times (n,)."""
    at_rest = np.zeros_like(vectors)
    components = []
    for axis in np.eye(3):
        axes = np.broadcast_to(axis, vectors.shape).copy()
        turned, _ = ecef_state("EME2000", axes, at_rest, epoch_us, time_s)
        components.append(np.add.reduce(turned * vectors, axis=1))
    return np.stack(components, axis=1)


def _segments(sensor: Any, code: IntArray, since_us: IntArray) -> list[IntArray]:
    """Return the detections of each pair of sensor and object, rows in order of time."""
    order = np.lexsort((since_us, code, sensor))
    pairs = np.stack([sensor[order], code[order]], axis=1)
    edges = np.flatnonzero((pairs[1:] != pairs[:-1]).any(axis=1)) + 1
    return [segment for segment in np.split(order, edges) if len(segment)]


def _data(since_us: IntArray, angles_deg: FloatArray, epoch_us: int) -> list[str]:
    samples = zip(time_texts(since_us, epoch_us), angles_deg.tolist(), strict=True)
    return [
        f"ANGLE_{number} = {time} {angle:.9f}"
        for time, pair in samples
        for number, angle in enumerate(pair, start=1)
    ]
