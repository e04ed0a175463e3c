"""Hypotheses taken apart by when the burn ends: each part linearised where its end leads.

How a path leans and how its acceleration grows tells one sensor how long the burn may be: of short burns much, of ever
longer ones ever less. Rows that are linear where the fit stands leave too little to late ends, which take impacts
farthest. Given its end a part is as good as linear; how much more of the posterior there is at that end than the linear
problem of the whole has there is told by the part's evidence.
"""

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.profile import fit
from opir_trackers.profile.burnout_speed import Placed
from opir_trackers.profile.family import Family
from opir_trackers.profile.fit import Hypotheses, Solved
from opir_trackers.profile.memory import FitMemory
from opir_trackers.profile.start import started

#: No burn is over sooner than this after its start, s.
_SOONEST_S = 1e-3


def given_ends(
    hypotheses: Hypotheses, origin: IntArray, parts: Hypotheses, end_s: FloatArray, memory: FitMemory
) -> Placed:
    """Return where parts (m,) of hypotheses (n,) are likeliest given when their burns end, and what is left of them.

    `origin` (m,) is whose part each is, `end_s` (m,) the scene time at which its burn ends. Parts stand where their
    rows are to be linearised. The logarithms are of how much likelier they are than hypotheses, which are linear, say.
    """
    stood = fit.family_of(hypotheses, memory.priors)
    whole = fit.solved(hypotheses, memory.priors, memory.bias_sigma_rad)
    whole = started(hypotheses, whole, memory.priors, memory.seen)
    mean, _, variance = _lengths(hypotheses, whole, stood)
    since = _log_since(end_s, stood.start_s[origin])
    density = -0.5 * (np.square(since - mean[origin]) / variance[origin] + np.log(variance[origin])) - since
    told = whole.evidence[origin] / hypotheses.misfit[origin] + density
    trial, family, solution = memory.linearised(parts)
    given, since = _given(trial, solution, family, end_s)
    given = started(trial, given._replace(misfit=hypotheses.misfit[origin]), memory.priors, memory.seen)
    prior = memory.priors.take(parts.kind)
    parameters = fit.within(fit.plausible(given.parameters, prior), prior)
    return Placed(parameters, given.spread, given.evidence / given.misfit - since - told)


def _given(parts: Hypotheses, solution: Solved, family: Family, end_s: FloatArray) -> tuple[Solved, FloatArray]:
    """Return solutions (m,) given ends of burns, and the logarithms (m,) of times to these from where starts stand."""
    mean, gain, variance = _lengths(parts, solution, family)
    gain, since = gain / variance[:, None], _log_since(end_s, family.start_s)
    away = since - mean
    given = Solved(
        solution.parameters + gain * away[:, None],
        solution.spread - variance[:, None, None] * gain[:, :, None] * gain[:, None],
        solution.evidence - 0.5 * (np.square(away) / variance + np.log(variance)),
        solution.misfit,
    )
    return given, since


def _lengths(hypotheses: Hypotheses, solution: Solved, family: Family) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means (n,) of logarithms of times to ends, parameters' covariances (n, 10) with these, and variances."""
    away = solution.parameters - hypotheses.parameters
    mean = np.log(family.courses.burn_s) + np.sum(family.end_slope() * away, axis=1)
    return mean, *family.with_end(solution.spread)


def _log_since(end_s: FloatArray, start_s: FloatArray) -> FloatArray:
    """Return logarithms (m,) of times from starts to ends."""
    found: FloatArray = np.log(np.maximum(end_s - start_s, _SOONEST_S))
    return found
