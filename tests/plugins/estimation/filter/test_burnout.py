"""Where a target is that burnt out after its last detection: when that was, and what its force has
not done since.
"""

import numpy as np
import pytest
from opir_estimation import ModeEstimates
from opir_estimation.filter.mode_mixing import coast_from_boost
from opir_estimation.square_root import covariance

FORCE_M_S2 = 40.0
EXACT = 1e-3


def boosts(silent_s, pause_s, force_sigma, copies=1):
    """Return estimates of burns detected every `pause_s`, that went on burning for `silent_s` since
    the last look.

    State and force at the last look are known but for the size of the force.
    """
    step = np.eye(10)
    push = silent_s * np.eye(3)
    step[3:6, 6:9] = push
    step[:3, 3:6] = push
    step[:3, 6:9] = 0.5 * silent_s * push
    sigma = np.concatenate([np.full(6, EXACT), [force_sigma, EXACT, EXACT], [EXACT]])
    root = np.triu(np.linalg.qr(np.diag(1.0 / sigma) @ np.linalg.inv(step))[1])
    mean = step @ np.array([7e6, 0.0, 0.0, 3000.0, 0.0, 0.0, FORCE_M_S2, 0.0, 0.0, 0.01])
    many = [np.repeat(each[None], copies, axis=0) for each in (mean, root)]
    coast = many[0][:, :6], np.repeat(np.eye(6)[None], copies, axis=0)
    rate = np.tile([10.0, 10.0 * pause_s, silent_s], (copies, 1))
    return ModeEstimates(np.tile([0.9, 0.1], (copies, 1)), *many, *coast, rate)


def drawn_burnouts(period_s, chance, seed):
    """Return times from the last detection to burnout, of scans that detect by chance, until four
    are missed.
    """
    rng = np.random.default_rng(seed)
    burnout = rng.uniform(0.0, 60.0 * period_s, 400_000)
    return burnout[rng.random(len(burnout)) < (1.0 - chance) ** np.floor(burnout / period_s)]


@pytest.mark.parametrize("copies", [1, 2])
@pytest.mark.parametrize("chance", [1.0, 0.9, 0.5])
def test_a_regular_scanner_knows_when_the_burn_ended(chance, copies):
    period_s = 10.0
    silent_s = 100.0
    drawn = drawn_burnouts(period_s, chance, 2)
    mean, root = coast_from_boost(boosts(silent_s, period_s / chance, EXACT, copies), period_s)
    assert mean[:, 3] == pytest.approx(3000.0 + FORCE_M_S2 * drawn.mean(), rel=5e-3)
    assert np.sqrt(covariance(root)[:, 3, 3]) == pytest.approx(FORCE_M_S2 * drawn.std(), rel=0.03)


@pytest.mark.parametrize("copies", [1, 2])
def test_fast_scans_that_rarely_detect_leave_the_time_between_detections(copies):
    mean, root = coast_from_boost(boosts(100.0, 5.0, EXACT, copies), 0.1)
    assert mean[:, 3] == pytest.approx(3000.0 + FORCE_M_S2 * 5.0, rel=2e-3)
    assert np.sqrt(covariance(root)[:, 3, 3]) == pytest.approx(FORCE_M_S2 * 5.0, rel=0.02)


@pytest.mark.parametrize("copies", [1, 2])
def test_a_force_that_is_not_known_has_not_acted_since_burnout(copies):
    """For 6 of the 30 s it may have acted; propagated as a burn, its error would be that of 30
    s.
    """
    sigmas = []
    for force_sigma in (EXACT, 10.0):
        _, root = coast_from_boost(boosts(30.0, 10.0 / 0.9, force_sigma, copies), 10.0)
        sigmas.append(np.sqrt(covariance(root)[:, 3, 3]))
    assert np.sqrt(sigmas[1] ** 2 - sigmas[0] ** 2) == pytest.approx(
        10.0 * (10.0 / 0.9 - 5.0), rel=1e-3
    )
