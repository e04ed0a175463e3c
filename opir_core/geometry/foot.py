"""The foot of the perpendicular from a point to an ellipse."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.vectors import Floats


def normal_and_height(rho: Floats, z: Floats, a: ArrayLike, b: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Return sine and cosine of the normal's latitude at the foot, and the signed height above the ellipse."""
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    focus_squared = (a - b) * (a + b)
    evolute_rho, evolute_z = focus_squared / a, focus_squared / b
    r = np.sqrt(rho * rho + z * z)
    sine, cosine = b * z * (r + evolute_z), a * rho * r
    for _ in range(2):
        norm = np.sqrt(sine * sine + cosine * cosine)
        sine, cosine = sine / norm, cosine / norm
        up, out = z + evolute_z * sine * sine * sine, rho - evolute_rho * cosine * cosine * cosine
        sine, cosine = b * up, a * out
    norm = np.sqrt(up * up + out * out)
    sine, cosine = up / norm, out / norm
    axial, radial = b * sine, a * cosine
    height = rho * cosine + z * sine - np.sqrt(axial * axial + radial * radial)
    return sine, cosine, height
