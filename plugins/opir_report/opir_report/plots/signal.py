"""Signal, probability of detection and air along the boost of one target, for each sensor that
looks at it.
"""

from typing import Any

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

#: Looks of a pair that are evaluated.
_LOOKS = 121
#: Sensors that are drawn: those with the most looks.
_SHOWN = 8
_NAMES = (
    *("target_id", "sensor_id", "since_ignition_s", "height_km", "is_visible"),
    *("snr", "detection_probability", "transmittance"),
)

#: What each plot shows: its column, its label and the settings of its axis.
PANELS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "snr": ("snr", "expected SNR, reference band", {"yscale": "log"}),
    "probability": ("detection_probability", "P_d of a look", {"ylim": (-0.03, 1.03)}),
    "air": ("transmittance", "transmittance of the air", {"ylim": (-0.03, 1.03)}),
}


def signals(facts: RunFacts, target: int) -> FigureData:
    """Return what evenly chosen looks at a target would measure, of all sensors that look at it.

    target_id, sensor_id, since_ignition_s, height_km, is_visible, snr (expected, in the reference
    band), P_d and the transmittance between target and sensor. Where the detection model has no
    signal, SNR and transmittance are nan.
    """
    plan = facts.plan
    own = np.flatnonzero((plan.pairs.target == target) & (plan.pairs.looks > 0))
    parts = [_pair_signals(facts, pair) for pair in own.tolist()]
    if not parts:
        return FigureData.of_rows(_NAMES, ())
    return FigureData({name: np.concatenate([part[name] for part in parts]) for name in _NAMES})


def _pair_signals(facts: RunFacts, pair: int) -> FigureData:
    plan = facts.plan
    first = int(plan.pairs.first_scan[pair])
    last = int(plan.pairs.last_scan[pair])
    scan = np.unique(np.linspace(first, last, _LOOKS).astype(np.int64))
    rows = np.full(len(scan), pair, dtype=np.int64)
    geometry = plan.look_geometry()
    exposures = geometry.exposures(rows, scan)
    sensor = plan.sensors[plan.pairs.sensor[pair]]
    target = int(plan.pairs.target[pair])
    snr, air = _snr_and_air(plan, sensor, exposures)
    return FigureData(
        {
            "target_id": np.full(len(scan), plan.targets.ids[target]),
            "sensor_id": np.full(len(scan), sensor.id),
            "since_ignition_s": exposures.emission_time_s - plan.targets.ignition_s[target],
            "height_km": 1e-3 * ecef_to_geodetic(exposures.target_ecef_m).height_m,
            "is_visible": geometry.visible(rows, scan),
            "snr": snr,
            "detection_probability": look_probability(plan, rows, exposures),
            "transmittance": air,
        }
    )


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
    column, label, scale = PANELS[panel]
    name = facts.ids[target]
    if not len(data):
        return without_data(axes, f"no sensor looks at {name}")
    if not np.isfinite(data[column]).any():
        model = facts.plan.scene.detection.name
        return without_data(axes, f"{label}: the detection model {model} has no signal")
    hues = []
    for number, sensor in enumerate(_most_visible(data)):
        own = data.where(data["sensor_id"] == sensor)
        hue = series_hue(number, sensor)
        # A logarithmic axis has no place for a signal of zero.
        is_shown = own["is_visible"] & ((own[column] > 0.0) | (panel != "snr"))
        shown = np.where(is_shown, own[column], np.nan)
        axes.plot(own["since_ignition_s"], shown, color=hue.colour, linestyle=hue.dashes)
        hues.append(hue)
    axes.set(xlabel="time since ignition, s", ylabel=label, **scale)
    axes.set_title(f"{name} ({facts.types[target]})")
    if axes.get_yscale() == "log":
        log_ticks(axes.yaxis)
    legend_of(axes, hues)
    return axes


def _most_visible(data: FigureData) -> list[str]:
    """Return the sensors that see the target most often, in the order of the scene."""
    names = list(dict.fromkeys(data["sensor_id"].tolist()))
    seen = {
        name: int(np.count_nonzero(data["is_visible"][data["sensor_id"] == name])) for name in names
    }
    most = sorted((name for name in names if seen[name]), key=lambda name: -seen[name])[:_SHOWN]
    return sorted(most, key=names.index)
