"""Stage of the engine: when the detections of each scan are reported; imported only for scenes with
latency.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import gammainccinv

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.records import Detections
from opir_core.interfaces.sensors import ReportingStage, Sensor
from opir_core.random_streams.philox import Stream, stream_key, uniforms_of
from opir_core.simulation.observation import Observation

#: The purpose of a sensor's stream for its reporting latencies.
STREAM = "reporting"

#: Scans without detections that are drawn over: reading them takes as long as a new position in the
#: stream.
_READ_OVER = 1024

#: The resolution of scene times, s.
_RESOLUTION_S = 1e-9

#: The chance that a stage takes longer than its share of `release_lag_ns`.
LATE_CHANCE = 0.001


class ReportingDelays:
    """Takes `detections`; gives them their `reported_ns`: one draw per sensor and scan, for all
    detections of the scan.

    `names` (sensors,) are the names of the sensors' streams.
    """

    def __init__(self, seed: int, sensors: Sequence[Sensor], names: Sequence[str]) -> None:
        self._stages = {
            number: sensor.reporting for number, sensor in enumerate(sensors) if sensor.reporting
        }
        self._streams = {
            number: Stream(stream_key(seed, names[number], STREAM), words=len(stages))
            for number, stages in self._stages.items()
        }

    def __call__(self, window: Observation) -> None:
        """Draw the latencies of the window's reports."""
        window.detections = self.reported(window.detections)

    def reported(self, detections: Detections) -> Detections:
        """Return detections with the times of their reports."""
        delay_ns = np.zeros(len(detections), dtype=np.int64)
        for number, stages in self._stages.items():
            rows = np.flatnonzero(detections.sensor == number)
            scans, of_row = np.unique(detections.scan[rows], return_inverse=True)
            delay_ns[rows] = np.rint(1e9 * self._latency_s(number, stages, scans)).astype(np.int64)[
                of_row
            ]
        return detections.replaced(reported_ns=detections.time_ns + delay_ns)

    def _latency_s(
        self, number: int, stages: Sequence[ReportingStage], scans: IntArray
    ) -> FloatArray:
        """Return the latencies (n,) of the reports of scans (n,), sorted."""
        is_drawn = any(stage.sigma_s >= _RESOLUTION_S for stage in stages)
        uniforms = (
            self._uniforms(number, scans) if is_drawn else np.zeros((len(scans), len(stages)))
        )
        latency_s = np.zeros(len(scans))
        for stage, column in zip(stages, uniforms.T, strict=True):
            latency_s += stage_latency_s(stage, 1.0 - column)
        return latency_s

    def _uniforms(self, number: int, scans: IntArray) -> FloatArray:
        """Return numbers (n, stages) in [0, 1) of sorted scans (n,), read by runs of neighbouring
        scans.
        """
        stream = self._streams[number]
        starts = np.flatnonzero(np.diff(scans, prepend=-2 * _READ_OVER) > _READ_OVER)
        runs = [
            scans[run] for run in map(slice, starts.tolist(), [*starts[1:].tolist(), len(scans)])
        ]
        words = [stream.words(int(run[0]), int(run[-1] - run[0]) + 1) for run in runs]
        stages = len(self._stages[number])
        uniforms = [
            uniforms_of(read).reshape(-1, stages)[run - run[0]]
            for read, run in zip(words, runs, strict=True)
        ]
        return np.concatenate([*uniforms, np.empty((0, stages))])


def stage_latency_s(stage: ReportingStage, exceedance: FloatArray) -> FloatArray:
    """Return the latencies of a stage, s, that are exceeded with probabilities in (0, 1].

    Constant if the standard deviation is below the resolution of times, 1 ns; else the gamma
    distribution of the stage's mean and standard deviation: shape (mean/σ)², scale σ²/mean
    (Johnson, Kotz and Balakrishnan, Continuous Univariate Distributions 1, 2nd ed., 1994, chapter
    17).
    """
    if stage.sigma_s < _RESOLUTION_S:
        return np.full(np.shape(exceedance), stage.mean_s)
    latency_s: FloatArray = gammainccinv((stage.mean_s / stage.sigma_s) ** 2, exceedance)
    return latency_s * (stage.sigma_s / stage.mean_s * stage.sigma_s)


def release_lag_ns(sensors: Sequence[Sensor]) -> int:
    """Return the time, ns, within which nearly all reports of the slowest sensor come.

    It is the sum over the stages of the latencies that are exceeded with probability `LATE_CHANCE`:
    by the union bound at most that share of reports per stage is later.
    """
    late_chance = np.array([LATE_CHANCE])
    lags_s = [
        sum(float(stage_latency_s(stage, late_chance)[0]) for stage in sensor.reporting)
        for sensor in sensors
    ]
    return round(1e9 * max(lags_s, default=0.0))
