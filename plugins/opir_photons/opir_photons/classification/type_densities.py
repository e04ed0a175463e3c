"""Densities of a sensor's measurements for each hypothesis, computed when a scene is compiled."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import names_of
from opir_core.planning import visible_now
from opir_core.plugin import Band, Response, Sensor
from opir_photons.classification.configs import SpectralConfig
from opir_photons.classification.gaussian_mixture import Components, Mixture, cell_moments, log_sum
from opir_photons.classification.hot_sources import KINDS, SourceKind
from opir_photons.classification.priors import LaunchPrior
from opir_photons.classification.synthetic_looks import (
    EARTH_RADIUS_M,
    LOWEST_SINE,
    MOMENTS,
    SyntheticLooks,
    brightness,
    launched_plumes,
    synthetic_launches,
    synthetic_sources,
)
from opir_photons.classification.unknown_objects import log_unknown
from opir_photons.detection.receivers import noise_chance
from opir_photons.detection.snr import SnrDetection
from opir_photons.detection.threshold import m_of_n_probability
from opir_photons.radiometry.propellants import band_log_sigma, gas_log_sigma

#: Edges of the elevation bins: sines of the sensor's elevation above the source's horizon.
_EDGES = np.array([0.15, 0.35, 0.65])

#: Least number of looks at a type in an elevation bin; with fewer, all elevations are used.
_FEW = 50

#: Parts of a burn, and step of the logarithm of brightness: each combination is one component.
#: Chosen by log scores, reliability and cost over drawn plumes of spread 0.7 and any propellant.
_STRETCHES = 8
_STEP_LOG = 1.0

#: Least weight of a component, as a share of its flight's or kind's.
_LEAST_COMPONENT = 1e-3

#: Weight of the class's spread in a component's covariance, in looks.
_SMOOTHING = 4.0

#: Counts are whole numbers from 1 on; their densities begin half a step below.
_LEAST_COUNT = 0.5

#: Probability that a detection count is uninformative (another object, a gap in visibility).
_UNINFORMATIVE = 0.01

#: Hot sources of each kind; least mean number of seconds or sources that a flight or kind is
#: reported for.
_SOURCES = 768
_LEAST_SHARE = 1e-9

#: Rounding step of the logarithm of satellite radii: satellites of one fleet share their densities.
_HEIGHT_STEP = 0.05

#: Slack of P_d of synthetic looks.
_SLACK = 1e-3

_NS_PER_S = 1e9
SECONDS_PER_DAY = 86_400.0

#: Looks at launches and at sources, by the satellite's distance from the Earth's centre, m.
LooksByRadius = Callable[[float], tuple[SyntheticLooks, SyntheticLooks]]


@frozen(eq=False)
class TypeDensities:
    """Densities of apparent intensities (irradiance times range²), W/sr, for each elevation bin.

    Weights of `plumes` are seconds of a launch of their flight; with `log_scale` (bins, flights)
    added, densities are those given a detection, times the share of a flight's detections in the
    bin over the bin's share of the ground. So are densities of `others` (kinds of sources, then
    noise).
    """

    width: int
    plumes: Mixture
    log_scale: FloatArray
    others: Mixture
    most_looks: float
    rates: "EventRates"

    def log_rates(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> FloatArray:
        """Return ln of the rates (n, hypotheses), 1/s, of events like those measured.

        Their elevation bins `place` and counts are (n,), intensities and their variances (n, B).
        """
        density, counted = self.plumes.log_densities(place, signal, variance, count, _LEAST_COUNT)
        counted = np.maximum(counted, np.log(_UNINFORMATIVE / self.most_looks))
        flown = self.plumes.by_class(density + counted) + self.log_scale[place]
        unknown = log_unknown(signal, variance, count, self.rates.looks_per_day)
        events = np.concatenate(
            [flown, self._log_others(place, signal, variance, count), unknown[:, None]], axis=1
        )
        return log_sum(events[:, None] + self.rates.log_rates)

    def _log_others(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> FloatArray:
        """Return ln of the densities (n, kinds and noise) of events of no launch.

        A hot source shines for an exponentially distributed time: events of one that is detected ν
        times on average have the number n of detections so far with probability exp(-n / ν) / ν.
        Components have their ν as their mean count. A false alarm has as many detections as the
        sensor needs, and seldom more.
        """
        density, _ = self.others.log_densities(place, signal, variance, count)
        noise = self.others.edges[-2]
        mean = np.maximum(self.others.mean[-1, place, :noise], 1.0)
        density[:, :noise] -= count[:, None] / mean + np.log(mean)
        further = count - self.rates.needed
        density[:, noise] += np.where(further >= 0.0, further * self.rates.log_again, -np.inf)
        return self.others.by_class(density)


@frozen(eq=False)
class EventRates:
    """Rates at which a sensor reports detections of what there may be, and the detections of false
    alarms.

    Events are of flights, kinds of sources, noise, and what is none of these, in this order:
    `log_rates` (hypotheses, events) are ln of the rates, 1/s, at which a hypothesis has them. A
    false alarm consists of `needed` detections; each further one has a probability with the
    logarithm `log_again`.
    """

    log_rates: FloatArray
    needed: int
    log_again: float
    looks_per_day: float

    @classmethod
    def of(
        cls,
        config: SpectralConfig,
        detection: SnrDetection,
        number: int,
        period_ns: int,
        prior: LaunchPrior,
        seen_s: FloatArray,
        chance: FloatArray,
    ) -> "EventRates":
        """Return the rates of a sensor that sees flights for (flights,) s, and sources with mean
        P_d (kinds,).
        """
        per_s = _NS_PER_S / period_ns
        false = detection.rate_per_scan[number]
        launched = prior.share * (config.launches_per_day / SECONDS_PER_DAY * seen_s * per_s)
        others = np.array([_in_view(config, kind) for kind in KINDS]) * chance * per_s
        rates = np.concatenate([launched, np.zeros((len(launched), len(KINDS) + 2))], axis=1)
        for row, each in enumerate(prior.hypotheses):
            rates[row, len(seen_s) : -2] = np.where(
                [kind.group == each.group for kind in KINDS], others, 0.0
            )
            rates[row, -2] = false * per_s if each.group == "noise" else 0.0
            rates[row, -1] = (
                config.unknown_per_day / SECONDS_PER_DAY if each.group == "none" else 0.0
            )
        with np.errstate(divide="ignore"):
            return cls(
                log_rates=np.log(rates),
                needed=int(detection.confirmation[number, 0]),
                log_again=float(np.log(detection.false_again[number])),
                looks_per_day=SECONDS_PER_DAY * per_s,
            )


def _in_view(config: SpectralConfig, kind: SourceKind) -> float:
    """Return the mean number of sources of a kind in the field of regard at a time."""
    if kind.group == "bolide":
        return config.bolides_per_day * kind.shining_s / SECONDS_PER_DAY
    return config.sources_in_view.get(kind.name, 0.0)


@frozen(eq=False)
class _Samples:
    """Synthetic looks as measured by a sensor: apparent intensities (n, B), counts and their
    variance, P_d.
    """

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


def looks_by_radius(bands: Sequence[Band], prior: LaunchPrior, launches: int) -> LooksByRadius:
    """Return a function of a satellite's distance from the Earth's centre to looks at launches and
    sources, cached.
    """
    plumes = launched_plumes(bands, prior.flights, launches)

    @cache
    def looks(radius_m: float) -> tuple[SyntheticLooks, SyntheticLooks]:
        flown = synthetic_launches(radius_m, prior.flights, plumes, launches)
        return flown, synthetic_sources(radius_m, bands, _SOURCES)

    return looks


def type_densities(
    detection: SnrDetection,
    number: int,
    sensor: Sensor,
    config: SpectralConfig,
    prior: LaunchPrior,
    looks: LooksByRadius,
) -> TypeDensities:
    """Return a sensor's densities: synthetic looks, measured through the scene's own atmosphere and
    background.
    """
    spread = _spread(config)
    flown, shining = looks(canonical_radius_m(sensor))
    factors = brightness(len(flown.targets.type_code), len(sensor.bands), *spread)
    launches = _measured(detection, number, sensor, flown, factors)
    sources = _measured(
        detection, number, sensor, shining, np.ones((1, len(shining.targets.type_code), 1))
    )
    shining_s = np.array([kind.shining_s for kind in KINDS])[sources.number]
    sources = evolve(sources, count=sources.chance * shining_s * _NS_PER_S / sensor.scan.period_ns)
    log_false = noise_chance(detection.receivers[number]) - log_noise_shares(
        canonical_radius_m(sensor)
    )
    flights = [
        _by_place(launches.take(launches.number == row)) for row in range(len(prior.flights))
    ]
    kinds = [_by_place(sources.take(sources.number == kind)) for kind in range(len(KINDS))]
    seen_s, chances = (
        np.exp([_log_chance(part.whole) for part in parts]) for parts in (flights, kinds)
    )
    places = range(len(_EDGES) + 1)
    return TypeDensities(
        width=len(sensor.bands),
        plumes=Mixture.of(
            [[_components(part.of[place], spread, 0.0) for part in flights] for place in places]
        ),
        log_scale=np.array([[part.log_scale[place] for part in flights] for place in places]),
        others=Mixture.of([_others(kinds, place, spread, log_false[place]) for place in places]),
        most_looks=float(launches.count.max(initial=1.0)),
        rates=EventRates.of(
            config, detection, number, sensor.scan.period_ns, prior, seen_s, chances
        ),
    )


def _spread(config: SpectralConfig) -> tuple[float, float]:
    """Return the deviations of ln of the gases' level, in all bands at once and in each: settings
    or the table's.
    """
    brightness_log_sigma = config.brightness_log_sigma
    colour_log_sigma = config.colour_log_sigma
    return (
        gas_log_sigma() if brightness_log_sigma is None else brightness_log_sigma,
        band_log_sigma() if colour_log_sigma is None else colour_log_sigma,
    )


def _others(
    kinds: "list[_ByPlace]", place: int, spread: tuple[float, float], log_false: float
) -> list[Components]:
    """Return the components of each kind of source and of noise in a bin, given a detection."""
    size = kinds[0].whole.signal.shape[1] + 1
    noise = Components(np.array([-log_false]), np.zeros((1, size)), np.zeros((1, size, size)))
    return [
        *(_components(part.of[place], spread, float(part.log_scale[place])) for part in kinds),
        noise,
    ]


def _log_chance(samples: _Samples) -> float:
    return float(np.log(np.maximum(np.sum(samples.share * samples.chance), _LEAST_SHARE)))


def looks_response(
    detection: SnrDetection, number: int, sensor: Sensor, looks: SyntheticLooks
) -> tuple[Response, BoolArray]:
    """Return a sensor's expected measurements of synthetic looks (n,), and which of them it may
    see.
    """
    exposures = evolve(
        looks.exposures, sensor=np.full(len(looks.exposures), number, dtype=np.int32)
    )
    none = np.zeros(len(looks.targets.type_code), dtype=np.int32)
    environment = evolve(
        detection.environment,
        targets=looks.targets,
        signatures=(looks.signatures,),
        group=none,
        place=np.arange(len(none), dtype=np.int32),
    )
    seen = visible_now(sensor, exposures.sensor_ecef_m, exposures.target_ecef_m)
    return evolve(detection, environment=environment).response(exposures, slack=_SLACK), seen


def _measured(
    detection: SnrDetection, number: int, sensor: Sensor, looks: SyntheticLooks, factors: FloatArray
) -> _Samples:
    """Return a sensor's measurements of visible looks, for brightness factors (draws, objects, B or
    1).

    Shares are those of looks with M - 1 detections in the N - 1 scans before: others are not
    reported.
    """
    response, seen = looks_response(detection, number, sensor, looks)
    exposures = looks.exposures
    width = len(sensor.bands)
    noise = response.noise_w_m2[:, :width]
    area = np.square(exposures.range_m)[:, None]
    place = elevation_bin(exposures.elevation_sine)
    stretch = _stretch(looks)
    parts = list[_Samples]()
    receiver = detection.receivers[number]
    (needed, scans) = detection.confirmation[number].tolist()
    for factor in factors:
        snr = response.snr[:, :width] * factor[exposures.target]
        slopes = receiver.slopes(snr, noise, exposures.elevation_sine)
        chance = np.where(seen, np.exp(receiver.rule.log_chances(snr, slopes, _SLACK)[0]), 0.0)
        count, variance = _counts(chance, looks.step_s, sensor.scan.period_ns / _NS_PER_S)
        share = (
            looks.share
            / len(factors)
            * np.maximum(m_of_n_probability(chance, needed - 1, scans - 1), _LEAST_SHARE)
        )
        columns = (snr * noise * area, snr.sum(axis=1), count, variance, chance)
        parts.append(_Samples(*columns, share, looks.number, stretch, place).take(seen))
    return _Samples(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in names_of(_Samples))
    )


def _stretch(looks: SyntheticLooks) -> IntArray:
    """Return the part of the burn (n,) of looks at launches; 0 for sources."""
    burns = np.arange(len(looks.exposures)) % MOMENTS * _STRETCHES // MOMENTS
    return burns if looks.step_s.any() else np.zeros_like(burns)


def _counts(
    chance: FloatArray, step_s: FloatArray, period_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance (n,) of the detection count of an object at a detection, this one
    included.

    A look at random in a step has half of the step's looks before it, less half a look: itself. The
    variance is not reduced by that half look and is up to 0.25 too high.
    """
    if not step_s.any():
        return np.ones_like(chance), np.ones_like(chance)
    looks = (step_s / period_s).reshape(-1, MOMENTS)
    hit = chance.reshape(-1, MOMENTS)
    mean = looks * hit
    variance = looks * hit * (1.0 - hit)
    before = [np.cumsum(column, axis=1) - 0.5 * column for column in (mean, variance)]
    # The first look is uniform over a period, a look uniform over its step of the burn.
    blur = np.square(looks * hit) / 12.0 + 1.0 / 12.0
    return (1.0 + before[0] - 0.5 * hit).ravel(), (before[1] + blur).ravel()


@frozen(eq=False)
class _ByPlace:
    """Samples of a flight or kind: as a whole, and those `of` each elevation bin, or of all where
    these are few.

    `log_scale` (bins,) turns sums of the weights in a bin into densities as `TypeDensities` has
    them.
    """

    whole: _Samples
    of: list[_Samples]
    log_scale: FloatArray


def _by_place(samples: _Samples) -> _ByPlace:
    bins = range(len(_EDGES) + 1)
    within = [samples.take(samples.place == place) for place in bins]
    of = [part if len(part.place) >= _FEW else samples for part in within]
    log_share = np.array([_log_chance(part) for part in within]) - _log_chance(samples)
    return _ByPlace(
        samples, of, log_share - _log_ground_shares() - np.array([_log_chance(part) for part in of])
    )


def _log_ground_shares() -> FloatArray:
    """Return ln (bins,) of the shares of the ground: the places of launches and sources are uniform
    in the sine of the elevation.
    """
    return np.log(np.diff([LOWEST_SINE, *_EDGES, 1.0]) / (1.0 - LOWEST_SINE))


def log_noise_shares(radius_m: float) -> FloatArray:
    """Return ln (bins,) of the shares of false alarms over those of the ground, for a satellite's
    distance from the Earth's centre.

    Directions of false alarms are uniform over the solid angle, that is in 1 - cos of the angle
    from nadir.
    """
    sines = np.array([0.0, *_EDGES, 1.0])
    fall = 1.0 - np.sqrt(1.0 - np.square(EARTH_RADIUS_M / radius_m) * (1.0 - np.square(sines)))
    return np.log(-np.diff(fall) / fall[0]) - _log_ground_shares()


def _components(samples: _Samples, spread: tuple[float, float], log_scale: float) -> Components:
    """Return the components of a type or kind; weights are shares of looks times exp(log_scale)."""
    step = np.floor(np.log(np.maximum(samples.brightness, 1e-3)) / _STEP_LOG).astype(np.int64)
    cell = (samples.number * _STRETCHES + samples.stretch) * 1000 + step - step.min(initial=0)
    weight, mean, covariance = cell_moments(samples.signal, samples.count, samples.share, cell)
    _, row, times = np.unique(cell, return_inverse=True, return_counts=True)
    covariance = _smoothed(covariance, mean, times, spread)
    covariance[:, -1, -1] += np.bincount(row, samples.share * samples.count_variance) / weight
    heavy = weight >= _LEAST_COMPONENT * weight.sum()
    return Components(np.log(weight[heavy]) + log_scale, mean[heavy], covariance[heavy])


def _smoothed(
    covariance: FloatArray, mean: FloatArray, times: IntArray, spread: tuple[float, float]
) -> FloatArray:
    """Return covariances regularised by the spread of the class's brightness, for components of few
    looks.
    """
    signal = mean[:, :-1]
    wide = np.zeros_like(covariance)
    wide[:, :-1, :-1] = (
        min(spread[0], _STEP_LOG) ** 2 * signal[:, :, None] * signal[:, None, :] / 12.0
    )
    band = np.arange(signal.shape[1])
    wide[:, band, band] += np.square(spread[1] * signal)
    wide[:, -1, -1] = np.square(mean[:, -1] / _STRETCHES)
    share = (_SMOOTHING / (times + _SMOOTHING))[:, None, None]
    return (1.0 - share) * covariance + share * wide
