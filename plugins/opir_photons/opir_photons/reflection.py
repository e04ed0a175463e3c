"""Sunlight that bodies reflect towards sensors, the times at which they enter and leave the Earth's
shadow, and those of other crossings in free flight.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.geometry import (
    ASTRONOMICAL_UNIT_M,
    Crossings,
    angle_between_rad,
    components,
    dot,
    length,
    local_axes,
    shadow_margins_rad,
    sun_ecef_m,
    sunlit_fraction,
    zero_crossings,
)
from opir_core.planning import Targets
from opir_core.plugin import Band, Exposures, Paths, Transmittance
from opir_photons.radiometry.sunlight import lambert_sphere_intensity, solar_irradiance


@frozen(eq=False)
class ReflectedSunlight:
    """The Sun's irradiance above the air, (bands,) W/m² at one astronomical unit, and the
    atmosphere on its way.
    """

    irradiance_w_m2: FloatArray
    atmosphere: Transmittance
    epoch_us: int

    @classmethod
    def of(
        cls, bands: Sequence[Band], atmosphere: Transmittance, epoch_us: int
    ) -> "ReflectedSunlight":
        """Return the sunlight of a scene in the bands of its sensors."""
        light = [float(solar_irradiance(band.lower_um, band.upper_um)) for band in bands]
        # Bands with swapped edges are empty.
        return cls(np.maximum(np.array(light), 0.0), atmosphere, epoch_us)

    def intensities_w_sr(
        self, bands: Sequence[int], exposures: Exposures, height_m: FloatArray, area_m2: FloatArray
    ) -> FloatArray:
        """Return radiant intensities (bands, n) of the targets of looks at the source; `area_m2`
        (n,) reflects.

        Bodies are diffuse spheres in the sunlight that the Earth and its air leave.
        """
        target_m = exposures.target_ecef_m
        time_s = exposures.emission_time_s
        sun_m = sun_ecef_m(time_s, self.epoch_us)
        lit = sunlit_fraction(target_m, sun_m)
        intensity = np.zeros((len(bands), len(exposures)))
        rows = np.flatnonzero((area_m2 > 0.0) & (lit > 0.0))
        if not len(rows):
            return intensity
        target_m = target_m[rows]
        to_sun = sun_m[rows] - target_m
        distance_m = length(*components(to_sun))
        sine = np.clip(dot(local_axes(target_m)[:, 2], to_sun) / distance_m, -1.0, 1.0)
        path = Paths(height_m[rows], sine, target_m, sun_m[rows], time_s[rows])
        air = self.atmosphere.transmittances(bands, path)
        phase = angle_between_rad(to_sun, exposures.sensor_ecef_m[rows] - target_m)
        area = area_m2[rows] * lit[rows] * np.square(ASTRONOMICAL_UNIT_M / distance_m)
        light = self.irradiance_w_m2[list(bands)][:, None] * air
        intensity[:, rows] = lambert_sphere_intensity(light, area, phase)
        return intensity


def shadow_times_s(targets: Targets, epoch_us: int) -> FloatArray:
    """Return the scene times (targets, k) at which bodies enter or leave penumbra or umbra after
    burnout; or nan.
    """

    def margin(edge: int, target: IndexArray, time_s: FloatArray) -> FloatArray:
        position_m = targets.position_ecef_m(target, time_s)
        return shadow_margins_rad(position_m, sun_ecef_m(time_s, epoch_us))[edge]

    return coasting_crossings_s(targets, [partial(margin, edge) for edge in (0, 1)])


def coasting_crossings_s(
    targets: Targets, margins: Sequence[Callable[[IndexArray, FloatArray], FloatArray]]
) -> FloatArray:
    """Return the scene times (targets, k) after burnout at which margins of targets (n,) at times
    (n,) cross 0; or nan. Margins cross it at most once in half a minute.
    """
    flying = np.flatnonzero(targets.end_s > targets.burnout_s).astype(np.int32)
    start_s = targets.burnout_s[flying]
    stop_s = targets.end_s[flying]

    def held(
        margin: Callable[[IndexArray, FloatArray], FloatArray], row: IntArray, time_s: FloatArray
    ) -> FloatArray:
        # Rounding must not lead out of the flight.
        return margin(flying[row], np.clip(time_s, start_s[row], stop_s[row]))

    crossings = [
        zero_crossings(partial(held, margin), start_s, stop_s, step_s=30.0) for margin in margins
    ]
    columns = [_by_row(edge_crossings, len(flying)) for edge_crossings in crossings]
    times_s = np.full((len(targets.ids), sum(column.shape[1] for column in columns)), np.nan)
    times_s[flying] = np.concatenate(columns, axis=1)
    return times_s


def _by_row(crossings: Crossings, rows: int) -> FloatArray:
    """Return the times of crossings as one row (k,) each, filled with nan."""
    count = np.bincount(crossings.row, minlength=rows)
    place = np.arange(len(crossings.row)) - np.repeat(np.cumsum(count) - count, count)
    times_s = np.full((rows, int(count.max(initial=0))), np.nan)
    times_s[crossings.row, place] = crossings.time_s
    return times_s
