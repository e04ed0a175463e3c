"""What a sensor expects to measure of each type, and of anything else: densities, made when a scene is compiled."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.classification.configs import SpectralConfig
from opir_core.classification.imagined import (
    KINDS,
    MOMENTS,
    PROFILE_TYPE,
    ImaginedLooks,
    brightness,
    class_plumes,
    imagined_launches,
    imagined_sources,
)
from opir_core.classification.mixture import Components, Mixture, gathered
from opir_core.interfaces.columns import names_of
from opir_core.interfaces.protocols import Band, Sensor
from opir_core.planning.visibility import visible_now
from opir_core.scene.scene import TARGET_TYPES

#: Densities are kept for parts of the sky, by the sine of the elevation under which a sensor stands there.
_EDGES = np.array([0.15, 0.35, 0.65])

#: A part of the sky with fewer looks than this at a type takes the looks at all of the sky.
_FEW = 50

#: A burn is cut into so many stretches, and brightness into steps of so much in its logarithm: each is one component.
_STRETCHES, _STEP_LOG = 8, 0.7

#: A component's spread is that of its looks and of so many more as wide as the class is.
_SMOOTHING = 4.0

#: Hot sources of each kind; types and kinds are detected at least so often, or their share would rest on nothing.
_SOURCES, _LEAST_CHANCE = 768, 1e-6

#: Steps, in the logarithm, that heights of satellites are rounded to: those of one fleet share their densities.
_HEIGHT_STEP = 0.05

#: P_d of imagined looks is right to this.
_SLACK = 1e-3

_NS_PER_S = 1e9

#: By distance from the Earth's centre, m: launches and sources.
Imagination = Callable[[float], tuple[ImaginedLooks, ImaginedLooks]]


@frozen(eq=False)
class TypeDensities:
    """Densities of apparent intensities, W/sr, irradiance times range², for each part of the sky.

    Weights of `plumes` are seconds of a launch of their type, and `log_seen_s` (parts, types) logarithms of the sums of
    these, each times its probability of detection: a type that is seen longer and more surely makes more of the
    detections. Weights of `others` are, kind by kind and noise among them, an equal share of detections over the
    probability of detection: that is what a density given a detection is.
    """

    width: int
    plumes: Mixture
    log_seen_s: FloatArray
    others: Mixture
    most_looks: float


@frozen(eq=False)
class _Samples:
    """Imagined looks as a sensor measures them: apparent intensities (n, B), counts and their variance, chances."""

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
    """Return the part of the sky (n,) that elevations belong to."""
    return np.searchsorted(_EDGES, elevation_sine).astype(np.int64)


def canonical_radius_m(sensor: Sensor) -> float:
    """Return the distance from the Earth's centre that stands for a sensor's: the median of a day, rounded."""
    position = sensor.orbit.position_ecef_m(np.linspace(0.0, 86_400.0, 97))
    median = float(np.median(np.sqrt(np.square(position).sum(axis=1))))
    return float(np.exp(np.round(np.log(median) / _HEIGHT_STEP) * _HEIGHT_STEP))


def imagination(bands: Sequence[Band], launches: int) -> Imagination:
    """Return what gives, by a satellite's distance from the Earth's centre, launches and sources; made once each."""
    plumes = class_plumes(bands)

    @cache
    def imagined(radius_m: float) -> tuple[ImaginedLooks, ImaginedLooks]:
        return imagined_launches(radius_m, plumes, launches), imagined_sources(radius_m, bands, _SOURCES)

    return imagined


def bank_of(
    detection: Any, number: int, sensor: Sensor, config: SpectralConfig, imagined: Imagination
) -> TypeDensities:
    """Return a sensor's bank: what the scene's own chain of light makes of what is imagined before it."""
    spread = config.brightness_log_sigma, config.colour_log_sigma
    flown, shining = imagined(canonical_radius_m(sensor))
    factors = brightness(len(flown.targets.type_code), len(sensor.bands), *spread)
    launches = _measured(detection, number, sensor, flown, factors)
    sources = _measured(detection, number, sensor, shining, np.ones((1, len(shining.targets.type_code), 1)))
    log_false = _log_noise_chance(detection, number)
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
    """Return the components of all kinds of sources and of noise, which have equal shares of detections."""
    even = -float(np.log(len(kinds) + 1.0))
    size = kinds[0].signal.shape[1] + 1
    noise = Components(np.array([even - log_false]), np.zeros((1, size)), np.zeros((1, size, size)))
    return [*(_components(part, spread, even - _log_chance(part)) for part in kinds), noise]


def _log_chance(samples: _Samples) -> float:
    return float(np.log(np.maximum(np.sum(samples.share * samples.chance), _LEAST_CHANCE * np.sum(samples.share))))


def _measured(detection: Any, number: int, sensor: Sensor, looks: ImaginedLooks, factors: FloatArray) -> _Samples:
    """Return what a sensor would measure of looks that see their object, for brightness (draws, objects, B or 1)."""
    exposures = evolve(looks.exposures, sensor=np.full(len(looks.exposures), number, dtype=np.int32))
    nobody = np.zeros(len(looks.targets.type_code), dtype=np.int32)
    scenery = evolve(
        detection.scenery,
        targets=looks.targets,
        signatures=(looks.signatures,),
        group=nobody,
        place=np.arange(len(nobody), dtype=np.int32),
    )
    seen = visible_now(sensor, exposures.sensor_ecef_m, exposures.target_ecef_m)
    response, width = evolve(detection, scenery=scenery).response(exposures, slack=_SLACK), len(sensor.bands)
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


def _stretch(looks: ImaginedLooks) -> IntArray:
    """Return the stretch of the burn (n,) that looks at launches fall in; 0 for sources."""
    burns = np.arange(len(looks.exposures)) % MOMENTS * _STRETCHES // MOMENTS
    return burns if looks.step_s.any() else np.zeros_like(burns)


def _counts(chance: FloatArray, step_s: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (n,) of how often an object has been detected when it is, this time included."""
    if not step_s.any():
        return np.ones_like(chance), np.ones_like(chance)
    looks = (step_s / period_s).reshape(-1, MOMENTS)
    hit = chance.reshape(-1, MOMENTS)
    mean, variance = looks * hit, looks * hit * (1.0 - hit)
    before = [np.cumsum(column, axis=1) - 0.5 * column for column in (mean, variance)]
    # The first look falls anywhere in a period, and a look anywhere in its step of the burn.
    blur = np.square(looks * hit) / 12.0 + 1.0 / 12.0
    return 1.0 + before[0].ravel(), (before[1] + blur).ravel()


def _of_place(samples: _Samples, place: int) -> _Samples:
    here: BoolArray = samples.place == place
    return samples.take(here) if np.count_nonzero(here) >= _FEW else samples


def _components(samples: _Samples, spread: tuple[float, float], log_scale: float) -> Components:
    """Return the components of a type or kind, whose weights are their looks' shares times exp(log_scale)."""
    step = np.floor(np.log(np.maximum(samples.brightness, 1e-3)) / _STEP_LOG).astype(np.int64)
    cell = (samples.number * _STRETCHES + samples.stretch) * 1000 + step - step.min(initial=0)
    weight, mean, covariance = gathered(samples.signal, samples.count, samples.share, cell)
    _, row, times = np.unique(cell, return_inverse=True, return_counts=True)
    covariance = _smoothed(covariance, mean, times, spread)
    covariance[:, -1, -1] += np.bincount(row, samples.share * samples.count_variance) / weight
    return Components(np.log(weight) + log_scale, mean, covariance)


def _smoothed(covariance: FloatArray, mean: FloatArray, times: IntArray, spread: tuple[float, float]) -> FloatArray:
    """Return covariances of few looks as if some more had been there, spread as the class's brightness is."""
    signal = mean[:, :-1]
    wide = np.zeros_like(covariance)
    wide[:, :-1, :-1] = min(spread[0], _STEP_LOG) ** 2 * signal[:, :, None] * signal[:, None, :] / 12.0
    band = np.arange(signal.shape[1])
    wide[:, band, band] += np.square(spread[1] * signal)
    wide[:, -1, -1] = np.square(mean[:, -1] / _STRETCHES)
    share = (_SMOOTHING / (times + _SMOOTHING))[:, None, None]
    return (1.0 - share) * covariance + share * wide


def _log_noise_chance(detection: Any, number: int) -> float:
    from opir_core.detection.receivers import noise_chance

    return noise_chance(detection.receivers[number])
