"""The reports of a scene's sensors about launches, those that look as often in one chain."""

from collections.abc import Sequence

import numpy as np
from attrs import define, field

from opir_core.arrays import FloatArray, IntArray
from opir_coverage.looks import GridLooks, Salvo
from opir_coverage.reports import ReportChain, Reports, ScanSteps

#: Launches times sensors from which a chain is worked out: larger ones take memory.
_AT_ONCE = 65_536


@define
class _Waiting:
    """Cells of sensors that look alike, and their quantiles (K, cells) of P_d at the nodes of the
    burn.
    """

    rows: list[IntArray] = field(factory=list)
    nodes: list[FloatArray] = field(factory=list)


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
            (1, 1) if confirmation is None else (int(each) for each in confirmation[number])
        )
        latency_s = sum(stage.mean_s for stage in sensor.reporting)
        kind = (sensor.scan.period_ns * 1e-9, needed, scans, latency_s)
        rows = np.unique(np.concatenate([each.rows for each in looks]))
        nodes = np.full((len(looks), len(rows)), np.nan)
        for step, each in enumerate(looks):
            nodes[step, np.searchsorted(rows, each.rows)] = each.probit
        alike = self._waiting.setdefault(kind, _Waiting())
        alike.rows.append(rows)
        alike.nodes.append(nodes)
        if sum(map(len, alike.rows)) > _AT_ONCE:
            self._work_out(kind, self._waiting.pop(kind))

    def close(self) -> None:
        """Add the looks that are left."""
        while self._waiting:
            self._work_out(*self._waiting.popitem())

    def _work_out(self, kind: tuple[float, int, int, float], alike: _Waiting) -> None:
        period_s, needed, scans, latency_s = kind
        steps = ScanSteps.of(period_s, self._salvo.burn_s)
        rows = np.concatenate(alike.rows)
        chain = ReportChain(len(rows), steps.phases, (needed, scans), self._reports.chance.shape[1])
        nodes = np.concatenate(alike.nodes, axis=1)
        alike.nodes.clear()
        self._reports.add(rows, chain, nodes, steps, latency_s)
