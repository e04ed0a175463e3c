"""Forecasts of tracks that began at different times are renewed at the same ticks."""

import numpy as np
from repository import TEST_SCENES

import opir_core as opir

EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"
EVERY_S = 5.0


def renewals(tracks, number):
    """Return the ticks at which a track has other regions than at the tick before."""
    rows = np.flatnonzero(tracks.track == number)
    regions = tracks.impact_regions[rows]
    return {
        float(tracks.tick_s[rows[place]])
        for place in range(1, len(rows))
        if regions[place] is not regions[place - 1]
    }


def test_tracks_of_launches_half_a_minute_apart_have_new_regions_together() -> None:
    changes = ["duration_s=80", "outputs=[]", f"tracker={{model: imm, regions_every_s: {EVERY_S}}}"]
    tracks = opir.simulate(opir.load_scene(EXAMPLE, overrides=changes)).tracks
    together = set(np.arange(60.0, 80.0, EVERY_S).tolist())
    assert together <= renewals(tracks, 0)
    assert together <= renewals(tracks, 1)
