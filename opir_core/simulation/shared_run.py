"""The windows of a run whose work several processes share."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from attrs import evolve

from opir_core.interfaces.columns import names_of
from opir_core.interfaces.records import Detections, DetectionTruth, Window
from opir_core.planning.plan import Plan
from opir_core.simulation.engine import Engine
from opir_core.simulation.report_order import ReportOrder
from opir_core.simulation.workers import Encode, Text, WindowWorkers, require_workers

#: The columns of detections and of their truth that `Tally` counts.
_COUNTED = {"time_ns", "reported_ns", "sensor", "reported_type", "confidence", "track", "target"}


def shared_windows(
    plan: Plan,
    edges_ns: Sequence[int],
    workers: int,
    encoders: Mapping[str, Encode] | None = None,
    *,
    only_counted: bool = False,
) -> Iterator[tuple[Window, Mapping[str, Sequence[Text]]]]:
    """Yield the windows of a plan, computed by worker processes, and by name the text that encoders
    make.

    `edges_ns` are the windows' ends; the last window has what is reported after the scene's end.

    The workers encode only where windows leave the engine as they are, without tracks and without
    waiting for reports; elsewhere there is no text. With `only_counted` windows with text have only
    the columns that `Tally` counts.
    """
    require_workers(workers)
    engine = Engine(plan)
    reports = ReportOrder(plan)
    is_final = plan.make_tracker().cadence_s is None and not plan.has_latency
    reduced = counted if only_counted and is_final else lambda window: window
    with WindowWorkers(engine, edges_ns, workers, (is_final and encoders) or {}, reduced) as group:
        for edge_ns, computed in zip(edges_ns, group.computed(), strict=True):
            yield reports.take(engine.track(computed.window, edge_ns), edge_ns), computed.texts
    last_window = reports.rest()
    if last_window is not None:
        yield last_window, {}


def counted(window: Window) -> Window:
    """Return a window with the columns that `Tally` counts, and no others."""
    absent: dict[str, Any] = {name: None for name in names_of(Detections) if name not in _COUNTED}
    no_truth: dict[str, Any] = {
        name: None for name in names_of(DetectionTruth) if name not in _COUNTED
    }
    return evolve(
        window,
        detections=evolve(window.detections, **absent),
        truth=evolve(window.truth, **no_truth),
    )
