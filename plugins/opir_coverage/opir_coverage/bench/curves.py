"""Curves of one look against height, aspect, elevation, cloud or climate, and operating
characteristics.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_coverage.bench.results import BenchLine, BenchPlot, BenchResult
from opir_coverage.bench.stand import Bench, Poses, Signals
from opir_coverage.grid import SeenPoints
from opir_coverage.launches import LaunchPlaces, target_class_of
from opir_coverage.looks import Salvo, band_thresholds
from opir_coverage.reports import Reports
from opir_coverage.visibility import Fleet
from opir_coverage.watch import Watch

_DAY_S = 86_400.0


@frozen
class Abscissa:
    """What a curve is against: its label, its values by default, the pose's column and the factor
    to its unit.
    """

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
CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")


def curve(
    benches: Sequence[Bench],
    quantity: str,
    against: str,
    classes: Sequence[str],
    pose: Mapping[str, float],
    values: Sequence[float] = (),
) -> BenchResult:
    """Return a quantity against a condition, for sensors and classes; the pose holds what does not
    change.
    """
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
    label = f"{bench.sensor.id}, {name}"
    if axis.column and quantity != "first-report":
        poses = Poses.of(name, **{**pose, axis.column: x * axis.factor})
        return _by_band(quantity, label, bench, x, bench.signals(poses))
    if axis.column and axis.column != "elevation_rad":
        raise ModelError(
            f"first-report is of a whole boost, so not against {axis.label}; give elevation, cloud,"
            f" climate"
        )
    found: list[list[BenchLine]] = []
    for value in x.tolist():
        where = {**pose, **({axis.column: value * axis.factor} if axis.column else {})}
        stand = (
            bench
            if axis.column
            else bench.changed(atmosphere=_air(bench, cloud={"top_km": value, "cover": 1.0}))
        )
        found.append(_at(stand, quantity, label, name, where, value))
    return [
        BenchLine(one[0].label, x, np.array([each.y[0] for each in one]))
        for one in zip(*found, strict=True)
        if one
    ]


def _at(
    bench: Bench, quantity: str, label: str, name: str, pose: Mapping[str, float], value: float
) -> list[BenchLine]:
    """Return lines of one point."""
    here = np.array([value])
    if quantity == "first-report":
        return [BenchLine(label, here, np.array([first_report_s(bench, name, pose)]))]
    return _by_band(quantity, label, bench, here, bench.signals(Poses.of(name, **pose)))


def _of_climates(
    benches: Sequence[Bench], quantity: str, classes: Sequence[str], pose: Mapping[str, float]
) -> BenchResult:
    lines: dict[str, list[float]] = {}
    for bench in benches:
        for name in classes:
            for number, climate in enumerate(CLIMATES):
                stand = bench.changed(atmosphere=_air(bench, climate=climate))
                for each in _at(stand, quantity, f"{bench.sensor.id}, {name}", name, pose, number):
                    lines.setdefault(each.label, []).append(float(each.y[0]))
    x = np.zeros(len(CLIMATES))
    made = [BenchLine(label, x, np.array(y)) for label, y in lines.items()]
    return _result(quantity, "climate", made, names=CLIMATES)


def _air(bench: Bench, **changes: Any) -> dict[str, Any]:
    """Return the scene's `lowtran` block with changes, or a new one."""
    block = bench.mapping.get("atmosphere")
    own = (
        block
        if isinstance(block, dict) and block.get("model") == "lowtran"
        else {"model": "lowtran"}
    )
    return {**own, **changes}


def _by_band(
    quantity: str, label: str, bench: Bench, x: FloatArray, found: Signals
) -> list[BenchLine]:
    """Return the lines of a quantity: one, or one for each band."""
    if quantity == "pd":
        return [BenchLine(label, x, found.chance)]
    columns = found.snr if quantity == "snr" else least_intensities_w_sr(bench, found)
    return [
        BenchLine(f"{label}, {band.name}", x, columns[:, n])
        for n, band in enumerate(bench.sensor.bands)
    ]


def least_intensities_w_sr(bench: Bench, found: Signals) -> FloatArray:
    """Return the in-band intensities (n, B) at the thresholds of one look: T noise R²/τ, inf where
    no light passes.
    """
    needed = band_thresholds(bench.sensor)
    with np.errstate(divide="ignore"):
        return needed * found.noise_w_m2 * np.square(found.range_m)[:, None] / found.transmittance


def first_report_s(
    bench: Bench, name: str, pose: Mapping[str, float], chance: float = 0.9
) -> float:
    """Return the time from launch by which a report has come with a probability, from a place of
    this elevation.
    """
    from opir_coverage.bench.stand import PosedTargets

    plan = bench.plan
    on_ground = Poses.of(name, **{**pose, "height_m": 0.0})
    place = SeenPoints.of(PosedTargets.of(plan, on_ground).place_m)
    latitude = np.arcsin(place.up[:, 2])
    longitude = np.arctan2(place.up[:, 1], place.up[:, 0])
    kind = target_class_of(plan, name)
    salvo = Salvo(plan, LaunchPlaces(latitude, longitude, kind, kind.profiles[0], 0.0), 3600.0)
    node_s = np.linspace(0.0, salvo.burn_s, 41)
    fleet = Fleet.of(plan, 3600.0 + node_s)
    looks = salvo.looks(fleet, 0, [SeenPoints.of(salvo.state(at)[0]) for at in node_s.tolist()])
    latency_s = sum(stage.mean_s for stage in plan.sensors[0].reporting)
    reports = Reports(np.linspace(0.0, salvo.burn_s + latency_s, 241), 1, 1)
    watch = Watch(salvo, reports)
    watch.add(0, looks)
    watch.close()
    return float(reports.times_s(1, chance)[0])


_QUANTITIES: Mapping[str, tuple[str, bool]] = {
    "pd": ("probability of detection of one look", False),
    "snr": ("signal-to-noise ratio", True),
    "least-intensity": ("least detectable intensity, W/sr", True),
    "first-report": ("time to the first report (90 %), s", False),
}
QUANTITIES = tuple(_QUANTITIES)


def _result(
    quantity: str, label: str, lines: Sequence[BenchLine], names: Sequence[str] = ()
) -> BenchResult:
    title, is_log = _QUANTITIES[quantity]
    x = lines[0].x
    first: Callable[[int], Any] = (lambda row: names[row]) if names else (lambda row: x[row])
    rows = [[first(row), *(line.y[row] for line in lines)] for row in range(len(x))]
    plot = BenchPlot(
        x_label=label,
        y_label=title,
        lines=lines,
        names=names,
        log_y=is_log,
        is_share=quantity == "pd",
    )
    return BenchResult(
        title=f"{title[0].upper()}{title[1:]}",
        head=(label, *(line.label for line in lines)),
        rows=rows,
        plot=plot,
    )


def operating_characteristic(
    bench: Bench, poses: Poses, thresholds: Sequence[float] = tuple(np.linspace(3.0, 8.0, 21))
) -> BenchResult:
    """Return P_d of one look at a posed target against reported false alarms of noise a day, by
    threshold.
    """
    stand = bench.whole()
    period_s = stand.sensor.scan.period_ns * 1e-9
    rows = []
    for threshold in thresholds:
        own = stand.changed(
            sensor__threshold_sigma=float(threshold), sensor__false_alarm_probability=None
        )
        rate = own.plan.detection.rate_per_scan
        per_day = np.nan if rate is None else float(rate[0]) * _DAY_S / period_s
        rows.append([float(threshold), per_day, float(own.signals(poses).chance[0])])
    columns = np.array(rows).T
    line = BenchLine(f"{bench.sensor.id}, {poses.target_class}", columns[1], columns[2])
    plot = BenchPlot(
        x_label="reported false alarms of noise a day",
        y_label="probability of detection",
        lines=[line],
        log_x=True,
        is_share=True,
    )
    head = ("threshold, sigma", "false alarms a day", "P_d of one look")
    return BenchResult(title="Receiver operating characteristic", head=head, rows=rows, plot=plot)
