"""Stages of tracks from tick to tick: gaps, false silence, hot staging and throttled engines, in
made-up estimates.
"""

import numpy as np
import pytest
from attrs import evolve
from boost_law import GAP, NONE
from opir_forecast import BoostEstimates
from opir_forecast.stage_history import StageHistory
from opir_forecast.track_rows import rows_of_tracks
from plain_boosts import RADIUS_M


def estimates(
    burning: float, force: float, silent_s: float = 0.05, staging: float = 0.0, free: float = 0.0
) -> BoostEstimates:
    """Return the estimate of one track that flies upwards, with an acceleration and 20 detections a
    second.
    """
    mean = np.array([[RADIUS_M + 5e4, 0.0, 0.0, 2000.0, 465.0, 0.0, force, 0.0, 0.0, 0.01]])
    times_s = np.array([silent_s]), np.array([0.05])
    estimate = BoostEstimates.of_moments(
        np.array([7]), mean, np.eye(10)[None], np.array([burning]), *times_s, 1
    )
    return evolve(
        estimate,
        burn_share=np.array([[1.0 - staging - free, staging, free]]),
        launch=np.zeros((1, 3)),
        launch_covariance=np.diag([1.0, 1.0, 0.09])[None],
    )


def history_of(*ticks: tuple[float, BoostEstimates]) -> StageHistory:
    """Return the history of a track that was launched at 0 s."""
    history = StageHistory.begun(np.array([7]), 1.0)
    for tick_s, estimate in ticks:
        history = history.updated(estimate, tick_s)
    return history


FIRST = [(float(tick), estimates(1.0, 20.0 / (1.0 - 0.01 * tick))) for tick in range(1, 61)]
DARK = [(float(tick), estimates(0.0, 50.0, silent_s=tick - 60.0)) for tick in range(61, 75)]


def test_a_gap_ends_a_stage_and_its_figures_are_kept() -> None:
    lit = [(float(tick), estimates(1.0, 18.0)) for tick in range(75, 80)]
    dark = history_of(*FIRST, *DARK)
    relit = history_of(*FIRST, *DARK, *lit)
    assert dark.is_dark[0]
    assert dark.done[0] == relit.done[0] == 1
    assert not relit.is_dark[0]
    burn, force, ratio, gap = np.exp(relit.logs[0, 0])
    assert burn == pytest.approx(60.0, abs=1.5)
    # Force and growth at 60 s: 50 m/s² and 1/100 s, so 50 / (1 + 0.6) at first.
    assert force == pytest.approx(50.0 / 1.6, rel=0.02)
    assert ratio == pytest.approx(1.6, rel=0.05)
    assert gap == pytest.approx(14.5, abs=1.5)
    assert relit.ignition_s[0] == pytest.approx(74.5)
    assert relit.launch_s[0] == pytest.approx(0.0, abs=1.5)


def test_a_silence_that_is_over_at_once_is_no_gap() -> None:
    blink = [(61.0, estimates(0.4, 50.0, silent_s=0.4)), (61.5, estimates(1.0, 50.0))]
    history = history_of(*FIRST, *blink)
    assert history.done[0] == 0
    assert history.ignition_s[0] == 0.0


@pytest.mark.parametrize(("force", "stages"), [(15.0, 1), (42.0, 0), (60.0, 0)])
def test_staging_counts_if_the_force_has_dropped(force: float, stages: int) -> None:
    """Forces of 42 and 60 m/s² after 50 are of a throttled engine."""
    turn = [(61.0, estimates(1.0, 50.0, staging=0.6)), (62.0, estimates(1.0, 50.0, staging=0.95))]
    history = history_of(*FIRST, *turn, (63.0, estimates(1.0, force, staging=0.02)))
    assert history.done[0] == stages
    if stages:
        assert np.isneginf(history.logs[0, 0, GAP])
        assert history.ignition_s[0] == pytest.approx(61.0, abs=1.5)


def test_tracks_keep_their_histories_whatever_comes_and_goes() -> None:
    history = history_of(*FIRST, *DARK)
    among = rows_of_tracks(
        history, np.array([3, 7, 9]), lambda number: StageHistory.begun(number, 80.0)
    )
    assert among.number.tolist() == [3, 7, 9]
    assert among.done.tolist() == [0, 1, 0]
    assert np.array_equal(among.take(np.array([1])).logs, history.logs, equal_nan=True)


def test_a_burn_in_another_direction_is_evidence_for_none() -> None:
    weak = (61.0, estimates(1.0, 20.0, free=0.3))
    turned = [(61.0, estimates(1.0, 20.0, free=0.95)), (62.0, weak[1])]
    assert not history_of(*FIRST).log_free.any()
    assert not history_of(*FIRST, weak).log_free.any()
    # Odds of 19 : 1 that were 1 : 9 count for half of what is none of these.
    expected = np.zeros(3)
    expected[NONE] = np.log(0.5 + 0.5 * 19.0 * 9.0)
    assert history_of(*FIRST, *turned).log_free[0] == pytest.approx(expected)
