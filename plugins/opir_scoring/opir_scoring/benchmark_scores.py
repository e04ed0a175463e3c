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
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import Problem, SceneError
from opir_scoring.benchmark_tables import DESCRIPTION, STATE, SetTracks, numbers, read_table
from opir_scoring.containments import nees
from opir_scoring.gospa_metric import gospa
from opir_scoring.proper_scores import energy_scores, normal_log_scores

#: Columns of the states of a scene, by what is scored.
MEASURES = (
    *("position_m", "velocity_m_s", "energy_m", "log_score", "nees"),
    *("bound_m", "free_bound_m", "bound_energy_m", "bound_log_score"),
)


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
        """Return at which ticks launches are scored (launches, ticks)."""
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
    """Return the description of a set and the truth of its scenes, of some cases or all."""
    try:
        description = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(
            [Problem("", f"is no benchmark set: {error}")], source=str(folder)
        ) from error
    if unknown := sorted(set(cases) - set(description["cases"])):
        words = f"no case {unknown[0]!r} in the set, which has {', '.join(description['cases'])}"
        raise SceneError([Problem("--case", words)], source="command line")
    tables = {name: _table(folder / f"{name}.csv") for name in ("truth", "bounds")}
    scenes = [each for each in description["scenes"] if not cases or each["case"] in cases]
    return description, [_truth(each, tables, description["tick_s"]) for each in scenes]


def _table(path: Path) -> dict[str, Any]:
    """Return the columns of a table of the set: names as text, all else as numbers."""
    raw = read_table(path)
    names = {name: np.array(raw[name]) for name in ("scene", "launch")}
    return names | {name: numbers(path, raw, name) for name in raw if name not in names}


def _truth(
    scene: Mapping[str, Any], tables: Mapping[str, dict[str, Any]], step_s: float
) -> SetTruth:
    ticks = round(scene["end_s"] / step_s)
    filled = {}
    columns = {"truth": STATE, "bounds": ("position_m", "free_position_m", "energy_m", "log_det")}
    for name, wanted in columns.items():
        table = tables[name]
        values = np.full((scene["launches"], ticks, len(wanted)), np.nan)
        rows = np.flatnonzero(table["scene"] == scene["scene"])
        launch = np.array([int(each[1:]) - 1 for each in table["launch"][rows]], dtype=np.int64)
        tick = np.round(table["time_s"][rows] / step_s).astype(np.int64) - 1
        values[launch, tick] = np.stack([table[column][rows] for column in wanted], axis=1)
        filled[name] = values
    tick_s = step_s * np.arange(1, ticks + 1)
    return SetTruth(
        scene["scene"], scene["case"], scene["cutoff_m"], tick_s, filled["truth"], filled["bounds"]
    )


def scene_scores(truth: SetTruth, tracks: SetTracks) -> SetScores:
    """Return the scores of a scene."""
    rows = tracks.rows_of(truth.name)
    rows = rows[tracks.time_s[rows] <= truth.tick_s[-1] + 1e-6]
    tick = np.round(tracks.time_s[rows] / truth.tick_s[0]).astype(np.int64) - 1
    names = sorted({tracks.track[row] for row in rows})
    number = np.array([names.index(tracks.track[row]) for row in rows], dtype=np.int64)
    assigned = _assigned(truth, tracks.state[rows], tick)
    owner, is_kept = _owners(truth, number, tick, assigned, len(names))
    held = np.array(
        [np.count_nonzero((number == each) & (assigned >= 0)) for each in range(len(names))]
    )
    chosen = _in_force(owner[number], tick, is_kept & (owner[number] >= 0), held[number])
    in_use = {int(each) for each in number[chosen]}
    launches = set(owner[number[chosen]].tolist())
    kept = np.flatnonzero(is_kept)
    return SetScores(
        case=truth.case,
        launches=len(truth.state),
        scored=int(truth.is_scored.sum()),
        false_tracks=len({int(each) for each in number[kept]} - in_use),
        missed_launches=sum(
            row not in launches for row in range(len(truth.state)) if truth.is_scored[row].any()
        ),
        cutoff_m=truth.cutoff_m,
        gospa_m=_gospa(truth, tracks.state[rows[kept]], tick[kept]),
        states=_states(truth, tracks, rows[chosen], owner[number[chosen]], tick[chosen]),
    )


def _assigned(truth: SetTruth, state: FloatArray, tick: IntArray) -> IntArray:
    """Return the launch (n,) to which each estimate is assigned at its tick, -1 for none."""
    found = np.full(len(state), -1, dtype=np.int64)
    for now in np.unique(tick).tolist():
        rows = np.flatnonzero(tick == now)
        flying = np.flatnonzero(np.isfinite(truth.state[:, now, 0]))
        pairs = gospa(state[rows, :3], truth.state[flying, now, :3], cutoff=truth.cutoff_m).assigned
        found[rows[pairs[:, 0]]] = flying[pairs[:, 1]]
    return found


def _owners(
    truth: SetTruth, number: IntArray, tick: IntArray, assigned: IntArray, tracks: int
) -> tuple[IntArray, Any]:
    """Return the launch of each track (tracks,), -1 if it is false, and which rows (n,) are
    scored.
    """
    count = np.zeros((tracks, len(truth.state)), dtype=np.int64)
    np.add.at(count, (number[assigned >= 0], assigned[assigned >= 0]), 1)
    owner = np.where(count.max(axis=1, initial=0) > 0, count.argmax(axis=1), -1)
    of_row = owner[number]
    is_any = truth.is_scored.any(axis=0)[tick]
    is_kept = np.where(of_row >= 0, truth.is_scored[of_row, tick], is_any)
    for each in range(tracks):
        mine = is_kept & (number == each)
        if 2 * np.count_nonzero(assigned[mine] >= 0) < np.count_nonzero(mine):
            owner[each] = -1
    return owner, is_kept


def _in_force(launch: IntArray, tick: IntArray, is_owned: Any, held: IntArray) -> IntArray:
    """Return the row in force for each launch and tick: of the track with the most assigned
    rows.
    """
    rows = np.flatnonzero(is_owned)
    order = rows[np.lexsort((-held[rows], tick[rows], launch[rows]))]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(launch[order]) != 0) | (np.diff(tick[order]) != 0)
    return np.asarray(order[first], dtype=np.int64)


def _gospa(truth: SetTruth, state: FloatArray, tick: IntArray) -> FloatArray:
    """Return GOSPA of positions at each tick with scored launches, over the square root of their
    number.
    """
    found = []
    for now in np.flatnonzero(truth.is_scored.any(axis=0)).tolist():
        scored = truth.state[truth.is_scored[:, now], now, :3]
        distance = gospa(state[tick == now, :3], scored, cutoff=truth.cutoff_m).distance
        found.append(distance / np.sqrt(len(scored)))
    return np.array(found, dtype=np.float64)


def _states(
    truth: SetTruth, tracks: SetTracks, row: IntArray, launch: IntArray, tick: IntArray
) -> Mapping[str, FloatArray]:
    """Return the columns `MEASURES` of the states in force."""
    error = tracks.state[row] - truth.state[launch, tick]
    covariance = tracks.covariance[row]
    bound = truth.bounds[launch, tick]
    # What an efficient estimate expects: half of a NEES of 6, and its covariance's determinant.
    expected = 0.5 * (6.0 + bound[:, 3] + 6.0 * np.log(2.0 * np.pi))
    return {
        "position_m": np.sqrt(np.sum(error[:, :3] ** 2, axis=1)),
        "velocity_m_s": np.sqrt(np.sum(error[:, 3:] ** 2, axis=1)),
        "energy_m": energy_scores(error, covariance, part=slice(0, 3)),
        "log_score": normal_log_scores(error, covariance),
        "nees": nees(error, covariance),
        "bound_m": bound[:, 0],
        "free_bound_m": bound[:, 1],
        "bound_energy_m": bound[:, 2],
        "bound_log_score": expected,
    }
