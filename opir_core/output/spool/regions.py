"""Columns of impact regions as JSON in an array of bytes, and back: the archives of a spool hold no
objects.

A tuple of regions that several rows share is stored once.
"""

from collections.abc import Mapping
from math import nan
from typing import Any

import msgspec
import numpy as np
from attrs import fields
from numpy.typing import NDArray

from opir_core.arrays import ObjectArray
from opir_core.interfaces.impact_regions import ImpactRegion

#: The arrays of a packed column: the tuple (n,) of each row, and the JSON of all tuples.
REGION_PARTS = ("of_row", "tuples")

_FIELDS = tuple(attribute.name for attribute in fields(ImpactRegion))
_encode = msgspec.json.Encoder(enc_hook=lambda array: array.tolist()).encode


def packed_regions(column: ObjectArray) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of a column (n,) of tuples of regions."""
    rows = column.tolist()
    tuples = {id(row): row for row in rows}
    documents = [
        [{name: getattr(region, name) for name in _FIELDS} for region in row]
        for row in tuples.values()
    ]
    place = {key: number for number, key in enumerate(tuples)}
    return {
        "of_row": np.array([place[id(row)] for row in rows], dtype=np.int64),
        "tuples": np.frombuffer(_encode(documents), dtype=np.uint8),
    }


def unpacked_regions(arrays: Mapping[str, NDArray[Any]]) -> ObjectArray:
    """Return the column (n,) of packed arrays."""
    documents = msgspec.json.decode(arrays["tuples"].tobytes())
    tuples = [tuple(_region(**region) for region in regions) for regions in documents]
    column = np.empty(len(arrays["of_row"]), dtype=np.object_)
    for row, number in enumerate(arrays["of_row"].tolist()):
        column[row] = tuples[number]
    return column


def _region(
    polygons: Any, centre: Any, effective_samples: float | None, **figures: Any
) -> ImpactRegion:
    return ImpactRegion(
        polygons=tuple(
            tuple(np.array(ring, dtype=np.float64).reshape(-1, 2) for ring in polygon)
            for polygon in polygons
        ),
        centre=centre and tuple(centre),
        effective_samples=nan if effective_samples is None else effective_samples,
        **figures,
    )
