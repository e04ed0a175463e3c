"""Layers of geometry: sensors in view over a day, figures of merit of access and gaps."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core import Plan
from opir_core.arrays import BoolArray, ByteArray, FloatArray
from opir_coverage import merits
from opir_coverage.grid import PlaceGrid, SeenPoints
from opir_coverage.layers import Layer
from opir_coverage.settings import CoverageSettings
from opir_coverage.stereo import dilution_m, directions, stereo_angles_rad
from opir_coverage.visibility import Fleet, SightMap, day_s

#: Radians in a microradian, the unit of dilutions of precision.
_PER_URAD = 1e-6


def geometry_layers(
    plan: Plan, grid: PlaceGrid, settings: CoverageSettings
) -> tuple[list[Layer], FloatArray]:
    """Return the layers of visibility of points at rest above the cells, and instants (T,), s."""
    time_s = day_s(settings.steps, 3600.0 * settings.hours)
    fleet = Fleet.of(plan, time_s)
    shape = grid.shape
    in_view = []
    stereo = []
    dilution = []
    for height_km in settings.heights_km:
        points = SeenPoints.above(grid, 1e3 * height_km)
        sight = SightMap.of(fleet, points)
        in_view.append(sight.in_view())
        if settings.target_class is not None:
            angles, spread = _crossing(fleet, sight, points)
            stereo.append(angles)
            dilution.append(spread)
    counts = np.stack(in_view)
    layers = list(_access_layers(counts, settings, shape))
    if stereo:
        layers += _crossing_layers(np.stack(stereo), np.stack(dilution), shape)
    return layers, time_s


def _crossing(fleet: Fleet, sight: SightMap, points: SeenPoints) -> tuple[FloatArray, FloatArray]:
    """Return stereo angles, degrees, and dilutions of precision, m/µrad, (T, cells)."""
    angles, spreads = np.empty((2, len(sight.bits), sight.cells), dtype=np.float32)
    for step in range(len(sight.bits)):
        seeing = sight.seeing(step)
        # Cells in order of their number of sensors: those that the k-th sensor sees are then next
        # to one another.
        cells = np.argsort(-(seeing >= 0).sum(axis=0), kind="stable")
        seeing = seeing[:, cells]
        is_seen = seeing >= 0
        direction, range_m = directions(points.position_m[cells], fleet.position_m[seeing, step])
        angles[step, cells] = np.degrees(stereo_angles_rad(direction, is_seen))
        spreads[step, cells] = dilution_m(direction, range_m, is_seen) * _PER_URAD
    shape = (sight.steps, sight.cells)
    return np.broadcast_to(angles, shape), np.broadcast_to(spreads, shape)


def _access_layers(
    counts: ByteArray, settings: CoverageSettings, shape: tuple[int, int]
) -> Iterator[Layer]:
    """Yield the layers of numbers in view (heights, T, cells)."""
    of_all = ("height", "time")
    yield Layer(
        "in_view",
        "Sensors in view",
        "1",
        of_all,
        _on_grid(counts, shape),
        "N Asset Coverage: sensors that see the point",
    )
    statistics = {
        "min": ("least", counts.min(axis=1)),
        "mean": ("mean", counts.mean(axis=1, dtype=np.float32)),
        "max": ("most", counts.max(axis=1)),
    }
    for name, (word, values) in statistics.items():
        title = f"Sensors in view, {word}"
        words = f"N Asset Coverage, {word} over the time"
        yield Layer(f"in_view_{name}", title, "1", ("height",), _on_grid(values, shape), words)
    yield from _merit_layers(counts, settings, shape)


def _merit_layers(
    counts: ByteArray, settings: CoverageSettings, shape: tuple[int, int]
) -> Iterator[Layer]:
    """Yield the figures of merit of numbers in view (heights, T, cells), by number of assets."""
    step_s = 3600.0 * settings.hours / settings.steps
    merits_of_cells = [
        _merits(merits.is_covered(count, assets), step_s)
        for assets in settings.assets
        for count in counts
    ]
    leading = (len(settings.assets), len(counts))
    for name, (title, unit, words) in _MERITS.items():
        rows = np.stack([merit[name] for merit in merits_of_cells])
        values = rows.reshape(*leading, *shape)
        yield Layer(name, title, unit, ("assets", "height"), values, words)


#: Title, unit and definition of each figure of merit.
_MERITS = {
    "covered": (
        "Simple coverage",
        "1",
        "Simple Coverage: 1 where enough sensors see the point at any time",
    ),
    "coverage_time": ("Coverage time", "percent", "Coverage Time, percent of the interval"),
    "accesses": ("Accesses", "1", "Number of Accesses"),
    "access_duration_min": ("Access duration, least", "s", "Access Duration, minimum"),
    "access_duration_mean": ("Access duration, mean", "s", "Access Duration, average"),
    "access_duration_max": ("Access duration, longest", "s", "Access Duration, maximum"),
    "gaps": ("Gaps", "1", "Number of Gaps"),
    "revisit_time_min": (
        "Revisit time, least",
        "s",
        "Revisit Time: the duration of a gap, minimum; 0 without gaps",
    ),
    "revisit_time_mean": (
        "Revisit time, mean",
        "s",
        "Revisit Time: the duration of a gap, average; 0 without gaps",
    ),
    "revisit_time_max": (
        "Revisit time, longest",
        "s",
        "Revisit Time: the duration of a gap, maximum; 0 without gaps",
    ),
    "time_average_gap": (
        "Time average gap",
        "s",
        "Time Average Gap: sum of squared gaps over the interval",
    ),
    "response_time_min": (
        "Response time, least",
        "s",
        "Response Time, minimum: 0 where there is an access",
    ),
    "response_time_mean": (
        "Response time, mean",
        "s",
        "Response Time: from a request to the next access, average",
    ),
    "response_time_max": ("Response time, longest", "s", "Response Time, maximum"),
    "age_of_data_min": (
        "Age of data, least",
        "s",
        "Age of Data, minimum: 0 where there is an access",
    ),
    "age_of_data_mean": (
        "Age of data, mean",
        "s",
        "Age of Data: since the end of the last access, average",
    ),
    "age_of_data_max": ("Age of data, oldest", "s", "Age of Data, maximum"),
}


def _merits(covered: BoolArray, step_s: float) -> dict[str, NDArray[Any]]:
    """Return the figures of merit (cells,) of a point's coverage (T, cells)."""
    interval_s = step_s * len(covered)
    access = merits.runs(covered, step_s)
    gap = merits.runs(~covered, step_s)
    return {
        "covered": merits.simple_coverage(covered),
        "coverage_time": 100.0 * merits.coverage_time_s(covered, step_s) / interval_s,
        "accesses": access.number,
        "access_duration_min": access.least_s,
        "access_duration_mean": access.mean_s,
        "access_duration_max": access.most_s,
        "gaps": gap.number,
        "revisit_time_min": np.nan_to_num(gap.least_s),
        "revisit_time_mean": np.nan_to_num(gap.mean_s),
        "revisit_time_max": np.nan_to_num(gap.most_s),
        "time_average_gap": merits.time_average_gap_s(gap, interval_s),
        **_statistics("response_time", merits.response_times_s(covered, step_s)),
        **_statistics("age_of_data", merits.ages_of_data_s(covered, step_s)),
    }


def _statistics(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """Return least, mean and largest value (…, cells) of (…, T, cells) over time, by layer.

    Instants without a value (nan) are left out.
    """
    is_known = np.isfinite(values)
    count = is_known.sum(axis=-2)
    infinity = values.dtype.type(np.inf)
    total = np.where(is_known, values, values.dtype.type(0.0)).sum(axis=-2)
    statistics = {
        "min": np.where(is_known, values, infinity).min(axis=-2),
        "mean": total / np.maximum(count, 1),
        "max": np.where(is_known, values, -infinity).max(axis=-2),
    }
    return {f"{name}_{word}": np.where(count > 0, row, np.nan) for word, row in statistics.items()}


def _crossing_layers(
    angles: FloatArray, spreads: FloatArray, shape: tuple[int, int]
) -> Iterator[Layer]:
    """Yield the layers of stereo angles and dilutions (heights, T, cells), and statistics."""
    quantities = [
        (
            "stereo_angle",
            "Stereo angle",
            "degree",
            angles,
            (
                "angle between the two lines of sight that are nearest to a right angle; nan below"
                " two sensors"
            ),
        ),
        (
            "dilution",
            "Dilution of precision",
            "m/urad",
            spreads,
            (
                "Dilution of Precision of lines of sight: rms position error for an error of 1 urad"
                " per axis"
            ),
        ),
    ]
    for name, title, unit, values, definition in quantities:
        yield Layer(name, title, unit, ("height", "time"), _on_grid(values, shape), definition)
    for name, title, unit, values, _ in quantities:
        for key, statistic in _statistics(name, values).items():
            word = key.removeprefix(f"{name}_")
            words = f"{title}, {word} over the time in which there is one"
            statistic = _on_grid(statistic, shape)
            yield Layer(key, f"{title}, {word}", unit, ("height",), statistic, words)


def _on_grid(values: NDArray[Any], shape: tuple[int, int]) -> NDArray[Any]:
    return values.reshape(*values.shape[:-1], *shape)
