"""Budgets: the noise of a look by term and band, NEI and NEDT, and the path from source to decision
in decibels.

A term is what the noise loses without it: the scene's own models are asked once with everything and
once without each term, and variances are subtracted. Terms that the sensor's settings do not know
are left out.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from opir_photons.radiometry import band_radiance_slope

from opir_core.arrays import FloatArray
from opir_coverage.bench.stand import Bench, Poses, Signals

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
    """The noise of one look by term, its whole (B,), W/m², the NEI of a dark background, and the
    NEDT at 300 K, K.

    `light_w_m2` (B,) is the target's irradiance, of which `signals` have what frame difference and
    wells leave.
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
    whole = bench.signals(poses)
    dark = bench.changed(background="none").signals(poses)
    still = bench.changed(background=_without_clutter(bench)).signals(poses)
    total, nei, photons = (each.noise_w_m2[0] for each in (whole, dark, still))
    terms = [*_detector_terms(bench, poses, nei)]
    terms.append(NoiseTerm("photons of the background", _left(photons, nei)))
    clutter = _left(total, photons)
    terms += _clutter_terms(bench, poses, clutter)
    ifov_sr = 0.0 if bench.sensor.radiometer is None else bench.sensor.radiometer.ifov_rad**2
    slope = [
        float(band_radiance_slope(SCENE_K, band.lower_um, band.upper_um))
        for band in bench.sensor.bands
    ]
    with np.errstate(divide="ignore"):
        nedt = total / (np.array(slope) * ifov_sr)
    names = tuple(band.name for band in bench.sensor.bands)
    return NoiseBudget(names, terms, total, nei, nedt, bench.light_w_m2(poses)[0], whole)


def _left(whole: FloatArray, rest: FloatArray) -> FloatArray:
    """Return the standard deviations whose squares are the differences of others'."""
    return np.sqrt(np.maximum(np.square(whole) - np.square(rest), 0.0))


def _without_clutter(bench: Bench) -> Any:
    """Return the scene's background block without clutter."""
    block = bench.background()
    if "structure" in block:
        still = {
            name: {**block["structure"][name], "thermal_rms": 0.0, "solar_rms": 0.0}
            for name in _STRUCTURES
        }
        block = {**block, "structure": {**block["structure"], **still}}
    return {**block, "clutter_residual": 0.0} if "clutter_residual" in block else block


def _detector_terms(bench: Bench, poses: Poses, nei: FloatArray) -> Iterator[NoiseTerm]:
    """Yield the terms of the NEI: those of focal planes, and what they do not explain."""
    rest = np.square(nei)
    if bench.planes:
        for name, changes in _OF_FOCAL_PLANE.items():
            without = (
                bench.with_planes(**changes).changed(background="none").signals(poses).noise_w_m2[0]
            )
            own = _left(nei, without)
            rest = rest - np.square(own)
            if own.any():
                yield NoiseTerm(name, own)
    if np.any(rest > _ROUNDING * np.square(nei)):
        yield NoiseTerm("detector (stated or calibrated NEI)", np.sqrt(np.maximum(rest, 0.0)))


def _clutter_terms(bench: Bench, poses: Poses, clutter: FloatArray) -> list[NoiseTerm]:
    """Return clutter, of sensors with a frame difference by what lets it through.

    Both together leave less than the sum of each alone: drift has what it leaves alone,
    registration what it adds.
    """
    if not bench.planes or bench.planes[0].temporal_filter == "none" or not clutter.any():
        return [NoiseTerm("clutter", clutter)]
    without = bench.with_planes(registration_urad=0.0)
    still = without.changed(background=_without_clutter(without)).signals(poses).noise_w_m2[0]
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
    """Return the steps of a band's SNR in decibels (10 log of intensity): source, range, air,
    noise, threshold.

    The last level is the margin: the SNR over the threshold.
    """
    look = budget.signals
    light = budget.light_w_m2[band]
    with np.errstate(divide="ignore", invalid="ignore"):
        intensity = light * look.range_m[0] ** 2 / look.transmittance[0, band]
        left = look.irradiance_w_m2[0, band] / light
    left = 1.0 if abs(left - 1.0) < _ROUNDING else left
    gains = [
        ("source", intensity, f"{intensity:.3g} W/sr"),
        ("range", 1.0 / look.range_m[0] ** 2, f"{1e-3 * look.range_m[0]:.0f} km"),
        ("air", look.transmittance[0, band], f"transmittance {look.transmittance[0, band]:.3g}"),
        ("frame difference and wells", left, f"{left:.3g} of it left"),
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
        own = 10.0 * float(np.log10(gain)) if gain > 0.0 else -np.inf
        level += own
        steps.append(WaterfallStep(name, own, level, words))
    return steps
