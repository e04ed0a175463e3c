"""How young tracks end: as lights that went out, or beside another track of what shines on."""

import numpy as np
from drawn_flights import flown, seen
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.state import TrackTable
from opir_trackers.imm.tracking import ImmTracking
from tracked_flights import detections_of, sensors_of, usual

from opir_core.interfaces import TRACK_ENDS
from opir_core.interfaces.contexts import TrackerContext

#: Two and three seconds after the first look.
YOUNG_S, OLDER_S = 7, 8


def test_the_lesser_of_two_tracks_of_one_light_is_lost_and_not_brief() -> None:
    _, rays = seen(flown("SRBM", 1, 11, "smooth"), usual("SRBM"), 11)
    context = TrackerContext(sensors=sensors_of(), epoch_us=0, duration_s=1e3, forces="kepler")
    tracking = ImmTracking.of(ImmConfig(), context)
    detections = detections_of(rays)
    cut = np.searchsorted(detections.time_ns, YOUNG_S * 1_000_000_000)
    end = np.searchsorted(detections.time_ns, OLDER_S * 1_000_000_000)
    state = tracking.stepped(tracking.start(), float(YOUNG_S), detections.take(slice(cut)))
    table = state.table
    twin = table.changed(number=table.number + 1, hits=table.hits - 1)
    doubled = state._replace(table=TrackTable.concatenate([table, twin]), next_number=2)
    state = tracking.stepped(doubled, float(OLDER_S), detections.take(slice(cut, end)))
    reported = tracking.reported_tracks(state)
    assert reported.table.number.tolist() == [0, 1]
    assert [TRACK_ENDS[code] for code in reported.end] == ["", "lost"]
    assert not reported.is_brief.any()
