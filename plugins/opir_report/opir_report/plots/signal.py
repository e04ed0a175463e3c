"""Signal, probability of detection and air along the boost of one target, for each sensor that
looks at it.
"""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from opir_core import Plan
from opir_core.arrays import FloatArray, IntArray
from opir_core.geometry import ecef_to_geodetic
from opir_core.plugin import Exposures, Sensor
from opir_report.canvas import legend_of, log_ticks, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import series_hue
from opir_report.run_facts import RunFacts

_NAMES = (
    "target_id",
    "sensor_id",
    "since_ignition_s",
    "height_km",
    "is_visible",
    "snr",
    "detection_probability",
    "transmittance",
)


class SignalPanel(NamedTuple):
    """A plot: its column, its label and the settings of its axis."""

    column: str
    label: str
    axis: dict[str, Any]


PANELS = {
    "snr": SignalPanel("snr", "expected SNR, reference band", {"yscale": "log"}),
    "probability": SignalPanel("detection_probability", "P_d of a look", {"ylim": (-0.03, 1.03)}),
    "air": SignalPanel("transmittance", "transmittance of the air", {"ylim": (-0.03, 1.03)}),
}


def signals(facts: RunFacts, target: int) -> FigureData:
    """Return the expected measurements of evenly chosen looks at a target, of all sensors that look
    at it.

    target_id, sensor_id, since_ignition_s, height_km, is_visible, snr (expected, in the reference
    band), P_d and the transmittance between target and sensor. Where the detection model has no
    signal, SNR and transmittance are nan.
    """
    pairs = facts.plan.pairs
    rows = np.flatnonzero((pairs.target == target) & (pairs.looks > 0))
    tables = [_pair_signals(facts.plan, pair) for pair in rows.tolist()]
    return FigureData.joined(tables) if tables else FigureData.of_rows(_NAMES, ())


def _pair_signals(plan: Plan, pair: int) -> FigureData:
    """Return the signals of up to 121 looks of a pair."""
    first = int(plan.pairs.first_scan[pair])
    last = int(plan.pairs.last_scan[pair])
    scan = np.unique(np.linspace(first, last, 121).astype(np.int64))
    rows = np.full(len(scan), pair, dtype=np.int64)
    geometry = plan.look_geometry()
    exposures = geometry.exposures(rows, scan)
    sensor = plan.sensors[plan.pairs.sensor[pair]]
    target = int(plan.pairs.target[pair])
    snr, air = _snr_and_air(plan, sensor, exposures)
    columns = (
        np.full(len(scan), plan.targets.ids[target]),
        np.full(len(scan), sensor.id),
        exposures.emission_time_s - plan.targets.ignition_s[target],
        1e-3 * ecef_to_geodetic(exposures.target_ecef_m).height_m,
        geometry.visible(rows, scan),
        snr,
        look_probability(plan, rows, exposures),
        air,
    )
    return FigureData(dict(zip(_NAMES, columns, strict=True)))


def look_probability(plan: Plan, pair: IntArray, exposures: Exposures) -> FloatArray:
    """Return P_d (n,) of looks of pairs (n,), were their targets visible."""
    constant = plan.detection.pair_probability(plan.pairs.sensor[pair], plan.pairs.target[pair])
    return plan.detection.probability(exposures) if constant is None else constant


def _snr_and_air(plan: Plan, sensor: Sensor, exposures: Exposures) -> tuple[FloatArray, FloatArray]:
    """Return expected SNR and transmittance (n,) in a sensor's reference band, nan where the model
    has none.
    """
    unknown = np.full(len(exposures), np.nan)
    response = plan.detection.response(exposures)
    if response is None:
        return unknown, unknown
    place = sensor.radiometer.reference if sensor.radiometer is not None else 0
    air = plan.detection.transmittance(exposures, sensor.bands[place])
    return response.snr[:, place], unknown if air is None else air


def signal_plot(axes: Axes, facts: RunFacts, target: int, data: FigureData, panel: str) -> Axes:
    """Draw one of `PANELS` over the time since ignition, a line for each sensor; gaps where it does
    not see.
    """
    column, label, axis = PANELS[panel]
    name = facts.ids[target]
    if not len(data):
        return without_data(axes, f"no sensor looks at {name}")
    if not np.isfinite(data[column]).any():
        model = facts.plan.scene.detection.name
        return without_data(axes, f"{label}: the detection model {model} has no signal")
    hues = []
    for number, sensor in enumerate(_most_visible(data)):
        looks = data.at("sensor_id", sensor)
        hue = series_hue(number, sensor)
        # A logarithmic axis has no place for a signal of zero.
        is_shown = looks["is_visible"] & ((looks[column] > 0.0) | (panel != "snr"))
        values = np.where(is_shown, looks[column], np.nan)
        axes.plot(looks["since_ignition_s"], values, **hue.style)
        hues.append(hue)
    axes.set(xlabel="time since ignition, s", ylabel=label, **axis)
    axes.set_title(f"{name} ({facts.types[target]})")
    if axes.get_yscale() == "log":
        log_ticks(axes.yaxis)
    legend_of(axes, hues)
    return axes


def _most_visible(data: FigureData) -> list[str]:
    """Return the eight sensors that see the target most often, in the order of the scene."""
    looks = Counter(data["sensor_id"][data["is_visible"]].tolist())
    names = [name for name in data.levels("sensor_id") if looks[name]]
    return sorted(sorted(names, key=lambda name: -looks[name])[:8], key=names.index)
