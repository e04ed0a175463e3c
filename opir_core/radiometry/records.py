"""The columns that radiometry works on: paths from targets to sensors, and views of what lies behind them."""

from typing import Self

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.columns import Columns


@frozen(eq=False)
class Paths(Columns):
    """Paths of light from targets to sensors, one row each; the arguments of `Transmittance.transmittance`.

    `height_m` is the target's height above the WGS 84 ellipsoid; `elevation_sine` that of the sensor above the target's
    horizon; `target_ecef_m` and `sensor_ecef_m` are positions (n, 3), m; `time_s` is scene time.
    """

    height_m: FloatArray
    elevation_sine: FloatArray
    target_ecef_m: FloatArray
    sensor_ecef_m: FloatArray
    time_s: FloatArray

    @classmethod
    def empty(cls) -> Self:
        """Return the record of no paths."""
        none, nowhere = np.empty(0), np.empty((0, 3))
        return cls(none, none, nowhere, nowhere, none)


@frozen(eq=False)
class Views(Columns):
    """What lines of sight end on, one row each; the arguments of `Background.radiance_w_m2_sr`.

    `point_ecef_m` (n, 3) is where the line of sight meets the WGS 84 ellipsoid or, where it misses it, the point of the
    line that comes nearest to it. `height_m` is that point's height: 0 on the Earth, the tangent height beyond the limb
    (inf where the line only leads away from the Earth). `elevation_sine` is of the sensor above the point's horizon, 0
    beyond the limb; `sun_elevation_sine` of the Sun above it; `time_s` is scene time.
    """

    height_m: FloatArray
    elevation_sine: FloatArray
    sun_elevation_sine: FloatArray
    point_ecef_m: FloatArray
    time_s: FloatArray

    @classmethod
    def empty(cls) -> Self:
        """Return the record of no views."""
        none = np.empty(0)
        return cls(none, none, none, np.empty((0, 3)), none)


def in_a_row(rows: IntArray) -> "slice | IntArray":
    """Return rising rows as a slice where they follow one another, so that taking them copies nothing."""
    is_run = len(rows) > 0 and int(rows[-1] - rows[0]) == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if is_run else rows
