"""`imm`, which knows no family of boosts, against flights with stages and gaps between them."""

import numpy as np
import pytest
from drawn_flights import away_from, flown
from tracked_flights import followed, last_told, rows_of, usual

from opir_core.scoring.consistency import nees


@pytest.mark.parametrize(("course", "kind"), [("staged", "SRBM"), ("tabulated", "SRBM")])
def test_states_and_impacts_of_boosts_unlike_any_model_are_as_sure_as_they_say(course, kind):
    truth = flown(kind, 60, 1, course)
    told = last_told(truth, usual(kind), 1, 6.0)
    tick_s = float(told.tick_s[0])
    # The velocity at burnout is what an impact hangs on. ANEES of 60 draws: 99.9 % of χ² with 180 degrees are below.
    error = told.state - truth.states(tick_s)
    assert nees(error[:, 3:], told.state_covariance[:, 3:, 3:]).mean() / 3.0 < 1.36
    held = nees(away_from(told.impact, truth.impacts()), told.impact_covariance[:, :2, :2]) < 5.99
    # 60 draws that are held with 90 %: fewer than 46 are a case of one in a thousand.
    assert np.count_nonzero(held) >= 46


def test_no_impact_is_told_between_stages():
    truth = flown("SRBM", 30, 3, "staged")
    relit_s = truth.start_s + truth.dark[:, 0, 1] * truth.burn_s
    gaps = 0
    for tick in followed(truth, usual("SRBM"), 3, relit_s.max() + 1.0):
        begun = truth.start_s + truth.dark[:, 0, 0] * truth.burn_s < tick.time_s
        row = rows_of(tick.told, tick.shared)
        waits = begun & (tick.time_s < relit_s) & (row >= 0)
        gaps += np.count_nonzero(waits)
        assert np.isnan(tick.told.impact[row[waits]]).all()
    assert gaps >= 15
