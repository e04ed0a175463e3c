"""Metrics of directed sensors: custody of launches, cues, hand-overs, and the looks of narrow fields
that they cost.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import rows_in_force

from opir_core import Run
from opir_core.arrays import FloatArray, IntArray
from opir_core.planning import ModeSpan, mode_spans, whole_flights
from opir_core.plugin import MetricContext, NoConfig
from opir_studies.configs import CustodyConfig, HandOverConfig
from opir_studies.metrics.detection_metrics import mean_of_known, share_of_known
from opir_studies.metrics.track_metrics import first_tracked_s, run_evidence


@frozen
class CustodyMetric:
    """The share of the time from ignition to impact, or to the scene's end, in which a launch has a
    track.

    An estimate counts for one step of the tracker if its position is within `within_m` of the
    truth. A launch without a track has a custody of 0.
    """

    within_m: float
    units: ClassVar[Mapping[str, str]] = {"custody": ""}
    launch_units: ClassVar[Mapping[str, str]] = {"custody": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the mean over the launches that ignite; nan without one."""
        return {"custody": mean_of_known(self.launches(run)["custody"])}

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the custody of each launch; nan for one that does not ignite in the scene."""
        flights = whole_flights(run.plan)
        flight_s = np.minimum(flights.end_s, run.plan.scene.duration_s) - flights.ignition_s
        evidence, owners = run_evidence(run)
        estimates = evidence.tracks.take(rows_in_force(evidence, owners))
        target = owners.target[np.searchsorted(owners.track, estimates.track)]
        is_flying = estimates.tick_s >= flights.ignition_s[target]
        is_flying &= estimates.tick_s <= flights.end_s[target]
        rows = np.flatnonzero(is_flying & np.isfinite(estimates.state[:, 0]))
        true_m = flights.position_ecef_m(target[rows].astype(np.int32), estimates.tick_s[rows])
        error_m = np.linalg.norm(estimates.state[rows, :3] - true_m, axis=1)
        held = target[rows[error_m <= self.within_m]]
        held_s = np.bincount(held, minlength=len(flight_s)) * (
            run.plan.make_tracker().cadence_s or 0.0
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            return {"custody": np.where(flight_s > 0.0, np.minimum(held_s / flight_s, 1.0), np.nan)}


def custody_metric(config: CustodyConfig, _context: MetricContext) -> CustodyMetric:
    """Return the metric `custody`."""
    return CustodyMetric(np.inf if config.within_km is None else config.within_km * 1e3)


@frozen
class CueDelayMetric:
    """From the first available estimate of a launch to its first detection by a narrow field, 0 s
    for a field that detected it before.
    """

    shares: ClassVar[Mapping[str, str]] = {"cue_delay_s": "cued"}
    units: ClassVar[Mapping[str, str]] = {"cue_delay_s": "s", "cued": ""}
    launch_units: ClassVar[Mapping[str, str]] = {"cue_delay_s": "s"}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the mean over launches with a track and such a detection, and their share."""
        delay_s = self.launches(run)["cue_delay_s"]
        return {
            "cue_delay_s": mean_of_known(delay_s),
            "cued": share_of_known(delay_s, len(delay_s)),
        }

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the delay of each launch, inf without a track or such a detection."""
        tracked_s = first_tracked_s(run)
        seen_s = np.full_like(tracked_s, np.inf)
        rows = _narrow_rows(run)
        np.minimum.at(seen_s, run.truth.target[rows], run.detections.time_s[rows])
        delay_s = np.full_like(tracked_s, np.inf)
        np.subtract(seen_s, tracked_s, out=delay_s, where=np.isfinite(tracked_s))
        return {"cue_delay_s": np.maximum(delay_s, 0.0)}


def cue_delay_metric(_config: NoConfig, _context: MetricContext) -> CueDelayMetric:
    """Return the metric `cue_delay`."""
    return CueDelayMetric()


@frozen
class HandOverGapMetric:
    """Hand-overs: a narrow field loses a launch, and another one has it already, or has it next.

    The gap is the time between their detections, 0 s where they overlap.
    """

    lost_after_s: float
    shares: ClassVar[Mapping[str, str]] = {"hand_over_gap_s": "handed_over"}
    units: ClassVar[Mapping[str, str]] = {
        "hand_over_gap_s": "s",
        "handed_over": "",
        "hand_overs": "",
    }
    launch_units: ClassVar[Mapping[str, str]] = {"hand_over_gap_s": "s"}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the mean of the launches' longest gaps, the share of launches that are handed over,
        and the number of hand-overs a launch.
        """
        gaps_s = self._gaps_s(run)
        longest_s = _longest_s(gaps_s)
        counts = np.array([len(of_launch) for of_launch in gaps_s], dtype=np.float64)
        return {
            "hand_over_gap_s": mean_of_known(longest_s),
            "handed_over": share_of_known(longest_s, len(longest_s)),
            "hand_overs": mean_of_known(counts),
        }

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the longest gap of each launch; nan without a hand-over."""
        return {"hand_over_gap_s": _longest_s(self._gaps_s(run))}

    def _gaps_s(self, run: Run) -> list[list[float]]:
        """Return the gaps of each launch."""
        rows = _narrow_rows(run)
        target = run.truth.target[rows]
        return [
            hand_over_gaps_s(
                run.detections.time_s[rows[target == launch]],
                run.detections.sensor[rows[target == launch]],
                self.lost_after_s,
            )
            for launch in range(len(run.plan.scene.targets))
        ]


def hand_over_gap_metric(config: HandOverConfig, _context: MetricContext) -> HandOverGapMetric:
    """Return the metric `hand_over_gap`."""
    return HandOverGapMetric(config.lost_after_s)


def hand_over_gaps_s(time_s: FloatArray, sensor: IntArray, lost_after_s: float) -> list[float]:
    """Return the gaps, s, between the spans in which sensors (n,) detect a target at times (n,).

    A span of a sensor ends where it detects nothing for longer than `lost_after_s`.
    """
    spans = sorted(
        (float(span[0]), float(span[-1]), number)
        for number in np.unique(sensor).tolist()
        for span in _spans(np.sort(time_s[sensor == number]), lost_after_s)
    )
    gaps_s = []
    until_s = np.inf
    holder = -1
    for start_s, end_s, number in spans:
        if holder < 0 or end_s > until_s:
            if holder not in (-1, number):
                gaps_s.append(max(start_s - until_s, 0.0))
            until_s = end_s
            holder = number
    return gaps_s


def _spans(time_s: FloatArray, lost_after_s: float) -> list[FloatArray]:
    """Return increasing times (n,), split where they are further apart than `lost_after_s`."""
    return np.split(time_s, np.flatnonzero(np.diff(time_s) > lost_after_s) + 1)


def _longest_s(gaps_s: list[list[float]]) -> FloatArray:
    return np.array([max(of_launch, default=np.nan) for of_launch in gaps_s], dtype=np.float64)


@frozen
class LooksUsedMetric:
    """How much of narrow fields serves launches: the share of their looks that detect one, and the
    share of their time in which they turn.
    """

    units: ClassVar[Mapping[str, str]] = {"looks_used": "", "turning": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return both shares over all sensors with a narrow field; nan without one."""
        duration_s = run.plan.scene.duration_s
        spans = {
            number: mode_spans(sensor, run.commands, duration_s)
            for number, sensor in enumerate(run.sensors)
            if sensor.is_narrow
        }
        if not spans:
            return {"looks_used": np.nan, "turning": np.nan}
        looks = sum(
            (span.until_s - span.start_s) / (span.sensor.scan.period_ns * 1e-9)
            for of_sensor in spans.values()
            for span in of_sensor
        )
        used = sum(_used_looks(run, number, of_sensor) for number, of_sensor in spans.items())
        turned_s = sum(
            min(span.from_s, span.until_s) - span.start_s
            for of_sensor in spans.values()
            for span in of_sensor
        )
        return {"looks_used": used / looks, "turning": turned_s / (duration_s * len(spans))}


def _used_looks(run: Run, number: int, spans: Sequence[ModeSpan]) -> int:
    """Return how many looks of a sensor, by its number, detect a launch; each mode counts its scans
    anew.
    """
    rows = _narrow_rows(run)
    rows = rows[run.detections.sensor[rows] == number]
    starts_s = [span.start_s for span in spans]
    place = np.searchsorted(starts_s, run.detections.time_s[rows], side="right")
    modes = [id(span.sensor) for span in spans]
    return len(set(zip((modes[row - 1] for row in place), run.detections.scan[rows], strict=True)))


def looks_used_metric(_config: NoConfig, _context: MetricContext) -> LooksUsedMetric:
    """Return the metric `looks_used`."""
    return LooksUsedMetric()


def _narrow_rows(run: Run) -> IntArray:
    """Return the rows of a run's detections of launches by sensors with a narrow field."""
    is_narrow = np.array([sensor.is_narrow for sensor in run.sensors], dtype=np.bool_)
    target = run.truth.target
    is_launch = (target >= 0) & (target < len(run.plan.scene.targets))
    return np.flatnonzero(is_launch & is_narrow[run.detections.sensor])
