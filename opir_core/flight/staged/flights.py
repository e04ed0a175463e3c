"""Flights of gravity turns from ignition to impact: solved, integrated and described as columns
over n targets.
"""

from collections.abc import Sequence

import numpy as np
from attrs import asdict, evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.aiming import forces_on
from opir_core.flight.boost import launch_site
from opir_core.flight.dense_output import DenseArcs, StepRecorder
from opir_core.flight.forces import ForceModel
from opir_core.flight.rows import Rows
from opir_core.flight.staged.aiming import StagedSolution, solved
from opir_core.flight.staged.gravity_turn import Boosts, burnout
from opir_core.flight.staged.shots import StagedShots
from opir_core.flight.staged.staging import Staging
from opir_core.geometry import Geodetic, geodetic_to_ecef


@frozen(eq=False, repr=False)
class StagedColumns(Rows):
    """The flights of n targets: columns (n,), vectors (n, 3), intervals (n, k, 2).

    `azimuth_rad` is clockwise from true north. `cut_off_s` is since ignition: that of the flight to
    the aim point, less the early shutdown; `earliest_s` and `latest_s` are its limits. `burns_s`
    are the scene times of ignition and burnout of each stage, nan where a target has fewer;
    `edges_s` (n, e) those at which the thrust is not smooth. `is_solved` says whether the aim point
    is reached without the early shutdown; `nearest_m` and `farthest_m` are about how far the stages
    fly with the best kick and the earliest and the latest cut-off; `apogees_m` (n, 4) are the
    limits of apogee (`opir_core.flight.staged.lofting.Launches`).
    """

    azimuth_rad: FloatArray
    kick_rad: FloatArray
    cut_off_s: FloatArray
    earliest_s: FloatArray
    latest_s: FloatArray
    ignition_s: FloatArray
    burnout_s: FloatArray
    impact_s: FloatArray
    impact_ecef_m: FloatArray
    miss_m: FloatArray
    burnout_position_ecef_m: FloatArray
    burnout_velocity_ecef_m_s: FloatArray
    burns_s: FloatArray
    edges_s: FloatArray
    nearest_m: FloatArray
    farthest_m: FloatArray
    apogees_m: FloatArray
    is_solved: BoolArray


@frozen(eq=False, repr=False)
class StagedFlights(StagedColumns):
    """Flights with their boosts as arcs."""

    arcs: DenseArcs

    def state(self, target: RowArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ECEF positions and velocities relative to the Earth (m, 3) in the boosts of
        targets at times (m,).
        """
        elapsed_s = np.clip(time_s - self.ignition_s[target], 0.0, self.arcs.end_s(target))
        return self.arcs.state(target, elapsed_s)


def staged_flights(
    launch: Geodetic,
    aim_point: Geodetic,
    ignition_s: FloatArray,
    stagings: Sequence[Staging],
    loft: FloatArray,
    early_shutdown_s: FloatArray,
    forces: ForceModel = "kepler",
    apogee_m: FloatArray | None = None,
) -> StagedFlights:
    """Return the flights of n targets with one staging each; places, times and settings are columns
    (n,).

    `forces` act from burnout to impact; during the boost act their gravity, and drag in their air
    or, without drag, in an exponential atmosphere. Where apogees `apogee_m` are given and not nan,
    they count instead of the loft; see `opir_core.flight.staged.lofting`.
    """
    if apogee_m is None:
        apogee_m = np.full_like(loft, np.nan)
    count = np.array([len(staging.stages) for staging in stagings])
    free = forces_on(forces, len(stagings))
    recorder = StepRecorder()
    groups = []
    targets = []
    for stages in np.unique(count).tolist():
        rows = np.flatnonzero(count == stages)
        group = [stagings[row] for row in rows.tolist()]
        start, end = (
            Geodetic(*(np.asarray(column)[rows] for column in place))
            for place in (launch, aim_point)
        )
        boosts = Boosts.of(launch_site(*start), group, forces)
        shots = StagedShots.of(boosts, group, geodetic_to_ecef(*end), end.height_m)
        group_forces = None if free is None else free.take(rows)
        solution = solved(shots, loft[rows], apogee_m[rows], group_forces)
        launches = solution.launches
        shots = evolve(
            shots, kick_rad=launches.kick_rad, fineness=launches.fineness, forces=group_forces
        )
        cut_off_s = launches.cut_off_s - early_shutdown_s[rows]
        boost = launches.azimuth_rad, launches.kick_rad, cut_off_s, launches.fineness
        burnout(boosts, *boost, recorder, rows)
        groups.append(_flown(shots, solution, cut_off_s, ignition_s[rows], int(count.max())))
        targets.append(rows)
    columns = StagedColumns.concatenate(groups).take(np.argsort(np.concatenate(targets)))
    return StagedFlights(**asdict(columns, recurse=False), arcs=recorder.arcs(len(count)))


def _flown(
    shots: StagedShots,
    solution: StagedSolution,
    cut_off_s: FloatArray,
    ignition_s: FloatArray,
    stage_count: int,
) -> StagedColumns:
    """Return the flights of solved launches with one number of stages, padded to `stage_count`."""
    launches = solution.launches
    position_m, velocity_m_s = shots.burnout(launches.azimuth_rad, cut_off_s)
    landing = shots.landing(launches.azimuth_rad, cut_off_s)
    burnout_s = ignition_s + (cut_off_s + shots.boosts.tail_off_s)
    stages = shots.boosts.stages
    ignitions_s = ignition_s + stages.ignition_s
    burnouts_s = np.concatenate([ignitions_s[:-1] + stages.burn_time_s[:-1], burnout_s[None]])
    burns_s = np.stack([ignitions_s, burnouts_s], axis=-1).transpose(1, 0, 2)
    legs = list(shots.boosts.legs(cut_off_s))
    edges_s = np.stack([ignition_s + leg.stop_s for leg in legs[:-1]], axis=1)
    lacking = stage_count - burns_s.shape[1]
    return StagedColumns(
        azimuth_rad=np.remainder(launches.azimuth_rad, 2.0 * np.pi),
        kick_rad=launches.kick_rad,
        cut_off_s=cut_off_s,
        earliest_s=shots.earliest_s,
        latest_s=shots.latest_s,
        ignition_s=ignition_s,
        burnout_s=burnout_s,
        impact_s=burnout_s + landing.duration_s,
        impact_ecef_m=landing.impact_ecef_m,
        miss_m=landing.miss_m,
        burnout_position_ecef_m=position_m,
        burnout_velocity_ecef_m_s=velocity_m_s,
        burns_s=np.pad(burns_s, ((0, 0), (0, lacking), (0, 0)), constant_values=np.nan),
        edges_s=np.pad(edges_s, ((0, 0), (0, 3 * lacking)), constant_values=np.nan),
        nearest_m=solution.nearest_m,
        farthest_m=solution.farthest_m,
        apogees_m=launches.apogees_m,
        is_solved=launches.is_solved,
    )
