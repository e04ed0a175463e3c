"""The paper's sensors in simulation: latencies, detections of a boost, confidence; with 99.9 %
intervals.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import frozen

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray

#: The sensors of the paper, in its order.
SENSORS = ("DSP", "SBIRS-GEO", "NEXTGEN-GEO")

#: Launches whose first detection is timed, and boosts whose looks are counted.
_LAUNCHES = 4000
_BOOSTS = 20

#: The paper's boost, s, and the time in which a launch is first detected but for one in 10¹².
_BOOST_S = 300.0
_FIRST_S = 6.1

#: Two-sided 99.9 % of a normal distribution, in standard deviations.
SIGMAS_999 = 3.2905


@frozen
class Simulated:
    """A figure of a simulation and its 99.9 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def mean(cls, values: FloatArray) -> "Simulated":
        """Return the mean of values (n,)."""
        half = SIGMAS_999 * float(values.std(ddof=1)) / math.sqrt(len(values))
        middle = float(values.mean())
        return cls(middle, middle - half, middle + half)

    @classmethod
    def share(cls, hits: int, trials: int) -> "Simulated":
        """Return a share by the Wilson score interval, which holds near 0 and 1 too."""
        share = hits / trials
        z2 = SIGMAS_999 * SIGMAS_999 / trials
        middle = (share + 0.5 * z2) / (1.0 + z2)
        half = (
            SIGMAS_999 * math.sqrt(share * (1.0 - share) / trials + 0.25 * z2 / trials) / (1.0 + z2)
        )
        return cls(share, max(0.0, middle - half), min(1.0, middle + half))

    def holds(self, value: float) -> bool:
        """Whether a value is in the interval."""
        return self.low - 1e-12 <= value <= self.high + 1e-12


def scene(seed: int, launches: int = 1, duration_s: float = _BOOST_S + 1.0) -> Mapping[str, Any]:
    """Return the paper's sensors over launches at the scene's epoch, as plain data; boosts last 300
    s.

    With `preset: paper` light takes no time and scans begin at ignition, as in the paper's
    latencies.
    """
    place = {"lat_deg": 5.0, "lon_deg": -100.0, "time_s": 0.0}
    boost = {
        "type": "ICBM",
        "launch": place,
        "aim": {"lat_deg": -50.0, "lon_deg": -60.0},
        "burn_time_s": _BOOST_S,
    }
    return {
        "scene": "paper",
        "epoch": "2026-04-01T00:00:00Z",
        "duration_s": duration_s,
        "seed": seed,
        "preset": "paper",
        "sensors": [{"model": name, "id": name, "orbital_slot_deg": -100.0} for name in SENSORS],
        "targets": [{"id": f"T{number}", **boost} for number in range(launches)],
    }


def first_scans(seed: int) -> Mapping[str, IntArray]:
    """Return, by sensor, the scan, counted from ignition, that first detects each of the launches
    (n,).
    """
    run = opir.simulate(opir.scene_from_mapping(scene(seed, _LAUNCHES, _FIRST_S)))
    scans = {}
    for number, sensor in enumerate(run.sensors):
        rows = np.flatnonzero(run.detections.sensor == number)
        rows = rows[np.unique(run.truth.target[rows], return_index=True)[1]]
        periods = run.detections.time_ns[rows] / sensor.scan.period_ns
        scans[sensor.id] = np.rint(periods).astype(np.int64)
    return scans


@frozen
class BoostCounts:
    """Looks of a boost by sensor, the share of them that detects, and the confidence of first and
    later detections.
    """

    looks: Mapping[str, int]
    detected: Mapping[str, Simulated]
    confidence: Mapping[str, tuple[float, float]]


def boost_counts(seed: int) -> BoostCounts:
    """Return the counts of a boost of 300 s."""
    plan = opir.compile_plan(opir.scene_from_mapping(scene(seed, _BOOSTS)))
    detections = opir.run_of_plan(plan).detections
    looks = {}
    detected = {}
    confidence = {}
    for number, name in enumerate(SENSORS):
        looks[name] = int(plan.pairs.looks[plan.pairs.sensor == number][0])
        rows = np.flatnonzero(detections.sensor == number)
        detected[name] = Simulated.share(len(rows), _BOOSTS * looks[name])
        initial = rows[detections.detection_count[rows] == 1]
        values = detections.confidence
        confidence[name] = float(values[initial].mean()), float(values[rows].max())
    return BoostCounts(looks, detected, confidence)
