"""Discrimination and classification through the whole engine: the order of sensors, and
probabilities that hold.

The objects are those of benchmarks/calibration_looks.py, fewer of them. Sensors have a given noise and
no focal planes, whose difference of frames would take away what does not move: bands are compared.
"""

import importlib
import sys
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from attrs import fields
from numpy.typing import NDArray
from repository import ROOT
from scipy.stats import norm

from opir_core import Host
from opir_core.flight import boost_profile
from opir_core.plugin import TARGET_TYPES
from opir_core.sensors.radiometer import RadiometerConfig

pytestmark = pytest.mark.slow

BENCHMARKS = ROOT / "benchmarks"
FLOATS = NDArray[np.float64]
PERIOD_S = 2.0
#: Each look is judged by itself, and all sensors look at the same whole periods.
LOOKS = {"confirmation_detections": 1, "scan_period_ms": 1e3 * PERIOD_S, "scan_phase": "aligned"}
NOISE: dict[str, dict[str, Any]] = {
    "DSP": {"preset": "paper", "focal_plane": None, "nei_w_m2": 5e-13},
    "SBIRS-GEO": {"focal_plane": None, "nei_w_m2": 1e-12},
    "NEXTGEN-GEO": {"focal_plane": None, "nei_w_m2": 1e-13, "collection_m2_s": 0.02},
}
#: Mean times for which sources shine, as in the classifier's prior.
SHINING_S = {"fire": 21_600.0, "flare": 86_400.0, "glint": 1200.0}
LAUNCHES = 80
SOURCES = 70


@pytest.fixture(scope="module")
def benchmark_() -> Iterator[SimpleNamespace]:
    """Yield the names of the benchmark's module."""
    sys.path.insert(0, str(BENCHMARKS))
    yield SimpleNamespace(**vars(importlib.import_module("calibration_looks")))
    sys.path.remove(str(BENCHMARKS))


@pytest.fixture(scope="module")
def people(benchmark_: SimpleNamespace) -> Any:
    people = benchmark_.population(LAUNCHES, SOURCES, seed=2)
    burn_s = np.array(
        [boost_profile(each["profile"]).burn_time_s for each in people.scene["targets"]]
    )
    within_s = np.append(burn_s, np.full(SOURCES * len(SHINING_S), benchmark_.DURATION_S))
    moment_s = moments_s(np.random.default_rng([2, 17]), within_s)
    scene = {
        **people.scene,
        "sensors": sensors(),
        "classification": {"model": "spectral", **prior(benchmark_.DURATION_S)},
    }
    return people._replace(scene=scene, moment_s=moment_s)


def sensors() -> list[dict[str, Any]]:
    """Return every sensor twice: with and without its rule over bands."""
    return [
        {"model": name, "id": f"{name}{suffix}", "orbital_slot_deg": 0.0, **LOOKS, **noise, **rule}
        for name, noise in NOISE.items()
        for suffix, rule in (("", {}), ("-ANY", {"spectral_discrimination": "none"}))
    ]


def prior(duration_s: float) -> dict[str, Any]:
    """Return the prior: as many launches a day, and sources that shine as long, as in the scene."""
    return {
        "launches_per_day": 86_400.0 / duration_s * LAUNCHES * len(TARGET_TYPES),
        "prior": dict.fromkeys(TARGET_TYPES, 1.0 / len(TARGET_TYPES)),
        "sources_in_view": {
            kind: SOURCES * shining_s / duration_s for kind, shining_s in SHINING_S.items()
        },
    }


def moments_s(rng: np.random.Generator, within_s: FLOATS) -> FLOATS:
    """Return moments (n,) of looks, drawn evenly within spans (n,) of scene time."""
    drawn: FLOATS = PERIOD_S * np.ceil(
        rng.random(len(within_s)) * np.floor(within_s / PERIOD_S - 0.5)
    )
    return drawn


@pytest.fixture(scope="module")
def simulated(benchmark_: SimpleNamespace, people: Any) -> Any:
    return benchmark_.simulated(people)


@pytest.fixture(scope="module")
def burning(benchmark_: SimpleNamespace, people: Any, simulated: Any) -> tuple[Any, dict[str, Any]]:
    """Return what is looked at within its own burn, and the looks."""
    return people, benchmark_.looks_at(people, *simulated)


@pytest.fixture(scope="module")
def streamed(
    benchmark_: SimpleNamespace, people: Any, simulated: Any
) -> tuple[Any, dict[str, Any]]:
    """Return what is looked at within one span for all: types are seen as often as in a stream of
    detections.
    """
    span_s = np.full(len(people.kind), boost_profile("ICBM_liquid").burn_time_s)
    moment_s = moments_s(np.random.default_rng(3), span_s)
    other = people._replace(moment_s=moment_s)
    return other, benchmark_.looks_at(other, *simulated)


@pytest.mark.parametrize("of_looks", [False, True])
def test_discrimination_follows_the_order_of_bands(
    benchmark_: SimpleNamespace, burning: tuple[Any, dict[str, Any]], of_looks: bool
) -> None:
    people, looks = burning
    any_band = {sensor: looks[f"{sensor}-ANY"] for sensor in NOISE}
    orders = benchmark_.area_orders(people, any_band, of_looks=of_looks)
    assert [order[:2] for order in orders] == [("DSP", "SBIRS-GEO"), ("SBIRS-GEO", "NEXTGEN-GEO")]
    assert min(gain for _, _, gain, _, _ in orders) > 0.0
    # Soot and alumina have colours in two bands that fires have not; the third adds less, which 80
    # launches a type show at 5 %.
    assert max(p for _, _, _, _, p in orders) < 0.1


def test_sensors_tell_types_in_the_order_of_their_bands(
    benchmark_: SimpleNamespace, burning: tuple[Any, dict[str, Any]]
) -> None:
    orders = benchmark_.type_orders(*burning)
    assert min(gain for _, _, gain, _ in orders) > 0.0
    assert max(p for _, _, _, p in orders) < 0.01


@pytest.mark.parametrize(
    "sensor", ["DSP-ANY", "SBIRS-GEO", "SBIRS-GEO-ANY", "NEXTGEN-GEO", "NEXTGEN-GEO-ANY"]
)
def test_a_type_of_probability_p_is_right_in_a_share_p_of_cases(
    streamed: tuple[Any, dict[str, Any]], sensor: str
) -> None:
    people, looks = streamed
    launches = np.isin(people.kind, TARGET_TYPES)
    chances = looks[sensor].probability[launches]
    seen = np.isfinite(chances[:, 0])
    given_plume = chances[seen, :3] / chances[seen, :3].sum(axis=1, keepdims=True)
    right = people.kind[launches][seen][:, None] == np.array(TARGET_TYPES)
    assert len(right) > 20
    reported = 0
    for low, high in ((0.0, 0.1), (0.1, 0.4), (0.4, 0.7), (0.7, 0.95), (0.95, 1.01)):
        cell = (given_plume >= low) & (given_plume < high)
        assert abs(surprise(given_plume[cell], right[cell])) < norm.isf(0.0005), (low, high)
        reported += int(cell.sum())
    assert reported == given_plume.size


def surprise(chance: FLOATS, happened: NDArray[np.bool_]) -> float:
    """Return by how many standard deviations events happen more often than their chances say, less
    half an event.
    """
    off = float(happened.sum() - chance.sum())
    return float(
        np.sign(off) * max(abs(off) - 0.5, 0.0) / np.sqrt(np.sum(chance * (1.0 - chance)) + 1e-12)
    )


def test_areas_under_curves_of_normal_scores(
    benchmark_: SimpleNamespace,
) -> None:
    # Scores N(1, 1) against N(0, 1): the area is Phi(1/sqrt 2); deviations are held to those of
    # many repetitions.
    rng = np.random.default_rng(9)
    result = []
    for _ in range(400):
        plume = rng.normal(1.0, 1.0, 80)
        other = rng.normal(0.0, 1.0, 60)
        result.append(benchmark_.area(plume, other))
    middle, low, high = np.array(result).T
    true = norm.cdf(np.sqrt(0.5))
    assert abs(middle.mean() - true) < 3.3 * middle.std() / 20.0
    assert 0.90 < np.mean((low <= true) & (true <= high)) < 0.985


def test_a_gain_of_nothing_is_seldom_significant(benchmark_: SimpleNamespace) -> None:
    rng = np.random.default_rng(10)
    p = []
    for _ in range(400):
        shared = rng.normal(0.0, 1.0, (2, 60))
        worse, better = (
            [row + rng.normal(0.0, 1.0, 60) + (side == 0) for side, row in enumerate(shared)]
            for _ in "ab"
        )
        hidden = rng.random(60) < 0.2
        worse[0][hidden] = -np.inf
        better[0][hidden] = worse[0][hidden]
        p.append(benchmark_.area_gain(worse, better, of_looks=False)[2])
    assert 0.015 < np.mean(np.array(p) < 0.05) < 0.10


def test_the_heo_sensor_measures_light_as_sbirs_geo_does() -> None:
    """Why the benchmark has no row of its own for it."""
    host = Host.discover(["sbirs", "heo"])
    geo, heo = (host.component("opir_sensor_models", name).config for name in ("SBIRS-GEO", "HEO"))
    names = [
        *(field.name for field in fields(RadiometerConfig)),
        "bands",
        "spectral_discrimination",
    ]
    for name in names:
        assert getattr(fields(geo), name).default == getattr(fields(heo), name).default, name
