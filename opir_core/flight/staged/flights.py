"""Flights of gravity turns from ignition to impact: solved, integrated and described as columns
over n targets.
"""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.flight.aiming import forces_on
from opir_core.flight.boost import launch_site
from opir_core.flight.dense_output import DenseArcs, StepRecorder
from opir_core.flight.forces import ForceModel
from opir_core.flight.staged.aiming import StagedSolution, solved
from opir_core.flight.staged.gravity_turn import Boosts, burnout
from opir_core.flight.staged.shots import StagedShots
from opir_core.flight.staged.staging import Staging
from opir_core.geometry import Geodetic, ecef_to_eci_state, geodetic_to_ecef


@frozen(eq=False, repr=False)
class StagedFlights:
    """The flights of n targets: columns (n,), vectors (n, 3), intervals (n, k, 2).

    `azimuth_rad` is clockwise from true north. `cut_off_s` is since ignition: that of the flight to
    the aim point, less the early shutdown; `earliest_s` and `latest_s` are its limits. ECI is ECEF
    frozen at scene epoch. `burns_s` are the scene times of ignition and burnout of each stage, nan
    where a target has fewer; `edges_s` (n, e) those at which the thrust is not smooth. `is_solved`
    says whether the aim point is reached without the early shutdown; `nearest_m` and `farthest_m`
    are about how far the stages fly with the best kick and the earliest and the latest cut-off;
    `apogees_m` (n, 4) are the limits of apogee (`opir_core.flight.staged.lofting.Launches`).
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
    burnout_position_eci_m: FloatArray
    burnout_velocity_eci_m_s: FloatArray
    burns_s: FloatArray
    edges_s: FloatArray
    nearest_m: FloatArray
    farthest_m: FloatArray
    apogees_m: FloatArray
    is_solved: BoolArray
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
    merged = dict[str, FloatArray]()
    for stages in np.unique(count).tolist():
        rows = np.flatnonzero(count == stages)
        own = [stagings[row] for row in rows.tolist()]
        start, end = (
            Geodetic(*(np.asarray(column)[rows] for column in place))
            for place in (launch, aim_point)
        )
        boosts = Boosts.of(launch_site(*start), own, forces)
        shots = StagedShots.of(boosts, own, geodetic_to_ecef(*end), end.height_m)
        own_forces = None if free is None else free.take(rows)
        solution = solved(shots, loft[rows], apogee_m[rows], own_forces)
        launches = solution.launches
        shots = evolve(
            shots, kick_rad=launches.kick_rad, fineness=launches.fineness, forces=own_forces
        )
        columns = _columns(
            shots, solution, ignition_s[rows], early_shutdown_s[rows], int(count.max())
        )
        for name, column in columns.items():
            whole = merged.setdefault(name, np.full((len(count), *column.shape[1:]), np.nan))
            whole[rows] = column
        burnout(
            boosts,
            launches.azimuth_rad,
            launches.kick_rad,
            columns["cut_off_s"],
            launches.fineness,
            recorder,
            rows,
        )
    is_solved = merged.pop("is_solved") > 0.0
    return StagedFlights(
        ignition_s=ignition_s, is_solved=is_solved, arcs=recorder.arcs(len(count)), **merged
    )


def _columns(
    shots: StagedShots,
    solution: StagedSolution,
    ignition_s: FloatArray,
    early_s: FloatArray,
    most_stages: int,
) -> dict[str, FloatArray]:
    """Return the columns of solved launches with one number of stages, by their names."""
    boosts = shots.boosts
    launches = solution.launches
    cut_off_s = launches.cut_off_s - early_s
    ecef = shots.burnout(launches.azimuth_rad, cut_off_s)
    landing = shots.landing(launches.azimuth_rad, cut_off_s)
    burnout_s = ignition_s + (cut_off_s + boosts.tail_off_s)
    eci = ecef_to_eci_state(*ecef, burnout_s)
    legs = list(boosts.legs(cut_off_s))
    edges_s = np.stack([ignition_s + leg.stop_s for leg in legs[:-1]], axis=1)
    ignitions_s = ignition_s + boosts.stages.ignition_s
    burnouts_s = np.concatenate(
        [ignitions_s[:-1] + boosts.stages.burn_time_s[:-1], burnout_s[None]]
    )
    burns_s = np.stack([ignitions_s, burnouts_s], axis=-1).transpose(1, 0, 2)
    lacking = most_stages - burns_s.shape[1]
    return {
        "azimuth_rad": np.remainder(launches.azimuth_rad, 2.0 * np.pi),
        "kick_rad": launches.kick_rad,
        "cut_off_s": cut_off_s,
        "earliest_s": shots.earliest_s,
        "latest_s": shots.latest_s,
        "burnout_s": burnout_s,
        "impact_s": burnout_s + landing.duration_s,
        "impact_ecef_m": landing.impact_ecef_m,
        "miss_m": landing.miss_m,
        "burnout_position_ecef_m": ecef[0],
        "burnout_velocity_ecef_m_s": ecef[1],
        "burnout_position_eci_m": eci[0],
        "burnout_velocity_eci_m_s": eci[1],
        "burns_s": np.pad(burns_s, ((0, 0), (0, lacking), (0, 0)), constant_values=np.nan),
        "edges_s": np.pad(edges_s, ((0, 0), (0, 3 * lacking)), constant_values=np.nan),
        "nearest_m": solution.nearest_m,
        "farthest_m": solution.farthest_m,
        "apogees_m": launches.apogees_m,
        "is_solved": launches.is_solved.astype(np.float64),
    }
