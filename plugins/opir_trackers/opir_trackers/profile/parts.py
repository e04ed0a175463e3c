"""Hypotheses taken apart by when the burn ends: each part linearised where its end leads.

How a path leans and how its acceleration grows tells one sensor how long the burn may be: of short burns much, of ever
longer ones ever less. Rows that are linear where the fit stands leave too little to late ends, which take impacts
farthest. Given its end a part is as good as linear; how much more of the posterior there is at that end than the linear
problem of the whole has there is told by the part's evidence.

Hypotheses taken apart by when the boost started, for what is told of tracks that one sensor alone has seen.

How long clouds hid a boost leaves its start open by seconds, and how far it has flown goes with the square of the time
since: within a window over the lean (`windows`) the posterior still bends along the start, and one normal distribution
is too narrow for it. Such a hypothesis is told as three, whose starts and weights are Gauss's rule for what the fit and
the first light leave of its start. Each part is linearised where its start leads, and stands where the rest is
likeliest given that start. How much more the posterior holds there than the linear problem of the whole goes into its
weight.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.profile import fit
from opir_trackers.profile.burnout_speed import Placed
from opir_trackers.profile.end import gauss_rule
from opir_trackers.profile.family import START, Family, Priors
from opir_trackers.profile.fit import Hypotheses, Solved, plausible, within
from opir_trackers.profile.hypotheses import FitMemory
from opir_trackers.profile.start import started, starts_of

#: Starts that stand for a distribution, and places over which that is summed up, to so many standard deviations off.
_STARTS, _PLACES, _FAR = 3, 128, 6.0

#: A start known no better than this, of the time since, is told by parts: second order in it is then a fortieth of
#: first order, of errors that one sensor knows a hundred times better across its line of sight than along.
_OPEN = 0.05

#: Where the first light was another's with more than this chance, the start has a tail that three starts do not hold.
_STRAY_PARTS = 0.05

#: Where one part holds more than this, three starts lie too far apart to stand for the rest: the middle one of a normal
#: distribution holds two thirds.
_HELD = 0.9


def are_open(hypotheses: Hypotheses, tick_s: float) -> BoolArray:
    """Return of which hypotheses (n,) the start is so uncertain, beside the time since, that paths bend with it."""
    since_s = tick_s - hypotheses.anchor_s - hypotheses.parameters[:, START]
    found: BoolArray = np.sqrt(hypotheses.spread[:, START, START]) > _OPEN * since_s
    return found


class Parts(NamedTuple):
    """Hypotheses (m,) that stand for others by their starts, s (m,), from the anchors; `origin` (m,) is whose part.

    `evidence` (m,) is the logarithm of the part's weight in the evidence of the whole, over the density that the linear
    problem of the whole has for that start.
    """

    hypotheses: Hypotheses
    origin: IntArray
    start_s: FloatArray
    evidence: FloatArray

    def given(self, solution: Solved) -> Solved:
        """Return the solutions of the parts' linear problems given their starts; the evidence is the parts' own."""
        variance = solution.spread[:, START, START]
        gain = solution.spread[:, START] / variance[:, None]
        left = solution.spread - variance[:, None, None] * gain[:, :, None] * gain[:, None, :]
        # Given the start nothing is left of it: not even rounding, which may be below nothing.
        left[:, START] = left[:, :, START] = 0.0
        misfit = self.hypotheses.misfit
        return Solved(
            solution.parameters + gain * (self.start_s - solution.parameters[:, START])[:, None],
            left * misfit[:, None, None],
            self.evidence + solution.evidence + _log_density(solution, self.start_s),
            misfit,
        )


def parts_of(hypotheses: Hypotheses, solution: Solved, first_s: FloatArray, priors: Priors) -> Parts:
    """Return the parts of hypotheses (n,), of whose linear problems these are the solutions, where they have any.

    `first_s` (n,) is the first light, from the anchors; `priors` are one row a hypothesis.
    """
    grown = solution.spread[:, START, START] * solution.misfit
    starts = starts_of(solution.parameters[:, START], grown, first_s, priors.hidden_s)
    whole = np.flatnonzero(starts.stray < _STRAY_PARTS)
    node, weight = _rule(solution.parameters[whole, START], grown[whole], first_s[whole], priors.hidden_s[whole])
    origin, start_s = np.repeat(whole, _STARTS), node.ravel()
    trial, linear = hypotheses.take(origin), Solved(*(each[origin] for each in solution))
    # A rule's weights are shares of what is told, however much a poor fit tempers what evidence says.
    evidence = starts.evidence[origin] + linear.misfit * np.log(weight.ravel()) - _log_density(linear, start_s)
    # A part sets out from where its whole stands, which knows of the end of the burn too.
    gain = trial.spread[:, START] / trial.spread[:, START, START, None]
    parameters = trial.parameters + gain * (start_s - trial.parameters[:, START])[:, None]
    mine = priors.take(origin)
    parameters = within(plausible(parameters, mine), mine)
    return Parts(evolve(trial, parameters=parameters, misfit=linear.misfit), origin, start_s, evidence)


def _rule(
    mean: FloatArray, variance: FloatArray, first_s: FloatArray, hidden_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return Gauss's rule, nodes, s, and weights (n, nodes), of starts before the first light (`start`)."""
    reach = _FAR * np.sqrt(variance)
    latest = np.minimum(mean + reach, first_s)
    span = latest - np.minimum(mean, first_s) + reach
    place = latest[:, None] - span[:, None] * (np.arange(_PLACES) + 0.5) / _PLACES
    hidden = np.square(place) - np.square(first_s[:, None] - place)
    log = 0.5 * (hidden / np.square(hidden_s)[:, None] - np.square(place - mean[:, None]) / variance[:, None])
    share = np.exp(log - log.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    middle = np.sum(share * place, axis=1, keepdims=True)
    scale = np.sqrt(np.sum(share * np.square(place - middle), axis=1, keepdims=True))
    node, weight = gauss_rule((place - middle) / scale, share, _STARTS)
    return middle + scale * node, weight


def _log_density(solution: Solved, start_s: FloatArray) -> FloatArray:
    """Return the log densities (n,) that solutions have for starts."""
    variance = solution.spread[:, START, START]
    away = start_s - solution.parameters[:, START]
    log: FloatArray = -0.5 * (np.square(away) / variance + np.log(2.0 * np.pi * variance))
    return log


def parted(hypotheses: Hypotheses, parts: Hypotheses, origin: IntArray) -> Hypotheses:
    """Return hypotheses (n,) with parts (m,) of those at `origin` (m,), which come in order, in their place.

    Where parts went astray, or one of them holds nearly all, the whole stays.
    """
    evidence = np.where(np.isfinite(parts.parameters).all(axis=1), parts.evidence, np.nan).reshape(-1, _STARTS)
    shares = np.exp((evidence - evidence.max(axis=1, keepdims=True)) / parts.misfit.reshape(-1, _STARTS))
    sound = np.repeat(shares.sum(axis=1) * _HELD > 1.0, _STARTS)
    kept = np.setdiff1d(np.arange(len(hypotheses)), origin[sound])
    order = np.argsort(np.append(kept, origin[sound]), kind="stable")
    return Hypotheses.concatenate([hypotheses.take(kept), parts.take(sound)]).take(order)


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
