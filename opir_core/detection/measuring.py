"""What detections measure, filled in sensor by sensor."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.detection.receivers import Rule
from opir_core.protocols import Measured
from opir_core.records import FloatArray, IntArray


@frozen(eq=False)
class MeasuredColumns:
    """Measurements that are filled in sensor by sensor; nan beyond a sensor's bands."""

    bands: NDArray[np.uint8]
    snr: FloatArray
    sigma_rad: FloatArray
    irradiance_w_m2: FloatArray
    noise_w_m2: FloatArray

    @classmethod
    def of(cls, rows: int, width: int) -> "MeasuredColumns":
        """Return columns of so many rows, still to be filled."""
        beyond = np.full((rows, width), np.nan)
        return cls(np.empty(rows, np.uint8), np.empty(rows), np.empty(rows), beyond, beyond.copy())

    def measured(self) -> Measured:
        """Return what was filled in."""
        return Measured(self.bands, self.snr, self.sigma_rad, self.irradiance_w_m2, self.noise_w_m2)

    def put(
        self,
        rows: slice | IntArray,
        measured: FloatArray,
        noise: FloatArray,
        rule: Rule,
        floor_and_footprint_rad: tuple[float, float],
    ) -> None:
        """Fill in what one sensor measured, in standard deviations (n, B) of the noise (n, B), in some of the rows."""
        confirms = rule.confirms(measured)
        bands, best = confirms[:, 0].astype(np.uint8), measured[:, 0].copy()
        for band in range(1, measured.shape[1]):
            bands |= confirms[:, band].view(np.uint8) << np.uint8(band)
            np.maximum(best, measured[:, band], out=best)
        self.bands[rows], self.snr[rows] = bands, best
        floor_rad, footprint_rad = floor_and_footprint_rad
        spread = footprint_rad / best
        self.sigma_rad[rows] = np.sqrt(floor_rad * floor_rad + spread * spread)
        self.irradiance_w_m2[rows, : measured.shape[1]] = measured * noise
        self.noise_w_m2[rows, : measured.shape[1]] = noise
