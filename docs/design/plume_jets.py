"""How `plume_long_waves.csv` of opir-photons was made: what hot water, carbon dioxide and carbon
monoxide radiate from 5 to 14 µm in exhaust that mixes with air.

    git clone https://github.com/firemodels/radcal
    python docs/design/plume_jets.py radcal/Source --write
    python docs/design/plume_jets.py radcal/Source --shares

It builds RADCAL (NIST; the narrow-band data of C. B. Ludwig et al., NASA SP-3080, 1973) with
gfortran. The exhaust is a round jet at the pressure of the air around it, uniform across. Three
balances hold along it, in the vehicle's frame: of mass, with the entrainment of F. P. Ricou and D.
B. Spalding (J. Fluid Mech. 11, 1961, 21), slowed by the convective Mach number as P. E. Dimotakis
has it (0.2 + 0.8 exp(-3 M²), 1991); of momentum; of energy, with chamber enthalpy, afterburning as
far as oxygen has been entrained, and what is radiated away. Afterburning ends between 40 and 60 km.
The vehicle's speed is that of usual ascents. A row of the table is the light of the brightest 2 km
within 10 km behind the vehicle, the pixel of a civil imager, broadside. Nothing of it was fitted to
a sighting.

Left out: nozzles beside each other, barrel shocks, dissociation, gas that is not in local
equilibrium (above 80 km), condensation. `--shares` prints what share of the jet power the same jets
would radiate in 2.5 to 3.0 µm: 0.1 to 40 %, 2 % in the median, ten times the notional level of the
classes; shorter waves are not taken from them.
"""

import argparse
import ctypes
import subprocess
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

TABLE = Path("plugins/opir_photons/opir_photons/data/plume_long_waves.csv")

HEIGHTS_KM = (0, 10, 20, 30, 40, 50, 60, 70, 80)
POWERS_GW = (0.1, 1.0, 10.0, 100.0)
EDGES_UM = np.round(np.arange(5.0, 14.01, 0.2), 1)

GAS_J_MOL_K = 8.314462
AIR_KG_MOL = 0.0289644
AIR_MOL_KG = {"N2": 27.3, "O2": 7.25}

#: Molar heats: their part without vibration, over the gas constant; temperatures of vibrations, K.
HEATS: dict[str, tuple[float, tuple[float, ...]]] = {
    "N2": (3.5, (3374.0,)),
    "O2": (3.5, (2256.0,)),
    "H2O": (4.0, (2294.0, 5261.0, 5403.0)),
    "CO2": (3.5, (960.0, 960.0, 1932.0, 3380.0)),
    "CO": (3.5, (3103.0,)),
    "H2": (3.5, (6100.0,)),
    "HCl": (3.5, (4227.0,)),
    # Droplets: 15 atoms' degrees of freedom, potential and kinetic; no volume.
    "Al2O3": (15.0, ()),
}

#: What burns with the air: its product, and its heat, J/mol.
BURNS = {"CO": ("CO2", 283e3), "H2": ("H2O", 242e3)}

#: Ratio of entrained to jet mass flow a diameter, 0.32, as entrainment velocity over excess speed.
ENTRAINMENT = 0.08

WINDOW_M, REACH_M = 2_000.0, 10_000.0


class Exhaust(NamedTuple):
    """A kilogram of exhaust: contents, mol; speed at sea level and in vacuum, m/s; chamber, K.

    Contents are balances of elements at usual mixture ratios, rounded: kerosene 2.45, methane 3.6,
    hydrogen 6, amines 2, with oxygen or nitrogen tetroxide; a third of the solid's is alumina.
    """

    mol: dict[str, float]
    sea_level_m_s: float
    vacuum_m_s: float
    chamber_k: float


EXHAUSTS = {
    "kerosene": Exhaust({"H2O": 15, "CO2": 8.7, "CO": 12, "H2": 5}, 2770, 3050, 3500),
    "methane": Exhaust({"H2O": 24.5, "CO2": 10.9, "CO": 2.7, "H2": 2.7}, 3200, 3430, 3550),
    "hydrogen": Exhaust({"H2O": 53.6, "H2": 17.3}, 3600, 4300, 3500),
    "storable": Exhaust({"H2O": 15, "CO2": 3.5, "CO": 4, "H2": 3, "N2": 15}, 2500, 2850, 3300),
    "solid": Exhaust(
        {"H2O": 4, "CO2": 0.7, "CO": 8.5, "H2": 10, "N2": 3, "HCl": 5.5, "Al2O3": 3.3},
        2400,
        2700,
        3300,
    ),
}

#: Heights, km, and speeds, m/s, of usual ascents: medians of twelve webcasts (shahar603/Telemetry-Data).
ASCENT = ((0.0, 1.6, 7.6, 24.9, 58.0, 119.0), (0.0, 121.0, 291.0, 740.0, 1624.0, 1964.0))

#: Bases of the layers of the U.S. Standard Atmosphere, 1976: m, K, K/m, Pa.
LAYERS = (
    (0.0, 288.15, -6.5e-3, 101_325.0),
    (11e3, 216.65, 0.0, 22_632.06),
    (20e3, 216.65, 1e-3, 5_474.889),
    (32e3, 228.65, 2.8e-3, 868.0187),
    (47e3, 270.65, 0.0, 110.9063),
    (51e3, 270.65, -2.8e-3, 66.93887),
    (71e3, 214.65, -2e-3, 3.956420),
)

DRIVER = """
SUBROUTINE gas_depth(n, t, p, xc, xh, xm, length, waves, wave, depth) BIND(C)
USE, INTRINSIC :: ISO_C_BINDING
USE RADCAL_VAR
USE RADCAL_CALC
INTEGER(C_INT), VALUE :: n, waves
REAL(C_DOUBLE) :: t(n), p(n), xc(n), xh(n), xm(n), length(n), wave(waves), depth(waves,n)
REAL(EB) :: a, b, c, d
INTEGER :: i
LOGICAL, SAVE :: first = .TRUE.
IF (first) THEN
  NPT = 1; OMMIN = 600._EB; OMMAX = 4200._EB; TWALL = 0._EB
  CALL RCALLOC
  ALLOCATE(PARTIAL_PRESSURES_ATM(N_RADCAL_SPECIES,1), TEMP_GAS(1), SEGMENT_LENGTH_M(1))
  ALLOCATE(TOTAL_PRESSURE_ATM(1))
  CALL INIT_RADCAL
  first = .FALSE.
END IF
wave(1:NOM) = WAVE_NUMBER
DO i = 1, n
  PARTIAL_PRESSURES_ATM = 0._EB
  PARTIAL_PRESSURES_ATM(I_CO2,1) = xc(i)
  PARTIAL_PRESSURES_ATM(I_H2O,1) = xh(i)
  PARTIAL_PRESSURES_ATM(I_CO,1) = xm(i)
  PARTIAL_PRESSURES_ATM(I_N2,1) = p(i) - xc(i) - xh(i) - xm(i)
  TEMP_GAS = t(i); TOTAL_PRESSURE_ATM = p(i); SEGMENT_LENGTH_M = length(i)
  CALL SUB_RADCAL(a, b, c, d)
  depth(1:NOM,i) = -LOG(TTAU(1,:))
END DO
END SUBROUTINE
"""
#: Wave numbers of RADCAL from 600 to 4200 1/cm.
WAVES = 224


def built(source: Path, folder: Path) -> Any:
    """Return RADCAL as a library."""
    driver = folder / "driver.f90"
    driver.write_text(DRIVER, encoding="utf-8")
    library = folder / "radcal.so"
    files = [source / "rmod.f90", source / "rcal.f90", driver]
    subprocess.run(
        ["gfortran", "-O2", "-shared", "-fPIC", "-J", folder, "-o", library, *files], check=True
    )
    return ctypes.CDLL(str(library))


def depths(library: Any, columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return wave numbers, 1/cm, and depths (n, waves) of columns (n,): K, atm and m."""
    arrays = [np.ascontiguousarray(column, dtype=np.float64) for column in columns]
    wave = np.zeros(WAVES)
    depth = np.zeros((len(arrays[0]), WAVES))

    def pointer(array: np.ndarray) -> Any:
        return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    library.gas_depth(len(arrays[0]), *map(pointer, arrays), WAVES, pointer(wave), pointer(depth))
    return wave, depth


def enthalpy_j(mol: dict[str, float], temperature_k: Any) -> Any:
    """Return the enthalpy of a mixture over that at 0 K."""
    temperature = np.asarray(temperature_k, dtype=np.float64)
    total = np.zeros_like(temperature)
    for name, amount in mol.items():
        base, vibrations = HEATS[name]
        heat = base * temperature + sum(k / np.expm1(k / temperature) for k in vibrations)
        total = total + amount * GAS_J_MOL_K * heat
    return total


def planck(wavelength_um: np.ndarray, temperature_k: float) -> np.ndarray:
    """Return the radiance of a black body, W/m²/sr/µm."""
    ratio = 14_387.77 / (wavelength_um * temperature_k)
    return np.asarray(1.191042972e8 / wavelength_um**5 / np.expm1(ratio))


#: Temperatures between which the energy balance is solved, K.
GRID_K = np.linspace(150.0, 4500.0, 436)


def air(height_m: float) -> tuple[float, float]:
    """Return temperature, K, and pressure, Pa."""
    level_m = 6_356_766.0 * height_m / (6_356_766.0 + height_m)
    base_m, base_k, lapse, base_pa = [row for row in LAYERS if row[0] <= level_m][-1]
    rise_m = level_m - base_m
    exponent = 9.80665 * AIR_KG_MOL / GAS_J_MOL_K
    temperature = base_k + lapse * rise_m
    if lapse == 0.0:
        return temperature, base_pa * np.exp(-exponent * rise_m / base_k)
    return temperature, base_pa * (temperature / base_k) ** (-exponent / lapse)


class Mixture(NamedTuple):
    """A place along a jet: contents of a kilogram, mol; speed, m/s; temperature, K."""

    mol: dict[str, float]
    speed_m_s: float
    temperature_k: float


def mixture(exhaust: Exhaust, height_m: float, share: float, lost_j_kg: float) -> Mixture:
    """Return what a share of exhaust in air is, that has lost heat, at a height."""
    air_k, pressure = air(height_m)
    vehicle_m_s = float(np.interp(height_m / 1e3, *ASCENT))
    exhaust_m_s = exhaust.vacuum_m_s - (exhaust.vacuum_m_s - exhaust.sea_level_m_s) * (
        pressure / 101_325.0
    )
    speed = share * exhaust_m_s + (1.0 - share) * vehicle_m_s
    mol = {name: share * amount for name, amount in exhaust.mol.items()}
    for name, amount in AIR_MOL_KG.items():
        mol[name] = mol.get(name, 0.0) + (1.0 - share) * amount
    needed = 0.5 * sum(mol.get(name, 0.0) for name in BURNS)
    burnt = min(1.0, mol["O2"] / needed) * float(np.interp(height_m, [40e3, 60e3], [1.0, 0.0]))
    energy = share * float(enthalpy_j(exhaust.mol, exhaust.chamber_k)) + (1.0 - share) * (
        float(enthalpy_j(AIR_MOL_KG, air_k)) + 0.5 * vehicle_m_s**2
    )
    for name, (product, heat_j) in BURNS.items():
        amount = burnt * mol.get(name, 0.0)
        mol[name] = mol.get(name, 0.0) - amount
        mol[product] = mol.get(product, 0.0) + amount
        mol["O2"] -= 0.5 * amount
        energy += amount * heat_j
    energy -= 0.5 * speed**2 + lost_j_kg
    return Mixture(mol, speed, float(np.interp(energy, enthalpy_j(mol, GRID_K), GRID_K)))


def jet(
    library: Any, exhaust: Exhaust, power_w: float, height_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return starts of pieces, m, wavelengths, µm, and intensities (pieces, waves), W/sr/m/µm."""
    air_k, pressure = air(height_m)
    air_kg_m3 = pressure * AIR_KG_MOL / GAS_J_MOL_K / air_k
    first_flow = 2.0 * power_w / exhaust.sea_level_m_s**2
    flow = first_flow
    vehicle_m_s = float(np.interp(height_m / 1e3, *ASCENT))
    lost_w = 0.0
    starts = np.concatenate([[0.0], np.geomspace(1.0, REACH_M, 200)])
    rows = []
    for start, end in pairwise(starts.tolist()):
        mol, speed, temperature = mixture(exhaust, height_m, first_flow / flow, lost_w / flow)
        total = sum(mol.values()) - mol.get("Al2O3", 0.0)
        density = pressure / (GAS_J_MOL_K * temperature * total)
        radius = np.sqrt(flow / (np.pi * density * speed))
        atm = pressure / 101_325.0
        parts = [atm * mol.get(name, 0.0) / total for name in ("CO2", "H2O", "CO")]
        wave, depth = depths(
            library,
            [np.array([value]) for value in (temperature, atm, *parts, 0.5 * np.pi * radius)],
        )
        wavelength = 1e4 / wave
        # What the air in its place would radiate is no excess.
        black = planck(wavelength, temperature) - planck(wavelength, air_k)
        light = 2.0 * radius * -np.expm1(-depth[0]) * black
        rows.append(light)
        # A long body's mean over all directions is π/4 of what it shows broadside.
        lost_w += np.pi**2 * abs(float(np.trapezoid(light, wavelength))) * (end - start)
        excess = abs(speed - vehicle_m_s)
        sounds = np.sqrt(1.25 * GAS_J_MOL_K * temperature * total) + np.sqrt(
            1.4 * GAS_J_MOL_K * air_k / AIR_KG_MOL
        )
        slowed = 0.2 + 0.8 * np.exp(-3.0 * (excess / sounds) ** 2)
        edge = 2.0 * np.pi * radius * np.sqrt(density * air_kg_m3)
        flow += ENTRAINMENT * edge * excess * slowed * (end - start)
    return starts, wavelength, np.array(rows)


def brightest_w_sr_um(starts: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Return the light (waves,) of the brightest window, by wavelength."""
    summed = np.cumsum(light * np.diff(starts)[:, None], axis=0)
    summed = np.vstack([np.zeros(light.shape[1]), summed])
    begins = np.linspace(0.0, REACH_M - WINDOW_M, 161)
    best = np.zeros(light.shape[1])
    for number, column in enumerate(summed.T):
        within = np.interp(begins + WINDOW_M, starts, column) - np.interp(begins, starts, column)
        best[number] = within.max()
    return best


def mean_between(wavelength: np.ndarray, light: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return means of a spectrum between edges."""
    order = np.argsort(wavelength)
    fine = np.linspace(edges[0], edges[-1], 40 * (len(edges) - 1) + 1)
    values = np.interp(fine, wavelength[order], light[order])
    steps = 0.5 * (values[1:] + values[:-1])
    return steps.reshape(len(edges) - 1, 40).mean(axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="folder of RADCAL's source")
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--shares", action="store_true")
    arguments = parser.parse_args()
    lines = []
    with tempfile.TemporaryDirectory() as folder:
        library = built(arguments.source, Path(folder))
        for name, exhaust in EXHAUSTS.items():
            for power_gw in POWERS_GW:
                for height_km in HEIGHTS_KM:
                    starts, wavelength, light = jet(
                        library, exhaust, power_gw * 1e9, height_km * 1e3
                    )
                    best = brightest_w_sr_um(starts, light)
                    if arguments.shares:
                        short = mean_between(wavelength, best, np.array([2.5, 3.0]))
                        share = 4.0 * np.pi * 0.5 * float(short[0]) / (power_gw * 1e9)
                        print(name, power_gw, height_km, f"{share:.4f}", flush=True)
                    spectrum = mean_between(wavelength, best, EDGES_UM)
                    values = ",".join(f"{value:.3g}" for value in spectrum)
                    lines.append(f"{name},{power_gw:g},{height_km},{values}")
    if arguments.write:
        head = HEADER.strip().splitlines()
        columns = ",".join(f"{edge:g}" for edge in EDGES_UM[:-1])
        text = "\n".join([*head, f"propellant,power_gw,height_km,{columns}", *lines])
        TABLE.write_text(text + "\n", encoding="utf-8")


HEADER = """
# Spectral radiant intensities, W/sr/um, broadside, of hot H2O, CO2 and CO in exhaust that mixes with air, over those
# of the air in its place: the brightest 2 km within 10 km behind the vehicle, by propellant, jet power and height. A
# column is the mean from its wavelength, um, to the next, the last to 14 um. Computed by docs/design/plume_jets.py: a
# turbulent jet at the pressure of the air, emission by RADCAL (NIST; narrow-band data of NASA SP-3080). Levels hold
# within a factor of about 3: entrainment and afterburning at high Mach numbers. Nothing was fitted to a sighting.
"""

if __name__ == "__main__":
    main()
