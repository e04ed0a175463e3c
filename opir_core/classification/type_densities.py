"""Densities of a sensor's measurements for each type and for other sources, computed when a scene is compiled."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.classification.configs import SpectralConfig
from opir_core.classification.gaussian_mixture import Components, Mixture, cell_moments
from opir_core.classification.synthetic_looks import (
    KINDS,
    MOMENTS,
    PROFILE_TYPE,
    SyntheticLooks,
    brightness,
    class_plumes,
    synthetic_launches,
    synthetic_sources,
)
from opir_core.detection.receivers import noise_chance
from opir_core.detection.snr import SnrDetection
from opir_core.interfaces.columns import names_of
from opir_core.interfaces.protocols import Band, Sensor
from opir_core.planning.visibility import visible_now
from opir_core.scene.scene import TARGET_TYPES

#: Edges of the elevation bins: sines of the sensor's elevation above the source's horizon.
_EDGES = np.array([0.15, 0.35, 0.65])

#: Least number of looks at a type in an elevation bin; with fewer, all elevations are used.
_FEW = 50

#: Parts of a burn, and step of the logarithm of brightness: each combination is one component.
_STRETCHES, _STEP_LOG = 8, 0.7

#: Weight of the class's spread in a component's covariance, in looks.
_SMOOTHING = 4.0

#: Hot sources of each kind; least probability of detection of types and kinds.
_SOURCES, _LEAST_CHANCE = 768, 1e-6

#: Rounding step of the logarithm of satellite radii: satellites of one fleet share their densities.
_HEIGHT_STEP = 0.05

#: Slack of P_d of synthetic looks.
_SLACK = 1e-3

_NS_PER_S = 1e9

#: Looks at launches and at sources, by the satellite's distance from the Earth's centre, m.
LooksByRadius = Callable[[float], tuple[SyntheticLooks, SyntheticLooks]]


@frozen(eq=False)
class TypeDensities:
    """Densities of apparent intensities (irradiance times range²), W/sr, for each elevation bin.

    Weights of `plumes` are seconds of a launch of their type; `log_seen_s` (bins, types) are logarithms of the sums of
    these times P_d, since types that are visible longer make more of the detections. Weights of `others` (kinds of
    sources, and noise) are equal shares of detections divided by P_d: a density given a detection.
    """

    width: int
    plumes: Mixture
    log_seen_s: FloatArray
    others: Mixture
    most_looks: float


@frozen(eq=False)
class _Samples:
    """Synthetic looks as measured by a sensor: apparent intensities (n, B), counts and their variance, P_d."""

    signal: FloatArray
    brightness: FloatArray
    count: FloatArray
    count_variance: FloatArray
    chance: FloatArray
    share: FloatArray
    number: IntArray
    stretch: IntArray
    place: IntArray

    def take(self, rows: Any) -> "_Samples":
        return _Samples(*(getattr(self, name)[rows] for name in names_of(type(self))))


def elevation_bin(elevation_sine: FloatArray) -> IntArray:
    """Return the elevation bins (n,)."""
    return np.searchsorted(_EDGES, elevation_sine).astype(np.int64)


def canonical_radius_m(sensor: Sensor) -> float:
    """Return a sensor's median distance from the Earth's centre over a day, m, rounded."""
    position = sensor.orbit.position_ecef_m(np.linspace(0.0, 86_400.0, 97))
    median = float(np.median(np.sqrt(np.square(position).sum(axis=1))))
    return float(np.exp(np.round(np.log(median) / _HEIGHT_STEP) * _HEIGHT_STEP))


def looks_by_radius(bands: Sequence[Band], launches: int) -> LooksByRadius:
    """Return a function of a satellite's distance from the Earth's centre to looks at launches and sources, cached."""
    plumes = class_plumes(bands)

    @cache
    def looks(radius_m: float) -> tuple[SyntheticLooks, SyntheticLooks]:
        return synthetic_launches(radius_m, plumes, launches), synthetic_sources(radius_m, bands, _SOURCES)

    return looks


def type_densities(
    detection: SnrDetection, number: int, sensor: Sensor, config: SpectralConfig, looks: LooksByRadius
) -> TypeDensities:
    """Return a sensor's densities: synthetic looks, measured through the scene's own atmosphere and background."""
    spread = config.brightness_log_sigma, config.colour_log_sigma
    flown, shining = looks(canonical_radius_m(sensor))
    factors = brightness(len(flown.targets.type_code), len(sensor.bands), *spread)
    launches = _measured(detection, number, sensor, flown, factors)
    sources = _measured(detection, number, sensor, shining, np.ones((1, len(shining.targets.type_code), 1)))
    log_false = noise_chance(detection.receivers[number])
    places = range(len(_EDGES) + 1)
    types = [launches.take(PROFILE_TYPE[launches.number] == code) for code in range(len(TARGET_TYPES))]
    kinds = [sources.take(sources.number == kind) for kind in range(len(KINDS))]
    return TypeDensities(
        width=len(sensor.bands),
        plumes=Mixture.of([[_components(_of_place(part, place), spread, 0.0) for part in types] for place in places]),
        log_seen_s=np.array([[_log_chance(_of_place(part, place)) for part in types] for place in places]),
        others=Mixture.of([_others([_of_place(part, place) for part in kinds], spread, log_false) for place in places]),
        most_looks=float(launches.count.max(initial=1.0)),
    )


def _others(kinds: list[_Samples], spread: tuple[float, float], log_false: float) -> list[Components]:
    """Return the components of all kinds of sources and of noise, with equal shares of detections."""
    even = -float(np.log(len(kinds) + 1.0))
    size = kinds[0].signal.shape[1] + 1
    noise = Components(np.array([even - log_false]), np.zeros((1, size)), np.zeros((1, size, size)))
    return [*(_components(part, spread, even - _log_chance(part)) for part in kinds), noise]


def _log_chance(samples: _Samples) -> float:
    return float(np.log(np.maximum(np.sum(samples.share * samples.chance), _LEAST_CHANCE * np.sum(samples.share))))


def _measured(
    detection: SnrDetection, number: int, sensor: Sensor, looks: SyntheticLooks, factors: FloatArray
) -> _Samples:
    """Return a sensor's measurements of visible looks, for brightness factors (draws, objects, B or 1)."""
    exposures = evolve(looks.exposures, sensor=np.full(len(looks.exposures), number, dtype=np.int32))
    none = np.zeros(len(looks.targets.type_code), dtype=np.int32)
    environment = evolve(
        detection.environment,
        targets=looks.targets,
        signatures=(looks.signatures,),
        group=none,
        place=np.arange(len(none), dtype=np.int32),
    )
    seen = visible_now(sensor, exposures.sensor_ecef_m, exposures.target_ecef_m)
    response, width = evolve(detection, environment=environment).response(exposures, slack=_SLACK), len(sensor.bands)
    noise, area = response.noise_w_m2[:, :width], np.square(exposures.range_m)[:, None]
    place, stretch = elevation_bin(exposures.elevation_sine), _stretch(looks)
    parts = list[_Samples]()
    for factor in factors:
        snr = response.snr[:, :width] * factor[exposures.target]
        chance = np.where(seen, np.exp(detection.receivers[number].chances(snr, noise, _SLACK)[0]), 0.0)
        count, variance = _counts(chance, looks.step_s, sensor.scan.period_ns / _NS_PER_S)
        columns = (snr * noise * area, snr.sum(axis=1), count, variance, chance)
        parts.append(_Samples(*columns, looks.share / len(factors), looks.number, stretch, place).take(seen))
    return _Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names_of(_Samples)))


def _stretch(looks: SyntheticLooks) -> IntArray:
    """Return the part of the burn (n,) of looks at launches; 0 for sources."""
    burns = np.arange(len(looks.exposures)) % MOMENTS * _STRETCHES // MOMENTS
    return burns if looks.step_s.any() else np.zeros_like(burns)


def _counts(chance: FloatArray, step_s: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (n,) of the detection count of an object at a detection, this one included."""
    if not step_s.any():
        return np.ones_like(chance), np.ones_like(chance)
    looks = (step_s / period_s).reshape(-1, MOMENTS)
    hit = chance.reshape(-1, MOMENTS)
    mean, variance = looks * hit, looks * hit * (1.0 - hit)
    before = [np.cumsum(column, axis=1) - 0.5 * column for column in (mean, variance)]
    # The first look is uniform over a period, a look uniform over its step of the burn.
    blur = np.square(looks * hit) / 12.0 + 1.0 / 12.0
    return 1.0 + before[0].ravel(), (before[1] + blur).ravel()


def _of_place(samples: _Samples, place: int) -> _Samples:
    here: BoolArray = samples.place == place
    return samples.take(here) if np.count_nonzero(here) >= _FEW else samples


def _components(samples: _Samples, spread: tuple[float, float], log_scale: float) -> Components:
    """Return the components of a type or kind; weights are shares of looks times exp(log_scale)."""
    step = np.floor(np.log(np.maximum(samples.brightness, 1e-3)) / _STEP_LOG).astype(np.int64)
    cell = (samples.number * _STRETCHES + samples.stretch) * 1000 + step - step.min(initial=0)
    weight, mean, covariance = cell_moments(samples.signal, samples.count, samples.share, cell)
    _, row, times = np.unique(cell, return_inverse=True, return_counts=True)
    covariance = _smoothed(covariance, mean, times, spread)
    covariance[:, -1, -1] += np.bincount(row, samples.share * samples.count_variance) / weight
    return Components(np.log(weight) + log_scale, mean, covariance)


def _smoothed(covariance: FloatArray, mean: FloatArray, times: IntArray, spread: tuple[float, float]) -> FloatArray:
    """Return covariances regularised by the spread of the class's brightness, for components of few looks."""
    signal = mean[:, :-1]
    wide = np.zeros_like(covariance)
    wide[:, :-1, :-1] = min(spread[0], _STEP_LOG) ** 2 * signal[:, :, None] * signal[:, None, :] / 12.0
    band = np.arange(signal.shape[1])
    wide[:, band, band] += np.square(spread[1] * signal)
    wide[:, -1, -1] = np.square(mean[:, -1] / _STRETCHES)
    share = (_SMOOTHING / (times + _SMOOTHING))[:, None, None]
    return (1.0 - share) * covariance + share * wide
