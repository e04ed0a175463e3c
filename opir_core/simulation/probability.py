"""Stages of the engine: the P_d of each look, from the detection model or interpolated; 0 if it is
not visible.
"""

from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.doors import deferred
from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.planning.looks import LookGeometry, Looks, blocks, look_times_s
from opir_core.planning.plan import Plan
from opir_core.simulation.observation import Observation
from opir_core.simulation.output_checks import checked_probability

if TYPE_CHECKING:
    from opir_core.planning.faults import SensorFaults
    from opir_core.simulation.interpolation import ProbabilityInterpolant
    from opir_core.simulation.pointing import PointedFields
    from opir_core.simulation.stuck_looks import StuckScans


@frozen(eq=False, repr=False)
class EvaluatedProbability:
    """Takes `looks`; gives `probability` (l,), from the model: pair by pair if it is constant, else
    look by look.
    """

    model: DetectionProbability
    geometry: LookGeometry

    def __call__(self, window: Observation) -> None:
        """Evaluate the P_d of all looks."""
        pairs = self.geometry.pairs
        looks = window.looks
        of_pair = self.model.pair_probability(
            pairs.sensor[looks.active], pairs.target[looks.active]
        )
        if of_pair is not None:
            of_pair = checked_probability(of_pair, len(looks.active), "pair_probability")
            window.probability = np.repeat(of_pair, looks.scans)
        else:
            blocks_of_looks = [self._varying(looks, rows) for rows in blocks(len(looks.pair))]
            window.probability = np.concatenate([*blocks_of_looks, np.empty(0)])

    def _varying(self, looks: Looks, rows: slice) -> FloatArray:
        model = self.model
        exposed = self.geometry.exposures(
            looks.pair[rows], looks.scan[rows], with_geometry=model.needs_geometry
        )
        return checked_probability(model.probability(exposed), len(exposed))


@frozen(eq=False, repr=False)
class InterpolatedProbability:
    """Takes `looks`; gives `interpolant`, `probability` (l,) and `undecided`."""

    whole: "ProbabilityInterpolant"

    def __call__(self, window: Observation) -> None:
        """Interpolate the P_d of all looks."""
        interpolant = self.whole.over(window.looks)
        window.interpolant = interpolant
        window.probability = checked_probability(
            interpolant.probability(), len(window.looks.pair), "response"
        )
        window.undecided = interpolant.undecided()


@frozen(eq=False, repr=False)
class VisibilityTest:
    """Takes `looks` and `probability` (l,), which becomes 0 where an uncertain look is not
    visible.
    """

    geometry: LookGeometry

    def __call__(self, window: Observation) -> None:
        """Test the looks that the plan left open."""
        looks = window.looks
        unchecked = np.flatnonzero(self.geometry.pairs.is_checked[looks.pair])
        for rows in blocks(len(unchecked)):
            block = unchecked[rows]
            window.probability[block] *= self.geometry.visible(looks.pair[block], looks.scan[block])


@frozen(eq=False, repr=False)
class WatchTest:
    """Takes `looks` and `probability` (l,), which becomes 0 where the sensor does not look, or is
    blind, or looks, by its true time, when the target does not shine, or its scan is stuck
    elsewhere.
    """

    plan: Plan
    stuck: "StuckScans | None" = None

    @classmethod
    def of(cls, plan: Plan, fields: "PointedFields | None" = None) -> "WatchTest | None":
        """Return the test of a plan; None where all sensors look throughout without a fault."""
        is_needed = plan.faults or any(sensor.watched_s is not None for sensor in plan.sensors)
        return cls(plan, stuck_scans_of(plan, fields)) if is_needed else None

    def __call__(self, window: Observation) -> None:
        """Test the looks of sensors that do not look throughout, or fail."""
        window.probability *= self.is_made(window.looks.pair, window.looks.scan)

    def is_made(self, pair: IntArray, scan: IntArray) -> BoolArray:
        """Return which looks (l,) are made by a sensor that sees, at what shines."""
        pairs = self.plan.pairs
        sensor = pairs.sensor[pair]
        stated_s = look_times_s(pairs, pair, scan)
        is_made = np.ones(len(pair), dtype=np.bool_)
        for number, each in enumerate(self.plan.sensors):
            if each.watched_s is not None:
                rows = np.flatnonzero(sensor == number)
                is_made[rows] = each.is_watching(stated_s[rows])
        if self.plan.faults is not None:
            is_made &= self._is_seen(self.plan.faults, pair, stated_s)
        if self.stuck is not None:
            is_made &= self.stuck.is_looking(pair, scan)
        return is_made

    def _is_seen(self, faults: "SensorFaults", pair: IntArray, stated_s: FloatArray) -> BoolArray:
        """Return which looks (l,) at stated times are of sensors that see and, by their true times,
        of targets that shine.
        """
        pairs = self.plan.pairs
        sensor = pairs.sensor[pair]
        clock_s = faults.clock_s(sensor, stated_s)
        true_s = stated_s - clock_s
        ignition_s = self.plan.targets.ignition_s[pairs.target[pair]]
        shines = (true_s >= ignition_s) & (true_s <= pairs.until_s[pair])
        return ((clock_s == 0.0) | shines) & ~faults.is_blind(sensor, stated_s)


class PointingTest:
    """Takes `looks` and `probability` (l,), which becomes 0 where the target is outside of the
    sensor's narrow field.
    """

    def __init__(self, fields: "PointedFields", geometry: LookGeometry) -> None:
        self._fields = fields
        self._geometry = geometry

    def __call__(self, window: Observation) -> None:
        """Test the looks of sensors with a narrow field."""
        looks = window.looks
        sensor = self._geometry.pairs.sensor[looks.pair]
        for number in self._fields.sensors:
            of_sensor = np.flatnonzero((sensor == number) & (window.probability > 0.0))
            for block in blocks(len(of_sensor)):
                rows = of_sensor[block]
                exposed = self._geometry.exposures(looks.pair[rows], looks.scan[rows])
                places = exposed.sensor_ecef_m, exposed.target_ecef_m
                window.probability[rows] *= self._fields.is_inside(number, *places, exposed.time_s)


def stuck_scans_of(plan: Plan, fields: "PointedFields | None") -> "StuckScans | None":
    """Return the scans of a plan's sensors that are stuck at times; None without any."""
    stuck: StuckScans | None = None
    if plan.faults is not None:
        stuck = deferred("opir_core.simulation.stuck_looks.stuck_scans")(plan, fields)
    return stuck


def interpolant_of(plan: Plan, geometry: LookGeometry) -> "ProbabilityInterpolant | None":
    """Return the interpolated P_d of looks, or None if the detection model does not allow
    interpolation.

    The curves are computed once for all replicates of a plan.
    """
    model = plan.detection
    if model.probability_tolerance is None:
        return None
    from opir_core.simulation.interpolation import KnotCurves

    made_of = model, plan.sightlines, plan.sensors
    *kept_of, curves = plan.kept.get("curves", (None,) * 4)
    if any(
        part_of_plan is not part_of_interpolant
        for part_of_plan, part_of_interpolant in zip(made_of, kept_of, strict=True)
    ):
        curves = KnotCurves.of(geometry, model, model.probability_tolerance)
        plan.kept["curves"] = *made_of, curves
    return curves.at_scans(geometry)
