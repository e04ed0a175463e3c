"""Is what `imm` reports calibrated on flights of its own prior? Ranks of the truth, and whether
they are uniform.

    python benchmarks/simulation_calibration.py [--flights 150] [--seed 1] [--processes 2] [--write
    docs/benchmarks]

Simulation-based calibration (Talts et al., arXiv:1804.06788, 2018): the truth is drawn from the
prior and observed, so its rank in the reported distribution is uniform if the tracker computes with
that prior. Each flight of `prior_flights` is a scene of its own with two SBIRS-GEO. Ranks are taken
at times since the first detection, for a time that depends on the truth, as burnout does, would say
more than the tracker knows. They are the reported distribution's share below the truth; those of
states are the containment of the ellipsoid on which the truth lies, with the reported radii; those
of impacts are the smallest region that holds it, whose condition is true. P(orbit), given that it
is a missile or reaches orbit, and the probability that the burn is over are compared, in bins, with
the shares of which they are true. The launch point of what is seen at once is a mixture over launch
times, of which the moments are reported: ranks are those in the mixture, others those in a normal
distribution. The moments of the time have a figure of their own, error² / variance.
"""

import argparse
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from foreign_flights import directions, ecef
from opir_scoring import nees, regions_given
from opir_scoring.containments import on_normal_scale
from opir_trackers import launch_points
from prior_flights import PriorFlight, drawn_flights_of_prior
from result_files import write_csv
from scipy.stats import chi2, norm
from simulation_calibration_page import write_page

import opir_core as opir
from opir_core.interfaces import TRACK_CONTAINMENTS

EPOCH = "2026-04-01T18:00:00Z"
START_S = 10.0
#: Times since the first detection, s.
MARKS_S = (30.0, 90.0, 180.0)
#: Time within which a burn is detected, and between forecasts: half as many as by default, s.
LATEST_S = 2.0
REGIONS_EVERY_S = 10.0
#: Quantities whose ranks are uniform numbers, taken at one mark, for they are kept; what their
#: moments say of the time; one whose ranks are cells, and probabilities.
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
BINS = 10
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
    when: np.ndarray
    chance: np.ndarray

    def ranks(self, launch: tuple[float, float]) -> tuple[float, float, float]:
        """Return the shares east, north and later of a launch at `START_S`."""
        apart = ecef(*launch)[:, None] - self.place
        sides = [
            float(
                norm.cdf(
                    axis @ apart / np.sqrt(np.einsum("i,ijm,j->m", axis, self.covariance, axis))
                )
                @ self.chance
            )
            for _, axis in (directions(launch, 0.5 * np.pi), directions(launch, 0.0))
        ]
        edges_s = launch_points.EDGES_S
        before_s = self.when[0] + 0.5 * (edges_s[0] + edges_s[1]) - START_S
        at_times = np.sum(self.chance.reshape(-1, len(edges_s) - 1), axis=0)
        return (
            *sides,
            1.0 - float(np.interp(before_s, edges_s, np.append(0.0, np.cumsum(at_times)))),
        )


def normal_ranks(track: opir.Tracks, launch: tuple[float, float]) -> tuple[float, float, float]:
    """Return the shares east, north and later of a launch at `START_S`, of a track whose launch
    point is normal.
    """
    (latitude, longitude, launch_s), spread = (
        track.launch[0],
        np.sqrt(np.diag(track.launch_covariance[0])),
    )
    apart = ecef(*launch) - ecef(latitude, longitude)
    east, north = (directions(launch, azimuth)[1] @ apart for azimuth in (0.5 * np.pi, 0.0))
    return tuple(norm.cdf(np.array([east, north, START_S - launch_s]) / spread).tolist())


#: Times of the same launch point differ by less than this, s: clocks change variances alone.
SAME_S = 1e-9

MOMENTS = launch_points.moment_matched
#: The mixtures of a run by their mean times.
MIXTURES = dict[float, Mixture]()


def recorded_moments(
    place: np.ndarray, covariance: np.ndarray, when: np.ndarray, chance: np.ndarray
) -> Any:
    """Return the moments of mixtures (n, m) as the tracker works them out, and keep the
    mixtures.
    """
    points, spread = MOMENTS(place, covariance, when, chance)
    own = (
        place.reshape(3, *chance.shape),
        covariance.reshape(3, 3, *chance.shape),
        when.reshape(chance.shape),
    )
    for row, mean_s in enumerate(points[:, 2].tolist()):
        MIXTURES[mean_s] = Mixture(own[0][:, row], own[1][:, :, row], own[2][row], chance[row])
    return points, spread


def scene_of(flight: PriorFlight, path: Path, seed: int) -> opir.Scene:
    """Return the scene of a flight, its table written to a file."""
    flight.write(path)
    longitude = float(np.degrees(flight.launch[1]))
    slots = [(longitude + shift + 540.0) % 360.0 - 180.0 for shift in (-35.0, 30.0)]
    return opir.scene_from_mapping(
        {
            "scene": "calibration",
            "epoch": EPOCH,
            "duration_s": float(np.ceil(START_S + flight.seen_s + MARKS_S[-1] + LATEST_S)),
            "seed": seed,
            "sensors": [
                {"model": "SBIRS-GEO", "id": f"S{slot:.2f}", "orbital_slot_deg": slot}
                for slot in slots
            ],
            "targets": [
                {
                    "id": "T",
                    "model": "table",
                    "type": flight.kind,
                    "file": str(path),
                    "start_s": START_S,
                }
            ],
            "tracker": {"model": "imm", "regions_every_s": REGIONS_EVERY_S},
        }
    )


def ranks_of(task: tuple[PriorFlight, int]) -> list[Rank]:
    """Return the ranks of a flight's truth at the marks."""
    flight, seed = task
    # A plume that is first seen in the instant of burnout is never seen.
    if flight.seen_s >= flight.burnout_s:
        return []
    MIXTURES.clear()
    launch_points.moment_matched = recorded_moments
    with tempfile.TemporaryDirectory() as folder:
        run = opir.run_of_plan(
            opir.compile_plan(scene_of(flight, Path(folder, "flight.csv"), seed))
        )
    tracks = run.tracks
    seen = run.truth.target == 0
    number, count = np.unique(tracks.track, return_counts=True)
    found = list[Rank]()
    for mark, since_s in enumerate(MARKS_S if seen.any() else ()):
        here = np.flatnonzero(
            tracks.tick_s == np.round(run.detections.time_s[seen].min() + since_s)
        )
        if len(here):
            # The oldest track: false ones are short.
            row = int(here[np.argmax(count[np.searchsorted(number, tracks.track[here])])])
            found += _ranks_at(mark, flight, tracks.take(np.array([row])))
    return found


def _ranks_at(mark: int, flight: PriorFlight, track: opir.Tracks) -> Iterator[Rank]:
    """Yield the ranks of what a track reports; of nothing that it does not."""
    launch_s = float(track.launch[0, 2])
    if mark == LAUNCH_MARK and np.isfinite(launch_s):
        nearest_s = min(MIXTURES, key=lambda mean_s: abs(mean_s - launch_s))
        is_mixture = abs(nearest_s - launch_s) < SAME_S
        ranks = (
            MIXTURES[nearest_s].ranks(flight.launch)
            if is_mixture
            else normal_ranks(track, flight.launch)
        )
        yield from (Rank(mark, *one) for one in zip(LAUNCH, ranks, strict=True))
        yield Rank(
            mark, SQUARE, (START_S - launch_s) ** 2 / float(track.launch_covariance[0, 2, 2])
        )
    square = on_normal_scale(
        nees(track.state - flight.state(float(track.tick_s[0]) - START_S), track.state_covariance),
        track.state_sigmas,
        6,
    )
    if np.isfinite(square[0]):
        yield Rank(mark, STATE, float(chi2.cdf(square[0], 6)))
    regions = track.impact_regions[0]
    is_over = float(track.tick_s[0]) >= START_S + flight.burnout_s
    given = regions_given(regions, is_over) if regions else []
    if given and flight.impact:
        holds = [
            region.contains(*flight.impact)
            for region in sorted(given, key=lambda each: each.containment)
        ]
        yield Rank(
            mark, IMPACT, float(holds.index(True) if any(holds) else len(TRACK_CONTAINMENTS))
        )
    # Neither gliders nor what is none of these is drawn, and failures are among the latter for the
    # tracker.
    orbit = float(track.probability_orbit[0])
    missile = float(track.probability_missile[0])
    if orbit + missile > 0.0 and not (flight.kind == "SLV" and flight.impact):
        yield Rank(mark, ORBIT, orbit / (orbit + missile), flight.impact is None)
    over = float(1.0 - track.probability_burning[0] - np.nan_to_num(track.probability_relights[0]))
    if np.isfinite(over):
        yield Rank(mark, OVER, float(np.clip(over, 0.0, 1.0)), is_over)


def uniformity(ranks: list[Rank]) -> tuple[np.ndarray, float, int, float]:
    """Return the counts of ranks in [0, 1] in equal bins, χ², its degrees of freedom and the
    p-value.
    """
    bins = int(np.clip(len(ranks) // LEAST_EXPECTED, 2, BINS))
    count = np.histogram([rank.value for rank in ranks], np.linspace(0.0, 1.0, bins + 1))[0]
    return count, *_test(count, np.full(bins, len(ranks) / bins), bins - 1)


def of_cells(ranks: list[Rank]) -> tuple[np.ndarray, float, int, float]:
    """Return the counts of impacts in the cells between regions, χ², its degrees of freedom and the
    p-value.
    """
    count = np.bincount([int(rank.value) for rank in ranks], minlength=len(CELLS)).astype(float)
    expected = len(ranks) * CELLS
    while len(expected) > 2 and expected[-1] < LEAST_EXPECTED:
        count, expected = (np.append(each[:-2], each[-2:].sum()) for each in (count, expected))
    return count, *_test(count, expected, len(expected) - 1)


def of_probabilities(ranks: list[Rank]) -> tuple[np.ndarray, float, int, float]:
    """Return the counts of what is true by stated probability, χ², its degrees of freedom and the
    p-value.

    Hosmer and Lemeshow's test with stated probabilities: one degree of freedom for each bin.
    """
    stated = np.array([rank.value for rank in ranks])
    is_true = np.array([rank.is_true for rank in ranks])
    number = np.digitize(stated, EDGES[1:-1])
    count, mean, spread = (
        np.bincount(number, weight, len(EDGES) - 1)
        for weight in (is_true, stated, stated * (1.0 - stated))
    )
    # Where less than one is expected, on either side, a count has no normal distribution: a
    # variance of 1 is on the safe side, and still shows what is stated too surely.
    value = float(np.sum(np.square(count - mean) / np.maximum(spread, 1.0)))
    freedom = len(np.unique(number))
    return count, value, freedom, float(chi2.sf(value, freedom))


def of_squares(ranks: list[Rank]) -> tuple[np.ndarray, float, int, float]:
    """Return squared errors over their variance: no counts, their sum and number, and no p, for
    they are not normal.
    """
    return np.empty(0), float(sum(rank.value for rank in ranks)), len(ranks), np.nan


def _test(count: np.ndarray, expected: np.ndarray, freedom: int) -> tuple[float, int, float]:
    value = float(np.sum(np.square(count - expected) / expected))
    return value, freedom, float(chi2.sf(value, freedom))


def rows_of(ranks: list[Rank]) -> Iterator[dict[str, str]]:
    """Yield the rows of the table: each quantity at each mark."""
    tests: dict[str, Any] = {
        SQUARE: of_squares,
        IMPACT: of_cells,
        ORBIT: of_probabilities,
        OVER: of_probabilities,
    }
    for quantity in (*LAUNCH, SQUARE, STATE, IMPACT, ORBIT, OVER):
        for mark, since_s in enumerate(MARKS_S):
            own = [rank for rank in ranks if rank.mark == mark and rank.quantity == quantity]
            if own:
                count, value, freedom, p_value = tests.get(quantity, uniformity)(own)
                yield {
                    "quantity": quantity,
                    "since_first_detection_s": f"{since_s:g}",
                    "flights": str(len(own)),
                    "p": f"{p_value:.2g}" if np.isfinite(p_value) else "",
                    "chi2": f"{value:.1f}",
                    "degrees_of_freedom": str(freedom),
                    "counts": " ".join(f"{each:.0f}" for each in count),
                }


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--write", type=Path, help="folder of the CSV and the page")
    options = parser.parse_args()
    flights = drawn_flights_of_prior(np.random.default_rng([options.seed, 11]), options.flights)
    tasks = [(flight, 100_000 * options.seed + number) for number, flight in enumerate(flights)]
    if options.processes > 1:
        with ProcessPoolExecutor(options.processes) as pool:
            found = list(pool.map(ranks_of, tasks, chunksize=4))
    else:
        found = list(map(ranks_of, tasks))
    rows = list(rows_of([rank for each in found for rank in each]))
    print("\n".join(",".join(row.values()) for row in rows))
    if options.write:
        write_csv(options.write / "simulation_calibration.csv", rows)
        write_page(options.write)


if __name__ == "__main__":
    main()
