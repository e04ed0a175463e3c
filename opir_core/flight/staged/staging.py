"""Stages of boosts as kinematics: burn times, ideal speeds, growth of the acceleration, dark gaps;
notional presets.

The acceleration of a burn is that of a constant thrust and mass flow, A/(1 - q t/T) with q = 1 -
1/growth over the burn time T (Curtis, Orbital Mechanics for Engineering Students, section 11.5),
and falls linearly to zero in the tail-off, the last seconds of the burn. A is such that its
integral over the burn is the ideal speed.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.flight.rows import TrailingRows

_TABLE = Path(__file__).parents[2] / "data" / "stagings.json"

#: The largest thrust acceleration, m/s²: with gravity and drag it stays below the 100 m/s² for
#: which visibility is exact (`opir_core.planning.visibility`).
MOST_ACCELERATION_M_S2 = 90.0

#: A stage lifts off with at least this thrust acceleration, m/s²: more than gravity anywhere on the
#: Earth.
LEAST_ACCELERATION_M_S2 = 9.9

#: Smaller values of q than this count as this: the acceleration is constant.
_LEAST_Q = 1e-9


@frozen
class Stage:
    """One burn: its time, s, the speed gained without gravity and drag, m/s, last over first
    acceleration, and the dark gap before the next burn, s."""

    burn_time_s: float
    ideal_speed_m_s: float
    growth: float
    gap_s: float = 0.0


@frozen
class Staging:
    """The stages of a boost and the course of its first seconds.

    Flight is vertical for `vertical_rise_s`; then the thrust is tilted for `pitch_over_s`, and
    follows the velocity after that. `tail_off_s` is the tail-off of every burn;
    `ballistic_coefficient_kg_m2` is m/(C_d A) during the boost; `profile` names the class profile
    whose plume it has. The range limits choose among the stagings of a class.
    """

    name: str
    stages: tuple[Stage, ...]
    vertical_rise_s: float
    pitch_over_s: float
    tail_off_s: float
    ballistic_coefficient_kg_m2: float
    profile: str = ""
    minimum_range_m: float = 0.0
    maximum_range_m: float = 2.004e7

    @property
    def earliest_cut_off_s(self) -> float:
        """Return when the last burn may be cut off at the earliest: after a tenth of it and after
        the pitch-over, s.
        """
        final_ignition_s = sum(stage.burn_time_s + stage.gap_s for stage in self.stages[:-1])
        return max(
            final_ignition_s + 0.1 * self.stages[-1].burn_time_s,
            self.vertical_rise_s + self.pitch_over_s,
        )

    @property
    def latest_cut_off_s(self) -> float:
        """Return when the tail-off of the whole last burn begins, s since ignition."""
        burns = (
            sum(stage.burn_time_s + stage.gap_s for stage in self.stages[:-1])
            + self.stages[-1].burn_time_s
        )
        return burns - self.tail_off_s

    def fault(self) -> str:
        """Return the first error of the stages, or ""."""
        turned_s = self.vertical_rise_s + self.pitch_over_s + self.tail_off_s
        if turned_s >= self.stages[0].burn_time_s:
            burn = f"stage 1 burns for {self.stages[0].burn_time_s:g} s"
            return f"{burn}, no longer than rise, pitch-over and tail-off together ({turned_s:g} s)"
        columns = StageColumns.of([self])
        for number, stage in enumerate(self.stages, 1):
            if stage.burn_time_s <= self.tail_off_s:
                return (
                    f"stage {number} burns for {stage.burn_time_s:g} s, no longer than its tail-off"
                )
            lift_off = float(columns.amplitude_m_s2[number - 1, 0])
            peak = lift_off * max(1.0, stage.growth)
            if peak > MOST_ACCELERATION_M_S2:
                return (
                    f"stage {number} reaches {peak:.0f} m/s²; at most {MOST_ACCELERATION_M_S2:g}"
                    f" are simulated: a longer burn, less speed or less growth helps"
                )
            if number == 1 and lift_off < LEAST_ACCELERATION_M_S2:
                return (
                    f"stage 1 begins with {lift_off:.2f} m/s²: no lift-off; a shorter burn or less"
                    f" growth helps"
                )
        return ""


@frozen(eq=False, repr=False)
class StageColumns(TrailingRows):
    """The stages of n boosts with s stages each, as columns (s, n).

    Times are since ignition: a stage's ignition and burn time; `amplitude_m_s2` and `q` are A and q
    above.
    """

    ignition_s: FloatArray
    burn_time_s: FloatArray
    amplitude_m_s2: FloatArray
    q: FloatArray

    @classmethod
    def of(cls, stagings: Sequence[Staging]) -> "StageColumns":
        """Return the columns of boosts with one number of stages."""
        burn, speed, growth, gap = (
            np.array(
                [[getattr(stage, name) for stage in staging.stages] for staging in stagings],
                dtype=np.float64,
            ).T
            for name in ("burn_time_s", "ideal_speed_m_s", "growth", "gap_s")
        )
        tail = np.array([staging.tail_off_s for staging in stagings])
        ignition = np.cumsum(burn + gap, axis=0) - (burn + gap)
        q = 1.0 - 1.0 / growth
        q = np.where(np.abs(q) < _LEAST_Q, _LEAST_Q, q)
        share = 1.0 - tail / burn
        unit_speed_s = -np.log1p(-q * share) / q * burn + 0.5 * tail / (1.0 - q * share)
        return cls(ignition, burn, speed / unit_speed_s, q)

    def acceleration_m_s2(self, stage: int, time_s: FloatArray) -> FloatArray:
        """Return the thrust accelerations (n,) of a stage before its tail-off, at times since
        ignition (n,).
        """
        share = (time_s - self.ignition_s[stage]) / self.burn_time_s[stage]
        return self.amplitude_m_s2[stage] / (1.0 - self.q[stage] * share)


@cache
def stagings() -> Mapping[str, Staging]:
    """Return the presets, by name."""
    rows = json.loads(_TABLE.read_text(encoding="utf-8"))["stagings"]
    return MappingProxyType({name: _staging(name, row) for name, row in rows.items()})


@cache
def stagings_of_classes() -> Mapping[str, tuple[Staging, ...]]:
    """Return the presets of each target class; of several, the first whose limits contain the range
    is flown.
    """
    classes = json.loads(_TABLE.read_text(encoding="utf-8"))["classes"]
    return MappingProxyType(
        {kind: tuple(stagings()[name] for name in names) for kind, names in classes.items()}
    )


def staging_for(presets: Sequence[Staging], range_m: float) -> Staging:
    """Return the first of the presets that covers a range, or else the one with the nearest
    limits.
    """
    return min(
        presets,
        key=lambda staging: max(
            staging.minimum_range_m - range_m, range_m - staging.maximum_range_m, 0.0
        ),
    )


def _staging(name: str, row: Mapping[str, Any]) -> Staging:
    minimum_km, maximum_km = row["range_limits_km"]
    return Staging(
        name=name,
        stages=tuple(Stage(**stage) for stage in row["stages"]),
        vertical_rise_s=row["vertical_rise_s"],
        pitch_over_s=row["pitch_over_s"],
        tail_off_s=row["tail_off_s"],
        ballistic_coefficient_kg_m2=row["ballistic_coefficient_kg_m2"],
        profile=row["profile"],
        minimum_range_m=1e3 * minimum_km,
        maximum_range_m=1e3 * maximum_km,
    )
