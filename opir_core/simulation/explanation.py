"""The work of a plan, computed or skipped, with reasons: the output of `opir explain`, as plain
values.
"""

import math
from collections import Counter
from collections.abc import Mapping
from itertools import groupby
from typing import Any

import numpy as np
from attrs import asdict

from opir_core.arrays import FloatArray
from opir_core.interfaces.classification import Classifier
from opir_core.interfaces.contract import has_own
from opir_core.interfaces.sensors import Sensor
from opir_core.interfaces.trackers import LAUNCH
from opir_core.orbits import eclipse_intervals, outage_intervals
from opir_core.planning.link_compiler import path_uses
from opir_core.planning.looks import look_times_ns
from opir_core.planning.plan import Plan
from opir_core.scene.scene import BY_REPORT
from opir_core.simulation.manifest import components_used
from opir_core.simulation.measurement import Classification
from opir_core.simulation.plan_checks import launch_expectations, plan_warnings
from opir_core.simulation.report_order import tracking_lag_ns
from opir_core.simulation.run import window_edges_ns
from opir_core.simulation.summary import planned_work
from opir_core.simulation.undetected import blocked_text, few_looks


def explained(plan: Plan) -> Mapping[str, Any]:
    """Return the work of a plan, computed, skipped and omitted, by sensor and by pair, as plain
    values.
    """
    looking = np.flatnonzero(plan.pairs.looks > 0)
    idle = np.flatnonzero(plan.pairs.looks == 0)
    return {
        "scene": plan.scene.name,
        "forces": list(plan.scene.forces.names),
        "components": components_used(plan),
        "automatic": plan.scene.automatic,
        "looks": int(plan.pairs.looks.sum()),
        "work": planned_work(plan.pairs),
        "windows": len(window_edges_ns(plan)),
        "pairs": [_pair(plan, row) for row in looking.tolist()],
        "dark": _dark(plan),
        "skipped": [
            {**_names(plan, row), "reason": blocked_text(plan, row)} for row in idle.tolist()
        ],
        "outages": [row for sensor in plan.sensors for row in _outages(plan, sensor)],
        "eclipses": [row for sensor in plan.sensors for row in _eclipses(plan, sensor)],
        "noise": _noise(plan),
        "focal_planes": _focal_planes(plan),
        "reporting": _reporting(plan),
        "links": _links(plan),
        "tracking": _tracking(plan),
        "sensors_assumed": _sensors_assumed(plan),
        "hypotheses": _hypotheses(plan),
        "rates": _rates(plan),
        "expected_launches": launch_expectations(plan),
        "truth_users": _truth_users(plan),
        "faults": [str(fault) for fault in plan.scene.faults],
        "directed": [sensor.id for sensor in plan.sensors if sensor.pointing],
        "modes": [f"{each.id}: {', '.join(each.modes)}" for each in plan.sensors if each.modes],
        "not_computed": _not_computed(plan),
        "warnings": plan_warnings(plan),
    }


def _pair(plan: Plan, row: int) -> Mapping[str, Any]:
    pair = plan.pairs.take(slice(row, row + 1))
    times_s = (
        look_times_ns(pair, np.zeros(2, dtype=np.int64), np.append(pair.first_scan, pair.last_scan))
        * 1e-9
    )
    probability = plan.detection.pair_probability(pair.sensor, pair.target)
    return {
        **_names(plan, row),
        "looks": int(pair.looks[0]),
        "first_look_s": float(times_s[0]),
        "last_look_s": float(times_s[1]),
        "visible": "checked look by look" if pair.is_checked[0] else "throughout",
        "probability": None if probability is None else float(probability[0]),
    }


def _dark(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the dark gaps of targets between their burns."""
    gaps_s = plan.targets.dark_gaps_s
    return [
        {"target_id": plan.targets.ids[row], "start_s": start_s, "stop_s": stop_s}
        for row in range(len(gaps_s))
        for start_s, stop_s in gaps_s[row][np.isfinite(gaps_s[row, :, 0])].tolist()
    ]


def _outages(plan: Plan, sensor: Sensor) -> list[Mapping[str, Any]]:
    """Return when the Sun keeps a sensor from looking at part of its field, where that is, and how
    much of it.
    """
    outages = outage_intervals(
        sensor, np.datetime64(plan.scene.epoch_us, "us"), 0.0, plan.scene.duration_s
    )
    azimuth = np.degrees(outages.azimuth_rad)
    columns = {
        "start_s": outages.start_s,
        "stop_s": outages.stop_s,
        "azimuth_at_start_deg": azimuth[:, 0],
        "azimuth_at_stop_deg": azimuth[:, 1],
        "closest_s": outages.closest_s,
        "sun_from_nadir_deg": np.degrees(outages.nadir_angle_rad),
        "share_of_field": outages.share,
    }
    return _rows(sensor, columns)


def _eclipses(plan: Plan, sensor: Sensor) -> list[Mapping[str, Any]]:
    """Return when a satellite is in the Earth's penumbra and umbra; None for an umbra that it does
    not meet.
    """
    eclipses = eclipse_intervals(
        sensor.orbit, np.datetime64(plan.scene.epoch_us, "us"), 0.0, plan.scene.duration_s
    )
    return _rows(sensor, eclipses._asdict())


def _rows(sensor: Sensor, columns: Mapping[str, FloatArray]) -> list[Mapping[str, Any]]:
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [
        {"sensor_id": sensor.id}
        | {
            name: value if math.isfinite(value) else None
            for name, value in zip(columns, row, strict=True)
        }
        for row in rows
    ]


def _noise(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the false-alarm rates by sensor; nothing for models without noise."""
    rates = plan.detection.rate_per_scan
    if rates is None:
        return []
    rows = zip(plan.sensors, rates.tolist(), strict=True)
    return [
        {
            "sensor_id": sensor.id,
            "per_scan": rate,
            "per_day": rate * 86_400e9 / sensor.scan.period_ns,
        }
        for sensor, rate in rows
    ]


def _focal_planes(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the figures of the focal planes by band, with the noise of looks in this scene; none
    without planes.
    """
    figures = getattr(plan.detection, "focal_plane_figures", None)
    looking = np.flatnonzero(plan.pairs.looks > 0)
    return [] if figures is None else list(figures(plan.sensors, few_looks(plan, looking)[2]))


def _reporting(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the latency of each sensor's reports: mean and standard deviation, in all and by
    stage.
    """
    return [
        {
            "sensor_id": sensor.id,
            "mean_s": sum(stage.mean_s for stage in sensor.reporting),
            "sigma_s": math.hypot(*(stage.sigma_s for stage in sensor.reporting)),
            "stages": [asdict(stage) for stage in sensor.reporting],
        }
        for sensor in plan.sensors
    ]


def _links(plan: Plan) -> list[Mapping[str, Any]]:
    """Return how long each sensor's transmitter is open during the scene, by path, and what a path
    delays a report without a queue; nothing without links.
    """
    return [] if plan.links is None else path_uses(plan.links, plan.sensors, plan.end_ns)


def _tracking(plan: Plan) -> Mapping[str, Any]:
    """Return the order in which the tracker gets detections and its lag, None for the order of
    observation.
    """
    order = plan.scene.tracking_order
    return {"order": order, "lag_s": tracking_lag_ns(plan) * 1e-9 if order == BY_REPORT else None}


#: What distinguishes the groups of hypotheses: by their motion, to a tracker, and by their light,
#: to a classifier.
_EVIDENCE = {
    "noise": (
        "lines of sight that have nothing in common",
        "as weak as the sensor's noise; seen once",
    ),
    "ground": (
        "stands still",
        "bands of a warm or burning surface; seen for hours, or while the Sun glints",
    ),
    "bolide": (
        "falls, faster than any boost; over in seconds",
        "bands of a hot body; seen for seconds",
    ),
    "missile": (
        "climbs and speeds up for minutes; then falls freely",
        "bands and brightness of its plume; seen for minutes",
    ),
    "orbit": (
        "as a missile, but burns on or again until it is as fast as an orbit",
        "as a missile, by its own plume",
    ),
    "glide": ("as a missile, but burns out low and level", "as a missile, by its own plume"),
    "none": (
        "re-enters, flies as aircraft do, flashes, or is unlike all of them",
        "hot as the air makes what re-enters, or unlike all of them in bands, brightness, duration",
    ),
}


def _hypotheses(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the hypotheses by group, each with the evidence by which a part of the plan weighs it."""
    weighs = (
        plan.make_tracker().cadence_s is not None,
        has_own(Classifier, plan.classifier, "log_posterior"),
    )
    if not any(weighs):
        return []
    return [
        {
            "hypotheses": [hypothesis.name for hypothesis in members],
            "group": group,
            "by_motion": _EVIDENCE[group][0] if weighs[0] else None,
            "by_light": _EVIDENCE[group][1] if weighs[1] else None,
        }
        for group, members in groupby(plan.hypotheses, lambda hypothesis: hypothesis.group)
    ]


def _sensors_assumed(plan: Plan) -> list[str]:
    """Return the tracker's prior of each sensor's errors, if it estimates them."""
    health = plan.make_tracker().sensor_health()
    return (
        []
        if health is None
        else [
            f"{sensor.id}: {text}" for sensor, text in zip(plan.sensors, health.text, strict=True)
        ]
    )


def _rates(plan: Plan) -> list[Mapping[str, Any]]:
    """Return the rates that the tracker assumes, beside what the scene has of each; none without
    such a prior.
    """
    rates = plan.make_tracker().assumed_rates()
    if not rates:
        return []
    present = Counter({LAUNCH: len(plan.scene.targets)})
    for source in plan.sources:
        present.update(source.trajectories.class_names)
    others = present.keys() - {kind for rate in rates for kind in rate.kinds}
    return [
        {
            "what": rate.name,
            "per_day": rate.per_day,
            "in_duration": rate.per_day * plan.scene.duration_s / 86_400.0,
            "scene": {
                kind: present[kind] for kind in rate.kinds or sorted(others) if present[kind]
            },
            "source": rate.source,
        }
        for rate in rates
    ]


def _truth_users(plan: Plan) -> list[str]:
    """Return the classifier, if its reports may depend on the true types of targets."""
    choice = plan.scene.classification
    return [f"{choice.path}: {choice.name}"] if plan.classifier.uses_truth else []


def _names(plan: Plan, row: int) -> Mapping[str, str]:
    sensor = plan.sensors[plan.pairs.sensor[row]]
    target = plan.targets.ids[plan.pairs.target[row]]
    return {"sensor_id": sensor.id, "target_id": target}


def _not_computed(plan: Plan) -> list[str]:
    """Return the computations that the engine omits for this scene."""
    everyone = np.zeros(0, dtype=np.int32)
    constant = plan.detection.pair_probability(everyone, everyone) is not None
    has_tracks = plan.make_tracker().cadence_s is not None
    omitted = (
        (
            constant,
            "geometry of looks that do not detect (the probability of detection is constant)",
        ),
        (
            constant and not plan.pairs.is_checked.any(),
            "visibility of single looks (every pair is certain)",
        ),
        (not plan.scene.light_time, "light time (switched off)"),
        (plan.scene.forces.is_kepler, "numerical propagation (forces: kepler, in closed form)"),
        (not has_tracks, "tracks (no tracker)"),
        (plan.scene.atmosphere.name == "clear", "atmosphere (a clear sky, transmittance 1)"),
        (plan.scene.background.name == "none", "background (none)"),
        (
            not plan.has_latency,
            "reporting latency (reports are at the times of looks)",
        ),
        (not plan.scene.outputs, "event encoding (no outputs)"),
        (
            not plan.scene.outputs and not has_tracks and Classification.of(plan).has_probabilities,
            "type probabilities, types and confidences, until read (no output or tracker reads them)",
        ),
    )
    return [line for is_skipped, line in omitted if is_skipped]
