"""The most probable type of each track."""

import numpy as np

from opir_core.plugin import REPORTED_TYPES, Tracks
from opir_core.scene import UNKNOWN_TYPE

#: The type of a track of which no type is known.
UNKNOWN = REPORTED_TYPES[UNKNOWN_TYPE]


def reported_types(tracks: Tracks) -> tuple[list[str], list[float]]:
    """Return the most probable types of tracks (n,) and their probabilities, 0 if not known."""
    shares = np.nan_to_num(tracks.type_probability)
    codes = np.where(shares.any(axis=1), shares.argmax(axis=1), UNKNOWN_TYPE)
    return [REPORTED_TYPES[code] for code in codes.tolist()], shares.max(axis=1).tolist()
