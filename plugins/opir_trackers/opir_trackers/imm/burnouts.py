"""Ends of burns: where a burn is over, the state that all of its looks give replaces the filter's."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from opir_estimation import (
    BURN_MEMORY_S,
    AngleMeasurements,
    BurnEnd,
    BurnPrior,
    Thrust,
    burn_end,
)

from opir_core.arrays import FloatArray
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import SliceLooks, TrackerState
from opir_trackers.onset.motion_statistics import LAUNCH

#: Probability of a coast with which a burn is over.
OVER = 0.99

#: Probability of thrust in any direction with which a burn stays as the filter has it: in ordinary
#: ones it is next to 0 after some seconds.
FREE = 0.02

#: A gap in the looks of this many mean pauses, s, and longer than this, is a dark spell between
#: two burns.
DARK_PAUSES = 3.0
DARK_S = 1.0

#: Looks from which other errors of sensors were taken off than from the last ones, by more than
#: these angles, rad, or clock, s, do not count.
SAME_ERROR = np.array([1e-6, 1e-6, 1e-3])


def with_looks(
    state: TrackerState, prediction: SlicePrediction, measurements: AngleMeasurements
) -> TrackerState:
    """Return the state with the measurements of a slice, without those that are too old."""
    table = state.table
    end_s = prediction.end_s
    error = prediction.registration.known.mean
    mean = table.estimates.boost_mean
    looks = (*state.looks, SliceLooks(end_s, table.number, mean, measurements, error))
    # Slices without lines have none.
    if looks[0].end_s < end_s - BURN_MEMORY_S:
        looks = looks[1:]
    return state._replace(looks=looks)


def with_burn_ends(models: TrackingModels, state: TrackerState) -> TrackerState:
    """Return the state with the coasts of launches whose burns are over, once for each burn."""
    table = state.table
    is_over = (table.estimates.weight[:, 1] > OVER) & (table.seen_s > table.burnt_s)
    if True not in is_over:
        return state
    launches = table.motion.probability[:, LAUNCH] >= models.config.least_launch_probability
    # The fit knows no thrust in any other direction than along the velocity.
    is_free = table.estimates.burn_share[:, 2] > FREE
    rows = (is_over & launches & ~is_free).nonzero()[0]
    if not rows.size:
        return state
    ends = {row: _burn_end(models, state, row) for row in rows.tolist()}
    found = {row: end for row, end in ends.items() if end is not None}
    estimates = models.filter.with_burn_ends(table.estimates, found, state.time_s)
    burnt_s = table.burnt_s.copy()
    burnt_s[rows] = table.seen_s[rows]
    return state._replace(table=table.changed(estimates=estimates, burnt_s=burnt_s))


def _burn_end(models: TrackingModels, state: TrackerState, row: int) -> BurnEnd | None:
    """Return the end of the burn of the track in a row, None where its looks do not tell it."""
    motion = models.filter.boost
    stage = models.filter.stage
    # Where bodies are seen after burnout, coasts have looks of their own.
    sees_bodies = not models.filter.least_open_weight
    if sees_bodies or stage is None or not isinstance(motion, Thrust):
        return None
    looks = _BurnLooks.of(state, row)
    if looks is None:
        return None
    prior = BurnPrior(motion, stage, looks.ignition_s)
    return burn_end(looks.measurements, looks.time_s, looks.mean, prior)


class _BurnLooks(NamedTuple):
    """The looks of a burn that ignited at a time, s, and its states (m, 9) at times (m,)."""

    measurements: AngleMeasurements
    time_s: FloatArray
    mean: FloatArray
    ignition_s: float

    @classmethod
    def of(cls, state: TrackerState, row: int) -> "_BurnLooks | None":
        """Return the looks of the last burn of the track in a row, None without any."""
        looks = list(_looks_of(state, int(state.table.number[row])))
        if not looks:
            return None
        times, means, parts = zip(*looks, strict=True)
        measurements = AngleMeasurements.concatenate(parts)
        measurements = measurements.take(np.argsort(measurements.time_s, kind="stable"))
        ignition_s = _ignition_s(measurements.time_s, state, row)
        return cls(measurements, np.array(times), np.array(means)[:, :9], ignition_s)


def _looks_of(
    state: TrackerState, number: int
) -> Iterator[tuple[float, FloatArray, AngleMeasurements]]:
    """Yield times, states and measurements of the track with a number in slices whose lines lacked
    the same errors as the last ones.
    """
    for looks in state.looks:
        place = int(np.searchsorted(looks.number, number))
        if place < len(looks.number) and looks.number[place] == number:
            rows = (looks.measurements.track == place).nonzero()[0]
            if rows.size and _are_same(looks.error, state.looks[-1].error):
                yield looks.end_s, looks.mean[place], looks.measurements.take(rows)


def _are_same(error: FloatArray, other: FloatArray) -> bool:
    apart = np.abs(error - other).reshape(-1, len(SAME_ERROR))
    return bool(np.all(apart <= SAME_ERROR))


def _ignition_s(time_s: FloatArray, state: TrackerState, row: int) -> float:
    """Return the ignition of the burn with looks at ascending times (n,): after the last dark spell
    between them, or at launch.
    """
    hits, spell, _ = state.table.estimates.detection_rate[row]
    dark_s = DARK_S + DARK_PAUSES * spell / max(hits, 1.0)
    begins = (np.diff(time_s) > dark_s).nonzero()[0]
    if begins.size:
        return float(time_s[begins[-1] + 1])
    return float(np.fmin(state.table.launch[row, 2], time_s[0]))
