"""Budgets of a look: noise by term and band, NEI, NEDT, and the SNR from source to decision, dB.

The variance of a term is that of all noise minus that without the term, both by the scene's models.
Terms for which the sensor has no setting are left out.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from opir_photons.radiometry import band_radiance_slope

from opir_bench.stand import Bench, Poses, Signals
from opir_core.arrays import FloatArray
from opir_core.plugin import Sensor

#: Terms of a focal plane's NEI, and the settings that switch each off.
_OF_FOCAL_PLANE: Mapping[str, Mapping[str, Any]] = {
    "dark current": {"dark_current_e_s": 0.0},
    "warm optics": {"optics_temperature_k": 0.0},
    "read-out": {"read_noise_e": 0.0},
    "conversion": {"bits": 64},
}
#: Clutter of the background, by setting of a scene, for all kinds of structure.
_STRUCTURES = ("cloud", "terrain", "sea", "limb")
#: The share of a variance or of light below which it is a rounding error.
_ROUNDING = 1e-9
#: The temperature at which NEDT is given, K.
SCENE_K = 300.0


@frozen(eq=False)
class NoiseTerm:
    """A term of noise: standard deviations (B,) at the aperture, W/m²."""

    name: str
    sigma_w_m2: FloatArray


@frozen(eq=False)
class NoiseBudget:
    """The noise (B,) of one look, W/m², by term and in all, NEI (dark background), NEDT (300 K).

    `light_w_m2` (B,) is the target's irradiance; `signals` are after frame difference and wells.
    """

    bands: tuple[str, ...]
    terms: Sequence[NoiseTerm]
    whole_w_m2: FloatArray
    nei_w_m2: FloatArray
    nedt_k: FloatArray
    light_w_m2: FloatArray
    signals: Signals


def noise_budget(bench: Bench, poses: Poses) -> NoiseBudget:
    """Return the budget of a look at one posed target."""
    bench = bench.whole()
    signals = bench.signals(poses)
    dark = bench.changed(background="none").signals(poses)
    still = _without_clutter(bench).signals(poses)
    total, nei, photons = (look.noise_w_m2[0] for look in (signals, dark, still))
    terms = [
        *_detector_terms(bench, poses, nei),
        NoiseTerm("photons of the background", _left(photons, nei)),
        *_clutter_terms(bench, poses, _left(total, photons)),
    ]
    names = tuple(band.name for band in bench.sensor.bands)
    nedt_k = _nedt_k(bench.sensor, total)
    return NoiseBudget(names, terms, total, nei, nedt_k, bench.light_w_m2(poses)[0], signals)


def _nedt_k(sensor: Sensor, noise_w_m2: FloatArray) -> FloatArray:
    """Return the noise-equivalent temperature differences (B,) at 300 K, K."""
    ifov_sr = 0.0 if sensor.radiometer is None else sensor.radiometer.ifov_rad**2
    slope = [
        float(band_radiance_slope(SCENE_K, band.lower_um, band.upper_um)) for band in sensor.bands
    ]
    with np.errstate(divide="ignore"):
        return noise_w_m2 / (np.array(slope) * ifov_sr)


def _left(total_w_m2: FloatArray, remaining_w_m2: FloatArray) -> FloatArray:
    """Return the square roots of the differences of variances, at least 0."""
    return np.sqrt(np.maximum(np.square(total_w_m2) - np.square(remaining_w_m2), 0.0))


def _without_clutter(bench: Bench) -> Bench:
    """Return the bench before a background without clutter."""
    block = bench.background()
    if "structure" in block:
        still = {
            name: {**block["structure"][name], "thermal_rms": 0.0, "solar_rms": 0.0}
            for name in _STRUCTURES
        }
        block = {**block, "structure": {**block["structure"], **still}}
    if "clutter_residual" in block:
        block["clutter_residual"] = 0.0
    return bench.changed(background=block)


def _detector_terms(bench: Bench, poses: Poses, nei: FloatArray) -> Iterator[NoiseTerm]:
    """Yield the terms of the NEI: those of focal planes, and the remainder."""
    remaining = np.square(nei)
    if bench.planes:
        for name, changes in _OF_FOCAL_PLANE.items():
            without = (
                bench.with_planes(**changes).changed(background="none").signals(poses).noise_w_m2[0]
            )
            sigma = _left(nei, without)
            remaining = remaining - np.square(sigma)
            if sigma.any():
                yield NoiseTerm(name, sigma)
    if np.any(remaining > _ROUNDING * np.square(nei)):
        yield NoiseTerm("detector (stated or calibrated NEI)", np.sqrt(np.maximum(remaining, 0.0)))


def _clutter_terms(bench: Bench, poses: Poses, clutter: FloatArray) -> list[NoiseTerm]:
    """Return the clutter; with a frame difference the shares by registration and by drift.

    Drift is the clutter without errors of registration; registration is what these add.
    """
    if not bench.planes or bench.planes[0].temporal_filter == "none" or not clutter.any():
        return [NoiseTerm("clutter", clutter)]
    without = bench.with_planes(registration_urad=0.0)
    still = _without_clutter(without).signals(poses).noise_w_m2[0]
    drift = _left(without.signals(poses).noise_w_m2[0], still)
    return [
        NoiseTerm("clutter by frame registration", _left(clutter, drift)),
        NoiseTerm("clutter by drift", np.minimum(drift, clutter)),
    ]


@frozen
class WaterfallStep:
    """A step from source to decision: the level after it in decibels, and what it is."""

    name: str
    gain_db: float
    level_db: float
    value: str


def waterfall(budget: NoiseBudget, band: int, threshold: float) -> list[WaterfallStep]:
    """Return the steps of a band's SNR, dB (10 log of intensity), from source to threshold.

    The last level is the margin: the SNR over the threshold.
    """
    look = budget.signals
    light = budget.light_w_m2[band]
    with np.errstate(divide="ignore", invalid="ignore"):
        intensity = light * look.range_m[0] ** 2 / look.transmittance[0, band]
        passed = look.irradiance_w_m2[0, band] / light
    passed = 1.0 if abs(passed - 1.0) < _ROUNDING else passed
    gains = [
        ("source", intensity, f"{intensity:.3g} W/sr"),
        ("range", 1.0 / look.range_m[0] ** 2, f"{1e-3 * look.range_m[0]:.0f} km"),
        ("air", look.transmittance[0, band], f"transmittance {look.transmittance[0, band]:.3g}"),
        ("frame difference and wells", passed, f"{passed:.3g} of it left"),
        ("detector noise", 1.0 / budget.nei_w_m2[band], f"NEI {budget.nei_w_m2[band]:.3g} W/m2"),
        (
            "background and clutter",
            budget.nei_w_m2[band] / budget.whole_w_m2[band],
            f"SNR {look.snr[0, band]:.3g}",
        ),
        ("threshold", 1.0 / threshold, f"{threshold:g} sigma"),
    ]
    steps = []
    level = 0.0
    for name, gain, words in gains:
        gain_db = 10.0 * float(np.log10(gain)) if gain > 0.0 else -np.inf
        level += gain_db
        steps.append(WaterfallStep(name, gain_db, level, words))
    return steps
