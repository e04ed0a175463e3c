"""Curves of one look against a condition, and receiver operating characteristics."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from opir_coverage import LaunchPlaces, band_thresholds, first_report_s, target_class_of

from opir_bench.results import BenchLine, BenchPlot, BenchResult
from opir_bench.stand import Bench, PosedTargets, Poses, Signals, noise_alarms_a_day
from opir_core import Plan
from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import local_axes

#: Scene time of the launch whose first report is timed, s.
_LAUNCH_S = 3600.0


@frozen
class Abscissa:
    """The condition of a curve: label, default values, column of the pose, factor to its unit."""

    label: str
    values: tuple[float, ...]
    column: str = ""
    factor: float = 1.0


ABSCISSAE: Mapping[str, Abscissa] = {
    "height": Abscissa("height, km", tuple(np.linspace(0.0, 100.0, 101)), "height_m", 1e3),
    "aspect": Abscissa(
        "aspect angle, °", tuple(np.linspace(0.0, 180.0, 73)), "aspect_rad", np.pi / 180.0
    ),
    "elevation": Abscissa(
        "elevation of the sensor, °",
        tuple(np.linspace(0.0, 90.0, 91)),
        "elevation_rad",
        np.pi / 180.0,
    ),
    "cloud": Abscissa("cloud top, km", (0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 18.0)),
}
CLIMATES = (
    "us1976",
    "tropical",
    "midlat_summer",
    "midlat_winter",
    "subarctic_summer",
    "subarctic_winter",
)


def curve(
    benches: Sequence[Bench],
    quantity: str,
    against: str,
    classes: Sequence[str],
    pose: Mapping[str, float],
    values: Sequence[float] = (),
) -> BenchResult:
    """Return a quantity against a condition, for sensors and classes in a fixed pose."""
    if quantity == "least-intensity":
        classes = classes[:1]  # it is that of any target
    if against == "climate":
        return _of_climates(benches, quantity, classes, pose)
    axis = ABSCISSAE[against]
    x = np.array(values or axis.values, dtype=np.float64)
    lines: list[BenchLine] = []
    for bench in benches:
        for name in classes:
            lines += _lines(bench, quantity, axis, x, name, pose)
    return _result(quantity, axis.label, lines)


def _lines(
    bench: Bench, quantity: str, axis: Abscissa, x: FloatArray, name: str, pose: Mapping[str, float]
) -> list[BenchLine]:
    if axis.column and quantity != "first-report":
        poses = Poses.of(name, **{**pose, axis.column: x * axis.factor})
        return _by_band(quantity, _label(bench, name), bench, x, bench.signals(poses))
    if axis.column and axis.column != "elevation_rad":
        raise ModelError(
            f"first-report is of a whole boost, so not against {axis.label}; give elevation, cloud,"
            f" climate"
        )
    points = [_at_value(bench, quantity, axis, value, name, pose) for value in x.tolist()]
    return [
        BenchLine(line_points[0].label, x, np.array([point.y[0] for point in line_points]))
        for line_points in zip(*points, strict=True)
        if line_points
    ]


def _at_value(
    bench: Bench, quantity: str, axis: Abscissa, value: float, name: str, pose: Mapping[str, float]
) -> list[BenchLine]:
    """Return lines of one point: another pose, or without a column another cloud top."""
    if axis.column:
        pose = {**pose, axis.column: value * axis.factor}
    else:
        bench = bench.changed(atmosphere=_air(bench, cloud={"top_km": value, "cover": 1.0}))
    return _at(bench, quantity, name, pose, value)


def _at(
    bench: Bench, quantity: str, name: str, pose: Mapping[str, float], value: float
) -> list[BenchLine]:
    """Return lines of one point."""
    x = np.array([value])
    label = _label(bench, name)
    if quantity == "first-report":
        places = _launch_place(bench.plan, name, pose)
        return [BenchLine(label, x, np.array([first_report_s(bench.plan, places, _LAUNCH_S, 0.9)]))]
    return _by_band(quantity, label, bench, x, bench.signals(Poses.of(name, **pose)))


def _of_climates(
    benches: Sequence[Bench], quantity: str, classes: Sequence[str], pose: Mapping[str, float]
) -> BenchResult:
    lines: dict[str, list[float]] = {}
    for bench in benches:
        for name in classes:
            for number, climate in enumerate(CLIMATES):
                stand = bench.changed(atmosphere=_air(bench, climate=climate))
                for line in _at(stand, quantity, name, pose, number):
                    lines.setdefault(line.label, []).append(float(line.y[0]))
    x = np.zeros(len(CLIMATES))
    curves = [BenchLine(label, x, np.array(y)) for label, y in lines.items()]
    return _result(quantity, "climate", curves, names=CLIMATES)


def _label(bench: Bench, name: str) -> str:
    return f"{bench.sensor.id}, {name}"


def _air(bench: Bench, **changes: Any) -> dict[str, Any]:
    """Return the scene's `lowtran` block with changes, or a new one."""
    block = bench.mapping.get("atmosphere")
    settings = (
        block
        if isinstance(block, dict) and block.get("model") == "lowtran"
        else {"model": "lowtran"}
    )
    return {**settings, **changes}


def _by_band(
    quantity: str, label: str, bench: Bench, x: FloatArray, signals: Signals
) -> list[BenchLine]:
    """Return the lines of a quantity: one, or one for each band."""
    if quantity == "pd":
        return [BenchLine(label, x, signals.chance)]
    columns = signals.snr if quantity == "snr" else least_intensities_w_sr(bench, signals)
    return [
        BenchLine(f"{label}, {band.name}", x, columns[:, n])
        for n, band in enumerate(bench.sensor.bands)
    ]


def least_intensities_w_sr(bench: Bench, signals: Signals) -> FloatArray:
    """Return the in-band intensities (n, B) at the thresholds T of one look: T noise R²/τ, W/sr.

    They are inf where the transmittance τ is 0.
    """
    needed = band_thresholds(bench.sensor)
    with np.errstate(divide="ignore"):
        return (
            needed
            * signals.noise_w_m2
            * np.square(signals.range_m)[:, None]
            / signals.transmittance
        )


def _launch_place(plan: Plan, name: str, pose: Mapping[str, float]) -> LaunchPlaces:
    """Return the place on the ground from which the first sensor has the elevation of the pose."""
    ground = PosedTargets.of(plan, Poses.of(name, **{**pose, "height_m": 0.0}))
    up = local_axes(ground.place_m)[:, 2]
    kind = target_class_of(plan, name)
    latitude = np.arcsin(up[:, 2])
    longitude = np.arctan2(up[:, 1], up[:, 0])
    return LaunchPlaces(latitude, longitude, kind, kind.profiles[0], 0.0)


QUANTITIES: Mapping[str, tuple[str, bool]] = {
    "pd": ("probability of detection of one look", False),
    "snr": ("signal-to-noise ratio", True),
    "least-intensity": ("least detectable intensity, W/sr", True),
    "first-report": ("time to the first report (90 %), s", False),
}


def _result(
    quantity: str, label: str, lines: Sequence[BenchLine], names: Sequence[str] = ()
) -> BenchResult:
    title, is_log = QUANTITIES[quantity]
    abscissae: Sequence[Any] = names or lines[0].x.tolist()
    rows = [[x, *(line.y[row] for line in lines)] for row, x in enumerate(abscissae)]
    plot = BenchPlot(label, title, lines, names, log_y=is_log, is_share=quantity == "pd")
    head = (label, *(line.label for line in lines))
    return BenchResult(f"{title[0].upper()}{title[1:]}", head, rows, plot)


def operating_characteristic(
    bench: Bench, poses: Poses, thresholds: Sequence[float] = tuple(np.linspace(3.0, 8.0, 21))
) -> BenchResult:
    """Return P_d of one look at a posed target against false alarms a day, by threshold."""
    stand = bench.whole()
    rows = []
    for threshold in thresholds:
        changed = stand.changed(
            sensor__threshold_sigma=float(threshold), sensor__false_alarm_probability=None
        )
        per_day = float(noise_alarms_a_day(changed.plan, np.nan)[0])
        rows.append([float(threshold), per_day, float(changed.signals(poses).chance[0])])
    columns = np.array(rows).T
    line = BenchLine(f"{bench.sensor.id}, {poses.target_class}", columns[1], columns[2])
    x_label = "reported false alarms of noise a day"
    plot = BenchPlot(x_label, "probability of detection", [line], log_x=True, is_share=True)
    head = ("threshold, sigma", "false alarms a day", "P_d of one look")
    return BenchResult("Receiver operating characteristic", head, rows, plot)
