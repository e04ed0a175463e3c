"""Where windows end: sized by the looks they hold, so that memory does not grow with a scene's duration."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import Problem, SceneError
from opir_core.plan import Plan
from opir_core.sightlines import Pairs

#: Looks that a window is meant to hold; a column of them takes 2 MiB.
LOOKS_PER_WINDOW = 1 << 18

_NS = 1_000_000_000


def window_edges_ns(plan: Plan, window_s: float | None = None) -> Sequence[int]:
    """Return the ends of a plan's windows, ns: every `window_s`, or after about `LOOKS_PER_WINDOW` looks."""
    if window_s is None:
        return _edges_by_looks(plan.pairs, plan.end_ns)
    step_ns = round(window_s * _NS)
    if step_ns < 1:
        raise SceneError([Problem("window_s", f"{window_s!r} is not a positive time of at least a nanosecond")])
    return [*range(step_ns, plan.end_ns, step_ns), plan.end_ns]


def _edges_by_looks(pairs: Pairs, end_ns: int) -> Sequence[int]:
    looking = pairs.take(pairs.looks > 0)
    total = int(looking.looks.sum())
    if total <= LOOKS_PER_WINDOW:
        return [end_ns]
    starts = looking.phase_ns + looking.first_scan * looking.period_ns
    stops = looking.phase_ns + (looking.last_scan + 1) * looking.period_ns
    knots = np.unique(np.concatenate([starts, stops]))
    passed = _looks_before(knots, starts, stops, looking.period_ns)
    wanted = np.arange(LOOKS_PER_WINDOW, total, LOOKS_PER_WINDOW)
    edges = np.unique(np.rint(np.interp(wanted, passed, knots)).astype(np.int64))
    return [*(edge for edge in edges.tolist() if 0 < edge < end_ns), end_ns]


def _looks_before(knots: IntArray, starts: IntArray, stops: IntArray, periods: IntArray) -> FloatArray:
    """Return about how many looks come before each knot: rates add up where pairs start and drop where they stop."""
    rates = np.zeros(len(knots))
    np.add.at(rates, np.searchsorted(knots, starts), 1.0 / periods)
    np.add.at(rates, np.searchsorted(knots, stops), -1.0 / periods)
    return np.concatenate([[0.0], np.cumsum(np.cumsum(rates)[:-1] * np.diff(knots))])
