"""Changes of a running plan: added and removed targets. Looks and random numbers of the others do not change."""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.planning.plan import Plan, with_targets
from opir_core.planning.sightlines import Pairs, Sightlines
from opir_core.planning.targets import Targets


def with_added_targets(plan: Plan, added: Plan) -> Plan:
    """Return a plan with the targets of another, of the same sensors, after its own."""
    count = len(plan.targets.ids)
    shifted = evolve(added.pairs, target=(added.pairs.target + count).astype(np.int32))
    pairs = Pairs.concatenate([plan.pairs, shifted])
    order = np.lexsort((pairs.target, pairs.sensor))
    ours, theirs = plan.sightlines, added.sightlines
    lines = Sightlines(
        first_point=np.concatenate([ours.first_point, theirs.first_point + len(ours.travel_s)])[order],
        travel_s=np.concatenate([ours.travel_s, theirs.travel_s]),
        elevation_sine=np.concatenate([ours.elevation_sine, theirs.elevation_sine]),
        sight=np.concatenate([ours.sight, theirs.sight]),
    )
    scene = evolve(plan.scene, targets=(*plan.scene.targets, *added.scene.targets))
    targets = _joined_targets(plan.targets, added.targets)
    return with_targets(evolve(plan, scene=scene), targets, pairs.take(order), lines)


def without_finished_targets(plan: Plan, time_ns: int) -> Plan:
    """Return a plan without the targets that no sensor looks at from a time on."""
    stays = is_active(plan, time_ns)
    if stays.all():
        return plan
    kept = np.flatnonzero(stays)
    number = np.cumsum(stays) - 1
    rows = np.flatnonzero(stays[plan.pairs.target])
    pairs = plan.pairs.take(rows)
    lines = _lines_of(pairs, plan.sightlines, rows)
    pairs = evolve(pairs, target=number[pairs.target].astype(np.int32))
    ids = {plan.targets.ids[row] for row in kept.tolist()}
    scene = evolve(plan.scene, targets=tuple(target for target in plan.scene.targets if target.id in ids))
    return with_targets(evolve(plan, scene=scene), _kept_targets(plan.targets, kept), pairs, lines)


def is_active(plan: Plan, time_ns: int) -> BoolArray:
    """Return which targets (n,) are not launched yet, or are still looked at by a sensor, at a time."""
    stays: BoolArray = plan.targets.ignition_s * 1e9 >= time_ns
    going = (plan.pairs.looks > 0) & ~plan.pairs.is_over(time_ns)
    stays[plan.pairs.target[going]] = True
    return stays


def _joined_targets(ours: Targets, theirs: Targets) -> Targets:
    return Targets(
        ids=(*ours.ids, *theirs.ids),
        type_code=np.concatenate([ours.type_code, theirs.type_code]),
        ignition_s=np.concatenate([ours.ignition_s, theirs.ignition_s]),
        burnout_s=np.concatenate([ours.burnout_s, theirs.burnout_s]),
        end_s=np.concatenate([ours.end_s, theirs.end_s]),
        trajectories=(*ours.trajectories, *theirs.trajectories),
        group=np.concatenate([ours.group, theirs.group + np.int32(len(ours.trajectories))]),
        place=np.concatenate([ours.place, theirs.place]),
    )


def _kept_targets(targets: Targets, kept: IntArray) -> Targets:
    """Return some of the targets, without trajectories that none of them uses."""
    groups, group = np.unique(targets.group[kept], return_inverse=True)
    return Targets(
        ids=tuple(targets.ids[row] for row in kept.tolist()),
        type_code=targets.type_code[kept],
        ignition_s=targets.ignition_s[kept],
        burnout_s=targets.burnout_s[kept],
        end_s=targets.end_s[kept],
        trajectories=tuple(targets.trajectories[number] for number in groups.tolist()),
        group=group.astype(np.int32),
        place=targets.place[kept],
    )


def _lines_of(pairs: Pairs, lines: Sightlines, rows: IntArray) -> Sightlines:
    """Return the lines of sight of some pairs (given with their rows), over the time of their looks."""
    first_step = _step(pairs, pairs.first_scan)
    points = np.where(pairs.looks > 0, _step(pairs, pairs.last_scan) - first_step + 2, 0)
    offset = np.cumsum(points) - points
    within = np.arange(int(points.sum())) - np.repeat(offset, points)
    chosen = np.repeat(lines.first_point[rows] + first_step, points) + within
    return Sightlines(
        first_point=offset - first_step,
        travel_s=lines.travel_s[chosen],
        elevation_sine=lines.elevation_sine[chosen],
        sight=lines.sight[chosen],
    )


def _step(pairs: Pairs, scan: IntArray) -> IntArray:
    """Return the grid step of scans (n,) of pairs (n,), as in `Sightlines.place`."""
    time_s: FloatArray = (pairs.phase_ns + scan * pairs.period_ns).astype(np.float64) * 1e-9
    return np.floor(time_s).astype(np.int64)


def scan_generations(plan: Plan, former: Plan) -> tuple[int, ...]:
    """Return the generation of each sensor's scans: one more if the scan times have changed.

    Scans of a new generation are numbered anew and must not share random numbers or ids with earlier ones. Both plans
    have the same sensors and targets.
    """
    differs = (plan.pairs.period_ns != former.pairs.period_ns) | (plan.pairs.phase_ns != former.pairs.phase_ns)
    sensors: IndexArray = plan.pairs.sensor[differs]
    moved = set(sensors.tolist())
    sensors_now = enumerate(zip(plan.sensors, former.sensors, strict=True))
    moved |= {row for row, (now, before) in sensors_now if now.scan.period_ns != before.scan.period_ns}
    numbers = former.scan_generations or (0,) * len(plan.sensors)
    return tuple(number + (row in moved) for row, number in enumerate(numbers)) if moved else former.scan_generations
