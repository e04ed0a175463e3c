"""Stages of the engine, of scenes with false alarms: these get rows among the detections of
targets.
"""

from typing import TYPE_CHECKING

import numpy as np

from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.planning.looks import LookGeometry
from opir_core.planning.plan import Plan
from opir_core.simulation.false_alarms import FalseAlarmGenerator
from opir_core.simulation.observation import Observation

if TYPE_CHECKING:
    from opir_core.simulation.pointing import PointedFields


class DrawFalseAlarms:
    """Takes `hits` and `order`; gives `false_alarms` and their `places`, and an `order` with a row
    for each.
    """

    def __init__(
        self,
        plan: Plan,
        model: DetectionProbability,
        geometry: LookGeometry,
        fields: "PointedFields | None" = None,
    ) -> None:
        self._generator = FalseAlarmGenerator(plan, model, geometry, fields)
        self._sensor = plan.pairs.sensor

    def __call__(self, window: Observation) -> None:
        """Draw the false alarms of the window and make room for them."""
        false_alarms = self._generator.between(window.start_ns, window.end_ns)
        window.false_alarms = false_alarms
        hits = window.hits
        order = window.order
        if false_alarms is None or not len(order):
            return
        places = false_alarms.places(hits.time_ns, self._sensor[hits.pair], order)
        window.places = places
        # `insert_false_alarms` overwrites the rows at `places`: any row fills them.
        window.order = np.insert(order, np.sort(places) - np.arange(len(places)), order[0])


def insert_false_alarms(window: Observation) -> None:
    """Overwrite rows with the false alarms.

    Takes `false_alarms`, `places`, `detections` and `truth`; gives the last two with the false
    alarms.
    """
    false_alarms = window.false_alarms
    if false_alarms is None:
        return
    if not len(window.order):
        window.detections, window.truth = false_alarms.alone()
        return
    window.detections.overwrite(window.places, false_alarms.detections)
    window.truth.overwrite(window.places, false_alarms.truth)
