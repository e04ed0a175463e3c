"""Columns of signatures that are no radiant intensities end the run with their row."""

import numpy as np
import pytest
from opir_photons.detection.radiometric_columns import checked_intensities

from opir_core.errors import ModelError
from opir_core.plugin import Signatures


@pytest.mark.parametrize("wrong", [-1.0, np.nan, np.inf])
def test_an_impossible_intensity_is_refused_with_its_row(wrong: float) -> None:
    intensity = np.ones((2, 5))
    assert checked_intensities(intensity, 2, 5) is intensity
    intensity[1, 3] = wrong
    with pytest.raises(
        ModelError,
        match=r"intensity_w_sr returned (-1|nan|inf) in row 3; \[0, inf\) W/sr is required",
    ):
        checked_intensities(intensity, 2, 5)


def test_bands_of_different_lengths_are_refused_as_they_are() -> None:
    class Ragged(Signatures):
        def intensity_w_sr(
            self, band: int, target: np.ndarray, *_columns: np.ndarray
        ) -> np.ndarray:
            return np.ones(len(target) - band)

    columns = (np.zeros(3, dtype=np.int32), np.zeros(3), np.zeros(3), np.zeros(3))
    with pytest.raises(
        ModelError, match=r"intensity_w_sr returned object .* floats of shape \(2, 3\) are required"
    ):
        checked_intensities(Ragged().intensities_w_sr((0, 1), *columns), 2, 3)


def test_no_rows_are_no_fault() -> None:
    assert checked_intensities(np.empty((2, 0)), 2, 0).size == 0
