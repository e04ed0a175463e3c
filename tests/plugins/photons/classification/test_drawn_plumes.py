"""Type probabilities of plumes that the classifier did not draw: spread 0.7, any propellant, other
temperatures.

Launches and fires are drawn here; nothing of the classifier's own draws is used. Detections of one
launch share its brightness: intervals are over launches.
"""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from opir_photons.classification.hot_sources import KINDS
from opir_photons.radiometry.propellants import band_log_sigma, gas_log_sigma, log_sigma
from scipy.stats import norm

import opir_core as opir

#: Of each flight: class, profile, reported type, share of launches, least and most range, km (none:
#: into orbit).
FLIGHTS = (
    ("SRBM", "SRBM", 2, 0.85 / 3, (100.0, 900.0)),
    ("MRBM", "MRBM", 1, 0.85 / 6, (1050.0, 2800.0)),
    ("IRBM", "MRBM", 1, 0.85 / 12, (1050.0, 2800.0)),
    ("IRBM", "IRBM", 1, 0.85 / 12, (3100.0, 5300.0)),
    ("SLBM", "SLBM", 0, 0.85 / 6, (2100.0, 11_500.0)),
    ("ICBM", "ICBM_solid", 0, 0.85 / 12, (5700.0, 14_500.0)),
    ("ICBM", "ICBM_liquid", 0, 0.85 / 12, (5700.0, 14_500.0)),
    ("HGV", "HGV", 1, 0.05, (2100.0, 7500.0)),
    ("SLV", "SLV", 3, 0.1, None),
)
UNKNOWN = 3
PROPELLANTS = ("kerosene", "methane", "solid", "storable", "hydrogen")
SENSORS = {"SBIRS-GEO": {"scan_period_ms": 10_000.0}, "DSP": {"preset": "heritage"}}
EARTH_KM = 6371.0
ORBIT_KM = 42_164.2
DURATION_S = 400.0

#: Largest mean score of a launch, ln of 1 over the probability of the true type, and points by
#: which a bin may be off.
MOST_SCORE = 0.9
POINTS = 0.07
#: Least number of detections in a bin, and the quantile of chance beyond the points.
ENOUGH = 100
QUANTILE = float(norm.isf(0.005))

Array = NDArray[np.float64]
Codes = NDArray[np.int64]


def moved(latitude: float, longitude: float, angle: float, heading: float) -> tuple[float, float]:
    """Return the place, rad, at an angle from another, on a sphere."""
    sine = math.sin(latitude) * math.cos(angle) + math.cos(latitude) * math.sin(angle) * math.cos(
        heading
    )
    east = math.sin(heading) * math.sin(angle) * math.cos(latitude)
    return math.asin(sine), longitude + math.atan2(
        east, math.cos(angle) - math.sin(latitude) * sine
    )


def degrees(latitude: float, longitude: float) -> dict[str, float]:
    return {
        "lat_deg": math.degrees(latitude),
        "lon_deg": (math.degrees(longitude) + 180.0) % 360.0 - 180.0,
    }


def seen_place(rng: np.random.Generator) -> tuple[float, float]:
    """Return a place under the sensor at longitude 0, uniform in the sine of the sensor's
    elevation.
    """
    elevation = math.asin(rng.uniform(0.05, 1.0))
    angle = math.acos(EARTH_KM * math.cos(elevation) / ORBIT_KM) - elevation
    return moved(0.0, 0.0, angle, rng.uniform(0.0, 2.0 * math.pi))


def drawn_launch(rng: np.random.Generator, number: int) -> tuple[dict[str, Any], int]:
    """Return a launch and the type that it is to be reported as."""
    share = [flight[3] for flight in FLIGHTS]
    kind, profile, code, _, ranges_km = FLIGHTS[rng.choice(len(FLIGHTS), p=share)]
    place = seen_place(rng)
    heading = rng.uniform(0.0, 2.0 * math.pi)
    plume = {
        "model": "plume",
        "scale": float(np.exp(0.7 * rng.standard_normal())),
        "propellant": PROPELLANTS[rng.integers(len(PROPELLANTS))],
        "gas_temperature_k": rng.uniform(1500.0, 2600.0),
        "continuum_temperature_k": rng.uniform(1300.0, 1800.0),
    }
    launch = {**degrees(*place), "time_s": rng.uniform(0.0, 10.0)}
    target = {"id": f"T{number}", "type": kind, "launch": launch, "signature": plume}
    if ranges_km is None:
        return {**target, "azimuth_deg": math.degrees(heading)}, code
    range_km = math.exp(rng.uniform(*np.log(ranges_km)))
    own = {"profile": profile} if kind in ("ICBM", "IRBM") else {}
    return {**target, **own, "aim": degrees(*moved(*place, range_km / EARTH_KM, heading))}, code


def drawn_fires(
    rng: np.random.Generator, count: int, least_m2: float, most_m2: float
) -> list[dict[str, float]]:
    """Return fires with areas uniform in their logarithm."""
    return [
        {
            **degrees(*seen_place(rng)),
            "temperature_k": rng.uniform(800.0, 1200.0),
            "area_m2": math.exp(rng.uniform(math.log(least_m2), math.log(most_m2))),
        }
        for _ in range(count)
    ]


def scene(targets: list[Any], fires: list[Any], seed: int, **classification: Any) -> opir.Scene:
    return opir.scene_from_mapping(
        {
            "scene": "drawn",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": DURATION_S,
            "seed": seed,
            "sensors": [
                {"model": name, "id": name, "orbital_slot_deg": 0.0, **settings}
                for name, settings in SENSORS.items()
            ],
            "targets": targets,
            "sources": [{"id": "F", "model": "fires", "at": fires}] if fires else [],
            "detection": "snr",
            "classification": {"model": "spectral", **classification},
            "confidence": "posterior",
            "atmosphere": {"model": "lowtran", "climate": "midlat_summer"},
            "background": "earth",
            "outputs": [],
        }
    )


@pytest.fixture(scope="module")
def classified() -> dict[str, tuple[Array, Codes, Codes]]:
    """Return, by sensor, type probabilities (n, 4), true types (n,) and launches (n,) of its
    detections of launches.
    """
    rng = np.random.default_rng([2027, 41])
    launches = [drawn_launch(rng, number) for number in range(1500)]
    code = np.array([true for _, true in launches])
    per_day = 86_400.0 / DURATION_S * len(launches)
    plain = scene(
        [target for target, _ in launches], [], 41, launches_per_day=per_day, sources_in_view={}
    )
    run = opir.simulate(plain)
    targets = opir.compile_plan(plain).targets
    result = {}
    for number, name in enumerate(SENSORS):
        rows = np.flatnonzero((run.detections.sensor == number) & (run.truth.target >= 0))
        launch = run.truth.target[rows].astype(np.int64)
        # What glides has no type of missiles.
        is_over = run.detections.time_s[rows] > targets.burnout_s[launch]
        true = np.where(is_over, UNKNOWN, code[launch])
        result[name] = run.detections.type_probability[rows], true, launch
    return result


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
def test_probabilities_of_types_are_right_within_seven_points(classified: Any, sensor: str) -> None:
    probability, true, launch = classified[sensor]
    bins = 0
    for code in range(UNKNOWN + 1):
        place = np.minimum((10.0 * probability[:, code]).astype(np.int64), 9)
        for number in range(10):
            own = np.flatnonzero(place == number)
            if len(own) < ENOUGH:
                continue
            bins += 1
            off = (true[own] == code) - probability[own, code]
            _, row = np.unique(launch[own], return_inverse=True)
            of_launch = np.bincount(row, off) - off.mean() * np.bincount(row)
            chance = QUANTILE * math.sqrt(np.sum(np.square(of_launch))) / len(own)
            assert abs(off.mean()) < POINTS + chance, (
                sensor,
                code,
                number,
                len(own),
                off.mean(),
                chance,
            )
    assert bins >= 30


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
def test_log_scores_match_an_informed_classifier(classified: Any, sensor: str) -> None:
    probability, true, launch = classified[sensor]
    score = -np.log(probability[np.arange(len(true)), true])
    assert np.mean(np.bincount(launch, score) / np.maximum(np.bincount(launch), 1)) < MOST_SCORE


@pytest.mark.slow
def test_large_fires_are_no_missiles() -> None:
    fires = drawn_fires(np.random.default_rng(19), 250, 8e3, 4.4e5)
    run = opir.simulate(scene([], fires, 19))
    taken = run.detections.reported_type[run.truth.target >= 0] != UNKNOWN
    assert len(taken) > 3000
    assert taken.mean() < 1e-3


def test_a_spread_is_the_factor_that_holds_nine_times_in_ten() -> None:
    assert math.exp(log_sigma(3.0) * norm.ppf(0.95)) == pytest.approx(3.0)
    assert gas_log_sigma() == pytest.approx(0.7, abs=0.005)
    assert band_log_sigma() == pytest.approx(math.log(1.2) / norm.ppf(0.95))


def test_fires_reach_from_a_small_pixel_to_tens_of_hectares() -> None:
    """Quantiles of MODIS pixels, 29 and 786 MW, by Stefan and Boltzmann's law at 1000 K, and a fire
    of 44 hectares.
    """
    fire = next(kind for kind in KINDS if kind.name == "fire")
    for area_m2 in (29e6 / (5.670374e-8 * 1e12), 786e6 / (5.670374e-8 * 1e12), 44e4):
        assert abs(math.log(area_m2 / fire.area_m2)) < 3.0 * fire.area_log_sigma
