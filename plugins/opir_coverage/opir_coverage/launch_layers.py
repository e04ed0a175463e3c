"""Layers of launches: P_d and least intensity, first report and track, bounds at burnout."""

from collections.abc import Iterator, Sequence

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
from opir_coverage.watch import Watch, latency_s_of

#: Number of times at which reports are counted, and the power that makes the first ones closest.
_REPORT_STEPS = 100
_REPORT_POWER = 1.5


def launch_layers(plan: Plan, grid: PlaceGrid, settings: CoverageSettings) -> list[Layer]:
    """Return the layers of launches of the settings' class from the cells of a grid."""
    assert settings.target_class is not None
    kind = target_class_of(plan, settings.target_class)
    salvos = []
    for azimuth_deg in settings.azimuths_deg:
        places = LaunchPlaces.of(grid, kind, np.radians(azimuth_deg), settings.profile)
        slopes = BurnSlopes.of(LaunchSlopes.of(places), settings.samples)
        salvos += [
            _of_salvo(Salvo(plan, places, ignition_s), slopes, settings)
            for ignition_s in launch_times_s(settings)
        ]
    leading = (len(settings.azimuths_deg), settings.launches)
    return [
        _layer(name, np.stack([salvo[name] for salvo in salvos]), leading, grid.shape, settings)
        for name in salvos[0]
    ]


def launch_times_s(settings: CoverageSettings) -> FloatArray:
    """Return the scene times of launches, s: middles of equal parts, on whole seconds."""
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
    """Return P_d (heights, cells) of one look of each sensor, least intensities (bands, …)."""
    heights_m = [1e3 * height_km for height_km in settings.heights_km]
    since_s = np.array([salvo.height_time_s(height_m) for height_m in heights_m])
    bands = distinct_bands(salvo.plan.sensors)
    cells = len(salvo.places)
    missed = np.full((len(heights_m), cells), np.nan)
    missed[np.isfinite(since_s)] = 1.0
    least = np.full((len(bands), len(heights_m), cells), np.nan)
    for row, looks in _looks_at_heights(salvo, since_s):
        missed[row, looks.rows] *= 1.0 - looks.chance
        for band, values in looks.least_w_sr.items():
            best = least[bands.index(band), row]
            best[looks.rows] = np.fmin(best[looks.rows], values)
    layers = {"detection_probability": 1.0 - missed}
    return layers if np.isnan(least).all() else {**layers, "least_intensity": least}


def _looks_at_heights(salvo: Salvo, since_s: FloatArray) -> Iterator[tuple[int, GridLooks]]:
    """Yield the number of a height and the looks of a sensor there, of heights within the burn."""
    reached = np.flatnonzero(np.isfinite(since_s))
    if not len(reached):
        return
    fleet = Fleet.of(salvo.plan, salvo.ignition_s + since_s[reached])
    points = [SeenPoints.of(salvo.state(time_s)[0]) for time_s in since_s[reached].tolist()]
    for number in range(len(salvo.plan.sensors)):
        looks = salvo.looks(fleet, number, points, with_least=True)
        yield from zip(reached.tolist(), looks, strict=True)


def _reports_and_bounds(
    salvo: Salvo, slopes: BurnSlopes, settings: CoverageSettings
) -> dict[str, FloatArray]:
    """Return the times of the first report and of a track, and the bounds at burnout, (cells,)."""
    node_s = np.linspace(0.0, salvo.burn_s, settings.samples + 1)
    fleet = Fleet.of(salvo.plan, salvo.ignition_s + node_s)
    points = [SeenPoints.of(salvo.state(since_s)[0]) for since_s in node_s.tolist()]
    reports = Reports(_report_times_s(salvo), settings.track_reports, len(salvo.places))
    information = LaunchInformation(slopes.moved)
    watch = Watch(salvo, reports)
    for number, sensor in enumerate(salvo.plan.sensors):
        looks = salvo.looks(fleet, number, points)
        if any(len(look.rows) for look in looks):
            watch.add(number, looks)
            _add_information(information, slopes, sensor, salvo.burn_s, looks)
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


def _report_times_s(salvo: Salvo) -> FloatArray:
    """Return the times since ignition at which reports are counted, s."""
    latency_s = [latency_s_of(sensor) for sensor in salvo.plan.sensors]
    start_s = min(latency_s)
    end_s = salvo.burn_s + max(latency_s)
    share = np.linspace(0.0, 1.0, _REPORT_STEPS + 1) ** _REPORT_POWER
    return start_s + (end_s - start_s) * share


def _add_information(
    information: LaunchInformation,
    slopes: BurnSlopes,
    sensor: Sensor,
    burn_s: float,
    looks: Sequence[GridLooks],
) -> None:
    """Add the information of a sensor's looks at equal steps of the burn, ends included."""
    last_step = len(looks) - 1
    sigma_rad = sensor.line_of_sight_bias_sigma_rad
    per_step = burn_s / last_step / (sensor.scan.period_ns * 1e-9)
    bias = BiasInformation(len(slopes.moved[0])) if sigma_rad > 0.0 else None
    for step, look in enumerate(looks):
        weight = (
            per_step
            * (0.5 if step in (0, last_step) else 1.0)
            * look.chance
            / np.square(look.sigma_rad)
        )
        measured = look.direction, look.range_m, weight
        information.add(step, look.rows, *measured)
        if bias is not None:
            bias.add(look.rows, slopes.moved[step][look.rows], *measured)
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
    values = rows.astype(np.float32).reshape(*leading, *rows.shape[1:-1], *shape)
    lead = len(leading)
    own_axes = tuple(range(lead, lead + len(words.dims)))
    values = np.transpose(values, (*own_axes, *range(lead), values.ndim - 2, values.ndim - 1))
    definition = words.definition.format(
        chance=settings.chance, track_reports=settings.track_reports
    )
    return Layer(
        name, words.title, words.unit, (*words.dims, "azimuth", "launch_time"), values, definition
    )
