"""The reports of a scene's sensors about launches, those that look as often in one chain."""

from collections.abc import Sequence

import numpy as np
from attrs import define, field

from opir_core import Plan
from opir_core.arrays import FloatArray, IntArray
from opir_core.plugin import Sensor
from opir_coverage.grid import SeenPoints
from opir_coverage.launches import LaunchPlaces
from opir_coverage.looks import GridLooks, Salvo
from opir_coverage.reports import ReportChain, Reports, ScanSteps
from opir_coverage.visibility import Fleet

#: Launches times sensors from which a chain is computed: larger ones take memory.
_AT_ONCE = 65_536


@define
class _Waiting:
    """Cells of sensors with equal scans, and quantiles (K, cells) of P_d at nodes of the burn."""

    rows: list[IntArray] = field(factory=list)
    nodes: list[FloatArray] = field(factory=list)


def latency_s_of(sensor: Sensor) -> float:
    """Return the mean time from a look of a sensor to its report, s."""
    return sum(stage.mean_s for stage in sensor.reporting)


class Watch:
    """Adds what sensors report about a salvo to `reports`."""

    def __init__(self, salvo: Salvo, reports: Reports) -> None:
        self._salvo = salvo
        self._reports = reports
        self._waiting: dict[tuple[float, int, int, float], _Waiting] = {}

    def add(self, number: int, looks: Sequence[GridLooks]) -> None:
        """Add the looks of a sensor at equal steps of the burn, its ends included."""
        sensor = self._salvo.plan.sensors[number]
        confirmation = self._salvo.detection.confirmation
        needed, scans = (
            (1, 1) if confirmation is None else (int(look) for look in confirmation[number])
        )
        kind = (sensor.scan.period_ns * 1e-9, needed, scans, latency_s_of(sensor))
        rows = np.unique(np.concatenate([look.rows for look in looks]))
        nodes = np.full((len(looks), len(rows)), np.nan)
        for step, look in enumerate(looks):
            nodes[step, np.searchsorted(rows, look.rows)] = look.probit
        waiting = self._waiting.setdefault(kind, _Waiting())
        waiting.rows.append(rows)
        waiting.nodes.append(nodes)
        if sum(map(len, waiting.rows)) > _AT_ONCE:
            self._work_out(kind, self._waiting.pop(kind))

    def close(self) -> None:
        """Add the waiting looks."""
        while self._waiting:
            self._work_out(*self._waiting.popitem())

    def _work_out(self, kind: tuple[float, int, int, float], waiting: _Waiting) -> None:
        period_s, needed, scans, latency_s = kind
        steps = ScanSteps.of(period_s, self._salvo.burn_s)
        rows = np.concatenate(waiting.rows)
        chain = ReportChain(len(rows), steps.phases, (needed, scans), self._reports.chance.shape[1])
        nodes = np.concatenate(waiting.nodes, axis=1)
        waiting.nodes.clear()
        self._reports.add(rows, chain, nodes, steps, latency_s)


def first_report_s(plan: Plan, places: LaunchPlaces, launch_s: float, chance: float) -> float:
    """Return the time from launch by which the first sensor has reported the first of `places`
    with probability `chance`, s.
    """
    salvo = Salvo(plan, places, launch_s)
    node_s = np.linspace(0.0, salvo.burn_s, 41)
    fleet = Fleet.of(plan, launch_s + node_s)
    looks = salvo.looks(fleet, 0, [SeenPoints.of(salvo.state(at)[0]) for at in node_s.tolist()])
    end_s = salvo.burn_s + latency_s_of(plan.sensors[0])
    reports = Reports(np.linspace(0.0, end_s, 241), 1, 1)
    watch = Watch(salvo, reports)
    watch.add(0, looks)
    watch.close()
    return float(reports.times_s(1, chance)[0])
