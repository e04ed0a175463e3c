"""A log-Gaussian law of the stages of vehicles, conditioned on what stages of a flight have shown.

A stage is the logarithms of its burn time s, first acceleration m/s², ratio of masses before and
after the burn, and dark gap after it s. Of each family of vehicles (`missile`, `space`) each of
these four rows is normal; between stages of one vehicle it has one correlation, so it is the sum of
a part of the vehicle and one of the stage (random effects: Searle, Casella and McCulloch, "Variance
Components", 1992, ch. 3). The law given k stages is closed. `none` is `missile` with its standard
deviations doubled. The parameters are data of the tracker (`vehicles.json`).
"""

import json
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import ModelError, reason_of
from opir_core.scene import file_bytes

#: Largest number of stages, and the rows of a stage's law.
STAGES = 4
BURN = 0
FORCE = 1
RATIO = 2
GAP = 3

#: Families of vehicles, in the order of their columns.
FAMILIES = ("missile", "space", "none")
MISSILE, SPACE, NONE = range(3)

#: Share of flights whose recorded stages say nothing: one was missed, or a throttled engine was
#: taken for one.
_UNRELIABLE = 0.1


@frozen(eq=False)
class Known:
    """What earlier stages of tracks (n,) say of the next one, by family.

    `done` (n,) is their number, `total` and `number` (n, families, 4) the sums of their standard
    scores and how many are known; `log_evidence` (n, families) is the density of their rows, `hot`
    (n, families) the probability that the next stage ignites without a gap.
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
        least = np.cumsum(self.stages[:, ::-1], axis=1)[:, ::-1]
        padded = np.concatenate([least, np.zeros((len(least), 1))], axis=1)
        return np.moveaxis(padded[:, np.minimum(done, STAGES)], 0, -1)

    def given(self, logs: FloatArray) -> Known:
        """Return the law of the next stage given earlier ones, (n, STAGES, 4).

        nan is unknown; a gap of -inf is none: the next stage ignited hot.
        """
        count = len(logs)
        family = np.arange(len(FAMILIES))
        total = np.zeros((count, len(family), 4))
        number = np.zeros((count, len(family), 4))
        log = np.zeros((count, len(family)))
        for stage in range(STAGES):
            mean, variance = self._next(total, number, family)
            seen = np.isfinite(logs[:, stage])[:, None]
            upper = int(stage > 0)
            score = (logs[:, stage, None] - self.median_log[:, upper]) / self.sigma[:, upper]
            away = np.where(seen, score - mean, 0.0)
            density = (
                -0.5 * away * away / variance
                - 0.5 * np.log(variance)
                - np.log(self.sigma[:, upper])
            )
            log += np.sum(np.where(seen, density, 0.0), axis=2)
            total = total + np.where(seen, score, 0.0)
            number = number + seen
        done = np.sum(np.isfinite(logs[:, :, BURN]), axis=1)
        cold = np.sum(np.isfinite(logs[:, :, GAP]), axis=1)[:, None]
        was_hot = np.sum(np.isneginf(logs[:, :, GAP]), axis=1)[:, None]
        hot = np.where(
            was_hot > cold,
            self.hot_again,
            np.where(cold > 0, self.hot * (1.0 - self.hot_again), self.hot),
        )
        floor = np.log(_UNRELIABLE) + log[:, NONE:]
        return Known(done, total, number, np.logaddexp(log, floor), hot)

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

    def _next(
        self, total: FloatArray, number: FloatArray, family: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return mean and variance of the next score given the sum and the number of earlier
        ones.
        """
        coupling = self.coupling[family]
        tied = coupling / (1.0 + (number - 1.0) * coupling)
        return tied * total, 1.0 - number * coupling * tied


def model_of(data: Mapping[str, Any]) -> VehicleModel:
    """Return the model of data as in `vehicles.json`."""
    rows = [data["families"][name] for name in ("missile", "space", "missile")]
    sigma = np.array([[row[part]["sigma"] for part in ("first", "upper")] for row in rows])
    sigma[NONE] *= data["none_spread"]
    return VehicleModel(
        np.log([[row[part]["median"] for part in ("first", "upper")] for row in rows]),
        sigma,
        np.array([row["coupling"] for row in rows]),
        np.array([row["stages"] for row in rows]),
        np.array([row["hot_probability"] for row in rows]),
        np.array([row["hot_again"] for row in rows]),
        data,
    )


@cache
def vehicle_model(path: str | None = None) -> VehicleModel:
    """Return the tracker's model, or that of a file written by `opir prior fit`.

    Raises `ModelError`, with the setting `boost_prior`, if the file cannot be read or holds no law.
    """
    if path is None:
        return model_of(
            json.loads(files("opir_trackers").joinpath("vehicles.json").read_text("utf-8"))
        )
    way_out = "write one with `opir prior fit FILES -o FILE`, or leave the setting out"
    try:
        model = model_of(json.loads(file_bytes(path)))
        _require_law(model)
    except OSError as error:
        raise ModelError(
            f"tracker.boost_prior: {path} cannot be read: {reason_of(error)}; {way_out}"
        ) from error
    except (ValueError, LookupError, TypeError) as error:
        what = f"no {error.args[0]}" if isinstance(error, KeyError) else str(error)
        raise ModelError(
            f"tracker.boost_prior: {path} holds no law of vehicles: {what}; {way_out}"
        ) from error
    return model


def _require_law(model: VehicleModel) -> None:
    """Raise `ValueError` for a model with data missing, or with other shapes than the tracker's
    own.
    """
    own = vehicle_model()
    missing = [key for key in own.data if key not in model.data]
    missing += [
        key for key in own.data["marginal"] if not missing and key not in model.data["marginal"]
    ]
    if missing:
        raise ValueError(f"no {', '.join(missing)}")
    for name in ("median_log", "sigma", "coupling", "stages", "hot", "hot_again"):
        column = getattr(model, name)
        like = getattr(own, name)
        if column.shape != like.shape or not np.isfinite(column).all():
            raise ValueError(f"the families' {name} is not {like[0].size} finite numbers each")
