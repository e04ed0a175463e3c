"""Doubt in lines weighs them down; that they were detected stays."""

import numpy as np
from attrs import evolve
from drawn_flights import flown, seen
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.outliers import FRACTIONS
from opir_trackers.imm.tracking import ImmTracking
from tracked_flights import detections_of, sensors_of, usual

from opir_core.interfaces.contexts import TrackerContext

SECOND_NS = 1_000_000_000


def test_detection_rates_are_the_same_whatever_is_doubted() -> None:
    """One of two sensors says that it looks no more."""
    _, rays = seen(flown("SRBM", 1, 11, "smooth"), usual("SRBM"), 11)
    west, east = sensors_of()
    sensors = west, evolve(east, watched_s=((0.0, 20.0),))
    context = TrackerContext(sensors=sensors, epoch_us=0, duration_s=1e3, forces="kepler")
    tracking = ImmTracking.of(ImmConfig(), context)
    looks = detections_of(rays.take(np.flatnonzero((rays.sensor == 0) | (rays.time_s < 20.0))))
    cut, end = np.searchsorted(looks.time_ns, [20 * SECOND_NS, 21 * SECOND_NS])
    state = tracking.stepped(tracking.start(), 20.0, looks.take(slice(cut)))
    # As after many lines of which half were outliers.
    doubt = -1e3 * np.abs(FRACTIONS - 0.5)[None]
    doubted = state._replace(table=state.table.changed(outliers=doubt))
    sure, unsure = (
        tracking.stepped(each, 21.0, looks.take(slice(cut, end))).table.estimates.detection_rate
        for each in (state, doubted)
    )
    np.testing.assert_allclose(unsure, sure, rtol=1e-12)
