"""The best edges of one band for targets and a background: a scan with the models of the scene.

Each candidate is the sensor with that band alone: dark current (by the long edge), warm optics,
photons, clutter, air and plume are those of the scene's models in it. Candidates have one
false-alarm probability per resolution cell and look, so their thresholds in standard deviations are
equal and the best is the one with the largest signal over noise at its worst target.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen
from scipy.special import ndtr, ndtri

from opir_bench.results import BenchLine, BenchPlot, BenchResult
from opir_bench.stand import Bench, Poses, noise_alarms_a_day
from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, SceneError
from opir_core.plugin import Sensor

#: Edges of the bands of LOWTRAN's table, µm: other edges have no air in `lowtran`.
_SHORT_UM = (2.0, 2.4, 2.5, 2.69, 2.95, 3.0, 3.5, 3.8, 4.0, 4.2, 4.45, 5.0)
LOWTRAN_EDGES_UM: tuple[float, ...] = (*_SHORT_UM, 5.77, 6.6, 6.75, 7.15, 7.24, 7.44, 8.0, 12.0)
#: The most bands that are plotted: more would repeat colours and dashes.
_PLOTTED = 6
_HEAD = ("band", "from um", "to um", "margin dB", "SNR", "P_d", "false alarms a day")


@frozen
class BandLimits:
    """Candidates: all bands between two of these edges, µm, of a width between two limits, µm."""

    edges_um: tuple[float, ...] = LOWTRAN_EDGES_UM
    least_width_um: float = 0.0
    most_width_um: float = math.inf

    def candidates(self) -> list[tuple[float, float]]:
        """Return the bands, by their lower edges; raises `ModelError` if there are none."""
        edges = sorted(set(self.edges_um))
        rounding = 1e-9
        least = self.least_width_um - rounding
        widest = self.most_width_um + rounding
        bands = [
            (low, high)
            for low in edges
            for high in edges
            if high > low and least <= high - low <= widest
        ]
        if not bands:
            raise ModelError(
                "no two of --edges are as far apart as --least-width and --most-width ask"
            )
        return bands


@frozen(eq=False)
class TriedBand:
    """A band on the bench: edges, least SNR and P_d of one look over targets, threshold of the SNR.

    `false_alarms` are the confirmed ones of noise a day.
    """

    edges_um: tuple[float, float]
    snr: float
    chance: float
    threshold: float
    false_alarms: float

    @property
    def margin_db(self) -> float:
        """The worst target's SNR over the threshold, dB, as in `--waterfall`, or -inf."""
        return 10.0 * math.log10(self.snr / self.threshold) if self.snr > 0.0 else -math.inf


def best_bands(
    bench: Bench, poses: Sequence[Poses], limits: BandLimits, most: int = 12
) -> BenchResult:
    """Return the best bands for posed targets, best first, and the sensor as it is below them.

    Raises `ModelError` for a sensor without focal planes, or with a stated noise, which no band
    would change.
    """
    bench = _computed(bench)
    chance = _false_alarm_probability(bench)
    tried = []
    unknown = list[tuple[float, float]]()
    for edges in limits.candidates():
        try:
            tried.append(_tried(_single_band(bench, edges, chance), poses))
        except (ModelError, SceneError) as error:
            if "atmosphere" not in str(error) and "background" not in str(error):
                raise
            unknown.append(edges)
    if not tried:
        raise ModelError(
            "the scene's air or background has none of these bands; give --edges of LOWTRAN's table"
        )
    tried.sort(key=lambda band: -band.margin_db)
    return _result(bench, poses, tried, len(unknown), most, chance)


def _computed(bench: Bench) -> Bench:
    """Return the bench with all settings, of a sensor whose noise is computed."""
    complete = bench.whole()
    name = bench.sensor.id
    settings = complete.mapping["sensors"][0]
    stated = [key for key in ("nei_w_m2", "nei_w_cm2", "band_nei_w_m2") if settings.get(key)]
    if stated or not complete.planes:
        reason = f"{stated[0]} states its noise" if stated else "it has no focal plane"
        raise ModelError(
            f"{name}: {reason}; opir physics bands needs a focal plane, whose noise depends on the"
            f" band"
        )
    return complete


def _false_alarm_probability(bench: Bench) -> float:
    """Return the sensor's probability that noise crosses the threshold in a cell and look."""
    settings = bench.mapping["sensors"][0]
    stated = settings.get("false_alarm_probability")
    return float(stated) if stated is not None else float(ndtr(-settings["threshold_sigma"]))


def _single_band(bench: Bench, edges_um: tuple[float, float], chance: float) -> Bench:
    """Return the sensor with one band, which has the focal plane of the nearest of its bands."""
    settings: Mapping[str, Any] = bench.mapping["sensors"][0]
    name = _nearest_band(bench.sensor, edges_um)
    planes = settings["band_focal_plane"]
    changed = {
        **settings,
        "bands": {name: list(edges_um)},
        "band_focal_plane": {name: planes[name]} if name in planes else {},
        "reference_band": name,
        "plausible_ratios": {},
        "spectral_discrimination": "none",
        "threshold_sigma": None,
        "false_alarm_probability": chance,
    }
    sensor = {key: value for key, value in changed.items() if value is not None}
    return Bench({**bench.mapping, "sensors": [sensor]})


def _nearest_band(sensor: Sensor, edges_um: tuple[float, float]) -> str:
    """Return the name of the band whose middle is nearest, by the ratio of wavelengths."""
    middle = math.sqrt(edges_um[0] * edges_um[1])
    nearest = min(
        sensor.bands,
        key=lambda band: abs(math.log(math.sqrt(band.lower_um * band.upper_um) / middle)),
    )
    return nearest.name


def _tried(bench: Bench, poses: Sequence[Poses]) -> TriedBand:
    """Return the band of a sensor with its figures for the worst target."""
    signals = [bench.signals(poses_of_class) for poses_of_class in poses]
    snr = min(
        float(_snr_of_rule(bench.sensor, poses_of_class.snr).min()) for poses_of_class in signals
    )
    radiometer = bench.sensor.radiometer
    band = bench.sensor.bands[0]
    assert radiometer is not None
    per_day = float(noise_alarms_a_day(bench.plan, math.nan)[0])
    least = min(float(poses_of_class.chance.min()) for poses_of_class in signals)
    return TriedBand((band.lower_um, band.upper_um), snr, least, radiometer.threshold, per_day)


def _snr_of_rule(sensor: Sensor, snr: FloatArray) -> FloatArray:
    """Return the SNR (n,) that the rule over bands compares with the threshold; `snr` is (n, B)."""
    if sensor.spectral_discrimination == "likelihood":
        return np.asarray(np.sqrt(np.square(snr).sum(axis=1)))
    if sensor.spectral_discrimination == "none":
        return np.asarray(snr.max(axis=1))
    assert sensor.radiometer is not None
    return snr[:, sensor.radiometer.reference]


def _result(
    bench: Bench,
    poses: Sequence[Poses],
    tried: Sequence[TriedBand],
    unknown: int,
    shown: int,
    chance: float,
) -> BenchResult:
    best = tried[:shown]
    rows = [_row(str(place + 1), band, band.edges_um) for place, band in enumerate(best)]
    bands = bench.sensor.bands
    names = "+".join(band.name for band in bands)
    edges_um = (min(band.lower_um for band in bands), max(band.upper_um for band in bands))
    rows.append(_row(f"as is: {names}", _tried(bench, poses), edges_um))
    targets = ", ".join(map(_words, poses))
    notes = [
        f"worst of {targets}; the best {len(best)} of {len(tried)} bands tried",
        (
            f"false-alarm probability in a cell and look: {chance:.3g} in each band, a threshold of"
            f" {-float(ndtri(chance)):.2f} sigma"
        ),
        "noise and clutter only: see opir physics false-alarms for fires and glints",
    ]
    if unknown:
        notes.append(f"{unknown} more have no data in the scene's air or background")
    return BenchResult(
        f"Best bands of {bench.sensor.id}, one alone", _HEAD, rows, _plot(best), notes
    )


def _row(name: str, band: TriedBand, edges_um: tuple[float, float]) -> list[Any]:
    return [name, *edges_um, band.margin_db, band.snr, band.chance, band.false_alarms]


def _plot(bands: Sequence[TriedBand]) -> BenchPlot:
    """Return the plot of the first bands' margins over their wavelengths."""
    lines = [
        BenchLine(
            f"{band.edges_um[0]:g}–{band.edges_um[1]:g} µm",
            np.array(band.edges_um),
            np.full(2, band.margin_db),
        )
        for band in bands[:_PLOTTED]
        if math.isfinite(band.margin_db)
    ]
    return BenchPlot("wavelength, µm", "margin of the worst target, dB", lines)


def _words(poses: Poses) -> str:
    heights = ", ".join(f"{height_km:g}" for height_km in poses.height_m * 1e-3)
    return f"{poses.target_class} at {heights} km"
