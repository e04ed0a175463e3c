"""Latency from ignition to the first detection: the run's pairs of sensor and target against the
closed form.
"""

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from opir_photons.detection import latency_cdf

from opir_core import Plan
from opir_core.arrays import FloatArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.planning import look_times_s
from opir_report.canvas import legend_above, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, series_hue
from opir_report.plots.signal import look_probability
from opir_report.run_facts import RunFacts

#: Looks of a pair whose P_d varies that are evaluated, and points of a curve.
_LOOKS = 400
_POINTS = 201
#: The distribution is drawn up to this share of pairs, plus a margin.
_TAIL = 0.999
_MARGIN = 1.15
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
        at, values = self.steps
        return np.append(0.0, values)[np.searchsorted(at, time_s, side="right")]


def pair_latencies(facts: RunFacts) -> list[PairLatency]:
    """Return the pairs of launches and sensors that see them from ignition on.

    A pair counts if its first look falls into the first period after the light of the ignition
    arrives, and sees. Of sensors that confirm detections over scans, the latency is that of the
    first confirmed one.
    """
    plan = facts.plan
    pairs = plan.pairs
    own = np.flatnonzero((pairs.target < facts.launches) & (pairs.looks > 0))
    if not len(own):
        return []
    geometry = plan.look_geometry()
    exposures = geometry.exposures(own, pairs.first_scan[own])
    shift_s = (
        exposures.range_m / SPEED_OF_LIGHT_M_S if plan.scene.light_time else np.zeros(len(own))
    )
    since_s = exposures.time_s - plan.targets.ignition_s[pairs.target[own]]
    period_s = pairs.period_ns[own] * 1e-9
    early = (since_s <= shift_s + period_s) & geometry.visible(own, pairs.first_scan[own])
    observed = _first_detections(facts)
    constant = plan.detection.pair_probability(pairs.sensor[own], pairs.target[own])
    found = []
    for place in np.flatnonzero(early).tolist():
        pair = int(own[place])
        sensor = plan.sensors[pairs.sensor[pair]]
        found.append(
            PairLatency(
                sensor_type=sensor.type,
                observed_s=observed.get((int(pairs.sensor[pair]), int(pairs.target[pair])), np.inf),
                steps=_steps(plan, pair) if constant is None else None,
                # Aligned scans are at whole periods of scene time, whenever the light arrives
                # before.
                shift_s=0.0
                if sensor.settings.get("scan_phase") == "aligned"
                else float(shift_s[place]),
                period_s=float(period_s[place]),
                probability=np.nan if constant is None else float(constant[place]),
                phase=str(sensor.settings.get("scan_phase", "random")),
            )
        )
    return found


def _steps(plan: Plan, pair: int) -> tuple[FloatArray, FloatArray]:
    """Return the times of a pair's first looks since ignition, and P_cum after each of these
    independent looks.
    """
    first = int(plan.pairs.first_scan[pair])
    last = int(plan.pairs.last_scan[pair])
    scan = np.arange(first, min(last, first + _LOOKS - 1) + 1)
    rows = np.full(len(scan), pair, dtype=np.int64)
    geometry = plan.look_geometry()
    chance = look_probability(plan, rows, geometry.exposures(rows, scan)) * geometry.visible(
        rows, scan
    )
    since_s: FloatArray = (
        look_times_s(plan.pairs, rows, scan) - plan.targets.ignition_s[plan.pairs.target[pair]]
    )
    needed = 1
    among = 1
    if plan.detection.confirmation is not None:
        needed, among = plan.detection.confirmation[plan.pairs.sensor[pair]].tolist()
    return since_s, confirmed_by(chance, needed, among)


def confirmed_by(chance: FloatArray, needed: int, among: int) -> FloatArray:
    """Return the probabilities (n,) that M of N successive looks have detected by each of n
    independent looks.

    `chance` (n,) are the probabilities of the looks, `needed` is M and `among` is N. A Markov chain
    over which of the last N - 1 looks detected; M of N is absorbing.
    """
    states = np.arange(1 << (among - 1))
    held = np.array([int(state).bit_count() for state in states.tolist()])
    after_miss = (states << 1) & (len(states) - 1)
    after_hit = after_miss | (1 if among > 1 else 0)
    share = np.where(states == 0, 1.0, 0.0)
    done = 0.0
    result = np.empty(len(chance))
    for look, each in enumerate(chance.tolist()):
        hits = each * share
        following = np.zeros(len(states))
        is_enough = held + 1 >= needed
        done += float(hits[is_enough].sum())
        np.add.at(following, after_miss, share - hits)
        np.add.at(following, after_hit[~is_enough], hits[~is_enough])
        share = following
        result[look] = done
    return result


def _first_detections(facts: RunFacts) -> dict[tuple[int, int], float]:
    """Return the latency of each sensor and launch with a detection."""
    run = facts.run
    order = np.argsort(run.detections.time_ns, kind="stable")[::-1]
    target = run.truth.target[order]
    keep = (target >= 0) & (target < facts.launches)
    sensor = run.detections.sensor[order][keep]
    target = target[keep]
    since_s = run.detections.time_s[order][keep] - facts.plan.targets.ignition_s[target]
    return dict(
        zip(zip(sensor.tolist(), target.tolist(), strict=True), since_s.tolist(), strict=True)
    )


def latency_curves(pairs: list[PairLatency]) -> FigureData:
    """Return the distributions by sensor type: series (`run` or `closed form`), sensor_type,
    latency_s, probability.

    `run` is the share of pairs with a detection after at most that time; the closed form is the
    mean over the same pairs.
    """
    rows: list[tuple[str, str, float, float]] = []
    for name in dict.fromkeys(pair.sensor_type for pair in pairs):
        own = [pair for pair in pairs if pair.sensor_type == name]
        observed = np.sort([pair.observed_s for pair in own])
        rows += [
            ("run", name, each, (rank + 1) / len(own))
            for rank, each in enumerate(observed.tolist())
            if each < np.inf
        ]
        time_s = np.linspace(0.0, _reach_s(own), _POINTS)
        mean = np.mean([pair.cdf(time_s) for pair in own], axis=0)
        rows += [
            ("closed form", name, *both)
            for both in zip(time_s.tolist(), mean.tolist(), strict=True)
        ]
    return FigureData.of_rows(("series", "sensor_type", "latency_s", "probability"), rows)


def _reach_s(pairs: list[PairLatency]) -> float:
    """Return a time by which nearly all of the pairs' first detections are due, and all that were
    observed are over.
    """
    seen = [pair.observed_s for pair in pairs if pair.observed_s < np.inf]
    reach_s = max([pair.shift_s + 2.0 * pair.period_s for pair in pairs] + seen)
    ever = _mean_cdf(pairs, _LONGEST_S)
    while _mean_cdf(pairs, reach_s) < _TAIL * ever and reach_s < _LONGEST_S:
        reach_s *= 1.5
    return _MARGIN * reach_s


def _mean_cdf(pairs: list[PairLatency], time_s: float) -> float:
    return float(np.mean([pair.cdf(np.array([time_s]))[0] for pair in pairs]))


def latency_plot(axes: Axes, facts: RunFacts, pairs: list[PairLatency], data: FigureData) -> Axes:
    """Draw, for each sensor type, the share of pairs that have detected, and dashed the closed
    form.
    """
    if not pairs:
        return without_data(axes, "no sensor sees a launch from ignition on")
    marks = []
    for number, name in enumerate(dict.fromkeys(data["sensor_type"].tolist())):
        hue = series_hue(number, name)
        own = data.where(data["sensor_type"] == name)
        curve = own.where(own["series"] == "closed form")
        seen = own.where(own["series"] == "run")
        axes.plot(
            curve["latency_s"],
            curve["probability"],
            color=hue.colour,
            linestyle="--",
            linewidth=1.2,
        )
        total = sum(pair.sensor_type == name for pair in pairs)
        edge = float(curve["latency_s"].max())
        steps_s = np.append(seen["latency_s"], edge)
        shares = np.append(0.0, seen["probability"])
        axes.stairs(shares, np.append(0.0, steps_s), color=hue.colour, linewidth=1.8, baseline=None)
        marks.append(
            Line2D([], [], color=hue.colour, label=f"{name}: {len(seen)} of {total} pairs detected")
        )
    marks.append(Line2D([], [], color=INK, linestyle="--", label="closed form"))
    axes.set(
        xlabel="latency from ignition to the first detection, s",
        ylabel="share of pairs",
        ylim=(-0.03, 1.03),
    )
    axes.set_xlim(left=0.0)
    omitted = int(
        np.count_nonzero((facts.plan.pairs.target < facts.launches) & (facts.plan.pairs.looks > 0))
    ) - len(pairs)
    later = f"; in view only later, left out: {omitted}" if omitted else ""
    axes.set_title(f"{len(pairs)} pairs of sensor and launch{later}")
    legend_above(axes, marks)
    return axes
