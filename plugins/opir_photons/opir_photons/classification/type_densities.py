"""Densities of a sensor's measurements for each hypothesis, computed when a scene is compiled."""

from functools import cached_property
from typing import Any

import numpy as np
from attrs import evolve, frozen
from scipy.special import log_ndtr

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import ModelError
from opir_core.interfaces import names_of
from opir_core.planning import visible_now
from opir_core.plugin import Response, Sensor
from opir_photons.classification.configs import SpectralConfig
from opir_photons.classification.gaussian_mixture import Components, Mixture, cell_moments, log_sum
from opir_photons.classification.hot_sources import KINDS, SourceKind
from opir_photons.classification.priors import LaunchPrior
from opir_photons.classification.synthetic_glides import gliding_rows, synthetic_glides
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
from opir_photons.detection.receivers import Receiver, noise_chance
from opir_photons.detection.snr import SnrDetection
from opir_photons.detection.threshold import m_of_n_probability
from opir_photons.radiometry.propellants import band_log_sigma, gas_log_sigma

#: Edges of the elevation bins: sines of the sensor's elevation above the source's horizon.
_EDGES = np.array([0.15, 0.35, 0.65])

#: Stretches of a burn, and step of the logarithm of brightness: each combination is one component.
#: Chosen by log scores, reliability and cost over drawn plumes of spread 0.7 and any propellant.
_STRETCHES = 8
_STEP_LOG = 1.0

#: Least mean number of seconds or sources that a flight or kind is reported for.
_LEAST_SHARE = 1e-9

#: Share of a glider's burn before which no detection is of its glide.
_BURNT = 0.9

#: Slack of P_d of synthetic looks.
_SLACK = 1e-3

SECONDS_PER_DAY = 86_400.0

#: Least share of the count's density in a glide: of another object, or with a gap in visibility.
_LEAST_GLIDE = 1e-9


@frozen(eq=False)
class Glides:
    """Densities of what glides after its burn, as `TypeDensities.plumes` has them; with fewer
    detections than `least_count` it burns.
    """

    mixture: Mixture
    log_scale: FloatArray
    least_count: float

    def log_densities(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> FloatArray:
        """Return ln (n, flights) of the densities of events."""
        log_density = np.full((len(count), self.log_scale.shape[1]), -np.inf)
        rows = np.flatnonzero(count >= self.least_count)
        glided = self.mixture.log_class_densities(
            place[rows], signal[rows], variance[rows], count[rows], 0.5, _LEAST_GLIDE
        )
        log_density[rows] = glided + self.log_scale[place[rows]]
        return log_density


@frozen(eq=False)
class TypeDensities:
    """Densities of apparent intensities (irradiance times range²), W/sr, for each elevation bin.

    Weights of `plumes` are seconds of a launch of their flight; with `log_scale` (bins, flights)
    added, densities are those given a detection, times the share of a flight's detections in the
    bin over the bin's share of the ground. So are densities of `non_launches` (kinds of sources,
    then noise). `longest_launch` is the largest mean count of a launch.
    """

    width: int
    plumes: Mixture
    log_scale: FloatArray
    non_launches: Mixture
    longest_launch: float
    rates: "EventRates"
    glides: Glides | None = None
    kinds: tuple[SourceKind, ...] = KINDS

    def log_rates(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> FloatArray:
        """Return ln of the rates (n, hypotheses), 1/s, of events like those measured.

        Their elevation bins `place` and counts are (n,), intensities and their variances (n, B).
        """
        # Counts are whole numbers from 1 on; their densities begin half a step below. One in a
        # hundred is uninformative: of another object, or with a gap in visibility.
        flown = self.plumes.log_class_densities(
            place, signal, variance, count, 0.5, 0.01 / self.longest_launch
        )
        flown += self.log_scale[place]
        parts = [flown]
        if self.glides is not None:
            parts.append(self.glides.log_densities(place, signal, variance, count))
        unknown = log_unknown(signal, variance, count, self.rates.looks_per_day)
        non_launches = self._log_non_launches(place, signal, variance, count)
        events = np.concatenate([*parts, non_launches, unknown[:, None]], axis=1)
        return log_sum(events[:, None] + self.rates.log_rates)

    def _log_non_launches(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> FloatArray:
        """Return ln of the densities (n, kinds and noise) of events of no launch.

        Components have as their mean count how often a source is detected. A false alarm has as
        many detections as the sensor needs, and seldom more.
        """
        density, _ = self.non_launches.log_densities(place, signal, variance, count)
        edges = self.non_launches.edges[:-1]
        noise = edges[-1]
        mean = np.maximum(self.non_launches.mean[-1, place, :noise], 1.0)
        sigma = np.repeat([kind.shining_log_sigma for kind in self.kinds], np.diff(edges))
        density[:, :noise] += _log_persistence(count[:, None], mean, sigma)
        further = count - self.rates.needed
        density[:, noise] += np.where(further >= 0.0, further * self.rates.log_again, -np.inf)
        return self.non_launches.by_class(density)


def _log_persistence(count: FloatArray, mean: FloatArray, log_sigma: FloatArray) -> FloatArray:
    """Return ln (n, K) of the probabilities of counts (n, 1) so far of sources that are detected ν
    times, `mean` (n, K): exp(-n / ν) / ν where they shine for exponentially distributed times.

    Where these are log-normal about ν, with `log_sigma` (K,) above 0, it is the probability that
    one lasts for n detections over the mean number of them.
    """
    log_chance = -(count / mean + np.log(mean))
    lasting = np.flatnonzero(log_sigma)
    sigma = log_sigma[lasting]
    log_mean = np.log(mean[:, lasting])
    survival = log_ndtr((log_mean - np.log(count)) / sigma)
    log_chance[:, lasting] = survival - log_mean - 0.5 * np.square(sigma)
    return log_chance


@frozen(eq=False)
class EventRates:
    """Rates at which a sensor reports detections of each event, and the detections of false alarms.

    Events are of flights, glides, kinds of sources, noise, and unknown objects, in this order:
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
        observer: "Observer",
        prior: LaunchPrior,
        visible_s: FloatArray,
        chance: FloatArray,
    ) -> "EventRates":
        """Return the rates of a sensor that detects flights for (flights,) s, and sources with mean
        P_d (kinds,).
        """
        detection = observer.detection
        per_s = 1e9 / observer.sensor.scan.period_ns
        launched = prior.share * (config.launches_per_day / SECONDS_PER_DAY * visible_s * per_s)
        sources = np.array([_in_view(config, kind) for kind in KINDS]) * chance * per_s
        rates = np.concatenate([launched, np.zeros((len(launched), len(KINDS) + 2))], axis=1)
        for row, hypothesis in zip(rates, prior.hypotheses, strict=True):
            is_of_group = [kind.group == hypothesis.group for kind in KINDS]
            row[len(visible_s) : -2] = np.where(is_of_group, sources, 0.0)
            if hypothesis.group == "noise":
                row[-2] = detection.rate_per_scan[observer.number] * per_s
            elif hypothesis.group == "none":
                row[-1] = config.unknown_per_day / SECONDS_PER_DAY
        with np.errstate(divide="ignore"):
            return cls(
                log_rates=np.log(rates),
                needed=int(detection.confirmation[observer.number, 0]),
                log_again=float(np.log(detection.false_again[observer.number])),
                looks_per_day=SECONDS_PER_DAY * per_s,
            )


def _in_view(config: SpectralConfig, kind: SourceKind) -> float:
    """Return the mean number of sources of a kind in the field of regard at a time."""
    per_day = {"bolide": config.bolides_per_day, "re-entry": config.reentries_per_day}
    if kind.name in per_day:
        return per_day[kind.name] * kind.shining_s / SECONDS_PER_DAY
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


@frozen(eq=False)
class Observer:
    """A sensor with its number in a detection model, which measures synthetic looks through the
    scene's own atmosphere and background.
    """

    detection: SnrDetection
    number: int
    sensor: Sensor

    @property
    def receiver(self) -> Receiver:
        """The receiver of the sensor."""
        return self.detection.receivers[self.number]

    @property
    def width(self) -> int:
        """The number of bands."""
        return len(self.sensor.bands)

    @property
    def radius_m(self) -> float:
        """The sensor's median distance from the Earth's centre over a day, m, rounded: satellites
        of one fleet share their densities.
        """
        position = self.sensor.orbit.position_ecef_m(np.linspace(0.0, 86_400.0, 97))
        median = float(np.median(np.sqrt(np.square(position).sum(axis=1))))
        return float(np.exp(np.round(np.log(median) / 0.05) * 0.05))

    def response(self, looks: SyntheticLooks) -> tuple[Response, BoolArray]:
        """Return the expected measurements of synthetic looks (n,), and whether each is visible."""
        sensor = np.full(len(looks.exposures), self.number, dtype=np.int32)
        exposures = evolve(looks.exposures, sensor=sensor)
        group = np.zeros(len(looks.targets.type_code), dtype=np.int32)
        environment = evolve(
            self.detection.environment,
            targets=looks.targets,
            signatures=(looks.signatures,),
            group=group,
            place=np.arange(len(group), dtype=np.int32),
        )
        is_visible = visible_now(self.sensor, exposures.sensor_ecef_m, exposures.target_ecef_m)
        detection = evolve(self.detection, environment=environment)
        return detection.response(exposures, slack=_SLACK), is_visible


def elevation_bin(elevation_sine: FloatArray) -> IntArray:
    """Return the elevation bins (n,)."""
    return np.searchsorted(_EDGES, elevation_sine).astype(np.int64)


@frozen(eq=False)
class ObserverDensities:
    """Makes the densities of observers in one detection model when it is called."""

    observers: tuple[Observer, ...]
    config: SpectralConfig
    prior: LaunchPrior

    def __call__(self) -> tuple[TypeDensities, ...]:
        """Return the densities of each observer."""
        return tuple(
            type_densities(observer, self.config, self.prior, self.looks[observer.radius_m])
            for observer in self.observers
        )

    @cached_property
    def looks(self) -> dict[float, tuple[SyntheticLooks, ...]]:
        """Looks at launches, sources and glides, by the satellite's distance from the Earth's
        centre, m.
        """
        bands = self.observers[0].detection.environment.bands
        flights, launches = self.prior.flights, self.config.launches
        plumes = launched_plumes(bands, flights, launches)
        gliders = [flights[number] for number in gliding_rows(flights)]
        bodies = launched_plumes(bands, gliders, launches) if gliders else plumes
        return {
            radius_m: (
                synthetic_launches(radius_m, flights, plumes, launches),
                synthetic_sources(radius_m, bands, 768),
                *([synthetic_glides(radius_m, gliders, bodies, launches)] if gliders else []),
            )
            for radius_m in {observer.radius_m for observer in self.observers}
        }


def type_densities(
    observer: Observer,
    config: SpectralConfig,
    prior: LaunchPrior,
    looks: tuple[SyntheticLooks, ...],
) -> TypeDensities:
    """Return a sensor's densities: synthetic looks, as the sensor measures them.

    Raises `ModelError` for a sensor whose field of regard holds no look of a flight, glide or kind.
    """
    spread = _spread(config)
    launches, sources, glides = _samples(observer, spread, looks)
    log_false = noise_chance(observer.receiver) - log_noise_shares(observer.radius_m)
    gliding = gliding_rows(prior.flights)
    flights = _by_number(launches, len(prior.flights))
    kinds = _by_number(sources, len(KINDS))
    after = [] if glides is None else _by_number(glides, len(gliding))
    if not all(len(samples.all_bins.place) for samples in [*flights, *kinds, *after]):
        raise ModelError(
            f"classification: spectral has too few synthetic looks of the sensor"
            f" {observer.sensor.id}, whose field of regard holds hardly any ground: widen it"
            " (minimum_elevation_deg, field_of_regard_half_angle_deg), raise classification.launches,"
            " or choose classification: paper"
        )
    visible_s, chance = (
        np.exp([_log_chance(samples.all_bins) for samples in group])
        for group in (flights + after, kinds)
    )
    events = evolve(prior, share=np.concatenate([prior.share, prior.share[:, gliding]], axis=1))
    places = range(len(_EDGES) + 1)
    return TypeDensities(
        width=observer.width,
        plumes=_mixture(flights, spread),
        log_scale=np.transpose([flight.log_scale for flight in flights]),
        non_launches=Mixture.of(
            [
                [
                    *(_components(kind.of[place], spread, kind.log_scale[place]) for kind in kinds),
                    _noise(observer.width, log_false[place]),
                ]
                for place in places
            ]
        ),
        longest_launch=float(launches.count.max(initial=1.0)),
        rates=EventRates.of(config, observer, events, visible_s, chance),
        glides=_glides(after, spread, prior, observer) if after else None,
    )


def _glides(
    glides: "list[_ByPlace]", spread: tuple[float, float], prior: LaunchPrior, observer: Observer
) -> Glides:
    """Return the densities of glides of flights with a prior."""
    burns_s = [prior.flights[number].profile.burn_time_s for number in gliding_rows(prior.flights)]
    return Glides(
        _mixture(glides, spread),
        np.transpose([glide.log_scale for glide in glides]),
        _BURNT * min(burns_s) * 1e9 / observer.sensor.scan.period_ns,
    )


def _mixture(flights: "list[_ByPlace]", spread: tuple[float, float]) -> Mixture:
    """Return the mixture of flights in each elevation bin."""
    places = range(len(_EDGES) + 1)
    return Mixture.of(
        [[_components(flight.of[place], spread, 0.0) for flight in flights] for place in places]
    )


def _by_number(samples: "_Samples", count: int) -> "list[_ByPlace]":
    """Return the samples of each flight or kind."""
    return [_by_place(samples.take(samples.number == number)) for number in range(count)]


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


def _samples(
    observer: Observer, spread: tuple[float, float], looks: tuple[SyntheticLooks, ...]
) -> tuple[_Samples, _Samples, _Samples | None]:
    """Return a sensor's measurements of launches, of hot sources with their mean counts, and of
    glides.
    """
    flown, shining, *gliding = looks
    factors = brightness(len(flown.targets.type_code), observer.width, *spread)
    launches = _measured(observer, flown, factors)
    sources = _measured(observer, shining, np.ones((1, len(shining.targets.type_code), 1)))
    shining_s = np.array([kind.shining_s for kind in KINDS])[sources.number]
    count = sources.chance * shining_s * 1e9 / observer.sensor.scan.period_ns
    glides = [
        _measured(observer, glide, brightness(len(glide.number), observer.width, *spread))
        for glide in gliding
    ]
    # The looks that stand for burns have no share.
    shared = [samples.take(samples.share > 0.0) for samples in glides]
    return launches, evolve(sources, count=count), next(iter(shared), None)


def _noise(width: int, log_false: float) -> Components:
    """Return the component of noise, given a detection."""
    size = width + 1
    return Components(np.array([-log_false]), np.zeros((1, size)), np.zeros((1, size, size)))


def _log_chance(samples: _Samples) -> float:
    return float(np.log(np.maximum(np.sum(samples.share * samples.chance), _LEAST_SHARE)))


def _measured(observer: Observer, looks: SyntheticLooks, factors: FloatArray) -> _Samples:
    """Return a sensor's measurements of visible looks, for brightness factors (draws, objects, B or
    1).

    Shares are those of looks with M - 1 detections in the N - 1 scans before: others are not
    reported.
    """
    response, is_visible = observer.response(looks)
    exposures = looks.exposures
    receiver = observer.receiver
    width = observer.width
    noise = response.noise_w_m2[:, :width]
    area = np.square(exposures.range_m)[:, None]
    needed, scans = observer.detection.confirmation[observer.number].tolist()
    draws = list[_Samples]()
    for factor in factors:
        snr = response.snr[:, :width] * factor[exposures.target]
        slopes = receiver.slopes(snr, noise, exposures.elevation_sine)
        log_chance, _ = receiver.rule.log_chances(snr, slopes, _SLACK)
        chance = np.where(is_visible, np.exp(log_chance), 0.0)
        count, variance = _counts(chance, looks.step_s, observer.sensor.scan.period_ns / 1e9)
        confirmed = np.maximum(m_of_n_probability(chance, needed - 1, scans - 1), _LEAST_SHARE)
        samples = _Samples(
            signal=snr * noise * area,
            brightness=snr.sum(axis=1),
            count=count,
            count_variance=variance,
            chance=chance,
            share=looks.share / len(factors) * confirmed,
            number=looks.number,
            stretch=_stretch(looks),
            place=elevation_bin(exposures.elevation_sine),
        )
        draws.append(samples.take(is_visible))
    return _Samples(
        *(np.concatenate([getattr(draw, name) for draw in draws]) for name in names_of(_Samples))
    )


def _stretch(looks: SyntheticLooks) -> IntArray:
    """Return the stretch of the burn (n,) of looks at launches; 0 for sources."""
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
    mean, variance = (
        np.cumsum(column, axis=1) - 0.5 * column
        for column in (looks * hit, looks * hit * (1.0 - hit))
    )
    # The first look is uniform over a period, a look uniform over its step of the burn.
    blur = np.square(looks * hit) / 12.0 + 1.0 / 12.0
    return (1.0 + mean - 0.5 * hit).ravel(), (variance + blur).ravel()


@frozen(eq=False)
class _ByPlace:
    """Samples of a flight or kind: of `all_bins`, and those `of` each elevation bin, or of all
    where these are few.

    `log_scale` (bins,) turns sums of the weights in a bin into densities as `TypeDensities` has
    them.
    """

    all_bins: _Samples
    of: list[_Samples]
    log_scale: FloatArray


def _by_place(samples: _Samples) -> _ByPlace:
    bins = range(len(_EDGES) + 1)
    within = [samples.take(samples.place == place) for place in bins]
    of = [in_bin if len(in_bin.place) >= 50 else samples for in_bin in within]
    log_share = np.array([_log_chance(in_bin) for in_bin in within]) - _log_chance(samples)
    log_scale = log_share - _log_ground_shares() - np.array([_log_chance(in_bin) for in_bin in of])
    return _ByPlace(samples, of, log_scale)


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
    heavy = weight >= 1e-3 * weight.sum()
    return Components(np.log(weight[heavy]) + log_scale, mean[heavy], covariance[heavy])


def _smoothed(
    covariance: FloatArray, mean: FloatArray, times: IntArray, spread: tuple[float, float]
) -> FloatArray:
    """Return covariances regularised by the spread of the class's brightness, for components of few
    looks.
    """
    signal = mean[:, :-1]
    wide = np.zeros_like(covariance)
    common = min(spread[0], _STEP_LOG) ** 2
    wide[:, :-1, :-1] = common * signal[:, :, None] * signal[:, None, :] / 12.0
    band = np.arange(signal.shape[1])
    wide[:, band, band] += np.square(spread[1] * signal)
    wide[:, -1, -1] = np.square(mean[:, -1] / _STRETCHES)
    # The spread of the class has the weight of four looks.
    share = (4.0 / (times + 4.0))[:, None, None]
    return (1.0 - share) * covariance + share * wide
