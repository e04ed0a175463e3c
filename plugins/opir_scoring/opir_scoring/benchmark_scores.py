"""Scores of tracks on a benchmark set of scenes: assignment, GOSPA, proper scores, consistency,
error over the bound.

At each tick estimates are assigned to launches one to one, with the least sum of squared distances,
each cut off at the scene's distance. A track's launch is the one to which it is assigned most
often; its rows at ticks at which this launch is not scored are left out. A track is false if it has
no launch, or is assigned at less than half of its rows. A launch's state at a tick is that of its
track with the most assigned rows, however far off it is then.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import BAD_DATA, Problem, SceneError
from opir_scoring.benchmark_tables import DESCRIPTION, STATE, SetTracks, numbers, read_table
from opir_scoring.containments import nees
from opir_scoring.gospa_metric import gospa
from opir_scoring.proper_scores import energy_scores, normal_log_scores

#: Columns of the scores of a scene's states.
MEASURES = (
    *("position_m", "velocity_m_s", "energy_m", "log_score", "nees"),
    *("bound_m", "free_bound_m", "bound_energy_m", "bound_log_score"),
)


#: The keys of a set's description.
_NEEDED = {"set", "version", "cases", "scenes", "tick_s"}
#: The most ticks of all launches of a scene.
_MOST_TICKS = 10_000_000


@frozen(eq=False)
class SetTruth:
    """The truth of a scene: states (launches, ticks, 6), nan before ignition, and bounds, nan where
    nothing is scored.

    `bounds` (launches, ticks, 4) are of position, of position with unknown thrust, the expected
    energy score of position, m, and the logarithm of the determinant of the bound's covariance.
    """

    name: str
    case: str
    cutoff_m: float
    tick_s: FloatArray
    state: FloatArray
    bounds: FloatArray

    @property
    def is_scored(self) -> Any:
        """Whether launches are scored at ticks (launches, ticks)."""
        return np.isfinite(self.bounds[:, :, 0])


@frozen(eq=False)
class SetScores:
    """The scores of one scene: a column per name in `MEASURES` over the states, and counts.

    `gospa_m` is per tick, over the number of scored launches to the power 1/2; `scored` counts
    launches and ticks.
    """

    case: str
    launches: int
    scored: int
    false_tracks: int
    missed_launches: int
    cutoff_m: float
    gospa_m: FloatArray
    states: Mapping[str, FloatArray]


def read_set(folder: Path, cases: Sequence[str] = ()) -> tuple[Mapping[str, Any], list[SetTruth]]:
    """Return the description of a set and the truth of its scenes, of some cases or all; raises
    `SceneError` where its files cannot be read.
    """
    try:
        return _set_in(folder, cases)
    except (OSError, *BAD_DATA) as error:
        problem = Problem("", f"is no benchmark set, or a damaged one: {error}")
        raise SceneError([problem], source=str(folder)) from error


def _set_in(folder: Path, cases: Sequence[str]) -> tuple[Mapping[str, Any], list[SetTruth]]:
    """Return what `read_set` returns; raises what damaged files lead to."""
    description = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    if lacking := sorted(_NEEDED - set(description)):
        raise ValueError(f"{DESCRIPTION} lacks {', '.join(lacking)}")
    if unknown := sorted(set(cases) - set(description["cases"])):
        words = f"no case {unknown[0]!r} in the set, which has {', '.join(description['cases'])}"
        raise SceneError([Problem("--case", words)], source="command line")
    tables = {name: _table(folder / f"{name}.csv") for name in ("truth", "bounds")}
    scenes = [scene for scene in description["scenes"] if not cases or scene["case"] in cases]
    return description, [_truth(scene, tables, description["tick_s"]) for scene in scenes]


def _table(path: Path) -> dict[str, Any]:
    """Return the columns of a table of the set: names as text, all else as numbers."""
    raw = read_table(path)
    names = {name: np.array(raw[name]) for name in ("scene", "launch")}
    return names | {name: numbers(path, raw, name) for name in raw if name not in names}


def _truth(
    scene: Mapping[str, Any], tables: Mapping[str, dict[str, Any]], step_s: float
) -> SetTruth:
    ticks = round(scene["end_s"] / step_s)
    if scene["launches"] * ticks > _MOST_TICKS:
        raise ValueError(f"{scene['launches']} launches of {ticks} ticks are more than are read")

    def values(name: str, columns: Sequence[str]) -> FloatArray:
        table = tables[name]
        rows = np.flatnonzero(table["scene"] == scene["scene"])
        launch = [int(label[1:]) - 1 for label in table["launch"][rows]]
        tick = np.round(table["time_s"][rows] / step_s).astype(np.int64) - 1
        grid = np.full((scene["launches"], ticks, len(columns)), np.nan)
        grid[np.array(launch, dtype=np.int64), tick] = np.stack(
            [table[column][rows] for column in columns], axis=1
        )
        return grid

    state = values("truth", STATE)
    bounds = values("bounds", ("position_m", "free_position_m", "energy_m", "log_det"))
    if np.isnan(state[np.isfinite(bounds[:, :, 0])]).any():
        raise ValueError("truth.csv lacks a state where bounds.csv has a bound")
    return SetTruth(
        name=scene["scene"],
        case=scene["case"],
        cutoff_m=scene["cutoff_m"],
        tick_s=step_s * np.arange(1, ticks + 1),
        state=state,
        bounds=bounds,
    )


class _Rows(NamedTuple):
    """Rows (n,) of tracks in a scene: the row in the file, the track by number, the tick, and the
    launch to which the estimate is assigned, -1 for none.
    """

    row: IntArray
    track: IntArray
    tick: IntArray
    assigned: IntArray

    def take(self, rows: IntArray) -> "_Rows":
        """Return some of the rows."""
        return _Rows(*(column[rows] for column in self))


def _rows_of(truth: SetTruth, tracks: SetTracks) -> _Rows:
    rows = tracks.rows_of(truth.name)
    rows = rows[tracks.time_s[rows] <= truth.tick_s[-1] + 1e-6]
    tick = np.round(tracks.time_s[rows] / truth.tick_s[0]).astype(np.int64) - 1
    names = np.array([tracks.track[row] for row in rows.tolist()], dtype=np.str_)
    track = np.unique(names, return_inverse=True)[1]
    return _Rows(rows, track, tick, _assigned(truth, tracks.state[rows], tick))


def scene_scores(truth: SetTruth, tracks: SetTracks) -> SetScores:
    """Return the scores of a scene."""
    rows = _rows_of(truth, tracks)
    owner, is_scored = _owners(truth, rows)
    scored = rows.take(np.flatnonzero(is_scored))
    in_force = _in_force(rows, owner, is_scored)
    launch = owner[in_force.track]
    return SetScores(
        case=truth.case,
        launches=len(truth.state),
        scored=int(truth.is_scored.sum()),
        false_tracks=len(np.setdiff1d(scored.track, in_force.track)),
        missed_launches=_missed(truth, launch),
        cutoff_m=truth.cutoff_m,
        gospa_m=_gospa(truth, tracks.state[scored.row], scored.tick),
        states=_states(truth, tracks, in_force, launch),
    )


def _missed(truth: SetTruth, launch: IntArray) -> int:
    """Return the number of scored launches that are not among those of the states in force."""
    return len(np.setdiff1d(np.flatnonzero(truth.is_scored.any(axis=1)), launch))


def _assigned(truth: SetTruth, state: FloatArray, tick: IntArray) -> IntArray:
    """Return the launch (n,) to which each estimate is assigned at its tick, -1 for none."""
    assigned = np.full(len(state), -1, dtype=np.int64)
    for number in np.unique(tick).tolist():
        rows = np.flatnonzero(tick == number)
        true = truth.state[:, number, :3]
        flying = np.flatnonzero(np.isfinite(true[:, 0]))
        pairs = gospa(state[rows, :3], true[flying], cutoff=truth.cutoff_m).assigned
        assigned[rows[pairs[:, 0]]] = flying[pairs[:, 1]]
    return assigned


def _owners(truth: SetTruth, rows: _Rows) -> tuple[IntArray, BoolArray]:
    """Return the launch of each track (tracks,), -1 if it is false, and whether rows (n,) are
    scored.
    """
    tracks = int(rows.track.max(initial=-1)) + 1
    is_assigned = rows.assigned >= 0
    count = np.zeros((tracks, len(truth.state)), dtype=np.int64)
    np.add.at(count, (rows.track[is_assigned], rows.assigned[is_assigned]), 1)
    owner = np.where(count.max(axis=1, initial=0) > 0, count.argmax(axis=1), -1)
    launch = owner[rows.track]
    is_scored_tick = truth.is_scored.any(axis=0)[rows.tick]
    is_scored = np.where(launch >= 0, truth.is_scored[launch, rows.tick], is_scored_tick)
    scored, assigned = (
        np.bincount(rows.track[marked], minlength=tracks)
        for marked in (is_scored, is_scored & is_assigned)
    )
    return np.where(2 * assigned < scored, -1, owner), is_scored


def _in_force(rows: _Rows, owner: IntArray, is_scored: BoolArray) -> _Rows:
    """Return the row in force for each launch and tick: of the track with the most assigned
    rows.
    """
    launch = owner[rows.track]
    held = np.bincount(rows.track[rows.assigned >= 0], minlength=len(owner))[rows.track]
    order = np.lexsort((-held, rows.tick, launch))
    order = order[(is_scored & (launch >= 0))[order]]
    is_in_force = np.ones(len(order), dtype=np.bool_)
    is_in_force[1:] = (np.diff(launch[order]) != 0) | (np.diff(rows.tick[order]) != 0)
    return rows.take(order[is_in_force])


def _gospa(truth: SetTruth, state: FloatArray, tick: IntArray) -> FloatArray:
    """Return GOSPA of positions at each tick with scored launches, over the square root of their
    number.
    """
    distances = []
    for number in np.flatnonzero(truth.is_scored.any(axis=0)).tolist():
        scored = truth.state[truth.is_scored[:, number], number, :3]
        distance = gospa(state[tick == number, :3], scored, cutoff=truth.cutoff_m).distance
        distances.append(distance / np.sqrt(len(scored)))
    return np.array(distances, dtype=np.float64)


def _states(
    truth: SetTruth, tracks: SetTracks, rows: _Rows, launch: IntArray
) -> Mapping[str, FloatArray]:
    """Return the columns `MEASURES` of the states in force."""
    error = tracks.state[rows.row] - truth.state[launch, rows.tick]
    covariance = tracks.covariance[rows.row]
    bound = truth.bounds[launch, rows.tick]
    # Of an efficient estimate: half of a NEES of 6, and its covariance's determinant.
    expected = 0.5 * (6.0 + bound[:, 3] + 6.0 * np.log(2.0 * np.pi))
    return {
        "position_m": np.sqrt(np.sum(error[:, :3] ** 2, axis=1)),
        "velocity_m_s": np.sqrt(np.sum(error[:, 3:] ** 2, axis=1)),
        "energy_m": energy_scores(error, covariance, components=slice(0, 3)),
        "log_score": normal_log_scores(error, covariance),
        "nees": nees(error, covariance),
        "bound_m": bound[:, 0],
        "free_bound_m": bound[:, 1],
        "bound_energy_m": bound[:, 2],
        "bound_log_score": expected,
    }
