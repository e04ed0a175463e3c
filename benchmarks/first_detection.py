"""First detections: by class, sensor, climate and cloud, from the engine and from every look's
probability.

    python benchmarks/first_detection.py [--targets 200] [--climates 5] [--write docs/benchmarks]
        [--from-csv docs/benchmarks]

A launch of each class is repeated many times, each time with random numbers of its own, in one run
of the engine. The distribution of the first report is compared with the one that follows exactly
from the probabilities of the looks and from the confirmation over scans. Where the two differ by
too much, the script fails. The exact distribution is computed once more with each cause of a delay
switched off by itself. `--write` puts the page, its data as CSV files and, where matplotlib is
installed, a plot into a folder; `--from-csv` draws page and plot again from the CSV files in a
folder.
"""

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from work_precision.results_csv import read_csv, write_csv

from opir_core.geometry import ecef_to_geodetic
from opir_core.host.host import Host
from opir_core.interfaces.radiometric_models import AtmosphereContext, Paths
from opir_core.planning.looks import Looks
from opir_core.planning.plan import Plan, compile_plan
from opir_core.plugin import Band
from opir_core.reading import scene_from_mapping
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
#: Heights and bands for which transmittances are listed.
HEIGHTS_KM = (0.0, 1.0, 2.0, 4.0, 6.0, 10.0)
BANDS = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0), Band("LWIR", 8.0, 12.0))
ELEVATION_DEG = 49.0

DURATION_S = 200.0
IGNITION_S = 2.0

#: Confidence of all comparisons together.
CONFIDENCE = 0.999

#: The paper's DSP, with its long-wave band, and its rules over bands, each of which is a veto.
PAPER = {
    "DSP": {"preset": "paper"},
    "SBIRS-GEO": {"preset": "paper"},
    "NEXTGEN-GEO": {"preset": "paper"},
}
#: Causes of delays: what is changed in the scene, and in the sensors, to be rid of each.
CAUSES: dict[str, tuple[dict[str, Any], dict[str, dict[str, Any]]]] = {
    "no air": ({"atmosphere": "clear"}, {}),
    "no background": ({"background": "none"}, {}),
    "presets paper": ({}, PAPER),
    "no confirmation": ({}, {sensor: {"confirmation_detections": 1} for sensor in SENSORS}),
}

PAGE = """# First detections

*When, and at what height, is a launch of each class first reported?* One launch of each class at 35° N, 110° W, seen
from the geostationary slots {slots}. Plumes and sensor noise are notional.

{headline}

Entries are medians under a clear sky of the launches that are reported during their burn: time after ignition and
height, as ranges over five climates. DSP, with light its preset `heritage`, reports {faint} % of the SRBM: a look every
10 s, of which three of four are needed, so times come in steps of 10 s after the start that is drawn once a run.

![Median height of the first report by class, sensor and sky](first_detection.svg)

NEXTGEN-GEO reports every class first, then SBIRS-GEO, then DSP. What delays a first report, each cause switched off by
itself under a clear sky:

- **Cloud.** No plume is detected below a deck: with one up to 10 km the others are reported from there; {cloudy} % of
  the SRBM by DSP. Half cover is drawn once in a run.
- **Air.** Water vapour absorbs SWIR: its transmittance from sea level is {swir}. Without air SBIRS-GEO reports
  an SRBM after {swir_delay}. What is seen near the ground is soot in the wings of MWIR,
  a level that holds within a factor of 3.
- **Background.** It matters in long waves; without it DSP, which has none, reports an IRBM after
  {lwir_delay}.
- **The paper's presets** (`preset: paper`). Their rules make every band a veto, and DSP's long-wave band reports
  practically none; an SRBM is reported by NEXTGEN-GEO after {paper_delay}. Ratio gates
  allow for a factor of {mwir_over_swir} in MWIR/SWIR that air makes
  ([detection](../explanation/detection.md#rules-over-bands)).
- **Confirmation**, two detections in three looks, costs a scan or two of a bright plume; without it
  (`confirmation_detections: 1`) DSP reports an ICBM after {confirmed_delay}.

`detection: snr`, `atmosphere: lowtran`, `background: earth` by day, all else by default. Each of the {cells} cases has
{targets} launches; times are distributed as computed exactly from the probabilities of all looks: the largest
difference is {worst:.2f} of the bound of Dvoretzky, Kiefer, Wolfowitz and Massart at {confidence:g} for all cases
together. All cases and causes: [first_detection.csv](first_detection.csv); transmittances:
[first_detection_air.csv](first_detection_air.csv).
"""


class Cell(NamedTuple):
    """Median time and height of the first detection, the share detected, the largest difference
    over its bound.
    """

    kind: str
    sensor: str
    climate: str
    cloud: str
    time_s: float
    height_km: float
    share: float
    ratio: float


class Air(NamedTuple):
    """Transmittances from a height to space, at the elevation of SBIRS-GEO and NEXTGEN-GEO from the
    launch site.
    """

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
    **changes: Any,
) -> Scene:
    """Return a scene with each launch repeated; `settings` are further keys by sensor, `changes` of
    the scene.
    """
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
            {
                "model": model,
                "id": model,
                "orbital_slot_deg": slot,
                **(settings or {}).get(model, {}),
            }
            for model, slot in SENSORS.items()
        ],
        "targets": rows,
        "detection": {"model": "snr", "exact": exact},
        "atmosphere": atmosphere,
        "background": "earth",
        "outputs": [],
        **changes,
    }
    return scene_from_mapping(mapping)


class Law(NamedTuple):
    """The looks of one sensor at one launch: when light left, how high, and the chance that this is
    reported first.
    """

    emission_s: NDArray[np.float64]
    height_m: NDArray[np.float64]
    first: NDArray[np.float64]


def laws(plan: Plan) -> dict[tuple[int, int], Law]:
    """Return the law of the first report by sensor and target, from every look's probability."""
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    exposed = plan.look_geometry().exposures(looks.pair, looks.scan)
    chance = plan.detection.probability(exposed)
    found = {}
    for pair in np.unique(looks.pair).tolist():
        rows = np.flatnonzero(looks.pair == pair)
        confirmation = plan.sensors[plan.pairs.sensor[pair]].radiometer.confirmation
        height = ecef_to_geodetic(exposed.target_ecef_m[rows]).height_m
        key = int(plan.pairs.sensor[pair]), int(plan.pairs.target[pair])
        found[key] = Law(
            exposed.emission_time_s[rows], height, first_reports(chance[rows], *confirmation)
        )
    return found


def first_reports(chance: NDArray[np.float64], needed: int, scans: int) -> NDArray[np.float64]:
    """Return the probabilities (n,) that looks with P_d (n,) are the first reported ones: the last
    of M in N looks.

    States are which of the last N - 1 looks detected, as bits, with none reported yet.
    """
    states = np.arange(1 << (scans - 1))
    hits = np.array([state.bit_count() for state in states.tolist()])
    shifted = (states << 1) & (len(states) - 1)
    weight = (states == 0).astype(np.float64)
    first = np.zeros(len(chance))
    for look, p in enumerate(chance.tolist()):
        reported = hits >= needed - 1
        first[look] = p * weight[reported].sum()
        after = np.bincount(shifted, weight * (1.0 - p), minlength=len(states))
        if scans > 1:
            after += np.bincount(
                (shifted | 1)[~reported], (weight * p)[~reported], minlength=len(states)
            )
        weight = after
    return first


def first_times(plan: Plan) -> NDArray[np.float64]:
    """Return when the light of first reports left (sensors, targets), s; inf where there is
    none.
    """
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
            off = np.abs(
                np.searchsorted(np.sort(seen), law.emission_s + 1e-6) / targets
                - np.cumsum(law.first)
            )
            ratio = float(off.max(initial=len(seen) / targets if not len(off) else 0.0) / bound)
            yield Cell(kind, name, climate, cloud, *median(law), ratio)


def median(law: Law) -> tuple[float, float, float]:
    """Return time after ignition, s, and height, km, of the median first detection, and the share
    detected.
    """
    share = float(law.first.sum())
    if share <= 0.0:
        return float("nan"), float("nan"), share
    middle = int(np.searchsorted(np.cumsum(law.first), 0.5 * share))
    return float(law.emission_s[middle] - IGNITION_S), float(law.height_m[middle] / 1e3), share


def without(cause: str, climate: str) -> Iterator[Cell]:
    """Yield the cases with a cause of delays switched off under a clear sky, from the exact
    distribution.
    """
    changes, settings = CAUSES[cause]
    by_look = laws(
        compile_plan(scene(climate, "clear sky", 1, exact=True, settings=settings, **changes))
    )
    for number, kind in enumerate(LAUNCHES):
        for sensor, name in enumerate(SENSORS):
            law = by_look.get((sensor, number), Law(np.zeros(0), np.zeros(0), np.zeros(0)))
            yield Cell(kind, name, climate, cause, *median(law), 0.0)


def air(climate: str) -> Iterator[Air]:
    """Yield the transmittances of the three bands from several heights."""
    lowtran = Host.discover().component("opir_atmosphere_models", "lowtran")
    sky = lowtran.build(
        lowtran.config(climate=climate), AtmosphereContext(bands=BANDS, path="atmosphere", seed=0)
    )
    height_m = 1e3 * np.array(HEIGHTS_KM)
    nowhere = np.zeros((len(HEIGHTS_KM), 3))
    sine = np.full(len(height_m), np.sin(np.radians(ELEVATION_DEG)))
    paths = Paths(height_m, sine, nowhere, nowhere, np.zeros(len(height_m)))
    columns = [sky.transmittance(number, paths).tolist() for number in range(len(BANDS))]
    for height_km, *values in zip(HEIGHTS_KM, *columns, strict=True):
        yield Air(climate, height_km, *values)


def spread(found: list[Cell]) -> str:
    """Return the range of times and heights of some cases."""
    times = [cell.time_s for cell in found]
    heights = [cell.height_km for cell in found]
    time = between(
        *(f"{each:.1f}" if each < 9.95 else f"{each:.0f}" for each in (min(times), max(times)))
    )
    return f"{time} s, {between(f'{min(heights):.1f}', f'{max(heights):.1f}')} km"


def between(low: str, high: str) -> str:
    return low if low == high else f"{low}–{high}"


def headline(found: list[Cell]) -> str:
    """Return a line for each class: ranges over the climates under a clear sky, by sensor."""
    clear = [cell for cell in found if cell.cloud == "clear sky"]
    lines = [f"| class | {' | '.join(SENSORS)} |", "|---" * (1 + len(SENSORS)) + "|"]
    for kind in LAUNCHES:
        own = [
            [cell for cell in clear if (cell.kind, cell.sensor) == (kind, sensor)]
            for sensor in SENSORS
        ]
        lines.append(f"| {kind} | {' | '.join(map(spread, own))} |")
    return "\n".join(lines)


def causes_table(found: list[Cell]) -> str:
    """Return a line for each class and sensor: times by default, and without each cause."""
    lines = [
        f"| class | sensor | default | {' | '.join(CAUSES)} |",
        "|---" * (3 + len(CAUSES)) + "|",
    ]
    for kind in LAUNCHES:
        for sensor in SENSORS:
            own = [cell for cell in found if (cell.kind, cell.sensor) == (kind, sensor)]
            every = [
                spread([c for c in own if c.cloud == sky]).partition(",")[0]
                for sky in ("clear sky", *CAUSES)
            ]
            lines.append(f"| {kind} | {sensor} | {' | '.join(every)} |")
    return "\n".join(lines)


def delay(found: list[Cell], kind: str, sensor: str, cause: str) -> str:
    """Return the times without a cause and by default."""
    own = [cell for cell in found if (cell.kind, cell.sensor) == (kind, sensor)]
    without_, default = (
        spread([c for c in own if c.cloud == sky]).partition(",")[0] for sky in (cause, "clear sky")
    )
    return f"{without_} instead of {default}"


def percent(found: list[Cell], cloud: str) -> str:
    """Return the range of the shares of SRBM launches that DSP detects, in percent."""
    shares = [
        100.0 * c.share for c in found if (c.kind, c.sensor, c.cloud) == ("SRBM", "DSP", cloud)
    ]
    return between(f"{min(shares):.0f}", f"{max(shares):.0f}")


def write_plot(found: list[Cell], path: Path) -> None:
    """Draw heights of the first report: a panel for each kind of cloud and without air, a mark for
    each climate.
    """
    import matplotlib as mpl

    mpl.use("svg")
    mpl.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        1, len(CLOUDS) + 1, figsize=(12, 4), sharey=True, constrained_layout=True
    )
    lines = [(kind, sensor) for kind in LAUNCHES for sensor in SENSORS]
    for axis, cloud in zip(axes, (*CLOUDS, "no air"), strict=True):
        for number, climate in enumerate(CLIMATES):
            own = [
                c for c in found if c.cloud == cloud and c.climate == climate and c.share >= 0.01
            ]
            places = [lines.index((c.kind, c.sensor)) + 0.12 * (number - 2) for c in own]
            axis.plot(places, [c.height_km for c in own], ".", label=climate)
        axis.set(title=cloud, yscale="symlog", xticks=range(len(lines)))
        axis.set_xticklabels(
            [f"{kind} {sensor}" for kind, sensor in lines], rotation=90, fontsize=7
        )
        axis.grid(axis="y", alpha=0.3)
    axes[0].set_ylabel("median height of the first report, km")
    axes[1].legend(fontsize=7)
    figure.savefig(path, metadata={"Date": None})


def page(found: list[Cell], rows: list[Air], facts: Mapping[str, str]) -> str:
    """Return the page."""
    ground = [row for row in rows if row.height_km == 0.0]
    swir = [row.swir for row in ground]
    ratio = [row.mwir / row.swir for row in ground]
    return PAGE.format(
        slots=", ".join(f"{-slot:g}° W ({name})" for name, slot in SENSORS.items()),
        headline=headline(found),
        faint=percent(found, "clear sky"),
        cloudy=percent(found, "cloud to 10 km"),
        swir_delay=delay(found, "SRBM", "SBIRS-GEO", "no air"),
        lwir_delay=delay(found, "IRBM", "DSP", "no background"),
        paper_delay=delay(found, "SRBM", "NEXTGEN-GEO", "presets paper"),
        confirmed_delay=delay(found, "ICBM", "DSP", "no confirmation"),
        mwir_over_swir=f"{min(ratio):.0f} to {max(ratio):.0f}",
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
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
        cell
        for cloud in CLOUDS
        for climate in climates
        for cell in cells(climate, cloud, options.targets, comparisons)
    ]
    worst = max(cell.ratio for cell in found)
    found += [cell for cause in CAUSES for climate in climates for cell in without(cause, climate)]
    print(headline(found), causes_table(found), sep="\n\n")
    print(f"\n{comparisons} cases, largest difference over its bound: {worst:.2f}")
    if worst > 1.0:
        raise SystemExit(
            "the engine's first reports do not follow from the probabilities of their looks"
        )
    if options.write:
        facts = {
            "cases": comparisons,
            "launches": options.targets,
            "worst_difference_over_bound": f"{worst:.4f}",
        }
        write_csv(options.write / "first_detection.csv", found, facts)
        write_csv(
            options.write / "first_detection_air.csv",
            [row for climate in climates for row in air(climate)],
        )
        redraw(options.write)


if __name__ == "__main__":
    main()
