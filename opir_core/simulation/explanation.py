"""What a plan computes, what it skips, and why: the output of `opir explain`, as plain values."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from opir_core.interfaces.optional import FalseAlarmModel
from opir_core.planning.looks import look_times_ns
from opir_core.planning.plan import Plan
from opir_core.planning.sightlines import Blocked
from opir_core.simulation.manifest import components_used
from opir_core.simulation.run import window_edges_ns
from opir_core.simulation.scan_alignment import alignment_warnings

_REASONS = {
    Blocked.NO_LOOK: "no scan falls into the {part} before the scene ends",
    Blocked.BEHIND_EARTH: "the Earth is in the way throughout the {part}",
    Blocked.OUTSIDE_FIELD_OF_REGARD: "outside the field of regard throughout the {part}",
    Blocked.BELOW_MINIMUM_ELEVATION: "the sensor stays below the minimum elevation throughout the {part}",
}


def explained(plan: Plan) -> Mapping[str, Any]:
    """Return components, pairs and looks, skipped pairs, noise, omitted computations and warnings, as plain values."""
    looking = np.flatnonzero(plan.pairs.looks > 0)
    return {
        "scene": plan.scene.name,
        "forces": list(plan.scene.forces.names),
        "components": components_used(plan),
        "looks": int(plan.pairs.looks.sum()),
        "windows": len(window_edges_ns(plan)),
        "pairs": [_pair(plan, row) for row in looking.tolist()],
        "skipped": [_skipped(plan, row) for row in np.flatnonzero(plan.pairs.looks == 0).tolist()],
        "noise": _noise(plan),
        "not_computed": _not_computed(plan),
        "warnings": alignment_warnings(plan),
    }


def _pair(plan: Plan, row: int) -> Mapping[str, Any]:
    pair = plan.pairs.take(slice(row, row + 1))
    times_s = look_times_ns(pair, np.zeros(2, dtype=np.int64), np.append(pair.first_scan, pair.last_scan)) * 1e-9
    probability = plan.detection.pair_probability(pair.sensor, pair.target)
    return {
        **_names(plan, row),
        "looks": int(pair.looks[0]),
        "first_look_s": float(times_s[0]),
        "last_look_s": float(times_s[1]),
        "visible": "checked look by look" if pair.is_checked[0] else "throughout",
        "probability": None if probability is None else float(probability[0]),
    }


def _skipped(plan: Plan, row: int) -> Mapping[str, Any]:
    part = "flight" if plan.sensors[plan.pairs.sensor[row]].follows_bodies else "burn"
    return {**_names(plan, row), "reason": _REASONS[Blocked(int(plan.pairs.blocked[row]))].format(part=part)}


def _noise(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the false-alarm rates by sensor; nothing for models without noise."""
    if not isinstance(plan.detection, FalseAlarmModel):
        return []
    both = zip(plan.sensors, plan.detection.rate_per_scan.tolist(), strict=True)
    return [
        {"sensor_id": sensor.id, "per_scan": rate, "per_hour": rate * 3600e9 / sensor.scan.period_ns}
        for sensor, rate in both
    ]


def _names(plan: Plan, row: int) -> Mapping[str, str]:
    sensor, target = plan.sensors[plan.pairs.sensor[row]], plan.targets.ids[plan.pairs.target[row]]
    return {"sensor_id": sensor.id, "target_id": target}


def _not_computed(plan: Plan) -> list[str]:
    """Return what the engine does not compute for this scene."""
    everyone = np.zeros(0, dtype=np.int32)
    constant = plan.detection.pair_probability(everyone, everyone) is not None
    omitted = (
        (constant, "geometry of looks that do not detect (the probability of detection is constant)"),
        (constant and not plan.pairs.is_checked.any(), "visibility of single looks (every pair is certain)"),
        (not plan.scene.light_time, "light time (switched off)"),
        (plan.scene.forces.is_kepler, "numerical propagation (forces: kepler, in closed form)"),
        (plan.make_tracker().cadence_s is None, "tracks (no tracker)"),
        (plan.scene.atmosphere.name == "clear", "atmosphere (a clear sky, transmittance 1)"),
        (plan.scene.background.name == "none", "background (none)"),
        (not plan.scene.outputs, "event encoding (no outputs)"),
    )
    return [line for is_skipped, line in omitted if is_skipped]
