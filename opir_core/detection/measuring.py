"""What detections measure, filled in kind of sensor by kind of sensor."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IntArray
from opir_core.detection.receivers import Rule
from opir_core.protocols import Measured


@frozen(eq=False)
class MeasuredColumns:
    """Measurements that are filled in kind by kind; nan beyond a sensor's bands."""

    bands: NDArray[np.uint8]
    snr: FloatArray
    sigma_rad: FloatArray
    irradiance_w_m2: FloatArray

    @classmethod
    def of(cls, rows: int, width: int) -> "MeasuredColumns":
        """Return columns of so many rows, still to be filled."""
        return cls(np.empty(rows, np.uint8), np.empty(rows), np.empty(rows), np.empty((rows, width)))

    def measured(self, noise_w_m2: FloatArray) -> Measured:
        """Return what was filled in, with the noise (n, B) it was measured in."""
        return Measured(self.bands, self.snr, self.sigma_rad, self.irradiance_w_m2, noise_w_m2)

    def put(
        self,
        rows: slice | IntArray,
        measured: FloatArray,
        noise: FloatArray,
        rule: Rule,
        floor_and_footprint_rad: tuple[float, float],
    ) -> None:
        """Fill in what one kind measured, in standard deviations (n, B) of the noise (n, B), in some of the rows."""
        width, best = measured.shape[1], measured[:, 0].copy()
        for band in range(1, width):
            np.maximum(best, measured[:, band], out=best)
        self.bands[rows], self.snr[rows] = rule.confirming(measured), best
        floor_rad, footprint_rad = floor_and_footprint_rad
        spread = footprint_rad / best
        spread *= spread
        spread += floor_rad * floor_rad
        self.sigma_rad[rows] = np.sqrt(spread, out=spread)
        for band in range(width):
            self.irradiance_w_m2[rows, band] = measured[:, band] * noise[:, band]
        self.irradiance_w_m2[rows, width:] = np.nan
