"""Clouds: thin opaque decks at one height, everywhere or over a random part of the Earth."""

from typing import Protocol

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import components, ecef_to_geodetic, length
from opir_core.plugin import Paths
from opir_core.random_streams import Stream, stream_key, uniforms_of


class Deck(Protocol):
    """Where there is cloud; the height of its top is the same everywhere."""

    @property
    def top_m(self) -> float:
        """Height of the top above the WGS 84 ellipsoid, m."""

    def is_cloudy(self, point_ecef_m: FloatArray) -> BoolArray:
        """Return whether points (n, 3) stand over, under or in cloud."""


@frozen
class FullDeck:
    """Cloud everywhere."""

    top_m: float

    def is_cloudy(self, point_ecef_m: FloatArray) -> BoolArray:
        """True for all points (n, 3)."""
        return np.ones(len(point_ecef_m), dtype=np.bool_)


@frozen(eq=False)
class CloudField:
    """Cloud over a random part of the Earth, the same at all times.

    The Earth is cut into rows of equal latitude, and each of these into cells about as wide as
    high; `row_start` (rows + 1) counts the cells before each row, `cloudy` (cells,) says which are
    covered.
    """

    top_m: float
    row_start: IntArray
    cloudy: BoolArray

    @classmethod
    def drawn(cls, top_m: float, cover: float, cell_m: float, seed: int) -> "CloudField":
        """Return a field of which each cell is covered with probability `cover`, by the stream
        "clouds" of a seed.
        """
        rows = max(1, round(np.pi * 6_371_000.0 / cell_m))
        middle = (np.arange(rows) + 0.5) / rows * np.pi - 0.5 * np.pi
        columns = np.maximum(1, np.rint(2.0 * rows * np.cos(middle))).astype(np.int64)
        row_start = np.concatenate([np.zeros(1, dtype=np.int64), np.cumsum(columns)])
        numbers = uniforms_of(Stream(stream_key(seed, "clouds")).words(0, int(row_start[-1])))
        return cls(top_m, row_start, numbers < cover)

    def is_cloudy(self, point_ecef_m: FloatArray) -> BoolArray:
        """Return whether points (n, 3) are in the column of a covered cell."""
        where = ecef_to_geodetic(point_ecef_m)
        rows = len(self.row_start) - 1
        row = np.clip((where.latitude_rad / np.pi + 0.5) * rows, 0, rows - 1).astype(np.int64)
        columns = self.row_start[row + 1] - self.row_start[row]
        turn = where.longitude_rad / (2.0 * np.pi)
        column = np.minimum(((turn - np.floor(turn)) * columns).astype(np.int64), columns - 1)
        return self.cloudy[self.row_start[row] + column]


def is_hidden(deck: Deck, path: Paths) -> BoolArray:
    """Return whether paths (n,) from targets to sensors pass through cloud.

    A path from below the deck's top goes through it once, one from above that first descends below
    it twice; the places, on a sphere through the top, are looked up in the deck.
    """
    hidden = np.zeros(len(path), dtype=np.bool_)
    offset = path.sensor_ecef_m - path.target_ecef_m
    direction = offset / length(*components(offset))[:, None]
    for distance in _crossings_m(deck.top_m, path):
        rows = np.flatnonzero(distance > 0.0)
        crossing = path.target_ecef_m[rows] + distance[rows, None] * direction[rows]
        hidden[rows] |= deck.is_cloudy(crossing)
    return hidden


def _crossings_m(top_m: float, path: Paths) -> tuple[FloatArray, FloatArray]:
    """Return the distances (n,) from targets at which lines of sight cross a height; nan if they do
    not.
    """
    radius = length(*components(path.target_ecef_m))
    # On the sphere through the target whose centre is the Earth's, and one about it through the
    # deck.
    along = radius * path.elevation_sine
    reach = np.square(along) + (top_m - path.height_m) * (2.0 * radius + top_m - path.height_m)
    root = np.sqrt(np.where(reach >= 0.0, reach, np.nan))
    return -along - root, -along + root
