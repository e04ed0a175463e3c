"""Thunderstorms: flashes of lightning, each an emitter that stands and glows evenly.

Intervals between the flashes of a storm are log-normal. The number of strokes of a flash is
geometric, the intervals between strokes log-normal: their geometric mean and the mean duration of
flashes of several strokes say their spread. A flash shines with the energy of its strokes, spread
evenly over its duration, and with the colour of a grey body; what clouds take of it is left out.
"""

import math
from collections.abc import Mapping

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.errors import ModelError
from opir_core.geometry import LatitudeLongitude, geodesic_direct
from opir_core.plugin import EMITTER_TYPES, SourceContext, Sources
from opir_photons.movers.configs import StormConfig
from opir_photons.radiometry.emitters import (
    MOST_EMITTERS,
    Emitters,
    emitters_of,
    normals,
    uniforms,
)
from opir_photons.radiometry.planck import band_radiance
from opir_photons.radiometry.sources import (
    EmitterSources,
    GreySignatures,
    StraightTrajectories,
    by_band,
    starts_m,
    truth_of,
)

#: The wavelengths of the detector that measured the energies of strokes, µm.
_MEASURED_UM = (0.4, 1.1)

#: Mean intervals between flashes before the start of a storm, after which flashes come evenly.
_EARLIER_INTERVALS = 20


class FlashTrajectories(StraightTrajectories):
    """Flashes of lightning, which stand."""

    @property
    def class_names(self) -> list[str]:
        """The kind of each emitter."""
        return ["lightning"] * len(self.type_code)


def storm_sources(config: StormConfig, context: SourceContext) -> Sources:
    """Return the flashes of thunderstorms, in the order of storms, then times."""
    storms = emitters_of(config, context)
    expected = float(
        np.sum(storms["flashes_per_minute"] * np.maximum(storms["end_s"] - storms["start_s"], 0.0))
        / 60.0
    )
    if expected > MOST_EMITTERS:
        raise ModelError(
            f"{context.path}: {expected:.0f} flashes are expected; a block has at most"
            f" {MOST_EMITTERS}: lower flashes_per_minute, or take fewer storms"
        )
    parts = [_flashes_of(config, storms, number, context) for number in range(len(storms))]
    columns = {
        name: np.concatenate([part[name] for part in parts]) if parts else np.empty(0)
        for name in _COLUMNS
    }
    return _sources(Emitters(columns), context)


#: What the truth says of a flash.
_COLUMNS = (
    "lat_deg",
    "lon_deg",
    "height_m",
    "start_s",
    "end_s",
    "storm",
    "strokes",
    "energy_j",
    "temperature_k",
)


def _flashes_of(
    config: StormConfig, storms: Emitters, number: int, context: SourceContext
) -> Mapping[str, FloatArray]:
    """Return the columns of the flashes of one storm."""
    storm = {name: float(column[number]) for name, column in storms.columns.items()}
    draw = _Draws(context, number)
    start_s = _starts_s(config, storm, draw)
    count = len(start_s)
    strokes = _strokes(config, draw, count)
    place = _places(storm, draw, count)
    rise_m = (storm["top_m"] - storm["bottom_m"]) * draw.even("height", count)
    scale = np.exp(config.energy_log_sigma * draw.normal("energy", count))
    return {
        "lat_deg": np.degrees(place.latitude_rad),
        "lon_deg": np.degrees(place.longitude_rad),
        "height_m": storm["bottom_m"] + rise_m,
        "start_s": start_s,
        "end_s": start_s + config.glow_s + _stroke_spans_s(config, draw, strokes),
        "storm": np.full(count, float(number + 1)),
        "strokes": strokes,
        "energy_j": storm["energy_j"] * scale * strokes,
        "temperature_k": np.full(count, storm["temperature_k"]),
    }


def _places(storm: Mapping[str, float], draw: "_Draws", count: int) -> LatitudeLongitude:
    """Return places (count,) even over the disc of a storm."""
    distance_m = storm["radius_m"] * np.sqrt(draw.even("distance", count))
    bearing = 2.0 * np.pi * draw.even("bearing", count)
    latitude, longitude = np.radians([storm["lat_deg"], storm["lon_deg"]])
    return geodesic_direct(latitude, longitude, bearing, distance_m)


@frozen
class _Draws:
    """The random numbers of one storm of a block."""

    context: SourceContext
    storm: int

    def even(self, purpose: str, count: int) -> FloatArray:
        """Return numbers (count,) even in [0, 1)."""
        return uniforms(self.context, f"{purpose} {self.storm}", count)

    def normal(self, purpose: str, count: int) -> FloatArray:
        """Return standard normal numbers (count,)."""
        return normals(self.context, f"{purpose} {self.storm}", count)


def _starts_s(config: StormConfig, storm: Mapping[str, float], draw: _Draws) -> FloatArray:
    """Return the times (n,) at which flashes of a storm begin."""
    mean_s = 60.0 / storm["flashes_per_minute"]
    sigma = config.interval_log_sigma
    median_s = mean_s * math.exp(-0.5 * sigma * sigma)
    first_s = storm["start_s"] - _EARLIER_INTERVALS * mean_s
    count = 64
    while True:
        intervals_s = median_s * np.exp(sigma * draw.normal("interval", count))
        times_s = first_s + np.cumsum(intervals_s)
        if times_s[-1] > storm["end_s"]:
            return times_s[(times_s >= storm["start_s"]) & (times_s < storm["end_s"])]
        count *= 2


def _strokes(config: StormConfig, draw: _Draws, count: int) -> FloatArray:
    """Return the numbers of strokes (count,), geometric from 1 on."""
    if config.strokes == 1.0:
        return np.ones(count)
    more = math.log1p(-1.0 / config.strokes)
    return 1.0 + np.floor(np.log1p(-draw.even("strokes", count)) / more)


def _stroke_spans_s(config: StormConfig, draw: _Draws, strokes: FloatArray) -> FloatArray:
    """Return the times (n,) from the first to the last stroke of flashes, s.

    Flashes of several strokes have as many intervals as all have strokes, on average: the mean
    interval is the mean duration over that number.
    """
    following = strokes.astype(np.int64) - 1
    flash = np.repeat(np.arange(len(strokes)), following)
    mean_s = config.duration_s / config.strokes
    sigma = math.sqrt(2.0 * math.log(mean_s / config.stroke_interval_s))
    normal = draw.normal("stroke", len(flash))
    intervals_s = config.stroke_interval_s * np.exp(sigma * normal)
    spans_s = np.zeros(len(strokes))
    np.add.at(spans_s, flash, intervals_s)
    return spans_s


def _sources(flashes: Emitters, context: SourceContext) -> Sources:
    truth = truth_of("lightning", flashes, context.id)
    position_m = starts_m(flashes)
    trajectories = FlashTrajectories(
        type_code=np.full(len(flashes), EMITTER_TYPES.index("other"), dtype=np.uint8),
        ignition_s=flashes["start_s"],
        burnout_s=flashes["end_s"],
        start_ecef_m=position_m,
        velocity_ecef_m_s=np.zeros_like(position_m),
        emitters_truth=truth,
    )
    signatures = GreySignatures(_intensities_w_sr(flashes, context))
    return EmitterSources(tuple(str(row["id"]) for row in truth), trajectories, signatures)


def _intensities_w_sr(flashes: Emitters, context: SourceContext) -> FloatArray:
    """Return intensities (bands, n) of flashes whose energy is that in the measured band."""
    measured = band_radiance(flashes["temperature_k"], *_MEASURED_UM)
    shining_s = flashes["end_s"] - flashes["start_s"]
    power_w_sr = flashes["energy_j"] / (4.0 * np.pi * shining_s)
    light = [
        power_w_sr
        * band_radiance(flashes["temperature_k"], band.lower_um, band.upper_um)
        / measured
        for band in context.bands
    ]
    return by_band(light, len(flashes))
