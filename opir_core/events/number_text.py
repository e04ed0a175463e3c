"""Columns of numbers as JSON text, in bulk."""

import msgspec
import numpy as np

from opir_core.arrays import FloatArray

#: Digits behind the point: angles to 1e-9 deg (0.1 mm on the ground), lengths to the millimetre, ratios to 1e-6.
DEGREE_DECIMALS = 9
METRE_DECIMALS = 3
RATIO_DECIMALS = 6

#: Digits of irradiances, whose sizes lie many powers of ten apart.
IRRADIANCE_DIGITS = 6

#: Between these sizes numbers are rounded to significant digits.
_LEAST, _MOST = 1e-290, 1e290

# Beyond it doubles have no half-units left to round.
_ALL_WHOLE = 2.0**52

_encode = msgspec.json.Encoder().encode


def rounded(values: FloatArray, decimals: int) -> FloatArray:
    """Return values rounded to decimals, element by element; never -0, nan and inf as they are."""
    scale = 10.0**decimals
    has_decimals = np.abs(values) < _ALL_WHOLE / scale
    return np.where(has_decimals, np.rint(np.where(has_decimals, values, 0.0) * scale) / scale, values) + 0.0


def significant(values: FloatArray, digits: int) -> FloatArray:
    """Return values rounded to so many significant digits, element by element; never -0, nan and inf as they are.

    Below 1e-290 they are 0, and beyond 1e290 left as they are: there powers of ten leave the doubles.
    """
    size = np.abs(values)
    lawful = (size >= _LEAST) & (size <= _MOST)
    known = np.where(lawful, values, 1.0)
    places = digits - 1 - np.floor(np.log10(np.abs(known)))
    # Powers of ten up to the 22nd are doubles themselves: texts have no more than the digits then.
    up, down = 10.0 ** np.maximum(places, 0.0), 10.0 ** np.maximum(-places, 0.0)
    nearest = np.rint(known * up / down) * down / up
    return np.where(lawful, nearest, np.where(size < _LEAST, 0.0, values)) + 0.0


def rounded_number(value: float, decimals: int) -> float:
    """Return one number rounded as `rounded` does."""
    return float(rounded(np.array([value]), decimals)[0])


def rounded_degrees(angle_rad: FloatArray) -> FloatArray:
    """Return angles, rad, in degrees, rounded."""
    return rounded(np.degrees(angle_rad), DEGREE_DECIMALS)


def rounded_bearing_deg(angle_rad: FloatArray, turn_deg: float = 360.0) -> FloatArray:
    """Return angles, rad, as degrees in [0, turn), rounded."""
    bearing = np.degrees(angle_rad)
    if not np.all((bearing >= 0.0) & (bearing < turn_deg)):  # The remainder leaves such as they are, but takes time.
        bearing = np.mod(bearing, turn_deg)
    bearing = rounded(bearing, DEGREE_DECIMALS)
    return np.where(bearing == turn_deg, 0.0, bearing)


def rounded_longitude_deg(longitude_rad: FloatArray) -> FloatArray:
    """Return longitudes, rad, as degrees in [-180, 180), rounded."""
    east = rounded_bearing_deg(longitude_rad)
    return np.where(east >= 180.0, rounded(east - 360.0, DEGREE_DECIMALS), east)


def number_texts(values: FloatArray) -> list[bytes]:
    """Return numbers (n,) as JSON: the shortest text that reads back as the same double; nan and inf are `null`."""
    return _encode(values.tolist())[1:-1].split(b",") if len(values) else []


def vector_texts(vectors: FloatArray) -> list[bytes]:
    """Return the components of vectors (n, m) as `number_texts`, joined by commas."""
    return _encode(vectors.tolist())[2:-2].split(b"],[") if len(vectors) else []
