"""Clips of frames as FITS."""

import numpy as np
from astropy.io import fits

from opir_core.cli.main import main


def test_a_clip_has_frames_masks_and_truth(tmp_path):
    words = [
        "--sensor",
        "SBIRS-GEO",
        "--band",
        "MWIR",
        "--pixels",
        "32",
        "--movie",
        "4",
        "--every",
        "0.5",
    ]
    assert main(["physics", "frame", *words, "-o", str(tmp_path)]) == 0
    with fits.open(tmp_path / "clips" / "clip000.fits") as file:
        assert file[0].data.shape == file["MASK"].data.shape == (4, 32, 32)
        assert (file[0].header["FILTER"], file[0].header["BUNIT"]) == ("MWIR", "electron")
        truth = file["TRUTH"].data
        assert truth["time_s"].tolist() == [0.0, 0.5, 1.0, 1.5]
        for mask, row, column in zip(file["MASK"].data, truth["row"], truth["column"], strict=True):
            assert mask[round(row), round(column)] == 1
        assert np.all(truth["snr"] > 0.0)
