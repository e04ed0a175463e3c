"""The columns that radiometry works on: paths from targets to sensors, and views of what lies behind them.

Columns of the shipped LOWTRAN7 tables: the rows of one sky, found without taking the others apart.
"""

from pathlib import Path
from typing import Self

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.columns import Columns


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


def sky_columns(table: Path, climate: str, aerosol: str) -> dict[str, list[str]]:
    """Return the cells of a climate and aerosol by the name of their column; of a sky that is not there, nothing.

    The rows of one sky stand together, below a line of names.
    """
    text, beginning = table.read_text(encoding="utf-8"), f"\n{climate},{aerosol},"
    first, last = text.find(beginning), text.rfind(beginning)
    if first < 0:
        return {}
    head = text.find("\natmosphere,aerosol,") + 1
    names = text[head : text.find("\n", head)].split(",")
    cells = text[first + 1 : text.find("\n", last + 1)].replace("\n", ",").split(",")
    return {name: cells[place :: len(names)] for place, name in enumerate(names)}
