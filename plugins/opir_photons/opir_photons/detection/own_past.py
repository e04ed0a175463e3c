"""What the frame difference of a focal plane subtracts of a target: its own light, one lag earlier.

A target that has hardly moved since the earlier frame is subtracted from itself. What is left of
its signal E(t) is E(t) - E(t - lag) g(d) / g(0), with the response g of the spatial filter to a
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

#: Scene time, s, by which a source that is no launch has begun to shine if it has shone for longer
#: than any lag.
_STEADY_S = -5.0

#: Irradiances (B, m) of looks.
IrradianceOf = Callable[[Exposures], FloatArray]


def subtract_own_past(
    signal_w_m2: FloatArray,
    looks: Exposures,
    plane: FocalPlaneTerms,
    environment: RadiometricEnvironment,
    irradiance_of: IrradianceOf,
) -> None:
    """Subtract from signals (B, n), in place, what a plane's frame difference does; none becomes
    negative.
    """
    if plane.frames is None or not len(looks):
        return
    rows, earlier, moved_rad = _near(looks, plane, environment)
    if not len(rows):
        return
    past = irradiance_of(earlier)
    for band, table in enumerate(plane.own_past):
        share = table.at(moved_rad / plane.pixel_rad)
        left = signal_w_m2[band, rows] - share * past[band]
        signal_w_m2[band, rows] = np.maximum(left, 0.0)


def _near(
    looks: Exposures, plane: FocalPlaneTerms, environment: RadiometricEnvironment
) -> tuple[IntArray, Exposures, FloatArray]:
    """Return the looks at targets that shone near by a lag earlier: rows, those targets then,
    angles moved, rad.
    """
    assert plane.frames is not None
    targets = environment.targets
    past_s = looks.emission_time_s - plane.frames.lag_s
    ignition_s = targets.ignition_s[looks.target]
    has_shone = (targets.type_code[looks.target] >= len(TARGET_TYPES)) & (ignition_s <= _STEADY_S)
    rows = np.flatnonzero((past_s > ignition_s) | has_shone)
    past_s = np.maximum(past_s, ignition_s)
    earlier = looks.take(rows)
    place_m = targets.position_ecef_m(earlier.target, past_s[rows])
    way_m = components(place_m - earlier.sensor_ecef_m)
    range_m = length(*way_m)
    now_m = components(earlier.target_ecef_m - earlier.sensor_ecef_m)
    # The chord of two unit vectors: pixels are small angles.
    moved_rad = length(
        *(then / range_m - now / earlier.range_m for then, now in zip(way_m, now_m, strict=True))
    )
    near = np.flatnonzero(moved_rad < plane.own_past[0].reach * plane.pixel_rad)
    there = evolve(
        earlier.take(near),
        emission_time_s=past_s[rows[near]],
        target_ecef_m=place_m[near],
        range_m=range_m[near],
    )
    return rows[near], there, moved_rad[near]
