"""Where a burn is over, the tracker takes its end from all of its looks."""

import numpy as np
import pytest
from attrs import evolve
from drawn_flights import flown, seen
from opir_estimation import BURN_MEMORY_S
from opir_estimation.square_root import covariance
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.burnouts import SAME_ERROR, with_burn_ends
from opir_trackers.imm.tracking import ImmTracking
from tracked_flights import detections_of, sensors_of, usual

from opir_core.interfaces.contexts import TrackerContext

FLIGHTS = 4


@pytest.fixture(scope="module")
def followed():
    """Return flights, the tracking of them, and its states by tick, s."""
    truth = flown("SRBM", FLIGHTS, 11, "smooth")
    _, rays = seen(truth, usual("SRBM"), 11)
    context = TrackerContext(sensors=sensors_of(), epoch_us=0, duration_s=1e3, forces="kepler")
    tracking = ImmTracking.of(ImmConfig(), context)
    detections = detections_of(rays)
    state = tracking.start()
    states = [state]
    cut = 0
    for tick in range(1, int(truth.burnout_s.max()) + 6):
        end = int(np.searchsorted(detections.time_ns, tick * 1_000_000_000))
        state = tracking.stepped(state, float(tick), detections.take(slice(cut, end)))
        states.append(state)
        cut = end
    return truth, tracking, states


@pytest.mark.slow
def test_coasts_are_surer_than_the_last_estimates_of_burns(followed):
    truth, _, states = followed
    table = states[-1].table
    assert len(table) == FLIGHTS
    assert np.array_equal(table.burnt_s, table.seen_s)
    before = states[int(truth.burnout_s.min()) - 1].table.estimates
    burning, coasting = (
        np.sqrt(np.trace(covariance(root)[:, 3:6, 3:6], axis1=1, axis2=2))
        for root in (before.boost_root, table.estimates.coast_root)
    )
    assert np.median(coasting) < np.median(burning)


@pytest.mark.slow
def test_looks_are_kept_for_a_bounded_time(followed):
    _, _, states = followed
    for state in states:
        if state.looks:
            assert state.looks[0].end_s >= state.looks[-1].end_s - BURN_MEMORY_S - 1.0
            assert len(state.looks) <= BURN_MEMORY_S + 2


@pytest.mark.slow
def test_an_end_is_found_once_for_each_burn(followed):
    _, tracking, states = followed
    assert with_burn_ends(tracking.models, states[-1]) is states[-1]


@pytest.mark.slow
def test_looks_with_other_errors_of_sensors_do_not_count(followed):
    """Of lines whose sensors have since been corrected none is left, and the filter's state
    stays.
    """
    _, tracking, states = followed
    state = states[-1]
    other = np.tile(2.0 * SAME_ERROR, len(state.looks[0].error) // len(SAME_ERROR))
    looks = [part._replace(error=part.error + other) for part in state.looks[:-1]]
    # As when the last burn was steady.
    steady = evolve(state.table.estimates, burn_share=np.tile([1.0, 0.0, 0.0], (FLIGHTS, 1)))
    table = state.table.changed(burnt_s=np.full(FLIGHTS, -np.inf), estimates=steady)
    state = state._replace(looks=(*looks, state.looks[-1]), table=table)
    after = with_burn_ends(tracking.models, state).table
    assert np.array_equal(after.burnt_s, after.seen_s)
    assert np.array_equal(after.estimates.coast_mean, table.estimates.coast_mean)


@pytest.mark.slow
def test_tracks_that_are_no_launches_keep_the_filters_state(followed):
    _, tracking, states = followed
    table = states[-1].table
    motion = evolve(table.motion, probability=np.zeros_like(table.motion.probability))
    table = table.changed(burnt_s=np.full(FLIGHTS, -np.inf), motion=motion)
    state = states[-1]._replace(table=table)
    assert with_burn_ends(tracking.models, state) is state
