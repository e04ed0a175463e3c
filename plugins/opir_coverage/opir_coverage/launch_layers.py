"""Layers of launches: P_d and least intensity, first report and track, bounds at burnout."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core import Plan
from opir_core.arrays import FloatArray
from opir_core.planning import distinct_bands
from opir_core.plugin import Ballistic, Band, Sensor
from opir_coverage.bounds import (
    BiasInformation,
    BurnSlopes,
    LaunchInformation,
    LaunchSlopes,
    burnout_bounds,
)
from opir_coverage.grid import PlaceGrid, SeenPoints
from opir_coverage.launches import LaunchPlaces, target_class_of
from opir_coverage.layers import Layer
from opir_coverage.looks import GridLooks, Salvo
from opir_coverage.reports import Reports
from opir_coverage.settings import CoverageSettings
from opir_coverage.visibility import Fleet
from opir_coverage.watch import Watch

#: Times at which reports are counted, from the least latency on, and the power that makes them
#: closest at first.
_REPORT_STEPS = 100
_REPORT_POWER = 1.5


def launch_layers(plan: Plan, grid: PlaceGrid, settings: CoverageSettings) -> list[Layer]:
    """Return the layers of launches of the settings' class from the cells of a grid."""
    assert settings.target_class is not None
    kind = target_class_of(plan, settings.target_class)
    found: dict[str, list[FloatArray]] = {}
    for azimuth_deg in settings.azimuths_deg:
        places = LaunchPlaces.of(grid, kind, np.radians(azimuth_deg), settings.profile)
        slopes = BurnSlopes.of(LaunchSlopes.of(places), settings.samples)
        for ignition_s in launch_times_s(settings):
            for name, values in _of_salvo(
                Salvo(plan, places, ignition_s), slopes, settings
            ).items():
                found.setdefault(name, []).append(values.astype(np.float32))
    leading = (len(settings.azimuths_deg), settings.launches)
    return [
        _layer(name, np.stack(rows), leading, grid.shape, settings) for name, rows in found.items()
    ]


def launch_times_s(settings: CoverageSettings) -> FloatArray:
    """Return the scene times of launches, s: the middles of equal parts of the interval, on whole
    seconds.
    """
    length_s = 3600.0 * settings.hours
    return np.round((np.arange(settings.launches) + 0.5) * (length_s / settings.launches))


def band_title(band: Band) -> str:
    """Return the name of a band with its edges."""
    return f"{band.name} {band.lower_um:g}-{band.upper_um:g} um"


def _of_salvo(
    salvo: Salvo, slopes: BurnSlopes, settings: CoverageSettings
) -> dict[str, FloatArray]:
    """Return the values of launches at one instant with one azimuth, by layer."""
    return {**_heights(salvo, settings), **_reports_and_bounds(salvo, slopes, settings)}


def _heights(salvo: Salvo, settings: CoverageSettings) -> dict[str, FloatArray]:
    """Return P_d (heights, cells) of one look of each sensor, and the least intensities (bands,
    heights, cells).
    """
    sensors = salvo.plan.sensors
    bands = distinct_bands(salvo.plan.sensors)
    cells = len(salvo.places)
    heights = settings.heights_km
    missed = np.full((len(heights), cells), np.nan)
    least = np.full((len(bands), len(heights), cells), np.nan)
    since_s = np.array([salvo.height_time_s(1e3 * each) for each in heights])
    reached = np.flatnonzero(np.isfinite(since_s))
    missed[reached] = 1.0
    fleet = Fleet.of(salvo.plan, salvo.ignition_s + since_s[reached])
    points = [SeenPoints.of(salvo.state(each)[0]) for each in since_s[reached].tolist()]
    for number in range(len(sensors) if len(reached) else 0):
        for row, looks in zip(
            reached, salvo.looks(fleet, number, points, with_least=True), strict=True
        ):
            missed[row, looks.rows] *= 1.0 - looks.chance
            for band, values in looks.least_w_sr.items():
                own = least[bands.index(band), row]
                own[looks.rows] = np.fmin(own[looks.rows], values)
    layers = {"detection_probability": 1.0 - missed}
    return layers if np.isnan(least).all() else {**layers, "least_intensity": least}


def _reports_and_bounds(
    salvo: Salvo, slopes: BurnSlopes, settings: CoverageSettings
) -> dict[str, FloatArray]:
    """Return the times of the first report and of a track, and the bounds at burnout, (cells,)."""
    sensors = salvo.plan.sensors
    cells = len(salvo.places)
    burn_s = salvo.burn_s
    node_s = np.linspace(0.0, burn_s, settings.samples + 1)
    fleet = Fleet.of(salvo.plan, salvo.ignition_s + node_s)
    latency_s = [sum(stage.mean_s for stage in each.reporting) for each in sensors]
    first_s = min(latency_s)
    last_s = burn_s + max(latency_s)
    time_s = (
        first_s + (last_s - first_s) * np.linspace(0.0, 1.0, _REPORT_STEPS + 1) ** _REPORT_POWER
    )
    reports = Reports(time_s, settings.track_reports, cells)
    information = LaunchInformation(slopes.moved)
    points = [SeenPoints.of(salvo.state(since)[0]) for since in node_s.tolist()]
    watch = Watch(salvo, reports)
    for number, sensor in enumerate(sensors):
        looks = salvo.looks(fleet, number, points)
        if not any(len(each.rows) for each in looks):
            continue
        watch.add(number, looks)
        _add_information(information, slopes, sensor, burn_s, looks)
    watch.close()
    comes_down = isinstance(salvo.places.target_class.after_burnout, Ballistic)
    bounds = burnout_bounds(slopes.burnout, information.covariance(), comes_down=comes_down)
    return {
        "first_report": reports.times_s(1, settings.chance),
        "report_probability": reports.probability(1),
        "track": reports.times_s(settings.track_reports, settings.chance),
        "track_probability": reports.probability(settings.track_reports),
        "launch_point_bound": 1e-3 * bounds.launch_m,
        "velocity_bound": bounds.velocity_m_s,
        "impact_bound": 1e-3 * bounds.impact_m,
    }


def _add_information(
    information: LaunchInformation,
    slopes: BurnSlopes,
    sensor: Sensor,
    burn_s: float,
    looks: Sequence[GridLooks],
) -> None:
    """Add what a sensor's looks at equal steps of the burn, its ends included, say of launches."""
    last = len(looks) - 1
    sigma_rad = sensor.line_of_sight_bias_sigma_rad
    per_step = burn_s / last / (sensor.scan.period_ns * 1e-9)
    bias = BiasInformation(len(slopes.moved[0])) if sigma_rad > 0.0 else None
    for step, each in enumerate(looks):
        weight = (
            per_step * (0.5 if step in (0, last) else 1.0) * each.chance / np.square(each.sigma_rad)
        )
        measured = each.direction, each.range_m, weight
        information.add(step, each.rows, *measured)
        if bias is not None:
            bias.add(each.rows, slopes.moved[step][each.rows], *measured)
    if bias is not None:
        information.lose(bias, sigma_rad)


@frozen
class _Words:
    """Title, unit and definition of a layer of launches; `dims` before azimuth and launch time."""

    title: str
    unit: str
    definition: str
    dims: tuple[str, ...] = ()


_WORDS = {
    "detection_probability": _Words(
        "Probability of detection",
        "1",
        "P_d of one look by each sensor in view, at a height of the boost",
        ("height",),
    ),
    "least_intensity": _Words(
        "Least detectable intensity",
        "W/sr",
        "in-band intensity at the threshold of one look of the best sensor, at a height of the"
        " boost",
        ("band", "height"),
    ),
    "first_report": _Words(
        "Time to the first report",
        "s",
        "from launch until a report has come with probability {chance:g}",
    ),
    "report_probability": _Words(
        "Probability of a report", "1", "of any report from looks during the boost"
    ),
    "track": _Words(
        "Time to a track",
        "s",
        "from launch until {track_reports} reports have come with probability {chance:g}",
    ),
    "track_probability": _Words(
        "Probability of a track", "1", "of {track_reports} reports from looks during the boost"
    ),
    "launch_point_bound": _Words(
        "Bound of the launch point", "km", "Cramer-Rao bound at burnout, horizontal rms"
    ),
    "velocity_bound": _Words(
        "Bound of the velocity at burnout", "m/s", "Cramer-Rao bound at burnout, rms"
    ),
    "impact_bound": _Words(
        "Bound of the impact point",
        "km",
        "Cramer-Rao bound at burnout, horizontal rms; none above 10925 km, that of a point anywhere"
        " on Earth",
    ),
}


def _layer(
    name: str,
    rows: FloatArray,
    leading: tuple[int, int],
    shape: tuple[int, int],
    settings: CoverageSettings,
) -> Layer:
    """Return a layer from its values (azimuths times launch times, …, cells)."""
    words = _WORDS[name]
    values = rows.reshape(*leading, *rows.shape[1:-1], *shape)
    first = len(leading)
    own = tuple(range(first, first + len(words.dims)))
    values = np.transpose(values, (*own, *range(first), values.ndim - 2, values.ndim - 1))
    definition = words.definition.format(
        chance=settings.chance, track_reports=settings.track_reports
    )
    return Layer(
        name, words.title, words.unit, (*words.dims, "azimuth", "launch_time"), values, definition
    )
