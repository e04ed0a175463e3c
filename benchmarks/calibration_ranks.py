"""Ranks of the truth in the reports of `imm`, on flights of its own prior, and whether they are
uniform.

Simulation-based calibration (Talts et al., arXiv:1804.06788, 2018): the truth is drawn from the
prior and observed, so its rank in the reported distribution is uniform if the tracker computes with
that prior. Each flight of `prior_flights` is a scene of its own with two SBIRS-GEO. Ranks are taken
at times since the first detection: a time that depends on the truth, as burnout does, would say
more than the tracker knows. They are the reported distribution's share below the truth; those of
states are the containment of the ellipsoid on which the truth lies, with the reported radii; those
of impacts are the smallest region that holds it, whose condition is true. P(orbit), given a missile
or an orbit, and the probability that the burn is over are compared, in bins, with the shares of
which they are true. The launch point of a launch seen at once is a mixture over launch times, of
which the moments are reported: ranks are those in the mixture, others those in a normal
distribution. The moments of the time have a figure of their own, error² / variance.
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from foreign_flights import directions, ecef
from one_flight import START_S, flight_scene, longest_track, table_target, write_table
from opir_forecast import launch_points
from opir_scoring import nees, regions_given
from opir_scoring.containments import on_normal_scale
from prior_flights import drawn_flights_of_prior
from scipy.stats import chi2, norm

import opir_core as opir
from opir_core.interfaces import TRACK_CONTAINMENTS

#: Times since the first detection, s.
MARKS_S = (30.0, 90.0, 180.0)
#: Launch points, taken at one mark, for they are kept.
LAUNCH = ("launch east", "launch north", "launch time")
LAUNCH_MARK = 1
SQUARE = "launch time, error² / variance"
STATE = "state"
IMPACT = "impact region"
ORBIT = "P(orbit)"
OVER = "P(burn over)"
#: The shares of true impacts in the 50 % region, between it and that of 90 %, and so on, and
#: outside.
CELLS = np.diff([0.0, *TRACK_CONTAINMENTS, 1.0])
#: Edges of the bins of stated probabilities.
EDGES = (0.0, 0.05, 0.2, 0.5, 0.8, 0.95, 1.0)
#: Fewer expected counts in a cell than this are too few for a χ² test.
LEAST_EXPECTED = 5.0


class Rank(NamedTuple):
    """The rank of a truth at a mark: a number in [0, 1], a cell of `CELLS`, or a probability and
    whether it is true.
    """

    mark: int
    quantity: str
    value: float
    is_true: bool = False


class Mixture(NamedTuple):
    """The mixture of one launch point: places (3, m), covariances (3, 3, m), times (m,) and
    probabilities (m,).

    Times are those of each kind of site, one after the other.
    """

    place: np.ndarray
    covariance: np.ndarray
    time_s: np.ndarray
    probability: np.ndarray

    def ranks(self, launch):
        """Return the shares east, north and later of a launch at `START_S`."""
        error = ecef(*launch)[:, None] - self.place
        east, north = (
            float(self.probability @ norm.cdf(axis @ error / self.sigma(axis)))
            for _, axis in (directions(launch, 0.5 * np.pi), directions(launch, 0.0))
        )
        edges_s = launch_points.EDGES_S
        before_s = self.time_s[0] + 0.5 * (edges_s[0] + edges_s[1]) - START_S
        bins = np.sum(self.probability.reshape(-1, len(edges_s) - 1), axis=0)
        earlier = np.interp(before_s, edges_s, np.append(0.0, np.cumsum(bins)))
        return east, north, 1.0 - float(earlier)

    def sigma(self, axis):
        """Return the standard deviations (m,) along an axis, m."""
        return np.sqrt(np.einsum("i,ijm,j->m", axis, self.covariance, axis))


def normal_ranks(track, launch):
    """Return the shares east, north and later of a launch at `START_S`, of a track whose launch
    point is normal.
    """
    latitude, longitude, launch_s = track.launch[0].tolist()
    sigma = np.sqrt(np.diag(track.launch_covariance[0]))
    error = ecef(*launch) - ecef(latitude, longitude)
    east, north = (directions(launch, azimuth)[1] @ error for azimuth in (0.5 * np.pi, 0.0))
    return tuple(norm.cdf(np.array([east, north, START_S - launch_s]) / sigma).tolist())


MOMENTS = launch_points.moment_matched
#: The mixtures of a run by their mean times.
MIXTURES = dict[float, Mixture]()


def recorded_moments(place, covariance, time_s, probability):
    """Return the moments of mixtures (n, m) as the tracker computes them, and keep the mixtures."""
    points, spread = MOMENTS(place, covariance, time_s, probability)
    shape = probability.shape
    places = place.reshape(3, *shape)
    covariances = covariance.reshape(3, 3, *shape)
    times = time_s.reshape(shape)
    for row, mean_s in enumerate(points[:, 2].tolist()):
        MIXTURES[mean_s] = Mixture(
            places[:, row], covariances[:, :, row], times[row], probability[row]
        )
    return points, spread


def ranks_of(task):
    """Return the ranks of a flight's truth at the marks."""
    flight, seed = task
    # A plume that is first seen in the instant of burnout is never seen.
    if flight.seen_s >= flight.burnout_s:
        return []
    MIXTURES.clear()
    launch_points.moment_matched = recorded_moments
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "flight.csv")
        write_table(path, flight.seen_table())
        duration_s = START_S + flight.seen_s + MARKS_S[-1] + 2.0
        longitude_deg = float(np.degrees(flight.launch[1]))
        tracker = {"model": "imm"}
        target = table_target(path, flight.kind)
        scene = flight_scene(target, longitude_deg, duration_s, seed, tracker=tracker)
        run = opir.run_of_plan(opir.compile_plan(scene))
    times_s = run.detections.time_s[run.truth.target == 0]
    track = longest_track(run.tracks)
    ranks = list[Rank]()
    for mark, since_s in enumerate(MARKS_S if len(times_s) else ()):
        rows = np.flatnonzero(track.tick_s == np.round(times_s.min() + since_s))
        if len(rows):
            ranks += ranks_at(mark, flight, track.take(rows))
    return ranks


def ranks_at(mark, flight, track):
    """Yield the ranks of all reports of a track's row."""
    time_s = float(track.tick_s[0]) - START_S
    is_over = time_s >= flight.burnout_s
    if mark == LAUNCH_MARK:
        yield from launch_ranks(flight, track)
    error = nees(track.state - flight.state(time_s), track.state_covariance)
    square = on_normal_scale(error, track.state_sigmas, 6)
    if np.isfinite(square[0]):
        yield Rank(mark, STATE, float(chi2.cdf(square[0], 6)))
    regions = track.impact_regions[0]
    inputs = regions_given(regions, is_over) if regions else []
    if inputs and flight.impact:
        ordered = sorted(inputs, key=lambda region: region.containment)
        holds = [*(region.contains(*flight.impact) for region in ordered), True]
        yield Rank(mark, IMPACT, float(holds.index(True)))
    # Gliders and unknown classes are not drawn, and failures are among the latter for the tracker.
    orbit = float(track.probability_orbit[0])
    missile = float(track.probability_missile[0])
    if orbit + missile > 0.0 and not (flight.kind == "SLV" and flight.impact):
        yield Rank(mark, ORBIT, orbit / (orbit + missile), flight.impact is None)
    burning = track.probability_burning[0] + np.nan_to_num(track.probability_relights[0])
    if np.isfinite(burning):
        yield Rank(mark, OVER, float(np.clip(1.0 - burning, 0.0, 1.0)), is_over)


def launch_ranks(flight, track):
    """Yield the ranks of a reported launch point."""
    launch_s = float(track.launch[0, 2])
    if not np.isfinite(launch_s):
        return
    nearest_s = min(MIXTURES, key=lambda mean_s: abs(mean_s - launch_s), default=np.inf)
    # Clocks change variances alone.
    is_mixture = abs(nearest_s - launch_s) < 1e-9
    ranks = (
        MIXTURES[nearest_s].ranks(flight.launch)
        if is_mixture
        else normal_ranks(track, flight.launch)
    )
    for quantity, rank in zip(LAUNCH, ranks, strict=True):
        yield Rank(LAUNCH_MARK, quantity, rank)
    variance = float(track.launch_covariance[0, 2, 2])
    yield Rank(LAUNCH_MARK, SQUARE, (START_S - launch_s) ** 2 / variance)


class Test(NamedTuple):
    """Counts, χ², its degrees of freedom and the p-value."""

    counts: np.ndarray
    chi2: float
    freedom: int
    p: float


def chi2_test(counts, expected):
    """Return the test of counts against expected ones."""
    value = float(np.sum(np.square(counts - expected) / expected))
    freedom = len(counts) - 1
    return Test(counts, value, freedom, float(chi2.sf(value, freedom)))


def values(ranks):
    """Return the values of ranks."""
    return np.array([rank.value for rank in ranks])


def uniformity(ranks):
    """Return the test of ranks in [0, 1] in at most ten equal bins."""
    bins = int(np.clip(len(ranks) // LEAST_EXPECTED, 2, 10))
    counts = np.histogram(values(ranks), np.linspace(0.0, 1.0, bins + 1))[0]
    return chi2_test(counts, np.full(bins, len(ranks) / bins))


def of_cells(ranks):
    """Return the test of impacts in the cells between regions."""
    counts = np.bincount(values(ranks).astype(int), minlength=len(CELLS)).astype(float)
    expected = len(ranks) * CELLS
    while len(expected) > 2 and expected[-1] < LEAST_EXPECTED:
        counts = np.append(counts[:-2], counts[-2:].sum())
        expected = np.append(expected[:-2], expected[-2:].sum())
    return chi2_test(counts, expected)


def of_probabilities(ranks):
    """Return the test of true events by stated probability.

    Hosmer and Lemeshow's test with stated probabilities: one degree of freedom for each bin.
    """
    stated = values(ranks)
    number = np.digitize(stated, EDGES[1:-1])
    sums = partial(np.bincount, number, minlength=len(EDGES) - 1)
    counts = sums(weights=[rank.is_true for rank in ranks])
    mean = sums(weights=stated)
    # Where less than one is expected, on either side, a count has no normal distribution: a
    # variance of 1 is on the safe side, and still shows overconfidence.
    variance = np.maximum(sums(weights=stated * (1.0 - stated)), 1.0)
    value = float(np.sum(np.square(counts - mean) / variance))
    freedom = len(np.unique(number))
    return Test(counts, value, freedom, float(chi2.sf(value, freedom)))


def of_squares(ranks):
    """Return squared errors over their variance: their sum and number, and no p, for they are not
    normal.
    """
    return Test(np.empty(0), float(values(ranks).sum()), len(ranks), np.nan)


def rank_rows(flights, seed):
    """Yield the tests of each quantity at each mark."""
    drawn = drawn_flights_of_prior(np.random.default_rng([seed, 11]), flights)
    ranks = [
        rank
        for number, flight in enumerate(drawn)
        for rank in ranks_of((flight, 100_000 * seed + number))
    ]
    tests = {SQUARE: of_squares, IMPACT: of_cells, ORBIT: of_probabilities, OVER: of_probabilities}
    for quantity in (*LAUNCH, SQUARE, STATE, IMPACT, ORBIT, OVER):
        for mark, since_s in enumerate(MARKS_S):
            part = [rank for rank in ranks if (rank.mark, rank.quantity) == (mark, quantity)]
            if part:
                test = tests.get(quantity, uniformity)(part)
                yield {
                    "quantity": quantity,
                    "since_first_detection_s": since_s,
                    "flights": len(part),
                    "p": test.p,
                    "chi2": test.chi2,
                    "degrees_of_freedom": test.freedom,
                    "counts": " ".join(f"{count:.0f}" for count in test.counts),
                }
