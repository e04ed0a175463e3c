"""Trackers stepped by hand: detections in portions, and what trackers of a plan are built from."""

from itertools import pairwise

import numpy as np

from opir_core.plugin import TrackerContext, Tracks


def portions(detections, ticks_s):
    """Return detections (ordered) before each tick, since the last one."""
    cuts = [0, *np.searchsorted(detections.time_s, ticks_s).tolist()]
    return [detections.take(slice(*edges)) for edges in pairwise(cuts)]


def stepped(tracker, ticks_s, slices):
    """Return the tracks of all ticks."""
    return Tracks.concatenate(
        [
            tracker.step(tick_s, detections)
            for tick_s, detections in zip(ticks_s, slices, strict=True)
        ]
    )


def last(tracks, count=1):
    """Return the tracks of the last ticks."""
    return tracks.take(np.flatnonzero(tracks.tick_s >= np.unique(tracks.tick_s)[-count]))


def context_of(plan, sensors):
    """Return what a tracker of a plan without false alarms is built from, with other sensors."""
    return TrackerContext(
        sensors=sensors,
        epoch_us=plan.scene.epoch_us,
        duration_s=plan.scene.duration_s,
        hypotheses=plan.hypotheses,
        false_alarms_per_scan=(0.0,) * len(sensors),
    )
