"""The signature model `plume`: notional radiant intensity by class, propellant, thrust phase,
altitude and aspect.

Sources: `opir_core/data/plumes.json` and `opir_photons/data/plume_gases.json` for the gases,
`opir_photons/data/propellants.json` for the continuum of soot and alumina, which mark their
notional values; `opir_photons.radiometry.long_waves` for gases from 5 to 14 µm. Gases, long waves
and particles depend on height each in its way, so that the ratios of bands change with height; the
factors for stage, rise at ignition and aspect are common. The factor of aspect is that of the
projected area of a long body: at an angle a from the direction of flight √(sin² a + e² cos² a),
with e its value end-on. After burnout only the body radiates, grey and at one temperature where
the air does not heat it (`opir_photons.radiometry.heating`), with a nozzle that cools, and
reflects sunlight as a diffuse sphere; earthshine is not modelled.

The stages of a target with several burns are these, each with a rise at its ignition; otherwise
stages share the burn equally and only the first rises. A number of stages that the configuration
gives shares the burn equally, too.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.flight import density_kg_m3
from opir_core.plugin import Band, Plume, SignatureContext, Signatures
from opir_core.scene import core_plumes, core_target_class, plume_table
from opir_photons.laws import law
from opir_photons.radiometry.configs import PlumeConfig
from opir_photons.radiometry.heating import HeatedBodies, heated_below_m
from opir_photons.radiometry.long_waves import LongWaves, has_long_waves, jet_spectra
from opir_photons.radiometry.planck import SECOND_RADIATION_UM_K, band_radiance
from opir_photons.radiometry.propellants import (
    Propellant,
    continuum_w_sr,
    jet_power_w,
    profile_propellant,
    propellants,
)

#: Time after burnout, s, below which looks are those in dark gaps between burns.
_LEAST_GLOW_S = 1e-9

#: The largest number of stages of a plume.
_MAX_STAGES = 8

#: The altitude from which gases expand as in vacuum, km; between jets and these light is linear.
_EXPANDING_KM = 100.0


@frozen(eq=False)
class PlumeSignatures(Signatures):
    """Plumes of n targets, and their bodies: `peak_w_sr` of gases, `particle_w_sr`, `body_w_sr`
    (bands, n); `long_waves` of gases from 5 to 14 µm.

    The other columns are (n,), shapes by number: altitudes, and the factors of gases and particles
    there. `body_reflecting_m2` is albedo times area; `bodies` are heated by the air, in
    `bands`. Of each stage (n, 8) the scale, its
    end and the ignition from which the intensity rises, s since the first ignition.
    """

    peak_w_sr: FloatArray
    long_waves: LongWaves
    particle_w_sr: FloatArray
    body_w_sr: FloatArray
    body_reflecting_m2: FloatArray
    bands: tuple[Band, ...]
    bodies: HeatedBodies
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
        gas, particles = common * self._altitude(target, altitude_m)
        burnt_out = np.flatnonzero(time_since_ignition_s > self.burn_time_s[target])
        intensities = np.empty((len(bands), len(target)))
        for intensity, band in zip(intensities, bands, strict=True):
            np.multiply(self.peak_w_sr[band].take(target), gas, out=intensity)
            if not self.long_waves.is_dark(band):
                intensity += common * self.long_waves.w_sr(band, target, altitude_m)
            intensity += self.particle_w_sr[band].take(target) * particles
            intensity[burnt_out] = self.body_w_sr[band].take(target[burnt_out])
        self._add_nozzles(intensities, bands, target, time_since_ignition_s)
        return intensities

    def _add_nozzles(
        self,
        intensities: FloatArray,
        bands: Sequence[int],
        target: IndexArray,
        time_since_ignition_s: FloatArray,
    ) -> None:
        """Add the glow of nozzles after the burn to intensities (bands, n), in place; in a dark gap,
        where the time is that of burnout, there is none.
        """
        since_s = time_since_ignition_s - self.burn_time_s[target]
        rows = np.flatnonzero((since_s > _LEAST_GLOW_S) & (self.bodies.nozzle_m2[target] > 0.0))
        if len(rows):
            chosen = [self.bands[band] for band in bands]
            intensities[:, rows] += self.bodies.nozzle_w_sr(chosen, target[rows], since_s[rows])

    def reflecting_area_m2(
        self, target: IndexArray, time_since_ignition_s: FloatArray
    ) -> FloatArray:
        """Return albedo times cross-section (n,) of bodies, m²; 0 before burnout."""
        is_burnt_out = time_since_ignition_s > self.burn_time_s[target]
        return np.where(is_burnt_out, self.body_reflecting_m2[target], 0.0)

    @property
    def heated_below_m(self) -> float:
        """Altitude below which the heat of the air counts, m."""
        return heated_below_m()

    def air_heated_w_sr(
        self,
        bands: Sequence[int],
        target: IndexArray,
        altitude_m: FloatArray,
        speed_m_s: FloatArray,
    ) -> FloatArray:
        """Return what bodies in the air radiate more than without it (bands, n), W/sr."""
        chosen = [self.bands[band] for band in bands]
        # An ephemeris ends on the ground, to rounding.
        density = density_kg_m3(np.maximum(altitude_m, 0.0))
        return self.bodies.excess_w_sr(chosen, target, density, speed_m_s)

    @property
    def time_breakpoints_s(self) -> FloatArray:
        """The ends of stages, the last of which is burnout, (n, 8) s since ignition."""
        return self.stage_end_s

    @property
    def altitude_breakpoints_m(self) -> FloatArray:
        """The altitudes at which the factor of altitude is given, (n, k) m."""
        levels_m = np.full((len(self.shapes), max(len(shape[0]) for shape in self.shapes)), np.nan)
        for row, (altitude_m, *_) in zip(levels_m, self.shapes, strict=True):
            row[: len(altitude_m)] = altitude_m
        return levels_m[self.shape]

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
        """Return the factors of altitude (2, n) of gases and particles."""
        factors = np.empty((2, len(target)))
        shape = self.shape[target]
        for number, (points_m, *levels) in enumerate(self.shapes):
            rows = slice(None) if len(self.shapes) == 1 else np.flatnonzero(shape == number)
            factors[:, rows] = [np.interp(altitude_m[rows], points_m, level) for level in levels]
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
    unheated_k = _unheated_k(configs, plumes)
    stages = _stages_of(configs, plumes, burn_time_s, context.burns_s)
    rows, kind = _distinct(configs, plumes)
    exhausts = [_Exhaust.of(configs[row], plumes[row], context.paths[row]) for row in rows]
    shapes = list(dict.fromkeys(exhaust.shape for exhaust in exhausts))
    numbers = [shapes.index(exhaust.shape) for exhaust in exhausts]

    def by_band(intensity_w_sr: Callable[[_Exhaust, Band], float]) -> FloatArray:
        columns = [
            [intensity_w_sr(exhaust, band) for exhaust in exhausts] for band in context.bands
        ]
        return np.array(columns, dtype=np.float64).reshape(len(context.bands), -1)[:, kind]

    return PlumeSignatures(
        peak_w_sr=by_band(_Exhaust.gas_w_sr),
        long_waves=LongWaves(kind, tuple(each.long_waves(context.bands) for each in exhausts)),
        particle_w_sr=by_band(_Exhaust.particle_w_sr),
        body_w_sr=_bodies_w_sr(configs, unheated_k, context.bands),
        body_reflecting_m2=_column(configs, "body_albedo") * _column(configs, "body_area_m2"),
        bands=context.bands,
        bodies=_heated_bodies(configs, unheated_k, context.profiles),
        burn_time_s=burn_time_s,
        stages=stages.number,
        stage_end_s=stages.end_s,
        stage_ignition_s=stages.ignition_s,
        stage_scale=np.array([_padded(config.stage_scale) for config in configs]),
        rise_time_s=_column(configs, "rise_time_s"),
        nose_on=_column(configs, "nose_on"),
        tail_on=_column(configs, "tail_on"),
        shape=np.array(numbers, dtype=np.int64)[kind],
        shapes=tuple(_factors(*shape) for shape in shapes),
    )


def _distinct(
    configs: Sequence[PlumeConfig], plumes: Sequence[Plume]
) -> tuple[list[int], IntArray]:
    """Return the first rows of targets with the same settings and plume, and of each target the
    number of its own.

    By identity: a raid, or a grid of launches, has few settings and plumes for all its targets.
    """
    keys = [(id(config), id(plume)) for config, plume in zip(configs, plumes, strict=True)]
    rows: dict[tuple[int, int], int] = {}
    for row, key in enumerate(keys):
        rows.setdefault(key, row)
    numbers = {key: number for number, key in enumerate(rows)}
    return list(rows.values()), np.array([numbers[key] for key in keys], dtype=np.int64)


@frozen(eq=False)
class _Exhaust:
    """The gases and particles of targets with the same settings and plume: `peak_w_sr` by the
    table's bands.
    """

    config: PlumeConfig
    peak_w_sr: Mapping[str, float]
    fuel: Propellant
    path: str

    @classmethod
    def of(cls, config: PlumeConfig, plume: Plume, path: str) -> "_Exhaust":
        """Return the exhaust of a target; without a propellant of its own it burns that of its
        class, a clean one for classes that the core has not.
        """
        of_class = [
            profile_propellant(name) for name, other in core_plumes().items() if other == plume
        ]
        name = config.propellant or (of_class[0] if of_class else None) or "storable"
        return cls(config, {**plume.peak_w_sr, **config.peak_w_sr}, propellants()[name], path)

    @property
    def shape(self) -> tuple[tuple[float, ...], tuple[float, ...], Propellant]:
        """The arguments of `_factors`."""
        return self.config.altitude_km, self.config.altitude_scale, self.fuel

    def gas_w_sr(self, band: Band) -> float:
        """Return the peak of the gases in a band; `ModelError` for impossible peaks."""
        temperatures = (self.config.continuum_temperature_k, self.config.gas_temperature_k)
        try:
            return self.config.scale * plume_intensity_w_sr(self.peak_w_sr, band, *temperatures)
        except ValueError as error:
            raise ModelError(f"{self.path}: {error}") from error

    @property
    def power_w(self) -> float:
        """The jet power."""
        return self.config.scale * jet_power_w(self.peak_w_sr)

    def long_waves(self, bands: Sequence[Band]) -> tuple[FloatArray, FloatArray]:
        """Return altitudes (k,), m, and there the intensities (bands, k) of gases in long waves: of
        jets in the air, and from 100 km on of thin gas that expands.
        """
        points_km = _points_km(self.config.altitude_km, self.fuel)
        high_km = np.append(_EXPANDING_KM, points_km[points_km > _EXPANDING_KM])
        levels = np.zeros((len(bands), len(points_km)))
        for level, band in zip(levels, bands, strict=True):
            if not has_long_waves(band):
                continue
            jets = jet_spectra()[self.fuel.name]
            low_w_sr = jets.intensities_w_sr(self.power_w, band)
            light_w_sr = np.append(low_w_sr, self._expanding_w_sr(high_km, band))
            level[:] = np.interp(points_km, np.append(jets.height_km, high_km), light_w_sr)
        return points_km * 1e3, levels

    def _expanding_w_sr(self, altitude_km: FloatArray, band: Band) -> FloatArray:
        """Return the intensities of hot water near 6.3 µm without air: of thin gas, by that near
        2.7 µm.
        """
        config = self.config
        gases = law("plume_gases")
        cooling = np.interp(altitude_km, gases["cooling_km"], gases["cooling"])
        level = np.interp(altitude_km, config.altitude_km, config.altitude_scale)
        hot_w_sr = water_intensity_w_sr(self.peak_w_sr["SWIR"], band, config.gas_temperature_k)
        ratio = [_water_ratio(config.gas_temperature_k * cooled) for cooled in cooling]
        cooled_w_sr = hot_w_sr * np.array(ratio) / _water_ratio(config.gas_temperature_k)
        return np.asarray(config.scale * level * cooled_w_sr)

    def particle_w_sr(self, band: Band) -> float:
        """Return the broadside intensity of particles in a band, where it is highest."""
        return continuum_w_sr(self.fuel, self.power_w, band.lower_um, band.upper_um)


def _factors(
    altitude_km: Sequence[float], altitude_scale: Sequence[float], fuel: Propellant
) -> tuple[FloatArray, ...]:
    """Return altitudes, m, and there the factors of gases and particles; both are linear between."""
    points_km = _points_km(altitude_km, fuel)
    gas = np.interp(points_km, altitude_km, altitude_scale)
    return points_km * 1e3, gas, np.interp(points_km, fuel.altitude_km, fuel.altitude_scale)


def _points_km(altitude_km: Sequence[float], fuel: Propellant) -> FloatArray:
    """Return the altitudes between which gases, long waves and particles are linear."""
    gases = law("plume_gases")
    parts = (altitude_km, fuel.altitude_km, gases["cooling_km"], gases["jet_heights_km"])
    return np.unique(np.concatenate(parts))


class _Stages(NamedTuple):
    """Stages of targets: their number (n,), and of each (n, 8) its end and the ignition from which
    the intensity rises, s since the first ignition.
    """

    number: IntArray
    end_s: FloatArray
    ignition_s: FloatArray


def _stages_of(
    configs: Sequence[PlumeConfig],
    plumes: Sequence[Plume],
    burn_time_s: FloatArray,
    burns_s: FloatArray,
) -> _Stages:
    """Return the stages of flights with several burns, else equal shares of the burn."""
    burns = np.minimum(np.count_nonzero(np.isfinite(burns_s[..., 0]), axis=1), _MAX_STAGES)
    is_set = np.array([config.stages is not None for config in configs], dtype=np.bool_)
    of_flight = ~is_set & (burns > 1)
    shares = [config.stages or plume.stages for config, plume in zip(configs, plumes, strict=True)]
    count = np.where(of_flight, burns, shares)
    number = np.arange(1, _MAX_STAGES + 1)
    end_s = burn_time_s[:, None] * np.minimum(number / count[:, None], 1.0)
    ignition_s = np.zeros(end_s.shape)
    flight_s = burns_s[of_flight, :_MAX_STAGES]
    missing = ((0, 0), (0, _MAX_STAGES - flight_s.shape[1]))
    burnout_s = np.fmin(flight_s[..., 1], burn_time_s[of_flight, None])
    end_s[of_flight] = np.pad(burnout_s, missing, mode="edge")
    ignition_s[of_flight] = np.pad(np.nan_to_num(flight_s[..., 0]), missing)
    return _Stages(count, end_s, ignition_s)


def plume_intensity_w_sr(
    peaks: Mapping[str, float], band: Band, continuum_k: float, gas_k: float
) -> float:
    """Return the gases' intensity, W/sr, in any band of a plume given by its intensities in the
    table's three bands.

    Without the band of water near 6.3 µm, `water_intensity_w_sr`.

    `ValueError` where the continuum implied by LWIR exceeds the given SWIR or MWIR.
    """
    edges = plume_table()["bands_um"]
    area = peaks["LWIR"] / _radiance(continuum_k, *edges["LWIR"])
    total = area * _radiance(continuum_k, band.lower_um, band.upper_um)
    for name, gas in law("plume_gases")["bands_um"].items():
        continuum_w_sr = area * _radiance(continuum_k, *edges[name])
        gas_w_sr = peaks[name] - continuum_w_sr
        if gas_w_sr < 0.0:
            raise ValueError(
                f"the continuum that LWIR {peaks['LWIR']:g} W/sr implies at {continuum_k:g} K,"
                f" {continuum_w_sr:g} W/sr in {name}, is more than the {peaks[name]:g} W/sr of"
                f" {name}"
            )
        whole = _radiance(gas_k, *_overlap(gas, Band(name, *edges[name])))
        total += gas_w_sr * _radiance(gas_k, *_overlap(gas, band)) / whole
    # Bands with swapped edges are empty.
    return max(total, 0.0)


def water_intensity_w_sr(swir_w_sr: float, band: Band, gas_k: float) -> float:
    """Return the intensity, W/sr, of hot water near 6.3 µm in a band, by that of the gases in
    SWIR.
    """
    gas = law("plume_gases")["bands_um"]["SWIR"]
    water = law("plume_gases")["water_um"]
    swir = Band("SWIR", *plume_table()["bands_um"]["SWIR"])
    near_2_7 = swir_w_sr * _radiance(gas_k, *gas) / _radiance(gas_k, *_overlap(gas, swir))
    share = _radiance(gas_k, *_overlap(water, band)) / _radiance(gas_k, *water)
    return max(near_2_7 * _water_ratio(gas_k) * share, 0.0)


def _water_ratio(gas_k: float) -> float:
    """Return the emission of thin hot water near 6.3 µm over that of water and carbon dioxide near
    2.7 µm.
    """
    gases = law("plume_gases")
    water, near_2_7 = (
        strength * centre**3 / np.expm1(SECOND_RADIATION_UM_K * 1e-4 * centre / gas_k)
        for centre, strength in (
            gases["water_centre_and_strength"],
            gases["near_2_7_centre_and_strength"],
        )
    )
    return float(water / near_2_7)


def _unheated_k(configs: Sequence[PlumeConfig], plumes: Sequence[Plume]) -> FloatArray:
    """Return the temperatures (n,) that bodies have without air."""
    return np.array(
        [
            plume.body_temperature_k
            if config.body_temperature_k is None
            else config.body_temperature_k
            for config, plume in zip(configs, plumes, strict=True)
        ]
    )


def _heated_bodies(
    configs: Sequence[PlumeConfig], unheated_k: FloatArray, profiles: Sequence[str]
) -> HeatedBodies:
    """Return what the air heats, by the profiles that targets fly or that are set."""
    names = [config.profile or name for config, name in zip(configs, profiles, strict=True)]
    area_m2 = _column(configs, "body_area_m2")
    return HeatedBodies.of(names, area_m2, _column(configs, "body_emissivity"), unheated_k)


def _bodies_w_sr(
    configs: Sequence[PlumeConfig], temperature_k: FloatArray, bands: Sequence[Band]
) -> FloatArray:
    """Return the intensities (bands, n) of grey bodies: emissivity · projected area · in-band
    radiance.
    """
    area_m2 = _column(configs, "body_emissivity") * _column(configs, "body_area_m2")
    radiance = [band_radiance(temperature_k, band.lower_um, band.upper_um) for band in bands]
    return area_m2 * np.maximum(np.array(radiance, dtype=np.float64), 0.0).reshape(len(bands), -1)


def _default_plume(config: PlumeConfig, context: SignatureContext, row: int) -> Plume:
    """Return the plume that a target has where its configuration gives no value."""
    classes = core_plumes()
    if config.profile is not None:
        if config.profile in classes:
            return classes[config.profile]
        raise ModelError(
            f"{context.paths[row]}.profile: {config.profile!r} is not one of {', '.join(classes)}"
        )
    if context.plumes:
        return context.plumes[row]
    return core_target_class(context.types[row]).plume(context.profiles[row])


@lru_cache(maxsize=4096)
def _radiance(temperature_k: float, lower_um: float, upper_um: float) -> float:
    """Return an in-band radiance, cached: many plumes share few temperatures and bands."""
    return float(band_radiance(temperature_k, lower_um, upper_um))


def _overlap(gas: Sequence[float], band: Band) -> tuple[float, float]:
    """Return the overlap of the band of a gas with another band, of zero width where they are
    disjoint.
    """
    lower = max(gas[0], band.lower_um)
    return lower, max(lower, min(gas[1], band.upper_um))


def _padded(scales: Sequence[float]) -> list[float]:
    return [*scales[:_MAX_STAGES], *[scales[-1]] * (_MAX_STAGES - len(scales))]


def _column(configs: Sequence[PlumeConfig], name: str) -> FloatArray:
    return np.array([getattr(config, name) for config in configs], dtype=np.float64)
