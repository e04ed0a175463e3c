"""What hot water and carbon dioxide radiate from 5 to 14 µm in exhaust that mixes with the air.

Source: `opir_photons/data/plume_long_waves.csv`, jets of exhaust in still air with the narrow-band
data of NASA SP-3080, by propellant, jet power and height; `docs/design/plume_jets.py` made it. The
light is that of the brightest 2 km behind a vehicle of usual speed, broadside.

Bands of `opir_core/data/plumes.json` have the levels of the class alone, LWIR too: the ratios of
these three belong together, and the jets' own SWIR is ten times the notional one.
"""

import math
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.plugin import Band
from opir_core.scene import plume_table
from opir_photons.laws import DATA

#: Where the table begins and ends, µm.
SHORTEST_UM = 5.0
LONGEST_UM = 14.0


@frozen(eq=False)
class JetSpectra:
    """Spectral intensities (powers, heights, columns), W/sr/µm, of jets of one propellant.

    `edges_um` has one more than the columns, between which a spectrum is constant.
    """

    edges_um: FloatArray
    log_power: FloatArray
    height_km: FloatArray
    log_intensity: FloatArray

    def intensities_w_sr(self, power_w: float, band: Band) -> FloatArray:
        """Return the intensities (heights,) in a band, W/sr, of a jet power.

        Between the table's powers ln I is linear in ln P; beyond them I is proportional to P.
        """
        if power_w <= 0.0:
            return np.zeros(len(self.height_km))
        log_power = math.log(power_w)
        place = float(np.interp(log_power, self.log_power, np.arange(len(self.log_power))))
        lower = min(int(place), len(self.log_power) - 2)
        share = place - lower
        first, second = self.log_intensity[lower : lower + 2]
        beyond = log_power - float(np.clip(log_power, self.log_power[0], self.log_power[-1]))
        spectra = np.exp((1.0 - share) * first + share * second + beyond)
        return np.asarray(np.sum(spectra * self._widths_um(band), axis=1))

    def _widths_um(self, band: Band) -> FloatArray:
        upper = np.minimum(self.edges_um[1:], band.upper_um)
        return np.maximum(upper - np.maximum(self.edges_um[:-1], band.lower_um), 0.0)


@cache
def jet_spectra() -> Mapping[str, JetSpectra]:
    """Return the table by propellant."""
    text = (DATA / "plume_long_waves.csv").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    edges_um = np.array([*map(float, lines[0].split(",")[3:]), LONGEST_UM])
    rows = [line.split(",") for line in lines[1:]]
    return MappingProxyType(
        {
            name: _spectra(edges_um, np.array([row[1:] for row in rows if row[0] == name], float))
            for name in dict.fromkeys(row[0] for row in rows)
        }
    )


def _spectra(edges_um: FloatArray, table: FloatArray) -> JetSpectra:
    power_gw = np.unique(table[:, 0])
    height_km = np.unique(table[:, 1])
    log_intensity = np.log(table[:, 2:]).reshape(len(power_gw), len(height_km), -1)
    return JetSpectra(edges_um, np.log(power_gw * 1e9), height_km, log_intensity)


def has_long_waves(band: Band) -> bool:
    """Return whether jets shine in a band: it overlaps the table, and no class fixes its level."""
    is_fixed = [band.lower_um, band.upper_um] in list(plume_table()["bands_um"].values())
    return not is_fixed and band.lower_um < LONGEST_UM and band.upper_um > SHORTEST_UM


@frozen(eq=False)
class LongWaves:
    """Intensities `level_w_sr` of kinds of plumes at altitudes, a pair of (k,) and (bands, k) a kind;
    of each target (n,) its kind.

    Linear in altitude between, constant beyond.
    """

    kind: IntArray
    level_w_sr: tuple[tuple[FloatArray, FloatArray], ...]

    def w_sr(self, band: int, target: IndexArray, altitude_m: FloatArray) -> FloatArray:
        """Return intensities (n,) of targets at altitudes, broadside, W/sr."""
        intensity = np.empty(len(target))
        kind = self.kind[target]
        for number, (points_m, levels) in enumerate(self.level_w_sr):
            rows = slice(None) if len(self.level_w_sr) == 1 else np.flatnonzero(kind == number)
            intensity[rows] = np.interp(altitude_m[rows], points_m, levels[band])
        return intensity

    def is_dark(self, band: int) -> bool:
        """Return whether no kind shines in a band."""
        return not any(levels[band].any() for _, levels in self.level_w_sr)
