"""Nozzles that do not glow: their light is held against a script of its own elsewhere."""

import numpy as np
from opir_photons.radiometry.heating import HeatedBodies


def silence_nozzles(monkeypatch):
    """Have nozzles be cold from burnout on."""

    def dark(_bodies, bands, rows, _since_s):
        return np.zeros((len(bands), len(rows)))

    monkeypatch.setattr(HeatedBodies, "nozzle_w_sr", dark)
