"""What re-enters is no missile to the classifier, and launches are not taken for it.

Bodies decay from orbits, fall as spent stages or as what a missile leaves, from random places.
"""

import numpy as np
import pytest
from opir_photons.classification.configs import SpectralConfig
from opir_trackers.configs import HypothesesConfig
from opir_trackers.onset.assumed_rates import assumed_rates
from pyproj import Geod

import opir_core as opir
from opir_core.plugin import REPORTED_TYPES

UNKNOWN = REPORTED_TYPES.index("UNKNOWN")
#: Speed, m/s, descent, deg, ballistic coefficient, kg/m², and area, m²: of 20 bodies each second is
#: of the first kind.
KINDS = (
    ((7300.0, 7900.0), (0.3, 2.0), (30.0, 300.0), (0.5, 10.0)),
    ((2500.0, 7000.0), (10.0, 40.0), (80.0, 300.0), (3.0, 20.0)),
    ((7300.0, 7900.0), (0.3, 2.0), (30.0, 300.0), (0.5, 10.0)),
    ((3000.0, 7200.0), (20.0, 45.0), (2000.0, 10_000.0), (0.2, 1.5)),
)
RANGES_KM = {"SRBM": 500.0, "MRBM": 2000.0, "IRBM": 4000.0, "ICBM": 9000.0}


def place(rng):
    """Return a random place within 50° of a satellite over 0° N 0° E."""
    return {"lat_deg": float(rng.uniform(-45, 45)), "lon_deg": float(rng.uniform(-45, 45))}


def body(rng, number):
    speed, descent, coefficient, area = KINDS[number % len(KINDS)]
    area_m2 = float(np.exp(rng.uniform(*np.log(area))))
    return {
        **place(rng),
        "speed_m_s": float(rng.uniform(*speed)),
        "descent_deg": float(rng.uniform(*descent)),
        "ballistic_coefficient_kg_m2": float(np.exp(rng.uniform(*np.log(coefficient)))),
        "area_m2": area_m2,
        "nose_radius_m": 0.5 * (area_m2 / np.pi) ** 0.5,
        "height_m": 105e3,
        "start_s": float(rng.uniform(0.0, 20.0)),
    }


def launch(rng, number):
    kind = list(RANGES_KM)[number % len(RANGES_KM)]
    start = place(rng)
    range_m = 1e3 * RANGES_KM[kind] * rng.uniform(0.8, 1.2)
    heading_deg = rng.uniform(0.0, 360.0)
    lon, lat, _ = Geod(ellps="WGS84").fwd(start["lon_deg"], start["lat_deg"], heading_deg, range_m)
    return {
        "id": f"T{number}",
        "type": kind,
        "launch": start,
        "aim": {"lat_deg": lat, "lon_deg": lon},
    }


def seen(seed, targets, sources, duration_s):
    """Return the plan, detections and targets (n,) of what is neither noise nor a false alarm."""
    scene = {
        "scene": "re-entry",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": duration_s,
        "seed": seed,
        "sensors": [
            {"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 0.0, "scan_period_ms": 1000},
            {"model": "NEXTGEN-GEO", "id": "N", "orbital_slot_deg": 5.0, "scan_period_ms": 1000},
            {"model": "DSP", "id": "D", "orbital_slot_deg": -5.0, "preset": "heritage"},
        ],
        "targets": targets,
        "sources": sources,
        "detection": "snr",
        "classification": "spectral",
        "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
        "background": "earth",
        "outputs": [],
    }
    run = opir.simulate(opir.scene_from_mapping(scene))
    rows = np.flatnonzero(run.truth.target >= 0)
    return run.plan, run.detections.take(rows), run.truth.target[rows]


def none_probability(plan, detections):
    none = plan.hypothesis_names.index("none of these")
    return np.exp(detections.hypothesis_log_probability[:, none])


@pytest.mark.slow
def test_what_re_enters_is_none_of_the_missiles():
    rng = np.random.default_rng(8191)
    bodies = [body(rng, number) for number in range(20)]
    plan, detections, target = seen(
        8191, [], [{"id": "R", "model": "reentries", "at": bodies}], 400.0
    )
    none = none_probability(plan, detections)
    for sensor in range(3):
        rows = np.flatnonzero(detections.sensor == sensor)
        called = detections.reported_type[rows] != UNKNOWN
        assert called.mean() <= 0.05, sensor
        assert np.mean(none[rows] > 0.5) > 0.75, sensor
    called_after_10_s = 0
    bodies_seen = np.unique(target)
    for number in bodies_seen:
        rows = np.flatnonzero((target == number) & (detections.sensor == 0))
        later = rows[detections.time_s[rows] >= detections.time_s[rows].min() + 10.0]
        called_after_10_s += detections.reported_type[later[0]] != UNKNOWN
    assert len(bodies_seen) == 20
    assert called_after_10_s <= 1


@pytest.mark.slow
def test_launches_do_not_re_enter_while_they_burn():
    rng = np.random.default_rng(8209)
    targets = [launch(rng, number) for number in range(20)]
    plan, detections, target = seen(8209, targets, [], 200.0)
    burns = detections.time_s < plan.targets.burnout_s[target]
    none = none_probability(plan, detections)
    assert np.count_nonzero(burns) > 4000
    assert np.mean(none[burns] > 0.5) < 0.1


def test_classifier_and_tracker_expect_as_many_by_the_same_name():
    rates = {rate.name: rate for rate in assumed_rates(HypothesesConfig())}
    rate = rates["reentries_per_day"]
    assert rate.per_day == SpectralConfig().reentries_per_day
    assert rate.kinds == ("re-entry",)
