"""Delays of reports over time, by sensor: what latencies and links cost."""

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes

from opir_report.canvas import legend_entry, legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import Hue, series_hue
from opir_report.run_facts import RunFacts

_BINS = 60
_NAMES = ("sensor_id", "time_s", "reports", "median_s", "p95_s")

#: Sensors that a plot tells apart.
_MOST_SENSORS = 8


def report_delays(facts: RunFacts) -> FigureData:
    """Return, by sensor and time of look, the median of the time to the report and its 95 %
    quantile; nothing for a run whose reports are at once.
    """
    return FigureData.of_rows(_NAMES, _rows(facts) if facts.plan.has_latency else ())


def _rows(facts: RunFacts) -> Iterator[tuple[object, ...]]:
    detections = facts.run.detections
    delay_s = (detections.reported_ns - detections.time_ns) * 1e-9
    width_s = facts.plan.scene.duration_s / _BINS
    place = np.clip((detections.time_s / width_s).astype(np.int64), 0, _BINS - 1)
    for number, sensor in enumerate(facts.run.sensors):
        is_own = detections.sensor == number
        for cell in np.unique(place[is_own]).tolist():
            delays_s = delay_s[is_own & (place == cell)]
            quantiles_s = np.quantile(delays_s, [0.5, 0.95]).tolist()
            yield sensor.id, (cell + 0.5) * width_s, len(delays_s), *quantiles_s


def delay_hues(data: FigureData) -> list[Hue]:
    """Return the hues of the sensors that are drawn: the first ones."""
    names = data.levels("sensor_id")[:_MOST_SENSORS]
    return [series_hue(number, name) for number, name in enumerate(names)]


def delay_plot(axes: Axes, _facts: RunFacts, data: FigureData) -> Axes:
    """Draw the median delay of each sensor's reports over time, with a band up to the 95 %
    quantile.
    """
    if not len(data):
        return without_data(axes, "reports are at the times of their looks")
    hues = delay_hues(data)
    for hue in hues:
        series = data.at("sensor_id", hue.label)
        axes.plot(series["time_s"], series["median_s"], color=hue.colour, linestyle=hue.dashes)
        axes.fill_between(
            series["time_s"],
            series["median_s"],
            series["p95_s"],
            color=hue.colour,
            alpha=0.15,
            linewidth=0,
        )
    axes.set(xlabel="time of the look, s", ylabel="time to its report, s", ylim=(0.0, None))
    legend_of(axes, hues, [legend_entry("median, to 95 %")])
    return axes
