"""The target's own light, one lag earlier, which the frame difference of a focal plane subtracts.

A target that has hardly moved since the earlier frame is subtracted from itself. Of its signal E(t)
there remains E(t) - E(t - lag) g(d) / g(0), with the response g of the spatial filter to a
spot that is displaced by d (`opir_photons.radiometry.FilteredSpot`). Frames are registered to the
ground: d is the angle between the directions to the target now and then, both from where the sensor
is now. Before ignition there is nothing to subtract; sources that have shone for some seconds when
the scene begins did so before.
"""

from collections.abc import Callable

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.geometry import components, length
from opir_core.plugin import TARGET_TYPES, Exposures
from opir_photons.detection.focal_planes import FocalPlaneTerms
from opir_photons.environment import RadiometricEnvironment

#: Irradiances (B, m) of looks.
IrradianceOf = Callable[[Exposures], FloatArray]


def subtract_own_past(
    signal_w_m2: FloatArray,
    looks: Exposures,
    plane: FocalPlaneTerms,
    environment: RadiometricEnvironment,
    irradiance_of: IrradianceOf,
) -> None:
    """Subtract from signals (B, n), in place, the light of a lag earlier; none becomes negative."""
    if plane.frames is None or not len(looks):
        return
    rows, earlier, moved_rad = _earlier_looks(looks, plane, environment)
    if not len(rows):
        return
    past = irradiance_of(earlier)
    for band, table in enumerate(plane.own_past):
        share = table.at(moved_rad / plane.pixel_rad)
        remaining = signal_w_m2[band, rows] - share * past[band]
        signal_w_m2[band, rows] = np.maximum(remaining, 0.0)


def _earlier_looks(
    looks: Exposures, plane: FocalPlaneTerms, environment: RadiometricEnvironment
) -> tuple[IntArray, Exposures, FloatArray]:
    """Return the looks at targets that shone near by a lag earlier: their rows, the looks then, and
    the angles that they have moved, rad.
    """
    assert plane.frames is not None
    targets = environment.targets
    past_s = looks.emission_time_s - plane.frames.lag_s
    ignition_s = targets.ignition_s[looks.target]
    # Sources that are no launches and shine 5 s before the scene do so for longer than any lag.
    has_shone = (targets.type_code[looks.target] >= len(TARGET_TYPES)) & (ignition_s <= -5.0)
    rows = np.flatnonzero((past_s > ignition_s) | has_shone)
    past_s = np.maximum(past_s, ignition_s)
    earlier = looks.take(rows)
    place_m = targets.position_ecef_m(earlier.target, past_s[rows])
    past_m = components(place_m - earlier.sensor_ecef_m)
    range_m = length(*past_m)
    present_m = components(earlier.target_ecef_m - earlier.sensor_ecef_m)
    # The chord of two unit vectors: pixels are small angles.
    moved_rad = length(
        *(
            past / range_m - present / earlier.range_m
            for past, present in zip(past_m, present_m, strict=True)
        )
    )
    within = np.flatnonzero(moved_rad < plane.own_past[0].reach * plane.pixel_rad)
    past_looks = evolve(
        earlier.take(within),
        emission_time_s=past_s[rows[within]],
        target_ecef_m=place_m[within],
        range_m=range_m[within],
    )
    return rows[within], past_looks, moved_rad[within]
