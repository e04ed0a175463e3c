"""The target model `gravity-turn`: staged boosts with dark gaps, then free flight."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import define, evolve

from opir_core.arrays import FloatArray
from opir_core.builtin.class_flights import (
    EPHEMERIS_TOLERANCE_M,
    ClassFlights,
    aims_of,
    classes_of,
    forces_of_targets,
    ignitions_s,
    plain_place,
    plain_places,
    plain_states,
    refuse,
)
from opir_core.builtin.target_models import GravityTurnConfig
from opir_core.errors import Problem
from opir_core.flight.burns import plain_gaps_s
from opir_core.flight.ephemeris import Ephemeris
from opir_core.flight.forces import ForceModel
from opir_core.flight.free_flight import free_flight_ephemeris
from opir_core.flight.staged.flights import StagedFlights, staged_flights
from opir_core.flight.staged.staging import (
    Stage,
    Staging,
    staging_for,
    stagings,
    stagings_of_classes,
)
from opir_core.geometry import ecef_to_eci_state
from opir_core.interfaces.contexts import TargetContext
from opir_core.interfaces.trajectories import Trajectories
from opir_core.scene.target_classes import Ballistic, TargetClass, core_profiles


@define(eq=False, kw_only=True, repr=False)
class GravityTurnTargets(ClassFlights):
    """Targets from ignition to burnout, or to impact; `profiles` are the class profiles that stand
    for their plumes.
    """

    flights: StagedFlights
    configs: tuple[GravityTurnConfig, ...]
    stagings: tuple[Staging, ...]

    @property
    def burns_s(self) -> FloatArray:
        """Scene times (n, k, 2) of ignition and burnout of each stage, nan where a target has
        fewer.
        """
        return self.flights.burns_s

    def truth(self) -> Sequence[Mapping[str, Any]]:
        """Return one mapping a target: settings, stages, gaps, burnout and impact.

        Velocities are relative to the rotating Earth; heights are above the WGS 84 ellipsoid; times
        are scene times.
        """
        flights = self.flights
        burnout = plain_states(flights.burnout_position_ecef_m, flights.burnout_velocity_ecef_m_s)
        impact = plain_places(flights.impact_ecef_m)
        return [
            {
                "id": self.ids[row],
                "type": config.type,
                "profile": staging.profile,
                "staging": staging.name,
                "launch": plain_place(config.launch),
                "aim": plain_place(config.aim),
                **(
                    {"loft": config.loft}
                    if config.apogee_km is None
                    else {"apogee_km": config.apogee_km}
                ),
                "early_shutdown_s": config.early_shutdown_s,
                "azimuth_deg": float(np.degrees(flights.azimuth_rad[row])),
                "kick_deg": float(np.degrees(flights.kick_rad[row])),
                **_recorded_times(flights, row),
                "burnout": burnout[row],
                "impact": {**impact[row], "time_s": float(flights.impact_s[row])},
                "miss_m": float(flights.miss_m[row]),
            }
            for row, (config, staging) in enumerate(zip(self.configs, self.stagings, strict=True))
        ]


def _recorded_times(flights: StagedFlights, row: int) -> Mapping[str, Any]:
    """Return ignition and burnout of a target, those of its stages, and its dark gaps."""
    burns = flights.burns_s[row]
    burns = burns[np.isfinite(burns[:, 0])]
    return {
        "ignition_s": float(flights.ignition_s[row]),
        "burnout_s": float(flights.burnout_s[row]),
        "stages": [{"ignition_s": start, "burnout_s": end} for start, end in burns.tolist()],
        "gaps_s": plain_gaps_s(burns),
    }


def gravity_turn_targets(
    configs: Sequence[GravityTurnConfig], context: TargetContext
) -> Trajectories:
    """Return the trajectories of all targets of the model.

    Raises `SceneError` with a problem for each target whose stages are impossible or do not reach
    its aim point.
    """
    launch, aim_point, range_m = aims_of(configs)
    classes = classes_of(configs, context, Ballistic.model, "gravity-turn")
    flown = _stagings(configs, classes, range_m, context.paths)
    loft, early_s = (
        np.array([getattr(config, name) for config in configs], dtype=np.float64)
        for name in ("loft", "early_shutdown_s")
    )
    ignition_s = ignitions_s(configs)
    forces = forces_of_targets(configs, context)
    apogee_m = 1e3 * np.array([config.apogee_km for config in configs], dtype=np.float64)
    flights = staged_flights(launch, aim_point, ignition_s, flown, loft, early_s, forces, apogee_m)
    refuse(_problems(configs, flown, flights, range_m, context.paths))
    end_s = flights.burnout_s
    edges_s = flights.edges_s
    return GravityTurnTargets(
        classes=classes,
        profiles=tuple(core_profiles()[staging.profile] for staging in flown),
        ids=context.ids,
        ignition_s=ignition_s,
        burnout_s=end_s,
        final_s=flights.impact_s,
        turns_s=edges_s,
        boost=Ephemeris.build(flights.state, ignition_s, end_s, edges_s, EPHEMERIS_TOLERANCE_M),
        coast=_coast(flights, forces) if context.free_flight else None,
        flights=flights,
        configs=tuple(configs),
        stagings=flown,
    )


def _coast(flights: StagedFlights, forces: ForceModel) -> Ephemeris:
    states = ecef_to_eci_state(
        flights.burnout_position_ecef_m, flights.burnout_velocity_ecef_m_s, flights.burnout_s
    )
    spans = flights.burnout_s, flights.impact_s
    return free_flight_ephemeris(*spans, *states, forces=forces, tolerance_m=EPHEMERIS_TOLERANCE_M)


def _stagings(
    configs: Sequence[GravityTurnConfig],
    classes: Sequence[TargetClass],
    range_m: FloatArray,
    paths: Sequence[str],
) -> tuple[Staging, ...]:
    """Return the staging of each target; raises `SceneError` for unknown and impossible ones."""
    problems = list[Problem]()
    flown = list[Staging]()
    for config, kind, distance_m, path in zip(
        configs, classes, range_m.tolist(), paths, strict=True
    ):
        presets = kind.own(stagings_of_classes()) or tuple(stagings().values())
        if config.staging is not None and config.staging not in stagings():
            names = ", ".join(stagings())
            problems.append(
                Problem(f"{path}.staging", f"no staging {config.staging!r}; there are {names}")
            )
            continue
        preset = (
            staging_for(presets, distance_m)
            if config.staging is None
            else stagings()[config.staging]
        )
        staging = _with_settings(preset, config)
        fault = staging.fault()
        if fault:
            problems.append(Problem(f"{path}.stages", fault))
        flown.append(staging)
    refuse(problems)
    return tuple(flown)


def _with_settings(preset: Staging, config: GravityTurnConfig) -> Staging:
    """Return a preset with what a target sets itself."""
    settings: dict[str, Any] = {
        "vertical_rise_s": config.vertical_rise_s,
        "pitch_over_s": config.pitch_over_s,
        "tail_off_s": config.tail_off_s,
        "ballistic_coefficient_kg_m2": config.boost_ballistic_coefficient_kg_m2,
    }
    if config.stages:
        settings["name"] = "own"
        settings["stages"] = tuple(
            Stage(stage.burn_time_s, stage.ideal_speed_m_s, stage.growth, stage.gap_s)
            for stage in config.stages
        )
    return evolve(preset, **{name: value for name, value in settings.items() if value is not None})


def _problems(
    configs: Sequence[GravityTurnConfig],
    flown: Sequence[Staging],
    flights: StagedFlights,
    range_m: FloatArray,
    paths: Sequence[str],
) -> list[Problem]:
    """Return the problems of targets that cannot fly as configured."""
    problems = []
    for row, (config, staging, path) in enumerate(zip(configs, flown, paths, strict=True)):
        if not flights.is_solved[row]:
            problems.append(_out_of_reach(config, staging, flights, row, float(range_m[row]), path))
        elif flights.cut_off_s[row] < flights.earliest_s[row]:
            most_s = config.early_shutdown_s + float(
                flights.cut_off_s[row] - flights.earliest_s[row]
            )
            words = f"the last burn cannot be cut off so early; at most {most_s:.3g} s are possible"
            problems.append(Problem(f"{path}.early_shutdown_s", words))
    return problems


def _out_of_reach(
    config: GravityTurnConfig,
    staging: Staging,
    flights: StagedFlights,
    row: int,
    range_m: float,
    path: str,
) -> Problem:
    """Return the problem of a target whose stages do not reach its aim point, or not with its
    apogee or loft.
    """
    distance = f"the aim point is {range_m / 1e3:.0f} km from the launch point"
    stages = "the stages given" if config.stages else f"the stages of {staging.name}"
    apogees = _apogee_words(flights.apogees_m[row])
    if config.apogee_km is not None and apogees:
        return Problem(
            f"{path}.apogee_km", f"{distance}; {stages} reach it with an apogee of {apogees}"
        )
    nearest_km = flights.nearest_m[row] / 1e3
    farthest_km = flights.farthest_m[row] / 1e3
    if config.loft < 0.0 and range_m <= flights.farthest_m[row]:
        words = (
            f"{distance}; {stages} have no flat flight to it, their flights of least energy go"
            f" {nearest_km:.0f} to"
        )
        return Problem(
            f"{path}.loft",
            f"{words} {farthest_km:.0f} km in its direction; lofts of 0 to 1 are steep ones",
        )
    if range_m < flights.nearest_m[row] or range_m < 0.98 * flights.farthest_m[row]:
        return Problem(
            f"{path}.loft",
            f"{distance}; no flight with this loft was found; another loft may reach it",
        )
    words = f"{distance}; {stages} fly at most about {farthest_km:.0f} km in its direction"
    return Problem(
        f"{path}.aim", f"{words}; a nearer aim point, another staging or more speed is in reach"
    )


def _apogee_words(apogees_m: FloatArray) -> str:
    """Return the intervals of apogees in reach, or "" without any."""
    flattest, flat, steep, steepest = (apogees_m / 1e3).tolist()
    intervals = [(flattest, flat), (steep, steepest)]
    if flat == steep:
        intervals = [(flattest, steepest)]
    return " or ".join(f"{low:.0f} to {high:.0f} km" for low, high in intervals if low <= high)
