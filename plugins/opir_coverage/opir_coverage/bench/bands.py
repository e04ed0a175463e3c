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

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError, SceneError
from opir_core.plugin import Sensor
from opir_coverage.bench.results import BenchLine, BenchPlot, BenchResult
from opir_coverage.bench.stand import Bench, Poses

#: Edges of the bands of LOWTRAN's table, µm: other edges have no air in `lowtran`.
_SHORT_UM = (2.0, 2.4, 2.5, 2.69, 2.95, 3.0, 3.5, 3.8, 4.0, 4.2, 4.45, 5.0)
LOWTRAN_EDGES_UM: tuple[float, ...] = (*_SHORT_UM, 5.77, 6.6, 6.75, 7.15, 7.24, 7.44, 8.0, 12.0)
_DAY_S = 86_400.0
#: The most bands that are plotted: more would repeat colours and dashes.
_PLOTTED = 6


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
        most = self.most_width_um + rounding
        found = [
            (low, high)
            for low in edges
            for high in edges
            if high > low and least <= high - low <= most
        ]
        if not found:
            raise ModelError(
                "no two of --edges are as far apart as --least-width and --most-width ask"
            )
        return found


@frozen(eq=False)
class TriedBand:
    """A band on the bench: edges, least SNR and P_d of one look at any target, the threshold of its
    SNR, and confirmed false alarms of noise a day."""

    edges_um: tuple[float, float]
    snr: float
    chance: float
    threshold: float
    false_alarms: float

    @property
    def margin_db(self) -> float:
        """The worst target's SNR over the threshold, 10 log₁₀ as in `--waterfall`; -inf without
        light.
        """
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
            tried.append(_tried(_alone(bench, edges, chance), poses))
        except (ModelError, SceneError) as error:
            if "atmosphere" not in str(error) and "background" not in str(error):
                raise
            unknown.append(edges)
    if not tried:
        raise ModelError(
            "the scene's air or background has none of these bands; give --edges of LOWTRAN's table"
        )
    tried.sort(key=lambda one: -one.margin_db)
    return _result(bench, poses, tried, len(unknown), most, chance)


def _computed(bench: Bench) -> Bench:
    """Return the bench with all settings, of a sensor whose noise is computed."""
    whole = bench.whole()
    name = bench.sensor.id
    own = whole.mapping["sensors"][0]
    stated = [key for key in ("nei_w_m2", "nei_w_cm2", "band_nei_w_m2") if own.get(key)]
    if stated or not whole.planes:
        what = f"{stated[0]} states its noise" if stated else "it has no focal plane"
        raise ModelError(
            f"{name}: {what}; opir physics bands needs a focal plane, whose noise depends on the"
            f" band"
        )
    return whole


def _false_alarm_probability(bench: Bench) -> float:
    """Return the chance that noise alone crosses the threshold in a cell and look, as the sensor's
    settings have it.
    """
    own = bench.mapping["sensors"][0]
    stated = own.get("false_alarm_probability")
    return float(stated) if stated is not None else float(ndtr(-own["threshold_sigma"]))


def _alone(bench: Bench, edges_um: tuple[float, float], chance: float) -> Bench:
    """Return the sensor with one band alone, and what the nearest of its own bands has of its
    own.
    """
    own: Mapping[str, Any] = bench.mapping["sensors"][0]
    middle = math.sqrt(edges_um[0] * edges_um[1])
    near = min(
        bench.sensor.bands,
        key=lambda each: abs(math.log(math.sqrt(each.lower_um * each.upper_um) / middle)),
    )
    planes = (
        {near.name: own["band_focal_plane"][near.name]}
        if near.name in own["band_focal_plane"]
        else {}
    )
    changed = {
        **own,
        "bands": {near.name: list(edges_um)},
        "band_focal_plane": planes,
        "reference_band": near.name,
        "plausible_ratios": {},
        "spectral_discrimination": "none",
        "threshold_sigma": None,
        "false_alarm_probability": chance,
    }
    return Bench(
        {
            **bench.mapping,
            "sensors": [{key: each for key, each in changed.items() if each is not None}],
        }
    )


def _tried(bench: Bench, poses: Sequence[Poses]) -> TriedBand:
    """Return what a sensor makes of its worst target."""
    found = [bench.signals(each) for each in poses]
    snr = min(float(_snr_of_rule(bench.sensor, each.snr).min()) for each in found)
    radiometer = bench.sensor.radiometer
    band = bench.sensor.bands[0]
    assert radiometer is not None
    rate = bench.plan.detection.rate_per_scan
    per_day = (
        math.nan if rate is None else float(rate[0]) * _DAY_S / (bench.sensor.scan.period_ns * 1e-9)
    )
    least = min(float(each.chance.min()) for each in found)
    return TriedBand((band.lower_um, band.upper_um), snr, least, radiometer.threshold, per_day)


def _snr_of_rule(sensor: Sensor, snr: FloatArray) -> FloatArray:
    """Return the SNR (n,) of looks that the rule over bands compares with the threshold, from those
    by band (n, B).
    """
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
    most: int,
    chance: float,
) -> BenchResult:
    head = ("band", "from um", "to um", "margin dB", "SNR", "P_d", "false alarms a day")
    shown = tried[:most]
    rows: list[list[Any]] = [
        [str(place + 1), *each.edges_um, each.margin_db, each.snr, each.chance, each.false_alarms]
        for place, each in enumerate(shown)
    ]
    lines = [
        BenchLine(f"{low:g}–{high:g} µm", np.array([low, high]), np.full(2, each.margin_db))
        for each, (low, high) in (
            (one, one.edges_um) for one in shown[:_PLOTTED] if math.isfinite(one.margin_db)
        )
    ]
    whole = _tried(bench, poses)
    names = "+".join(band.name for band in bench.sensor.bands)
    edges = (
        [band.lower_um for band in bench.sensor.bands],
        [band.upper_um for band in bench.sensor.bands],
    )
    rows.append(
        [
            f"as is: {names}",
            min(edges[0]),
            max(edges[1]),
            whole.margin_db,
            whole.snr,
            whole.chance,
            whole.false_alarms,
        ]
    )
    targets = ", ".join(
        f"{each.target_class} at {_listed(each.height_m * 1e-3)} km" for each in poses
    )
    sigma = -float(ndtri(chance))
    notes = [
        f"worst of {targets}; the best {len(shown)} of {len(tried)} bands tried",
        (
            f"false-alarm probability in a cell and look: {chance:.3g} in each band, a threshold of"
            f" {sigma:.2f} sigma"
        ),
        "noise and clutter only: see opir physics false-alarms for fires and glints",
    ]
    if unknown:
        notes.append(f"{unknown} more have no data in the scene's air or background")
    plot = BenchPlot(
        x_label="wavelength, µm", y_label="margin of the worst target, dB", lines=lines
    )
    return BenchResult(
        title=f"Best bands of {bench.sensor.id}, one alone",
        head=head,
        rows=rows,
        plot=plot,
        notes=notes,
    )


def _listed(values: Any) -> str:
    return ", ".join(f"{each:g}" for each in values)
