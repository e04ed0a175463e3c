"""A log-Gaussian law of the stages of vehicles, conditioned on the earlier stages of a flight.

A stage is the logarithms of its burn time s, first acceleration m/s², ratio of masses before and
after the burn, and dark gap after it s. Of each family of vehicles (`missile`, `space`) each of
these four rows is normal; between stages of one vehicle it has one correlation, so it is the sum of
a part of the vehicle and one of the stage (random effects: Searle, Casella and McCulloch, "Variance
Components", 1992, ch. 3). The law given k stages is closed. `none` is `missile` with its standard
deviations doubled. The parameters are data of the tracker (`vehicles.json`).
"""

import json
import re
from collections.abc import Mapping
from enum import IntEnum
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import law_parameters

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import BAD_DATA, ModelError, reason_of
from opir_core.interfaces import Columns
from opir_core.scene import file_bytes

#: Largest number of stages.
STAGES = 4


class StageRow(IntEnum):
    """Rows of a stage's law."""

    BURN = 0
    FORCE = 1
    RATIO = 2
    GAP = 3


class Family(IntEnum):
    """Families of vehicles."""

    MISSILE = 0
    SPACE = 1
    NONE = 2


BURN, FORCE, RATIO, GAP = StageRow
MISSILE, SPACE, NONE = Family

#: Names of the families in data.
FAMILIES = tuple(family.name.lower() for family in Family)

LAW = law_parameters("opir_forecast", "stages")


class VehicleStages(NamedTuple):
    """Stages of vehicles (n, STAGES): gaps before them, burn times (0: none), first accelerations
    and growths c.

    The acceleration is A / (1 - c s) after s seconds.
    """

    gap_s: FloatArray
    burn_s: FloatArray
    first_m_s2: FloatArray
    growth_per_s: FloatArray

    @property
    def starts_s(self) -> FloatArray:
        """Return the ignitions (n, STAGES) after the first gap begins."""
        return np.cumsum(self.burn_s + self.gap_s, axis=1) - self.burn_s


@frozen(eq=False, repr=False)
class Known(Columns):
    """The law of the next stage of tracks (n,) given their earlier stages, by family.

    `done` (n,) is the number of earlier stages, `total` and `number` (n, families, 4) the sums of
    their standard scores and how many are known; `log_evidence` (n, families) is the density of
    their rows, `hot` (n, families) the probability that the next stage ignites without a gap.
    """

    done: IntArray
    total: FloatArray
    number: FloatArray
    log_evidence: FloatArray
    hot: FloatArray


@frozen(eq=False)
class VehicleModel:
    """The laws of families: `median_log` and `sigma` (families, 2, 4) of first and upper stages.

    `coupling` (families, 4) is the correlation of stages, `stages` (families, STAGES) the
    probability of each number of stages; `hot` (families,) that of no gap, `hot_again` that of
    another one after one. `data` has the rest.
    """

    median_log: FloatArray
    sigma: FloatArray
    coupling: FloatArray
    stages: FloatArray
    hot: FloatArray
    hot_again: FloatArray
    data: Mapping[str, Any]

    def more(self, done: IntArray) -> FloatArray:
        """Return the probabilities (..., families) of more than `done` (...) stages."""
        at_least = np.cumsum(self.stages[:, ::-1], axis=1)[:, ::-1]
        padded = np.concatenate([at_least, np.zeros((len(at_least), 1))], axis=1)
        return np.moveaxis(padded[:, np.minimum(done, STAGES)], 0, -1)

    def given(self, logs: FloatArray) -> Known:
        """Return the law of the next stage given earlier ones, (n, STAGES, 4).

        nan is unknown; a gap of -inf means that the next stage ignited hot.
        """
        family = np.arange(len(FAMILIES))
        total = np.zeros((len(logs), len(family), 4))
        number = np.zeros_like(total)
        log = np.zeros(total.shape[:2])
        for stage in range(STAGES):
            is_known = np.isfinite(logs[:, stage])[:, None]
            score = self.scores(family, np.array(stage), logs[:, stage, None])
            sigma = self.sigma[:, int(stage > 0)]
            density = _log_density(score, *self._next(total, number, family)) - np.log(sigma)
            log += np.sum(np.where(is_known, density, 0.0), axis=2)
            total += np.where(is_known, score, 0.0)
            number += is_known
        done = np.sum(np.isfinite(logs[:, :, BURN]), axis=1)
        floor = np.log(LAW.unreliable) + log[:, NONE:]
        return Known(done, total, number, np.logaddexp(log, floor), self._hot(logs[:, :, GAP]))

    def _hot(self, gap: FloatArray) -> FloatArray:
        """Return the probabilities (n, families) of no gap after gaps (n, STAGES), -inf for none."""
        cold = np.sum(np.isfinite(gap), axis=1)[:, None]
        hot = np.sum(np.isneginf(gap), axis=1)[:, None]
        after_gap = np.where(cold > 0, self.hot * (1.0 - self.hot_again), self.hot)
        return np.where(hot > cold, self.hot_again, after_gap)

    def law(
        self, family: IntArray, stage: IntArray, total: FloatArray, number: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation (..., 4) of the logarithms of stages (...) of families
        (...).

        `total` and `number` (..., 4) are the sums of scores of earlier stages, and how many.
        """
        mean, variance = self._next(total, number, family)
        upper = (stage > 0).astype(np.int64)
        spread = self.sigma[family, upper]
        return self.median_log[family, upper] + spread * mean, spread * np.sqrt(variance)

    def scores(self, family: IntArray, stage: IntArray, logs: FloatArray) -> FloatArray:
        """Return the standard scores (..., 4) of the rows of stages (...) of families (...)."""
        upper = (stage > 0).astype(np.int64)
        return (logs - self.median_log[family, upper]) / self.sigma[family, upper]

    def figures(self, logs: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return burn times, first accelerations and growths (n,) of stages (n, 4).

        Few structures bear more than the law's highest acceleration: it bounds the ratio of masses.
        """
        bound = np.log(self.data["highest_m_s2"]) - logs[:, FORCE]
        ratio = np.maximum(np.minimum(logs[:, RATIO], bound), 0.02)
        burn = np.exp(logs[:, BURN])
        return burn, np.exp(logs[:, FORCE]), -np.expm1(-ratio) / burn

    def _next(
        self, total: FloatArray, number: FloatArray, family: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the next score given the sum and the number of earlier ones."""
        coupling = self.coupling[family]
        tied = coupling / (1.0 + (number - 1.0) * coupling)
        return tied * total, 1.0 - number * coupling * tied


def _log_density(score: FloatArray, mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return normal log densities of scores, without the constant."""
    residual = score - mean
    return -0.5 * residual * residual / variance - 0.5 * np.log(variance)


#: Places of a law's probabilities, and of numbers whose logarithm is taken or that divide.
_SHARES = re.compile("stages|coupling|hot_|groups|odd_|probability|any|marginal.(glide|orbit)")
_POSITIVE = re.compile("median|sigma|period|range|density")
#: Other numbers are at most so many times the tracker's own: beyond that a unit is mistaken.
_FACTOR = 1000.0


def model_of(data: Mapping[str, Any]) -> VehicleModel:
    """Return the model of data as in `vehicles.json`."""
    laws = [data["families"][name] for name in ("missile", "space", "missile")]
    medians, sigma = (
        np.array([[law[stage][name] for stage in ("first", "upper")] for law in laws])
        for name in ("median", "sigma")
    )
    sigma[NONE] *= data["none_spread"]
    names = ("coupling", "stages", "hot_probability", "hot_again")
    coupling, stages, hot, hot_again = (np.array([law[name] for law in laws]) for name in names)
    return VehicleModel(np.log(medians), sigma, coupling, stages, hot, hot_again, data)


@cache
def vehicle_model(path: str | None = None) -> VehicleModel:
    """Return the tracker's model, or that of a file written by `opir prior fit`.

    Raises `ModelError`, with the setting `boost_prior`, if the file cannot be read or holds no law.
    """
    if path is None:
        text = files("opir_forecast").joinpath("vehicles.json").read_text("utf-8")
        return model_of(json.loads(text))
    way_out = "write one with `opir prior fit FILES -o FILE`, or leave the setting out"
    try:
        data = json.loads(file_bytes(path))
        _require_like(data, vehicle_model().data, "")
        return model_of(data)
    except OSError as error:
        raise ModelError(
            f"tracker.boost_prior: {path} cannot be read: {reason_of(error)}; {way_out}"
        ) from error
    except BAD_DATA as error:
        reason = f"no {error.args[0]}" if isinstance(error, KeyError) else str(error)
        raise ModelError(
            f"tracker.boost_prior: {path} holds no law of vehicles: {reason}; {way_out}"
        ) from error


def _require_like(value: Any, default: Any, place: str) -> None:
    """Raise `ValueError` unless a value has the keys, lengths and magnitudes of the tracker's own."""
    if isinstance(default, dict):
        if missing := [key for key in default if key not in value]:
            raise ValueError(f"no {', '.join(missing)}")
        for key, inner in default.items():
            _require_like(value[key], inner, f"{place}.{key}" if place else key)
    elif isinstance(default, list):
        if not isinstance(value, list) or len(value) != len(default):
            raise ValueError(f"{place} is not a list of {len(default)} numbers")
        for number, inner in zip(value, default, strict=True):
            _require_like(number, inner, place)
    elif isinstance(default, float):
        least, largest = _bounds(default, place)
        if isinstance(value, bool | str) or not least <= value <= largest:
            raise ValueError(f"{place}: {value!r} is not in [{least:g}, {largest:g}]")


def _bounds(default: float, place: str) -> tuple[float, float]:
    """Return the least and the largest value of a number of a law."""
    if _SHARES.search(place):
        return 0.0, 1.0
    largest = _FACTOR * abs(default)
    if default < 0.0:
        return -largest, largest
    return (default / _FACTOR if _POSITIVE.search(place) else 0.0), largest
