"""What the engine draws, counted against exact laws: detections by SNR, first detections, noise,
lines of sight.

Every bound holds at 99.9 % for all comparisons of its test together (Bonferroni). Seeds are fixed;
`OPIR_CHANCE_TARGETS=500` repeats each launch that often; benchmarks/first_detection.py has all
climates and clouds.
"""

import itertools
import os
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm, poisson

import opir_core as opir
from opir_core import DetectionTruth, Engine
from opir_core.planning import Looks
from opir_core.plugin import Detections

TARGETS = int(os.environ.get("OPIR_CHANCE_TARGETS", "40"))
RISK = 0.001
CLASSES = {"SRBM": (38.0, -108.0), "IRBM": (50.0, -85.0), "ICBM": (60.0, 60.0)}
SENSORS = {"DSP": -95.0, "SBIRS-GEO": -105.0, "NEXTGEN-GEO": -115.0}
BINS = 20
CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")
CLOUDS = ({}, {"cloud": {"top_km": 10.0}}, {"cloud": {"top_km": 6.0, "cover": 0.5}})
#: Launches of each class under each sky.
FEW = max(TARGETS // 8, 1)


def scene(repeats: int, sensors: list[dict[str, Any]], **changes: Any) -> opir.Scene:
    """Return a scene in which each class is launched so often from one place, at one time."""
    targets = [
        {
            "id": f"{kind}-{number}",
            "type": kind,
            "launch": {"lat_deg": 35.0, "lon_deg": -110.0, "time_s": 2.0},
            "aim": {"lat_deg": aim[0], "lon_deg": aim[1]},
        }
        for kind, aim in CLASSES.items()
        for number in range(repeats)
    ]
    mapping = {
        "scene": "chance",
        "epoch": "2026-04-01T19:00:00Z",
        "duration_s": 90.0,
        "seed": 11,
        "sensors": sensors,
        "targets": targets,
        "detection": {"model": "snr"},
        "classification": "paper",  # the laws here are of detections
        "outputs": [],
    }
    return opir.scene_from_mapping({**mapping, **changes})


#: In long waves the Earth hides every plume: DSP in its heritage bands, as often as by default,
#: with such noise that an SRBM is seldom seen.
OWN = {"DSP": {"preset": "heritage", "scan_period_ms": 200.0, "nei_w_m2": 5e-11}}


def fleet(**settings: Any) -> list[dict[str, Any]]:
    """Return one sensor of each kind; they report every detection: the laws here are of single
    looks.
    """
    return [
        {
            "model": model,
            "id": model,
            "orbital_slot_deg": slot,
            **OWN.get(model, {}),
            "confirmation_detections": 1,
        }
        | settings
        for model, slot in SENSORS.items()
    ]


def drawn(plan: Any) -> tuple[Detections, DetectionTruth]:
    """Return a run's detections and truth."""
    engine = Engine(plan)
    window = engine.advance(plan.end_ns)
    return window.detections, window.truth


class Story(NamedTuple):
    """Exact chances and SNR of one launch's looks, and the scans in which the launches of its class
    were detected.
    """

    scan: np.ndarray
    chance: np.ndarray
    snr: np.ndarray
    found: list[np.ndarray]


def reported(
    repeats: int, sensors: list[dict[str, Any]], **changes: Any
) -> dict[tuple[str, str], Story]:
    """Return what becomes of each class before each sensor."""
    first_run = opir.compile_plan(scene(1, sensors, **changes))
    looks = Looks.between(first_run.pairs, 0, first_run.end_ns)
    exposed = first_run.look_geometry().exposures(looks.pair, looks.scan)
    chance = first_run.detection.probability(exposed)
    snr = first_run.detection.response(exposed).snr[:, 0]
    detections, truth = drawn(opir.compile_plan(scene(repeats, sensors, **changes)))
    results = {}
    for sensor, model in enumerate(SENSORS):
        for number, kind in enumerate(CLASSES):
            rows = (exposed.sensor == sensor) & (exposed.target == number)
            own_rows = [
                (detections.sensor == sensor) & (truth.target == number * repeats + item)
                for item in range(repeats)
            ]
            scans = [np.sort(detections.scan[item]) for item in own_rows]
            results[model, kind] = Story(exposed.scan[rows], chance[rows], snr[rows], scans)
    return results


@pytest.fixture(scope="module")
def stories() -> dict[tuple[str, str], Story]:
    """Return what becomes of each class before each sensor, through humid air, before the sunlit
    Earth.
    """
    return reported(
        TARGETS, fleet(), atmosphere={"model": "lowtran", "climate": "tropical"}, background="earth"
    )


@pytest.mark.parametrize("model", SENSORS)
def test_detection_rates_in_20_bins_of_snr(
    stories: dict[tuple[str, str], Story], model: str
) -> None:
    pieces = [stories[model, kind] for kind in CLASSES]
    snr, chance = (
        np.concatenate([getattr(part_value, name) for part_value in pieces])
        for name in ("snr", "chance")
    )
    hits = np.concatenate(
        [np.isin(part_value.scan, item) for part_value in pieces for item in part_value.found]
    )  # Class by class, launch by launch.
    bins = np.searchsorted(np.quantile(snr, np.linspace(0.0, 1.0, BINS + 1)[1:-1]), snr)
    edges = np.cumsum([0, *(len(part_value.scan) for part_value in pieces)])
    of_hits = np.concatenate([np.tile(bins[a:b], TARGETS) for a, b in itertools.pairwise(edges)])
    counted = np.bincount(of_hits, hits, minlength=BINS)
    expected = TARGETS * np.bincount(bins, chance, minlength=BINS)
    spread = np.sqrt(TARGETS * np.bincount(bins, chance * (1.0 - chance), minlength=BINS))
    # Interpolation between knots may move each chance by the default tolerance, 1e-4, and counts
    # are whole.
    allowance = 1.0 + 1e-4 * TARGETS * np.bincount(bins, minlength=BINS)
    limit = norm.isf(0.5 * RISK / (BINS * len(SENSORS)))
    assert counted.sum() > 5 * BINS
    assert (np.abs(counted - expected) <= limit * spread + allowance).all()


def test_first_detections_follow_the_product_of_misses(
    stories: dict[tuple[str, str], Story],
) -> None:
    """The bound of Dvoretzky, Kiefer, Wolfowitz and Massart on shares detected until each look, for
    all nine cells.
    """
    bound = np.sqrt(np.log(2.0 * len(stories) / RISK) / (2.0 * TARGETS))
    shares = {}
    for key, story in stories.items():
        missed = np.cumprod(1.0 - story.chance)
        first_value = np.sort([item[0] for item in story.found if len(item)])
        until = np.searchsorted(first_value, story.scan, side="right") / TARGETS
        assert np.abs(until - (1.0 - missed)).max() <= bound, key
        shares[key] = 1.0 - missed[-1]
    assert max(shares.values()) > 0.999
    assert min(shares.values()) < 0.999


@pytest.mark.slow
def test_latency_distribution_under_every_sky() -> None:
    """Class by class, sensor by sensor, climate by climate, cloud by cloud: the level of each
    launch's first detection.

    The level in its own law, drawn evenly within the look's step, is uniform; so are all of them
    together, and those of each class and sensor. While a target climbs the time of its first
    detection tells its height.
    """
    rng = np.random.default_rng(21)
    levels = {}
    for climate, cloud in itertools.product(CLIMATES, CLOUDS):
        sky = {"model": "lowtran", "climate": climate, **cloud}
        seldom = fleet(scan_period_ms=500.0)
        for cell, story in reported(
            FEW, seldom, atmosphere=sky, background="earth", duration_s=60.0
        ).items():
            law = np.concatenate([[0.0], 1.0 - np.cumprod(1.0 - story.chance), [1.0]])
            for scans in story.found:
                step = np.searchsorted(story.scan, scans[0]) if len(scans) else len(story.scan)
                levels.setdefault(cell, []).append(rng.uniform(law[step], law[step + 1]))
    everything = [first_run for cell in levels.values() for first_run in cell]
    assert len(everything) == 9 * FEW * len(CLIMATES) * len(CLOUDS)
    for group in (everything, *levels.values()):
        count = len(group)
        distance = np.abs(np.sort(group) - (np.arange(count) + 0.5) / count).max() + 0.5 / count
        assert distance <= np.sqrt(np.log(2.0 * (1 + len(levels)) / RISK) / (2.0 * count))


def noise_chance(sensor: Any, nei_w_m2: np.ndarray) -> float:
    """Return the chance that noise alone passes a sensor's rule, by SciPy's quadrature of its
    definition.
    """
    light = sensor.radiometer
    if sensor.spectral_discrimination == "likelihood":
        # A weighted sum of unit length.
        return float(norm.sf(light.threshold))
    if sensor.spectral_discrimination == "none":
        return float(-np.expm1(len(sensor.bands) * norm.logcdf(light.threshold)))

    def density(y: float) -> float:
        value = norm.pdf(y)
        for band in set(range(len(sensor.bands))) - {light.reference}:
            steep = nei_w_m2[light.reference] / nei_w_m2[band]
            least, upper = (ratio * steep for ratio in light.ratios[band])
            low = max(least * y - light.ratio_tolerance * np.hypot(1.0, least), light.coincidence)
            high = upper * y + light.ratio_tolerance * np.hypot(1.0, upper)
            value *= max(norm.sf(low) - norm.sf(high), 0.0)
        return float(value)

    return float(
        quad(density, light.threshold, light.threshold + 8.0, epsabs=0.0, epsrel=1e-9, limit=500)[0]
    )


#: Rules over bands, each with a threshold that noise passes some hundred times: gates take most of
#: it away.
RULES = {
    "likelihood": {
        "DSP": {"threshold_sigma": 5.4},
        "SBIRS-GEO": {"threshold_sigma": 5.75},
        "NEXTGEN-GEO": {"threshold_sigma": 6.1},
    },
    "gates": {
        "SBIRS-GEO": {"spectral_discrimination": "dual-band-ratio", "threshold_sigma": 5.4},
        "NEXTGEN-GEO": {"spectral_discrimination": "triple-coincidence", "threshold_sigma": 5.4},
    },
}


@pytest.mark.parametrize("rule", RULES)
def test_false_alarms_are_poisson_at_the_rate_of_the_threshold(rule: str) -> None:
    own_rows = RULES[rule]
    sensors = [
        first_run | own_rows[first_run["model"]]
        for first_run in fleet(coincidence_sigma=1.0)
        if first_run["model"] in own_rows
    ]
    plan = opir.compile_plan(scene(0, sensors, duration_s=120.0, classification="paper"))
    detections, truth = drawn(plan)
    assert (truth.target < 0).all()
    for number, sensor in enumerate(plan.sensors):
        cells = (
            4.0
            * np.pi
            * (np.sin(0.5 * sensor.field_of_regard_half_angle_rad) / sensor.radiometer.ifov_rad)
            ** 2
        )
        scans = round(120e9 / sensor.scan.period_ns)
        mean = noise_chance(sensor, plan.detection.receivers[number].nei_w_m2) * cells * scans
        times = detections.time_ns[detections.sensor == number]
        assert mean > 200.0, sensor.id
        # Two comparisons a sensor: the count, and how counts of a second spread.
        risk = RISK / (2 * len(plan.sensors))
        least, upper = poisson.interval(1.0 - risk, mean)
        assert least <= len(times) <= upper, sensor.id
        by_second = np.bincount(times // 10**9, minlength=120)
        spread = ((by_second - mean / 120.0) ** 2).sum() / (mean / 120.0)
        assert chi2.isf(1.0 - 0.5 * risk, 120) <= spread <= chi2.isf(0.5 * risk, 120), sensor.id


@pytest.mark.parametrize("bias_urad", [0.0, 40.0])
def test_line_of_sight_residuals_are_chi_squared(
    bias_urad: float,
) -> None:
    plan = opir.compile_plan(scene(4, fleet(line_of_sight_bias_sigma_urad=bias_urad)))
    detections, truth = drawn(plan)
    real = truth.target >= 0
    detections = detections.take(real)
    truth = truth.take(real)
    at = (
        plan.targets.position_ecef_m(truth.target, truth.emission_time_s) - detections.sensor_ecef_m
    )
    true = at / np.linalg.norm(at, axis=1)[:, None]
    turned = true
    if plan.bias is not None:
        turned = np.stack(
            plan.bias.applied(*true.T, detections.sensor, detections.sensor_ecef_m), axis=1
        )
    assert (plan.bias is None) == (bias_urad == 0.0)
    for number in range(len(SENSORS)):
        rows = detections.sensor == number
        for direction, is_right in ((true, bias_urad == 0.0), (turned, True)):
            off = (detections.line_of_sight_ecef - direction)[
                rows
            ] / detections.line_of_sight_sigma_rad[rows, None]
            shares = np.sort(chi2.cdf(np.square(off).sum(axis=1), 2))
            count = len(shares)
            assert count > 100
            distance = np.abs(shares - (np.arange(count) + 0.5) / count).max() + 0.5 / count
            limit = np.sqrt(np.log(2.0 * 12 / RISK) / (2.0 * count))
            assert (distance <= limit) == is_right, (number, bias_urad)
