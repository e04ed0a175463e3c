"""Standard deviations and rates of lines of sight that their sensors cannot have."""

from collections.abc import Iterator

import numpy as np

from opir_core import Detections, Plan
from opir_core.errors import number_of
from opir_readers.detections.columns_of_run import RunColumns, sigma_setting
from opir_readers.detections.numbers import place_of
from opir_readers.detections.times import NS_PER_S

#: Lines this many scan periods apart in the median, of at least so many gaps, were thinned out.
_RARE = 4
_FEWEST_GAPS = 8


def odd_sigmas(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield, for each sensor, standard deviations that no sensor has."""
    sigma_urad = columns.detections.line_of_sight_sigma_rad * 1e6
    least_urad, most_urad = sigma_setting().plausible_range or (0.0, np.inf)
    is_odd = (sigma_urad < least_urad) | (sigma_urad > most_urad)
    for number in np.unique(columns.detections.sensor[is_odd]).tolist():
        row = int(np.flatnonzero(is_odd & (columns.detections.sensor == number))[0])
        yield (
            f"{place_of(columns.rows[row])}the standard deviation of {plan.sensors[number].id},"
            f" {sigma_urad[row]:.3g} µrad, is outside of {least_urad:g} to"
            f" {most_urad:g} µrad; is it in another unit (line_of_sight_sigma_rad)?"
        )


def unwatched_lines(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield, for each sensor, that it has lines of times at which it did not look."""
    detections = columns.detections
    for number, sensor in enumerate(plan.sensors):
        rows = np.flatnonzero(detections.sensor == number)
        time_s = detections.time_s[rows]
        # Spans are given to a microsecond.
        is_watched = [sensor.is_watching(time_s + error_s) for error_s in (-1e-6, 0.0, 1e-6)]
        outside = rows[~np.any(is_watched, axis=0)]
        if len(outside):
            yield (
                f"{place_of(columns.rows[outside[0]])}{number_of('detection', len(outside))} of"
                f" {sensor.id} are outside of the spans that it watched, and are kept: are its"
                " spans right, or did it look at a part of its field alone (a mode, a stuck scan)?"
            )


def rare_lines(detections: Detections, plan: Plan) -> Iterator[str]:
    """Yield, for each sensor, that its lines come more rarely than its scans in the scene."""
    for number, sensor in enumerate(plan.sensors):
        gaps_ns = np.diff(np.sort(detections.time_ns[detections.sensor == number]))
        if len(gaps_ns) < _FEWEST_GAPS or np.median(gaps_ns) < _RARE * sensor.scan.period_ns:
            continue
        period_ms = float(np.median(gaps_ns)) * 1e-6
        yield (
            f"lines of {sensor.id} are {period_ms * 1e-3:.3g} s apart in the median, and its scans"
            f" in the scene {sensor.scan.period_ns / NS_PER_S:g} s, of which those between count as"
            f" misses; if the file is thinned, set scan_period_ms: {period_ms:.0f}"
        )
