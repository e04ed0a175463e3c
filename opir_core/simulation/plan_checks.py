"""The warnings about a plan, which runs all the same.

They are of implausible values, of events of targets on scan instants, on which latencies show the
phase, and of priors that expect another number of launches.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.errors import ModelError, Problem
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.plan import Plan, PlanParts
from opir_core.planning.sightlines import Pairs
from opir_core.planning.targets import Targets
from opir_core.scene.plausibility import REMEDY, implausible_values
from opir_core.sensors.scan_patterns import AlignedScan
from opir_core.simulation.unread_settings import unread_settings, unread_texts

#: How far an event may be from a scan instant, in scan periods.
TOLERANCE = 1e-6

#: Factor between expected and actual launches, of one at least, from which a warning is given.
_UNEXPECTED = 10.0
_COUNTS = ("expected_launches", "launches")

#: Ids that a message lists.
_LISTED = 3

#: A field of regard with less than this share of the ground below the orbit is a slip: 1 deg from
#: GEO has 0.5 %.
_LEAST_SHARE = 0.004

#: Implausible values that are listed one by one.
_LISTED_VALUES = 8


@frozen(eq=False, kw_only=True, repr=False)
class CheckedScene(PlanParts):
    """The built components of a valid scene, and the pairs that warnings may be about."""

    pairs: Pairs


def plan_warnings(plan: Plan | CheckedScene) -> list[str]:
    """Return the warnings: settings that nothing reads, coinciding scan instants, implausible
    values, more or fewer launches than expected, links that are overloaded."""
    unread = unread_texts(unread_settings(plan.scene, plan.host))
    return [
        *unread,
        *alignment_warnings(plan),
        *_implausible(plan),
        *_unexpected(plan),
        *_overloaded(plan),
    ]


def _overloaded(plan: Plan | CheckedScene) -> list[str]:
    """Return the sensors whose links are not open for as long as all of their looks would take."""
    transmitters = {} if plan.links is None else plan.links.transmitters
    looks = np.bincount(plan.pairs.sensor, plan.pairs.looks, minlength=len(plan.sensors))
    end_ns = np.array([plan.end_ns])
    taken_s = {
        number: (each.service_ns * looks[number] * 1e-9, each.open_until_ns(end_ns)[0] * 1e-9)
        for number, each in transmitters.items()
    }
    return [
        f"links: {plan.sensors[number].id}: a report of each of its {looks[number]:.0f} looks at"
        f" targets would take {busy_s:.4g} s, and its link is open for {open_s:.4g} s; reports queue"
        for number, (busy_s, open_s) in taken_s.items()
        if busy_s > open_s
    ]


def launch_expectations(plan: Plan | CheckedScene) -> list[Mapping[str, Any]]:
    """Return the launches that the classifier and the tracker expect in the scene, where they have
    such a prior.
    """
    duration_s = plan.scene.duration_s
    launches = len(plan.scene.targets)
    models = (plan.scene.classification, plan.classifier), (plan.scene.tracker, plan.make_tracker())
    expected = [
        (f"{choice.path}: {choice.name}", model.expected_launches(duration_s))
        for choice, model in models
        if hasattr(model, "expected_launches")
    ]
    return [
        {"component": name, "expected_launches": float(mean), "launches": launches}
        for name, mean in expected
        if mean is not None
    ]


def _unexpected(plan: Plan | CheckedScene) -> list[str]:
    rows = [
        (row, sorted(max(row[key], 1.0) for key in _COUNTS)) for row in launch_expectations(plan)
    ]
    return [
        f"{expectation_text(row)}: its probabilities are those of a world with as many launches as"
        f" it expects; set its"
        " rate of launches"
        for row, (fewer, more) in rows
        if more >= _UNEXPECTED * fewer
    ]


def expectation_text(row: Mapping[str, Any]) -> str:
    """Return `classification: spectral expects 0.7 launches in the scene, which has 90`."""
    return (
        f"{row['component']} expects {row['expected_launches']:.2g} launches in the scene, which"
        f" has {row['launches']}"
    )


def _implausible(plan: Plan | CheckedScene) -> list[str]:
    if plan.scene.allow_implausible:
        return []
    values = implausible_values(plan.scene)
    more = (
        [f"and {len(values) - _LISTED_VALUES} more implausible values"]
        if len(values) > _LISTED_VALUES
        else []
    )
    return [
        *(f"{problem}; {REMEDY}" for problem in values[:_LISTED_VALUES]),
        *more,
        *map(str, _of_parts(plan)),
    ]


def _of_parts(plan: Plan | CheckedScene) -> list[Problem]:
    """Return the warnings of targets, detection model and orbits about their settings and files."""
    problems = [
        problem
        for component in (*plan.targets.trajectories, plan.detection)
        for problem in getattr(component, "warnings", ())
    ]
    for choice, sensor in zip(plan.scene.sensors, plan.sensors, strict=True):
        words = getattr(sensor.orbit, "warnings", ())
        problems += [Problem(f"{choice.model.path}.orbit", text) for text in words]
        problems += [Problem(choice.model.path, text) for text in _narrow_field(sensor)]
    return problems


def _narrow_field(sensor: Sensor) -> Iterator[str]:
    """Yield that a sensor's field of regard has next to nothing of the ground below its orbit, as a
    GEO's has in LEO.

    The largest share of half a day counts, for high orbits pass low over one hemisphere.
    """
    share, horizon_rad = _ground_in_field(sensor, np.zeros(1))
    if share < _LEAST_SHARE:
        try:
            share, horizon_rad = _ground_in_field(sensor, np.linspace(0.0, 43_200.0, 25))
        except ModelError:  # of elements that end within the half day
            return
    if share < _LEAST_SHARE:
        half_deg, horizon_deg = np.degrees((sensor.field_of_regard_half_angle_rad, horizon_rad))
        yield (
            f"its field of regard, {half_deg:.3g} deg about nadir, holds {share:.2%} of the ground"
            f" that it could see;"
            f" the horizon is at {horizon_deg:.3g} deg: set field_of_regard_half_angle_deg"
        )


def _ground_in_field(sensor: Sensor, time_s: FloatArray) -> tuple[float, float]:
    """Return the largest share of the ground in view that is in the field of regard, and the
    horizon then, rad from nadir; on a sphere."""
    radius_m = np.sqrt(np.square(sensor.orbit.position_ecef_m(time_s)).sum(axis=1))
    sine = np.minimum(EARTH_EQUATORIAL_RADIUS_M / radius_m, 1.0 - 1e-9)
    angle_rad = np.minimum(sensor.field_of_regard_half_angle_rad, np.arcsin(sine))
    ground_rad = np.arcsin(np.minimum(np.sin(angle_rad) / sine, 1.0)) - angle_rad
    share = (1.0 - np.cos(ground_rad)) / (1.0 - sine)
    row = int(share.argmax())
    return float(share[row]), float(np.arcsin(sine[row]))


def alignment_warnings(plan: Plan | CheckedScene) -> list[str]:
    """Return a warning, if launches ignite or burn out on scan instants of sensors that see them;
    else nothing.

    Only sensors with looks at whole periods of scene time count; other scan phases meet an event by
    chance alone.
    """
    pairs = plan.pairs
    targets = plan.targets
    is_aligned = _is_aligned(plan.sensors)
    is_launch = pairs.target < len(plan.scene.targets)
    looking = pairs.take(np.flatnonzero(is_aligned[pairs.sensor] & is_launch & (pairs.looks > 0)))
    met = np.zeros(len(looking), dtype=np.bool_)
    events = []
    for name, time_s in (("ignitions", targets.ignition_s), ("burnouts", targets.burnout_s)):
        is_met = _on_scan_instant(time_s[looking.target], looking.period_ns, plan.end_ns)
        met |= is_met
        events += [name] if is_met.any() else []
    if not events:
        return []
    sensors = _ids(np.unique(looking.sensor[met]), [sensor.id for sensor in plan.sensors])
    launches = _ids(np.unique(looking.target[met]), targets.ids)
    warning = (
        f"aligned scan phases: looks of {sensors} coincide with {' and '.join(events)} of"
        f" {launches}, so latencies show"
        " the scan phase, not the sensor; set scan_phase: random (aligned is the paper's"
        " convention)"
    )
    return [warning]


def aligned_pairs(
    sensors: Sequence[Sensor], targets: Targets, launches: int, end_ns: int
) -> BoolArray:
    """Return which pairs (sensors, targets) may be warned about, were they to have looks: those of
    the first `launches` targets that ignite or burn out on scan instants."""
    met = np.zeros((len(sensors), len(targets.ids)), dtype=np.bool_)
    is_aligned = _is_aligned(sensors)
    period_ns = np.array([sensor.scan.period_ns for sensor in sensors], np.int64)
    for period in np.unique(period_ns[is_aligned]):
        events = (targets.ignition_s[:launches], targets.burnout_s[:launches])
        of_period = np.any([_on_scan_instant(time_s, period, end_ns) for time_s in events], axis=0)
        met[is_aligned & (period_ns == period), :launches] = of_period
    return met


def _is_aligned(sensors: Sequence[Sensor]) -> BoolArray:
    return np.array([isinstance(sensor.scan, AlignedScan) for sensor in sensors], dtype=np.bool_)


def _on_scan_instant(time_s: FloatArray, period_ns: IntArray | int, end_ns: int) -> BoolArray:
    """Return which events (n,) of a run are at whole periods, within the tolerance."""
    periods = time_s * 1e9 / period_ns
    return (np.abs(periods - np.rint(periods)) <= TOLERANCE) & (time_s * 1e9 <= end_ns)


def _ids(numbers: IntArray, ids: Sequence[str]) -> str:
    """Return `A, B, C and 4 more`."""
    listed = ", ".join(ids[number] for number in numbers[:_LISTED].tolist())
    return listed if len(numbers) <= _LISTED else f"{listed} and {len(numbers) - _LISTED} more"
