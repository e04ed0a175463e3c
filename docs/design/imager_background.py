"""How the rows of the civil imagers' bands in the table of background radiance were made.

    python docs/design/imager_background.py --check
    python docs/design/imager_background.py --write

Clear skies by night are Schwarzschild's integral: what each layer radiates, by the AFGL model
atmosphere's temperature, times the transmittance of LOWTRAN7's table above it, over a black surface
at the temperature of the first level; layers are those of the table, split into 20 each. Opaque
cloud is a black body times 1 - albedo below the same air. The solar part of 3.8 to 4.0 and 3.6 to 4.0 µm is
that of 3.5 to 4.0 µm by the Sun's irradiance; beyond 5 µm it is 0 (below 1 % of the thermal part).
`--check` prints the largest difference from LOWTRAN7's own radiance in 8 to 12 and 3.5 to 4.0 µm.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from opir_photons.radiometry import band_radiance, band_transmittance, solar_irradiance

TABLE = Path("plugins/opir_photons/opir_photons/data/lowtran7_background_radiance.csv")
BANDS = {
    "ABI_07": (3.8, 4.0),
    "ABI_08": (5.77, 6.6),
    "ABI_09": (6.75, 7.15),
    "ABI_10": (7.24, 7.44),
    "ABI_11": (8.3, 8.7),
    "ABI_12": (9.42, 9.8),
    "ABI_13": (10.1, 10.6),
    "ABI_14": (10.8, 11.6),
    "ABI_15": (11.8, 12.8),
    "ABI_16": (13.0, 13.6),
    "FCI_38": (3.6, 4.0),
    "FCI_63": (5.8, 6.8),
    "FCI_73": (7.1, 7.6),
    "FCI_87": (8.5, 8.9),
    "FCI_97": (9.51, 9.81),
    "FCI_105": (10.15, 10.85),
    "FCI_123": (12.05, 12.55),
}
WINDOW = ("MWIRW_3.5_4.0", 3.5, 4.0)
#: Incidence at the ground by the table's look angle, deg.
LOOKS = {180.0: 0.0, 120.0: 61.6, 105.0: 78.8}
TOPS_KM = (6, 10, 12, 15)

#: Temperatures, K, every kilometre from 0 to 25 km, then at 30, 35, 40, 45, 50, 70 and 100 km (F.
#: X. Kneizys et al., AFGL-TR-88-0177, 1988, model atmospheres).
PROFILES_K = {
    "us1976": "288.2 281.7 275.2 268.7 262.2 255.7 249.2 242.7 236.2 229.7 223.3 216.8 216.7 216.7"
    " 216.7 216.7 216.7"
    " 216.7 216.7 216.7 216.7 217.6 218.6 219.6 220.6 221.6 226.5 236.5 250.4 264.2 270.7 219.6"
    " 195.1",
    "tropical": "299.7 293.7 287.7 283.7 277.0 270.3 263.6 257.0 250.3 243.6 237.0 230.1 223.6"
    " 217.0 210.3 203.7 197.0"
    " 194.8 198.8 202.7 206.7 210.7 214.6 217.0 219.2 221.4 232.3 243.1 254.0 264.8 270.2 218.9"
    " 190.7",
    "midlat_summer": "294.2 289.7 285.2 279.2 273.2 267.2 261.2 254.7 248.2 241.7 235.3 228.8 222.3"
    " 215.8 215.7 215.7"
    " 215.7 215.7 216.8 217.9 219.2 220.4 221.6 222.8 223.9 225.1 233.7 245.2 257.5 269.9 275.7"
    " 218.1 190.5",
    "midlat_winter": "272.2 268.7 265.2 261.7 255.7 249.7 243.7 237.7 231.7 225.7 219.7 219.2 218.7"
    " 218.2 217.7 217.2 216.7"
    " 216.2 215.7 215.2 215.2 215.2 215.2 215.2 215.2 215.2 217.4 227.9 243.2 258.5 265.7 230.7"
    " 218.6",
    "subarctic_summer": "287.2 281.7 276.3 270.9 265.5 260.1 253.1 246.1 239.2 232.2 225.2 225.2"
    " 225.2 225.2 225.2 225.2 225.2"
    " 225.2 225.2 225.2 225.2 225.2 225.2 225.2 226.6 228.1 235.1 247.2 262.1 273.6 277.2 216.6"
    " 190.4",
    "subarctic_winter": "257.2 259.1 255.9 252.7 247.7 240.9 234.1 227.3 220.6 217.2 217.2 217.2"
    " 217.2 217.2 217.2"
    " 217.2 216.6 216.0 215.4 214.8 214.1 213.6 213.0 212.4 211.8 211.2 216.0 222.2 234.7 247.0"
    " 259.3 245.7 218.5",
}
LEVELS_KM = np.array([*range(26), 30, 35, 40, 45, 50, 70, 100], dtype=np.float64)
LAYERS_KM = np.concatenate([np.linspace(0, 20, 401), np.linspace(20, 100, 401)[1:]])


def emitted(
    climate: str, edges: tuple[float, float], incidence_deg: float, floor_km: float, black: float
) -> float:
    """Return the radiance above the air, W m⁻² sr⁻¹, of the air and of a surface at a height, black
    or less.
    """
    height_km = LAYERS_KM[floor_km <= LAYERS_KM]
    temperature_k = np.interp(
        height_km, LEVELS_KM, np.array(PROFILES_K[climate].split(), dtype=np.float64)
    )
    elevation = np.radians(90.0 - incidence_deg)
    passed = band_transmittance(*edges, height_km * 1e3, elevation, climate=climate)
    radiance = band_radiance(temperature_k, *edges)
    air = np.sum(0.5 * (radiance[1:] + radiance[:-1]) * np.diff(passed))
    return float(air + black * passed[0] * radiance[0])


def rows() -> list[str]:
    """Return the table's rows of the imagers' bands."""
    old = list(
        csv.DictReader(
            line for line in TABLE.read_text("utf-8").splitlines() if not line.startswith("#")
        )
    )
    old = [row for row in old if row["band"] == WINDOW[0]]
    own = {
        (row["atmosphere"], row["sky"], row["sza_deg"], row["albedo"], row["look_deg"]): row
        for row in old
    }
    whole = float(solar_irradiance(*WINDOW[1:]))
    suns = {
        name: float(solar_irradiance(*edges)) / whole
        for name, edges in BANDS.items()
        if edges[1] <= WINDOW[2]
    }
    lines = []
    for (climate, sky, sun_deg, albedo, look), row in own.items():
        is_cloud = sky.startswith("ANALYTIC")
        if sky != "clear" and not is_cloud:
            continue
        floor_km = (
            float(sky.removeprefix("ANALYTIC_opaque_cloud_top").removesuffix("km"))
            if is_cloud
            else 0.0
        )
        black = 1.0 - float(albedo) if is_cloud else 1.0
        dark = own[climate, sky, "", albedo if is_cloud else "", look]
        added = max(float(row["L_W_m2_sr"]) - float(dark["L_W_m2_sr"]), 0.0)
        for name, edges in BANDS.items():
            total = emitted(climate, edges, LOOKS[float(look)] if look else 0.0, floor_km, black)
            total += added * suns.get(name, 0.0)
            cells = (
                climate,
                sky,
                row["day_night"],
                sun_deg,
                albedo,
                look,
                name,
                *edges,
                f"{total:.4g}",
            )
            lines.append(",".join(map(str, cells)))
    return lines


def main() -> None:
    """Check, or append the rows."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    text = TABLE.read_text("utf-8")
    if options.check:
        for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
            if (
                row["sky"] == "clear"
                and row["day_night"] == "night"
                and row["band"] in ("LWIR", WINDOW[0])
            ):
                edges = (float(row["lo_um"]), float(row["hi_um"]))
                ours = emitted(row["atmosphere"], edges, LOOKS[float(row["look_deg"])], 0.0, 1.0)
                print(
                    row["atmosphere"],
                    row["band"],
                    row["look_deg"],
                    f"{ours / float(row['L_W_m2_sr']) - 1:+.3f}",
                )
    if options.write:
        kept = [line for line in text.splitlines() if ",ABI_" not in line and ",FCI_" not in line]
        TABLE.write_text("\n".join([*kept, *rows()]) + "\n", "utf-8")


if __name__ == "__main__":
    main()
