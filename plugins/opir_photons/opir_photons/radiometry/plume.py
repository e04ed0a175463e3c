"""The signature model `plume`: notional radiant intensity by class, propellant, thrust phase,
altitude and aspect.

Sources: `opir_core/data/plumes.json` for the gases, `opir_photons/data/propellants.json` for the
continuum of soot and alumina, which mark their notional values. Gases, hot water near 6.3 µm and
particles have factors of altitude of their own, so that the ratios of bands change with height; the
factors for stage, rise at ignition and aspect are common. The factor of aspect is that of the
projected area of a long body: at an angle a from the direction of flight √(sin² a + e² cos² a),
with e its value end-on. After burnout only the body radiates, grey and at one temperature, and
reflects sunlight as a diffuse sphere; earthshine is not modelled.

The stages of a target with several burns are these, each with a rise at its ignition; otherwise
stages share the burn equally and only the first rises. A number of stages that the configuration
gives shares the burn equally, too.
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.plugin import Band, Plume, SignatureContext, Signatures
from opir_core.scene import core_plumes, core_target_class, plume_table
from opir_photons.radiometry.configs import PlumeConfig
from opir_photons.radiometry.planck import SECOND_RADIATION_UM_K, band_radiance
from opir_photons.radiometry.propellants import (
    Propellant,
    continuum_w_sr,
    jet_power_w,
    profile_propellant,
    propellants,
)

#: Bands of hot combustion gases, µm: H₂O with CO₂ near 2.7, CO₂ near 4.3 (C. B. Ludwig et al.,
#: Handbook of Infrared Radiation from Combustion Gases, NASA SP-3080, 1973; the edges of the hot
#: bands are notional). The key is the band of the table that determines the gas.
GAS_BANDS_UM: Mapping[str, tuple[float, float]] = {"SWIR": (2.5, 3.1), "MWIR": (4.17, 4.6)}

#: The band of hot water near 6.3 µm, whose intensity follows that of the gases near 2.7 µm.
WATER_UM = (5.0, 7.7)

#: Centres, 1/cm, and strengths, m²/(g cm), of the bands near 6.3 and 2.7 µm: H₂O 41.2; H₂O 25.9
#: with CO₂ 4.0 at 2.44 g for each of H₂O, as hydrocarbons burn. Of thin gas. As recalled from D. K.
#: Edwards, Advances in Heat Transfer 12 (1976) 115, which was not at hand: to be taken as notional.
_WATER = (1600.0, 41.2)
_NEAR_2_7 = (3760.0, 25.9 + 2.44 * 4.0)

#: Temperature of the gases over that in afterburning, by altitude, km: without it, and expanding
#: into ever thinner air, they cool to about 1000 K. Notional.
_COOLING_KM = (40.0, 60.0, 75.0, 90.0)
_COOLING = (1.0, 0.8, 0.65, 0.5)

#: The most stages of a plume.
_MOST_STAGES = 8


@frozen(eq=False)
class PlumeSignatures(Signatures):
    """Plumes of n targets, and their bodies: `peak_w_sr` of gases, `water_w_sr` near 6.3 µm,
    `particle_w_sr`, `body_w_sr` (bands, n).

    The other columns are (n,), shapes by number: altitudes, and the factors of gases, water and
    particles there. `body_reflecting_m2` is albedo times area. Of each stage (n, 8) the scale, its
    end and the ignition from which the intensity rises, s since the first ignition.
    """

    peak_w_sr: FloatArray
    water_w_sr: FloatArray
    particle_w_sr: FloatArray
    body_w_sr: FloatArray
    body_reflecting_m2: FloatArray
    burn_time_s: FloatArray
    stages: IntArray
    stage_scale: FloatArray
    stage_end_s: FloatArray
    stage_ignition_s: FloatArray
    rise_time_s: FloatArray
    nose_on: FloatArray
    tail_on: FloatArray
    shape: IntArray
    shapes: tuple[tuple[FloatArray, ...], ...]

    def intensity_w_sr(
        self,
        band: int,
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return radiant intensities (n,) at the source, W/sr: 0 before ignition, the body's after
        burnout.
        """
        return self.intensities_w_sr(
            (band,), target, time_since_ignition_s, altitude_m, aspect_rad
        )[0]

    def intensities_w_sr(
        self,
        bands: Sequence[int],
        target: IndexArray,
        time_since_ignition_s: FloatArray,
        altitude_m: FloatArray,
        aspect_rad: FloatArray,
    ) -> FloatArray:
        """Return those of several bands (bands, n), which differ only in their peaks and bodies."""
        common = self._thrust(target, time_since_ignition_s) * self._aspect(target, aspect_rad)
        gas, *others = common * self._altitude(target, altitude_m)
        late = np.flatnonzero(time_since_ignition_s > self.burn_time_s[target])
        intensities = np.empty((len(bands), len(target)))
        for intensity, band in zip(intensities, bands, strict=True):
            np.multiply(self.peak_w_sr[band].take(target), gas, out=intensity)
            for peak_w_sr, factor in zip(
                (self.water_w_sr, self.particle_w_sr), others, strict=True
            ):
                intensity += peak_w_sr[band].take(target) * factor
            intensity[late] = self.body_w_sr[band].take(target[late])
        return intensities

    def reflecting_area_m2(
        self, target: IndexArray, time_since_ignition_s: FloatArray
    ) -> FloatArray:
        """Return albedo times cross-section (n,) of bodies, m²; 0 before burnout."""
        is_late = time_since_ignition_s > self.burn_time_s[target]
        return np.where(is_late, self.body_reflecting_m2[target], 0.0)

    @property
    def time_breakpoints_s(self) -> FloatArray:
        """The ends of stages, the last of which is burnout, (n, 8) s since ignition."""
        return self.stage_end_s

    @property
    def altitude_breakpoints_m(self) -> FloatArray:
        """The altitudes at which the factor of altitude is given, (n, k) m."""
        most = max(len(altitude_m) for altitude_m, *_ in self.shapes)
        padded = [
            np.concatenate([each, np.full(most - len(each), np.nan)]) for each, *_ in self.shapes
        ]
        return np.array(padded)[self.shape]

    def _thrust(self, target: IndexArray, time_s: FloatArray) -> FloatArray:
        stage = np.zeros(len(target), dtype=np.int64)
        for number in range(int(self.stages.max(initial=1)) - 1):
            stage += time_s >= self.stage_end_s[target, number]
        stage = np.minimum(stage, self.stages[target] - 1)
        since_s = np.maximum(time_s - self.stage_ignition_s[target, stage], 0.0)
        rise = -np.expm1(-since_s / np.maximum(self.rise_time_s[target], 1e-12))
        burns = (time_s >= 0.0) & (time_s <= self.burn_time_s[target])
        return np.where(burns, rise * self.stage_scale[target, stage], 0.0)

    def _altitude(self, target: IndexArray, altitude_m: FloatArray) -> FloatArray:
        """Return the factors of altitude (3, n) of gases, water and particles."""
        factors = np.empty((3, len(target)))
        shape = self.shape[target]
        for number, (points_m, *own) in enumerate(self.shapes):
            rows = slice(None) if len(self.shapes) == 1 else np.flatnonzero(shape == number)
            factors[:, rows] = [np.interp(altitude_m[rows], points_m, each) for each in own]
        return factors

    def _aspect(self, target: IndexArray, aspect_rad: FloatArray) -> FloatArray:
        cosine = np.cos(aspect_rad)
        end_on = np.where(cosine > 0.0, self.nose_on[target], self.tail_on[target]) * cosine
        return np.sqrt((1.0 - cosine) * (1.0 + cosine) + end_on * end_on)


def plume_signatures(configs: Sequence[PlumeConfig], context: SignatureContext) -> PlumeSignatures:
    """Return the plumes of all targets of the model; `ModelError` for a target with an unknown
    class of plume.
    """
    plumes = [_default_plume(config, context, row) for row, config in enumerate(configs)]
    burn_time_s = np.asarray(context.burn_time_s, dtype=np.float64)
    burns = np.minimum(
        np.count_nonzero(np.isfinite(context.burns_s[..., 0]), axis=1), _MOST_STAGES
    ).tolist()
    of_flight = [
        config.stages is None and count > 1 for config, count in zip(configs, burns, strict=True)
    ]
    stages = np.array(
        [
            count if own else config.stages or plume.stages
            for own, count, config, plume in zip(of_flight, burns, configs, plumes, strict=True)
        ]
    )
    ends_s, ignitions_s = _stage_times(
        np.array(of_flight, dtype=np.bool_), stages, burn_time_s, context.burns_s
    )
    first, alike = _alike(configs, plumes)
    each = [(configs[row], plumes[row]) for row in first]
    burnt = [_propellant(*one) for one in each]
    shape_of = [
        (own.altitude_km, own.altitude_scale, own.gas_temperature_k, fuel)
        for (own, _), fuel in zip(each, burnt, strict=True)
    ]
    shapes = list(dict.fromkeys(shape_of))
    peaks = [_peaks(*one, context, row) for one, row in zip(each, first, strict=True)]
    waters = [[_water_w_sr(*one, band) for band in context.bands] for one in each]
    continua = [
        _continuum(*one, fuel, context.bands) for one, fuel in zip(each, burnt, strict=True)
    ]
    return PlumeSignatures(
        peak_w_sr=_by_band(peaks, context.bands)[:, alike],
        water_w_sr=_by_band(waters, context.bands)[:, alike],
        particle_w_sr=_by_band(continua, context.bands)[:, alike],
        body_w_sr=_bodies(configs, plumes, context),
        body_reflecting_m2=_column(configs, "body_albedo") * _column(configs, "body_area_m2"),
        burn_time_s=burn_time_s,
        stages=stages,
        stage_end_s=ends_s,
        stage_ignition_s=ignitions_s,
        stage_scale=np.array([_padded(config.stage_scale) for config in configs]),
        rise_time_s=_column(configs, "rise_time_s"),
        nose_on=_column(configs, "nose_on"),
        tail_on=_column(configs, "tail_on"),
        shape=np.array([shapes.index(one) for one in shape_of], dtype=np.int64)[alike],
        shapes=tuple(_factors(*one) for one in shapes),
    )


def _alike(configs: Sequence[PlumeConfig], plumes: Sequence[Plume]) -> tuple[list[int], IntArray]:
    """Return the first rows of targets with the same settings and plume, and of each target the
    number of its own.

    By identity: a raid, or a grid of launches, has few settings and plumes for all its targets.
    """
    first: dict[tuple[int, int], int] = {}
    keys = [(id(config), id(plume)) for config, plume in zip(configs, plumes, strict=True)]
    for row, key in enumerate(keys):
        first.setdefault(key, row)
    number = {key: place for place, key in enumerate(first)}
    return list(first.values()), np.array([number[key] for key in keys], dtype=np.int64)


def _by_band(rows: Sequence[Sequence[float]], bands: Sequence[Band]) -> FloatArray:
    """Return columns (bands, n) from rows of n targets."""
    return np.array(rows, dtype=np.float64).reshape(-1, len(bands)).T.copy()


def _factors(
    altitude_km: Sequence[float], altitude_scale: Sequence[float], gas_k: float, fuel: Propellant
) -> tuple[FloatArray, ...]:
    """Return altitudes, m, and there the factors of gases, water and particles; all are linear
    between.
    """
    points_km = np.unique(np.concatenate([altitude_km, fuel.altitude_km, _COOLING_KM]))
    gas = np.interp(points_km, altitude_km, altitude_scale)
    cooled = gas_k * np.interp(points_km, _COOLING_KM, _COOLING)
    water = gas * np.array([_water_ratio(each) for each in cooled]) / _water_ratio(gas_k)
    return points_km * 1e3, gas, water, np.interp(points_km, fuel.altitude_km, fuel.altitude_scale)


def _stage_times(
    of_flight: BoolArray, stages: IntArray, burn_time_s: FloatArray, burns_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the ends of stages and the ignitions from which they rise, (n, 8) s: of the flight, or
    equal shares.
    """
    number = np.arange(1, _MOST_STAGES + 1)
    ends_s = burn_time_s[:, None] * np.minimum(number / stages[:, None], 1.0)
    ignitions_s = np.zeros(ends_s.shape)
    own = burns_s[of_flight, :_MOST_STAGES]
    missing = ((0, 0), (0, _MOST_STAGES - own.shape[1]))
    ends_s[of_flight] = np.pad(
        np.fmin(own[..., 1], burn_time_s[of_flight, None]), missing, mode="edge"
    )
    ignitions_s[of_flight] = np.pad(np.nan_to_num(own[..., 0]), missing)
    return ends_s, ignitions_s


def plume_intensity_w_sr(
    peaks: Mapping[str, float], band: Band, continuum_k: float, gas_k: float
) -> float:
    """Return the gases' intensity, W/sr, in any band of a plume given by its intensities in the
    table's three bands.

    Without the band of water near 6.3 µm, `water_intensity_w_sr`.

    `ValueError` where the continuum implied by LWIR exceeds the given SWIR or MWIR.
    """
    edges = plume_table()["bands_um"]
    area = peaks["LWIR"] / _radiance(continuum_k, edges["LWIR"])
    total = area * _radiance(continuum_k, (band.lower_um, band.upper_um))
    for name, gas in GAS_BANDS_UM.items():
        rest = peaks[name] - area * _radiance(continuum_k, edges[name])
        if rest < 0.0:
            raise ValueError(
                f"the continuum that LWIR {peaks['LWIR']:g} W/sr implies at {continuum_k:g} K,"
                f" {peaks[name] - rest:g} W/sr in {name}, is more than the {peaks[name]:g} W/sr of"
                f" {name}"
            )
        total += (
            rest
            * _radiance(gas_k, _overlap(gas, band))
            / _radiance(gas_k, _overlap(gas, Band(name, *edges[name])))
        )
    # Bands with swapped edges are empty.
    return max(total, 0.0)


def water_intensity_w_sr(swir_w_sr: float, band: Band, gas_k: float) -> float:
    """Return the intensity, W/sr, of hot water near 6.3 µm in a band, by what the gases have in
    SWIR.
    """
    gas = GAS_BANDS_UM["SWIR"]
    swir = Band("SWIR", *plume_table()["bands_um"]["SWIR"])
    near_2_7 = swir_w_sr * _radiance(gas_k, gas) / _radiance(gas_k, _overlap(gas, swir))
    share = _radiance(gas_k, _overlap(WATER_UM, band)) / _radiance(gas_k, WATER_UM)
    return max(near_2_7 * _water_ratio(gas_k) * share, 0.0)


def _water_ratio(gas_k: float) -> float:
    """Return the emission of thin hot water near 6.3 µm over that of water and carbon dioxide near
    2.7 µm.
    """
    six, three = (
        strength * centre**3 / np.expm1(SECOND_RADIATION_UM_K * 1e-4 * centre / gas_k)
        for centre, strength in (_WATER, _NEAR_2_7)
    )
    return float(six / three)


def _peaks(config: PlumeConfig, plume: Plume, context: SignatureContext, row: int) -> list[float]:
    """Return the peak of one target in each band."""
    peaks = {**plume.peak_w_sr, **config.peak_w_sr}
    temperatures = (config.continuum_temperature_k, config.gas_temperature_k)
    try:
        return [
            config.scale * plume_intensity_w_sr(peaks, band, *temperatures)
            for band in context.bands
        ]
    except ValueError as error:
        raise ModelError(f"{context.paths[row]}: {error}") from error


def _water_w_sr(config: PlumeConfig, plume: Plume, band: Band) -> float:
    """Return the intensity of hot water of one target in a band, at its altitude of highest
    intensity.
    """
    swir_w_sr = {**plume.peak_w_sr, **config.peak_w_sr}["SWIR"]
    return config.scale * water_intensity_w_sr(swir_w_sr, band, config.gas_temperature_k)


def _continuum(
    config: PlumeConfig, plume: Plume, fuel: Propellant, bands: Sequence[Band]
) -> list[float]:
    """Return the particles' broadside intensity in each band, at the altitude where it is
    highest.
    """
    power_w = config.scale * jet_power_w({**plume.peak_w_sr, **config.peak_w_sr})
    return [continuum_w_sr(fuel, power_w, band.lower_um, band.upper_um) for band in bands]


def _propellant(config: PlumeConfig, plume: Plume) -> Propellant:
    """Return a target's propellant: its own, or that of its class; a clean one for classes that the
    core has not.
    """
    of_class = [profile_propellant(name) for name, known in core_plumes().items() if known == plume]
    return propellants()[config.propellant or (of_class[0] if of_class else None) or "storable"]


def _bodies(
    configs: Sequence[PlumeConfig], plumes: Sequence[Plume], context: SignatureContext
) -> FloatArray:
    """Return the intensities (bands, n) of grey bodies: emissivity · projected area · in-band
    radiance.
    """
    shown_m2 = _column(configs, "body_emissivity") * _column(configs, "body_area_m2")
    own_k = [config.body_temperature_k for config in configs]
    usual_k = [plume.body_temperature_k for plume in plumes]
    temperature_k = np.array(
        [usual if own is None else own for own, usual in zip(own_k, usual_k, strict=True)]
    )
    radiance = [
        band_radiance(temperature_k, band.lower_um, band.upper_um) for band in context.bands
    ]
    whole = np.maximum(np.array(radiance, dtype=np.float64), 0.0).reshape(len(context.bands), -1)
    return shown_m2 * whole


def _default_plume(config: PlumeConfig, context: SignatureContext, row: int) -> Plume:
    """Return the plume that a target has where its configuration gives no value."""
    known = core_plumes()
    if config.profile is not None:
        if config.profile in known:
            return known[config.profile]
        raise ModelError(
            f"{context.paths[row]}.profile: {config.profile!r} is not one of {', '.join(known)}"
        )
    return (
        context.plumes[row]
        if context.plumes
        else core_target_class(context.types[row]).plume(context.profiles[row])
    )


def _radiance(temperature_k: float, edges_um: Sequence[float]) -> float:
    return _known_radiance(temperature_k, *edges_um)


@lru_cache(maxsize=4096)
def _known_radiance(temperature_k: float, lower_um: float, upper_um: float) -> float:
    """Return an in-band radiance, cached: many plumes share few temperatures and bands."""
    return float(band_radiance(temperature_k, lower_um, upper_um))


def _overlap(gas: tuple[float, float], band: Band) -> tuple[float, float]:
    """Return the overlap of the band of a gas with another band, of zero width where they are
    disjoint.
    """
    lower = max(gas[0], band.lower_um)
    return lower, max(lower, min(gas[1], band.upper_um))


def _padded(scales: Sequence[float]) -> list[float]:
    return [*scales[:_MOST_STAGES], *[scales[-1]] * (_MOST_STAGES - len(scales))]


def _column(configs: Sequence[PlumeConfig], name: str) -> FloatArray:
    return np.array([getattr(config, name) for config in configs], dtype=np.float64)
