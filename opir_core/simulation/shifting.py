"""Windows with other times: of a lap in the scene time of the whole run, of one run in the scene
time of another.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.records import CommandRecord, Tracks, Window


def shifted(window: Window, time_ns: int, tracks: int = 0) -> Window:
    """Return a window with all times `time_ns` later, of detections exactly, and track numbers
    `tracks` higher.
    """
    detections = window.detections
    offset_s = time_ns * 1e-9
    look_ns = detections.time_ns + time_ns
    reported_ns = detections.reported_ns + time_ns if detections.is_delayed else look_ns
    track: IntArray = np.where(detections.track >= 0, detections.track + tracks, detections.track)
    return evolve(
        window,
        start_s=window.start_s + offset_s,
        end_s=window.end_s + offset_s,
        detections=detections.replaced(
            time_ns=look_ns, reported_ns=reported_ns, track=track
        ).freeze(),
        tracks=_shifted_tracks(window.tracks, offset_s, tracks),
        estimates=_shifted_tracks(window.estimates, offset_s, tracks),
        commands=tuple(shifted_command(each, offset_s, tracks) for each in window.commands),
    )


def shifted_command(record: CommandRecord, offset_s: float, numbers: int) -> CommandRecord:
    """Return what became of a command, with later times and higher track numbers."""
    return record._replace(
        time_s=record.time_s + offset_s,
        start_s=record.start_s + offset_s,
        from_s=record.from_s + offset_s,
        track=record.track + numbers if record.track >= 0 else -1,
    )


def _shifted_tracks(tracks: Tracks, offset_s: float, numbers: int) -> Tracks:
    return evolve(
        tracks,
        tick_s=tracks.tick_s + offset_s,
        available_s=tracks.available_s + offset_s,
        track=tracks.track + numbers,
        launch=_later(tracks.launch, offset_s),
        impact=_later(tracks.impact, offset_s),
        burnout=_later(tracks.burnout, offset_s),
    )


def _later(event: FloatArray, offset_s: float) -> FloatArray:
    """Return events with a later time, their last column."""
    later = event.copy()
    later[:, -1] += offset_s
    return later
