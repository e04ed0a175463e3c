"""Latency from ignition to the first detection: the run's pairs of sensor and target against the
closed form.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from opir_photons.detection import latency_cdf

from opir_core import Plan
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.planning import look_times_s
from opir_report.canvas import legend_above, legend_entry, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import series_hue
from opir_report.plots.signal import look_probability
from opir_report.run_facts import RunFacts

#: No first detection is later, s.
_LONGEST_S = 86_400.0


@frozen(eq=False)
class PairLatency:
    """A pair of sensor and target: the observed latency, inf without a detection, and its
    distribution.
    """

    sensor_type: str
    observed_s: float
    #: Scene times since ignition at which P_cum rises, and P_cum from then on; for a constant P_d
    #: its parameters.
    steps: tuple[FloatArray, FloatArray] | None
    shift_s: float
    period_s: float
    probability: float
    phase: str

    def cdf(self, time_s: FloatArray) -> FloatArray:
        """Return the probabilities (n,) that the latency is at most `time_s` (n,)."""
        if self.steps is None:
            phase = "aligned" if self.phase == "aligned" else "random"
            return latency_cdf(time_s - self.shift_s, self.period_s, self.probability, phase)  # type: ignore[arg-type]
        step_s, values = self.steps
        return np.append(0.0, values)[np.searchsorted(step_s, time_s, side="right")]


def _looking_pairs(facts: RunFacts) -> IntArray:
    """Return the pairs of launches that have looks."""
    pairs = facts.plan.pairs
    return np.flatnonzero((pairs.target < facts.launches) & (pairs.looks > 0))


def pair_latencies(facts: RunFacts) -> list[PairLatency]:
    """Return the pairs of launches and sensors that see them from ignition on.

    A pair counts if its first look falls into the first period after the light of the ignition
    arrives, and sees. Of sensors that confirm detections over scans, the latency is that of the
    first confirmed one.
    """
    rows = _looking_pairs(facts)
    if not len(rows):
        return []
    plan = facts.plan
    light_s, is_seen = _first_looks(plan, rows)
    latency_s = _first_detections(facts)
    return [
        _latency(plan, pair, light, latency_s)
        for pair, light in zip(rows[is_seen].tolist(), light_s[is_seen].tolist(), strict=True)
    ]


def _first_looks(plan: Plan, rows: IntArray) -> tuple[FloatArray, BoolArray]:
    """Return the times (n,) of the light to pairs, s, and which see the ignition at once."""
    pairs = plan.pairs
    geometry = plan.look_geometry()
    exposures = geometry.exposures(rows, pairs.first_scan[rows])
    light_s = exposures.range_m / SPEED_OF_LIGHT_M_S * plan.scene.light_time
    since_s = exposures.time_s - plan.targets.ignition_s[pairs.target[rows]]
    period_s = pairs.period_ns[rows] * 1e-9
    is_soon = since_s <= light_s + period_s
    return light_s, is_soon & geometry.visible(rows, pairs.first_scan[rows])


def _latency(
    plan: Plan, pair: int, light_s: float, latency_s: dict[tuple[int, int], float]
) -> PairLatency:
    """Return the latency of a pair, from those of all sensors and launches with a detection."""
    sensor_row = plan.pairs.sensor[[pair]]
    target_row = plan.pairs.target[[pair]]
    sensor = plan.sensors[sensor_row[0]]
    phase = sensor.settings.get("scan_phase", "random")
    probability = plan.detection.pair_probability(sensor_row, target_row)
    return PairLatency(
        sensor_type=sensor.type,
        observed_s=latency_s.get((int(sensor_row[0]), int(target_row[0])), np.inf),
        steps=_steps(plan, pair) if probability is None else None,
        # Aligned scans are at whole periods of scene time, whenever the light arrives before.
        shift_s=0.0 if phase == "aligned" else light_s,
        period_s=plan.pairs.period_ns[pair] * 1e-9,
        probability=np.nan if probability is None else float(probability[0]),
        phase=phase,
    )


def _steps(plan: Plan, pair: int) -> tuple[FloatArray, FloatArray]:
    """Return the times of a pair's first 400 looks since ignition, and P_cum after each of these
    independent looks.
    """
    scan = np.arange(plan.pairs.first_scan[pair], plan.pairs.last_scan[pair] + 1)[:400]
    rows = np.full(len(scan), pair, dtype=np.int64)
    geometry = plan.look_geometry()
    probability = look_probability(plan, rows, geometry.exposures(rows, scan))
    time_s = look_times_s(plan.pairs, rows, scan)
    since_s: FloatArray = time_s - plan.targets.ignition_s[plan.pairs.target[pair]]
    probability = probability * geometry.visible(rows, scan)
    confirmation = plan.detection.confirmation
    if confirmation is None:
        return since_s, confirmed_by(probability, 1, 1)
    return since_s, confirmed_by(probability, *confirmation[plan.pairs.sensor[pair]].tolist())


def confirmed_by(probability: FloatArray, needed: int, looks: int) -> FloatArray:
    """Return the probabilities (n,) that M of N successive looks have detected by each of n
    independent looks.

    `probability` (n,) is P_d of each look, `needed` is M and `looks` is N. A Markov chain over
    which of the last N - 1 looks detected; M of N is absorbing.
    """
    states = np.arange(1 << (looks - 1))
    hits = np.array([int(state).bit_count() for state in states.tolist()])
    is_enough = hits + 1 >= needed
    after_miss = (states << 1) & (len(states) - 1)
    after_hit = after_miss | (1 if looks > 1 else 0)
    share = np.where(states == 0, 1.0, 0.0)
    confirmed = 0.0
    result = np.empty(len(probability))
    for look, hit_probability in enumerate(probability.tolist()):
        hit_share = hit_probability * share
        next_share = np.zeros(len(states))
        confirmed += float(hit_share[is_enough].sum())
        np.add.at(next_share, after_miss, share - hit_share)
        np.add.at(next_share, after_hit[~is_enough], hit_share[~is_enough])
        share = next_share
        result[look] = confirmed
    return result


def _first_detections(facts: RunFacts) -> dict[tuple[int, int], float]:
    """Return the latency of each sensor and launch with a detection."""
    run = facts.run
    rows = np.argsort(run.detections.time_ns, kind="stable")[::-1]
    rows = rows[(run.truth.target[rows] >= 0) & (run.truth.target[rows] < facts.launches)]
    target = run.truth.target[rows]
    since_s = run.detections.time_s[rows] - facts.plan.targets.ignition_s[target]
    keys = zip(run.detections.sensor[rows].tolist(), target.tolist(), strict=True)
    return dict(zip(keys, since_s.tolist(), strict=True))


def latency_curves(pairs: Sequence[PairLatency]) -> FigureData:
    """Return the distributions by sensor type: series (`run` or `closed form`), sensor_type,
    latency_s, probability.

    `run` is the share of pairs with a detection after at most that time; the closed form is the
    mean over the same pairs.
    """
    names = dict.fromkeys(pair.sensor_type for pair in pairs)
    return FigureData.of_rows(
        ("series", "sensor_type", "latency_s", "probability"),
        (row for name in names for row in _curve(name, pairs)),
    )


def _curve(name: str, pairs: Sequence[PairLatency]) -> Iterator[tuple[str, str, float, float]]:
    """Yield the two curves of a sensor type."""
    pairs = [pair for pair in pairs if pair.sensor_type == name]
    for rank, latency_s in enumerate(sorted(pair.observed_s for pair in pairs), start=1):
        if latency_s < np.inf:
            yield "run", name, float(latency_s), rank / len(pairs)
    time_s = np.linspace(0.0, _reach_s(pairs), 201)
    for latency_s, probability in zip(
        time_s.tolist(), _mean_cdf(pairs, time_s).tolist(), strict=True
    ):
        yield "closed form", name, latency_s, probability


def _reach_s(pairs: Sequence[PairLatency]) -> float:
    """Return a time by which nearly all of the pairs' first detections are due, and all that were
    observed are over, with a margin of 15 %.
    """
    observed_s = [pair.observed_s for pair in pairs if pair.observed_s < np.inf]
    reach_s = max([pair.shift_s + 2.0 * pair.period_s for pair in pairs] + observed_s)
    share = 0.999 * _mean_cdf(pairs, np.array([_LONGEST_S]))[0]
    while _mean_cdf(pairs, np.array([reach_s]))[0] < share and reach_s < _LONGEST_S:
        reach_s *= 1.5
    return 1.15 * reach_s


def _mean_cdf(pairs: Sequence[PairLatency], time_s: FloatArray) -> FloatArray:
    mean: FloatArray = np.mean([pair.cdf(time_s) for pair in pairs], axis=0)
    return mean


def latency_plot(
    axes: Axes, facts: RunFacts, pairs: Sequence[PairLatency], data: FigureData
) -> Axes:
    """Draw, for each sensor type, the share of pairs that have detected, and dashed the closed
    form.
    """
    if not pairs:
        return without_data(axes, "no sensor sees a launch from ignition on")
    marks = []
    for number, name in enumerate(data.levels("sensor_type")):
        colour = series_hue(number, name).colour
        detected = _draw_curves(axes, data.at("sensor_type", name), colour)
        total = sum(pair.sensor_type == name for pair in pairs)
        marks.append(legend_entry(f"{name}: {detected} of {total} pairs detected", colour))
    marks.append(legend_entry("closed form", linestyle="--"))
    axes.set(
        xlabel="latency from ignition to the first detection, s",
        ylabel="share of pairs",
        ylim=(-0.03, 1.03),
    )
    axes.set_xlim(left=0.0)
    omitted = len(_looking_pairs(facts)) - len(pairs)
    omission = f"; in view only later, left out: {omitted}" if omitted else ""
    axes.set_title(f"{len(pairs)} pairs of sensor and launch{omission}")
    legend_above(axes, marks)
    return axes


def _draw_curves(axes: Axes, curves: FigureData, colour: str) -> int:
    """Draw the curves of a sensor type; return the number of pairs that have detected."""
    closed_form = curves.at("series", "closed form")
    run = curves.at("series", "run")
    axes.plot(
        closed_form["latency_s"],
        closed_form["probability"],
        color=colour,
        linestyle="--",
        linewidth=1.2,
    )
    edges_s = np.concatenate([[0.0], run["latency_s"], [closed_form["latency_s"].max()]])
    shares = np.append(0.0, run["probability"])
    axes.stairs(shares, edges_s, color=colour, linewidth=1.8, baseline=None)
    return len(run)
