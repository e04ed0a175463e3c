"""When sensors that confirm over scans report a launch first: against chains over the last looks."""

import numpy as np
import pytest
from opir_forecast.launch_points import (
    EDGES_S,
    confirming_looks,
    delays_at_once,
    delays_out_of_clouds,
    log_unreported,
)

#: Nodes of the mean over the arcsine law (Chebyshev, first kind).
NODES = np.sin(np.pi * (2.0 * np.arange(400) + 1.0) / 1600.0) ** 2


def unconfirmed(needed: int, scans: int, looks: int) -> np.ndarray:
    """Return the probabilities that none of the first 1, 2, ... looks completed M of N, mean over
    sources: a chain over which of the last N - 1 looks detected.
    """
    states = {(0,) * (scans - 1): np.ones(len(NODES))}
    shares = []
    for _ in range(looks):
        after: dict[tuple[int, ...], np.ndarray] = {}
        for recent, share in states.items():
            for hit, chance in ((1, NODES), (0, 1.0 - NODES)):
                last = (*recent, hit)
                if hit and sum(last) >= needed:
                    continue
                key = last[1:] if scans > 1 else ()
                after[key] = after.get(key, 0.0) + share * chance
        states = after
        shares.append(np.mean(sum(states.values())))
    return np.array(shares)


@pytest.mark.parametrize(("needed", "scans"), [(1, 1), (2, 3), (3, 4), (2, 6)])
def test_looks_until_m_of_n_are_those_of_a_chain(needed: int, scans: int) -> None:
    drawn = confirming_looks(needed, scans)
    stated = [np.mean(drawn > looks) for looks in range(1, 13)]
    assert stated == pytest.approx(unconfirmed(needed, scans, 12), abs=0.02)


def test_no_sensor_reports_before_its_rule_allows() -> None:
    """Three of four scans of 10 s take 20 to 30 s if each look detects: of the arcsine law, the
    mean cube is 5/16. Two sensors report the first of both.
    """
    unreported = log_unreported(np.full(2, 10.0), np.full(2, 0.5), [(3, 4), (3, 4)])
    both, one = delays_at_once(unreported, np.array([[True, True], [True, False]]))
    until = EDGES_S < 30.0
    share = 5.0 / 16.0 * np.maximum(EDGES_S[until] - 20.0, 0.0) / 10.0
    reported = [np.concatenate([[0.0], np.cumsum(delays)])[until] for delays in (one, both)]
    assert reported[0] == pytest.approx(share, abs=0.01)
    assert reported[1] == pytest.approx(1.0 - (1.0 - share) ** 2, abs=0.02)


def test_clouds_add_a_uniform_time() -> None:
    """A report at once out of clouds is uniform; one after 20 s in view is never sooner."""
    at_once = np.zeros((2, len(EDGES_S) - 1))
    at_once[0, 0] = 1.0
    at_once[1, np.searchsorted(EDGES_S, 20.0) - 1] = 1.0
    uniform, late = delays_out_of_clouds(at_once)
    assert uniform == pytest.approx(np.diff(EDGES_S) / EDGES_S[-1], abs=1e-3)
    assert late[EDGES_S[1:] < 19.0].sum() == 0.0
    assert late.sum() == pytest.approx(0.75, abs=0.02)
