"""What one sensor alone sees of targets that fly as no family does: the filter takes the place of the fit."""

import numpy as np
import pytest
from off_model_flights import flown
from tracked_flights import followed, rows_of, sensors_of, usual

from opir_core.scoring.consistency import nees, on_normal_scale

KIND, COUNT, SEED, SHARE = "IRBM", 8, 1, 0.85


@pytest.mark.slow
def test_states_of_strange_targets_are_as_sure_as_they_say_before_the_burn_ends():
    truth = flown(KIND, COUNT, SEED, "staged")
    marks = truth.start_s + SHARE * truth.burn_s
    found, alone = np.full(COUNT, np.nan), sensors_of()[:1]

    def passing(tick_s):
        return np.flatnonzero((marks > tick_s - 1.0) & (marks <= tick_s))

    for tick in followed(truth, usual(KIND), SEED, marks.max() + 1.0, alone, asked=passing):
        mine = passing(tick.time_s)
        if len(mine):
            told = tick.told.take(rows_of(tick.told, tick.shared)[mine])
            error = told.state - truth.take(mine).states(tick.time_s)
            found[mine] = on_normal_scale(nees(error, told.state_covariance), told.state_sigmas, 6)
    # Of the fit alone one in five lies within what holds 95 %; five or more of eight were then one case in a hundred.
    assert np.isfinite(found).all()
    assert np.count_nonzero(found < 12.6) >= 5
    assert np.median(found) < 12.6
