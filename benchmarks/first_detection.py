"""First detections: by class, sensor, climate and cloud, from the engine and from every look's probability.

    python benchmarks/first_detection.py [--targets 200] [--climates 5] [--write docs/benchmarks]
        [--from-csv docs/benchmarks]

A launch of each class is repeated many times, each time with random numbers of its own, in one run of the engine. The
distribution of the first detection is compared with the one that follows exactly from the probabilities of the looks:
the first detection is at look k with probability p(k) times the product of 1 - p over the looks before it. Where the
two differ by too much, the script fails. The same exact distribution is computed once more with the ratio gates open.
`--write` puts the page, its data as CSV files and, where matplotlib is installed, a plot into a folder; `--from-csv`
draws page and plot again from the CSV files in a folder.
"""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from work_precision.results_csv import read_csv, write_csv

from opir_core.geometry import ecef_to_geodetic
from opir_core.interfaces.protocols import Band
from opir_core.interfaces.radiometric_models import AtmosphereContext, Paths
from opir_core.planning.looks import Looks
from opir_core.planning.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.scene.reading import scene_from_mapping
from opir_core.scene.scene import Scene
from opir_core.simulation.engine import Engine

CLIMATES = ("us1976", "tropical", "midlat_summer", "midlat_winter", "subarctic_winter")
CLOUDS: dict[str, dict[str, Any] | None] = {
    "clear sky": None,
    "cloud to 10 km": {"top_km": 10.0},
    "half covered to 6 km": {"top_km": 6.0, "cover": 0.5, "cell_km": 100.0},
}
SENSORS = {"DSP": -95.0, "SBIRS-GEO": -105.0, "NEXTGEN-GEO": -115.0}
LAUNCHES = {
    "SRBM": {"launch": (35.0, -110.0), "aim": (38.0, -108.0)},
    "IRBM": {"launch": (35.0, -110.0), "aim": (50.0, -85.0)},
    "ICBM": {"launch": (35.0, -110.0), "aim": (60.0, 60.0)},
}
#: The name of the cases with open ratio gates, and the heights and bands for which transmittances are listed.
OPEN = "clear sky, open gates"
HEIGHTS_KM = (0.0, 1.0, 2.0, 4.0, 6.0, 10.0)
BANDS = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0), Band("LWIR", 8.0, 12.0))
ELEVATION_DEG = 49.0

DURATION_S = 200.0
IGNITION_S = 2.0

#: Confidence of all comparisons together.
CONFIDENCE = 0.999

#: Ratio gates that let every ratio of bands pass.
OPEN_GATES = {
    "SBIRS-GEO": {"MWIR": [1e-9, 1e9]},
    "NEXTGEN-GEO": {"MWIR": [1e-9, 1e9], "LWIR": [1e-9, 1e9]},
}

PAGE = """# First detections

*When, and at what height, is a launch of each class first detected?* One launch of each class at 35° N, 110° W, seen
from the geostationary slots {slots}. Plumes and sensor noise are notional.

{headline}

Entries are medians of the launches that are detected during their burn: time after ignition and height, as ranges over
five climates. All launches are detected, except SRBM by DSP: {faint} %.

![Median height of the first detection by class, sensor and sky](first_detection.svg)

- DSP (LWIR) detects an ICBM from the ground up. An SRBM stays below its noise until late in the burn.
- SBIRS-GEO and NEXTGEN-GEO detect the ICBM, the brightest target, later than DSP. The cause is the ratio gate (next
  section).
- No plume is detected below a cloud deck. Over the cold top of the deck at 10 km DSP detects more SRBM ({cloudy} %): a
  cold cloud has less LWIR clutter than warm ground.
- Half cover either hides the launch site or does not; it is drawn once in a run. Here it hides the site.

## A limit of the ratio gate

`dual-band-ratio` and `triple-coincidence` compare the ratio of two measured bands with `plausible_ratios`. They use
irradiance **at the aperture** and do not correct for transmittance, which differs between bands. On this path the
atmosphere multiplies MWIR/SWIR (4 to 5 µm over 2.5 to 3 µm) by

{ratios}

The plumes have MWIR/SWIR of 1.75 at the source; the upper limit is 4. A plume therefore fails the gate as long as the
atmosphere multiplies the ratio by more than 2.3, although both bands are above their thresholds. NEXTGEN-GEO also
limits LWIR/SWIR to 0.5: 0.06 to 0.08 at the source, multiplied by {lwir} at sea level. With the gates open
(`plausible_ratios` of 1e-9 to 1e9), clear sky:

{gates}

- The gate causes most of the delay of the ICBM with both sensors, and of every class with NEXTGEN-GEO.
- With SBIRS-GEO it does not delay the SRBM, and the IRBM by about 2 s at most. There SWIR, the reference band, is below
  the threshold: its transmittance from sea level is {swir}.

To avoid this limit, widen `plausible_ratios` or set `spectral_discrimination: none`. Both let more fires, flares and
glints pass.

## Method

`detection: snr`, `atmosphere: lowtran`, `background: earth` by day, all else by default. Each of the {cells} cases
(class, sensor, climate, cloud) has {targets} launches with random numbers of their own. Times of first detection are
distributed as computed exactly from the probabilities of all looks: the largest difference is {worst:.2f} of the bound
of Dvoretzky, Kiefer, Wolfowitz and Massart at {confidence:g} for all cases together (Bonferroni). Open gates: exact
distribution.

All cases: [first_detection.csv](first_detection.csv); transmittances:
[first_detection_air.csv](first_detection_air.csv). Made by
`python benchmarks/first_detection.py --write docs/benchmarks`; `--from-csv docs/benchmarks` draws page and plot again.
"""


class Cell(NamedTuple):
    """Median time and height of the first detection, the share detected, the largest difference over its bound."""

    kind: str
    sensor: str
    climate: str
    cloud: str
    time_s: float
    height_km: float
    share: float
    ratio: float


class Air(NamedTuple):
    """Transmittances from a height to space, at the elevation of SBIRS-GEO and NEXTGEN-GEO from the launch site."""

    climate: str
    height_km: float
    swir: float
    mwir: float
    lwir: float


def scene(
    climate: str,
    cloud: str,
    targets: int,
    exact: bool,
    kinds: tuple[str, ...] = tuple(LAUNCHES),
    settings: Mapping[str, Mapping[str, Any]] | None = None,
) -> Scene:
    """Return a scene with each launch repeated; `settings` are further keys by sensor."""
    atmosphere: dict[str, Any] = {"model": "lowtran", "climate": climate}
    if CLOUDS[cloud] is not None:
        atmosphere["cloud"] = CLOUDS[cloud]
    rows = [
        {
            "id": f"{kind}-{number}",
            "type": kind,
            "launch": {
                "lat_deg": LAUNCHES[kind]["launch"][0],
                "lon_deg": LAUNCHES[kind]["launch"][1],
                "time_s": IGNITION_S,
            },
            "aim": {"lat_deg": LAUNCHES[kind]["aim"][0], "lon_deg": LAUNCHES[kind]["aim"][1]},
        }
        for kind in kinds
        for number in range(targets)
    ]
    mapping = {
        "scene": "first-detection",
        "epoch": "2026-04-01T19:00:00Z",
        "duration_s": DURATION_S,
        "seed": 11,
        "sensors": [
            {"model": model, "id": model, "orbital_slot_deg": slot, **(settings or {}).get(model, {})}
            for model, slot in SENSORS.items()
        ],
        "targets": rows,
        "detection": {"model": "snr", "exact": exact},
        "atmosphere": atmosphere,
        "background": "earth",
        "outputs": [],
    }
    return scene_from_mapping(mapping)


class Law(NamedTuple):
    """The looks of one sensor at one launch: when light left, how high, and the chance that this detects first."""

    emission_s: NDArray[np.float64]
    height_m: NDArray[np.float64]
    first: NDArray[np.float64]


def laws(plan: Plan) -> dict[tuple[int, int], Law]:
    """Return the law of the first detection by sensor and target, from every look's probability."""
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair, looks.scan)
    chance = plan.detection.probability(exposed)
    found = {}
    for pair in np.unique(looks.pair).tolist():
        rows = np.flatnonzero(looks.pair == pair)
        missed = np.cumprod(np.concatenate([[1.0], 1.0 - chance[rows][:-1]]))
        height = ecef_to_geodetic(exposed.target_ecef_m[rows]).height_m
        key = int(plan.pairs.sensor[pair]), int(plan.pairs.target[pair])
        found[key] = Law(exposed.emission_time_s[rows], height, chance[rows] * missed)
    return found


def first_times(plan: Plan) -> NDArray[np.float64]:
    """Return when the light of first detections left (sensors, targets), s; inf where there is none."""
    first = np.full((len(plan.sensors), len(plan.targets.ids)), np.inf)
    engine = Engine(plan)
    step_ns = 5 * 10**9
    for end_ns in range(step_ns, plan.end_ns + step_ns, step_ns):
        window = engine.advance(min(end_ns, plan.end_ns))
        real = window.truth.target >= 0
        where = window.detections.sensor[real], window.truth.target[real]
        np.minimum.at(first, where, window.truth.emission_time_s[real])
    return first


def cells(climate: str, cloud: str, targets: int, comparisons: int) -> Iterator[Cell]:
    """Yield what becomes of all classes and sensors under one sky."""
    kinds = tuple(LAUNCHES)
    by_look = laws(compile_plan(scene(climate, cloud, 1, exact=True)))
    plan = compile_plan(scene(climate, cloud, targets, exact=False))
    first = first_times(plan)
    bound = np.sqrt(np.log(2.0 * comparisons / (1.0 - CONFIDENCE)) / (2.0 * targets))
    for number, kind in enumerate(kinds):
        own = slice(number * targets, (number + 1) * targets)
        for sensor, name in enumerate(SENSORS):
            law = by_look.get((sensor, number), Law(np.zeros(0), np.zeros(0), np.zeros(0)))
            times = first[sensor, own]
            seen = times[np.isfinite(times)]
            off = np.abs(np.searchsorted(np.sort(seen), law.emission_s + 1e-6) / targets - np.cumsum(law.first))
            ratio = float(off.max(initial=len(seen) / targets if not len(off) else 0.0) / bound)
            yield Cell(kind, name, climate, cloud, *median(law), ratio)


def median(law: Law) -> tuple[float, float, float]:
    """Return time after ignition, s, and height, km, of the median first detection, and the share detected."""
    share = float(law.first.sum())
    if share <= 0.0:
        return float("nan"), float("nan"), share
    middle = int(np.searchsorted(np.cumsum(law.first), 0.5 * share))
    return float(law.emission_s[middle] - IGNITION_S), float(law.height_m[middle] / 1e3), share


def with_open_gates(climate: str) -> Iterator[Cell]:
    """Yield the cases with open ratio gates under a clear sky, from the exact distribution."""
    gates = {sensor: {"plausible_ratios": ratios} for sensor, ratios in OPEN_GATES.items()}
    by_look = laws(compile_plan(scene(climate, "clear sky", 1, exact=True, settings=gates)))
    for number, kind in enumerate(LAUNCHES):
        for sensor, name in enumerate(SENSORS):
            if name in gates:
                yield Cell(kind, name, climate, OPEN, *median(by_look[sensor, number]), 0.0)


def air(climate: str) -> Iterator[Air]:
    """Yield the transmittances of the three bands from several heights."""
    lowtran = Host.of().component("opir_atmosphere_models", "lowtran")
    sky = lowtran.build(lowtran.config(climate=climate), AtmosphereContext(bands=BANDS, path="atmosphere", seed=0))
    height_m, nowhere = 1e3 * np.array(HEIGHTS_KM), np.zeros((len(HEIGHTS_KM), 3))
    sine = np.full(len(height_m), np.sin(np.radians(ELEVATION_DEG)))
    paths = Paths(height_m, sine, nowhere, nowhere, np.zeros(len(height_m)))
    columns = [sky.transmittance(number, paths).tolist() for number in range(len(BANDS))]
    for height_km, *values in zip(HEIGHTS_KM, *columns, strict=True):
        yield Air(climate, height_km, *values)


def spread(found: list[Cell]) -> str:
    """Return the range of times and heights of some cases."""
    times, heights = [cell.time_s for cell in found], [cell.height_km for cell in found]
    time = between(f"{min(times):.0f}", f"{max(times):.0f}")
    return f"{time} s, {between(f'{min(heights):.1f}', f'{max(heights):.1f}')} km"


def between(low: str, high: str) -> str:
    return low if low == high else f"{low}–{high}"


def headline(found: list[Cell]) -> str:
    """Return a line for each class and sensor: ranges over the climates by cloud."""
    lines = [f"| class | sensor | {' | '.join(CLOUDS)} |", "|---" * (2 + len(CLOUDS)) + "|"]
    for kind in LAUNCHES:
        for sensor in SENSORS:
            own = [cell for cell in found if (cell.kind, cell.sensor) == (kind, sensor)]
            cells_ = [spread([cell for cell in own if cell.cloud == cloud]) for cloud in CLOUDS]
            lines.append(f"| {kind} | {sensor} | {' | '.join(cells_)} |")
    return "\n".join(lines)


def gates_table(found: list[Cell]) -> str:
    """Return a line for each class and sensor with ratio gates: default gates and open ones."""
    lines = ["| class | sensor | default gates | open gates |", "|---|---|---|---|"]
    for kind in LAUNCHES:
        for sensor in OPEN_GATES:
            own = [cell for cell in found if (cell.kind, cell.sensor) == (kind, sensor)]
            both = [spread([cell for cell in own if cell.cloud == cloud]) for cloud in ("clear sky", OPEN)]
            lines.append(f"| {kind} | {sensor} | {' | '.join(both)} |")
    return "\n".join(lines)


def ratios_table(rows: list[Air]) -> str:
    """Return the ratio of the transmittances MWIR/SWIR by height and climate."""
    climates = list(dict.fromkeys(row.climate for row in rows))
    lines = [f"| height, km | {' | '.join(climates)} |", "|---" * (1 + len(climates)) + "|"]
    for height_km in HEIGHTS_KM:
        own = [row.mwir / row.swir for row in rows if row.height_km == height_km]
        lines.append(f"| {height_km:g} | {' | '.join(f'{ratio:.1f}' for ratio in own)} |")
    return "\n".join(lines)


def percent(found: list[Cell], cloud: str) -> str:
    """Return the range of the shares of SRBM launches that DSP detects, in percent."""
    shares = [100.0 * c.share for c in found if (c.kind, c.sensor, c.cloud) == ("SRBM", "DSP", cloud)]
    return between(f"{min(shares):.0f}", f"{max(shares):.0f}")


def write_plot(found: list[Cell], path: Path) -> None:
    """Draw heights of first detection: a panel for each kind of cloud and for open gates, a mark for each climate."""
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, len(CLOUDS) + 1, figsize=(12, 4), sharey=True, constrained_layout=True)
    lines = [(kind, sensor) for kind in LAUNCHES for sensor in SENSORS]
    for axis, cloud in zip(axes, (*CLOUDS, OPEN), strict=True):
        for number, climate in enumerate(CLIMATES):
            own = [c for c in found if c.cloud == cloud and c.climate == climate and c.share >= 0.01]
            places = [lines.index((c.kind, c.sensor)) + 0.12 * (number - 2) for c in own]
            axis.plot(places, [c.height_km for c in own], ".", label=climate)
        axis.set(title=cloud, yscale="symlog", xticks=range(len(lines)))
        axis.set_xticklabels([f"{kind} {sensor}" for kind, sensor in lines], rotation=90, fontsize=7)
        axis.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("median height of the first detection, km")
    axes[1].legend(fontsize=7)
    figure.savefig(path, metadata={"Date": None})


def page(found: list[Cell], rows: list[Air], facts: Mapping[str, str]) -> str:
    """Return the page."""
    ground = [row for row in rows if row.height_km == 0.0]
    swir = [row.swir for row in ground]
    lwir = [row.lwir / row.swir for row in ground]
    return PAGE.format(
        slots=", ".join(f"{-slot:g}° W ({name})" for name, slot in SENSORS.items()),
        headline=headline(found),
        faint=percent(found, "clear sky"),
        cloudy=percent(found, "cloud to 10 km"),
        ratios=ratios_table(rows),
        lwir=f"{min(lwir):.0f} to {max(lwir):.0f}",
        gates=gates_table(found),
        swir=f"{min(swir):.3f} to {max(swir):.2f}",
        cells=facts["cases"],
        targets=facts["launches"],
        worst=float(facts["worst_difference_over_bound"]),
        confidence=CONFIDENCE,
    )


def redraw(folder: Path) -> None:
    """Write the page and the plot from the CSV files of a folder."""
    found, facts = read_csv(folder / "first_detection.csv", Cell)
    rows, _ = read_csv(folder / "first_detection_air.csv", Air)
    (folder / "first_detection.md").write_text(page(found, rows, facts), encoding="utf-8")
    write_plot(found, folder / "first_detection.svg")


def main() -> None:
    """Run all skies and print; write where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=200)
    parser.add_argument("--climates", type=int, default=len(CLIMATES))
    parser.add_argument("--write", type=Path)
    parser.add_argument("--from-csv", type=Path)
    options = parser.parse_args()
    if options.from_csv:
        redraw(options.from_csv)
        return
    climates = CLIMATES[: options.climates]
    comparisons = len(climates) * len(CLOUDS) * len(LAUNCHES) * len(SENSORS)
    found = [
        cell for cloud in CLOUDS for climate in climates for cell in cells(climate, cloud, options.targets, comparisons)
    ]
    worst = max(cell.ratio for cell in found)
    found += [cell for climate in climates for cell in with_open_gates(climate)]
    print(headline(found), gates_table(found), sep="\n\n")
    print(f"\n{comparisons} cases, largest difference over its bound: {worst:.2f}")
    if worst > 1.0:
        raise SystemExit("the engine's first detections do not follow from the probabilities of their looks")
    if options.write:
        facts = {"cases": comparisons, "launches": options.targets, "worst_difference_over_bound": f"{worst:.4f}"}
        write_csv(options.write / "first_detection.csv", found, facts)
        write_csv(options.write / "first_detection_air.csv", [row for climate in climates for row in air(climate)])
        redraw(options.write)


if __name__ == "__main__":
    main()
